"""Limits of tensions that an equilibrium does not satisfy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene import Finger
from continuum_grasp.simulation.slack import least_pull


@dataclass(frozen=True)
class TensionLimit:
    """A tendon that an equilibrium leaves slack, or pulls beyond its limit.

    Attributes
    ----------
    kind : {"slack", "max_tension"}
    tendon : int
        Number of the tendon, from 1.
    tension, limit : float
        Tension at the drive, and its limit [N]: the least one of a slack tendon.
    """

    kind: Literal["slack", "max_tension"]
    tendon: int
    tension: float
    limit: float

    def __str__(self) -> str:
        if self.kind == "slack":
            return f"tendon {self.tendon} is slack: nothing pulls there"
        return f"tendon {self.tendon} exceeds max_tension = {self.limit:g} N ({self.tension:.3g} N)"


def tension_limits(finger: Finger, tensions: NDArray[np.float64] | None) -> tuple[TensionLimit, ...]:
    """Limits that tensions (tendons,) [N] at rest do not satisfy; slack is one where winches and motors pull."""
    limits: list[TensionLimit] = []
    for k, tension in enumerate(() if tensions is None else tensions.tolist()):
        tendon = finger.tendon_list[k]
        if tension > tendon.max_tension:
            limits.append(TensionLimit("max_tension", k + 1, tension, tendon.max_tension))
        elif finger.winches and tension < least_pull(tendon):
            limits.append(TensionLimit("slack", k + 1, tension, least_pull(tendon)))
    return tuple(limits)
