"""Slack and overload of tendons that winches and motors wind up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.scene import Finger, Tendon

_SLACK = 1e-7
"""Tension below which a tendon is slack, per ``max_tension`` [1]."""


def least_pull(tendon: Tendon) -> float:
    """Tension below which a tendon is slack [N]."""
    return _SLACK * tendon.max_tension


@dataclass(frozen=True)
class SlackTime:
    """A time in which a tendon is slack: it does not pull, and its friction forgets its past.

    Attributes
    ----------
    tendon : int
        Number of the tendon, from 1.
    begins, ends : float
        First instant at which it is slack, and the first at which it is in tension again [s]: infinite if it never is.
    """

    tendon: int
    begins: float
    ends: float


def slack_times(finger: Finger, t: ArrayLike, tensions: ArrayLike) -> list[SlackTime]:
    """Times in which tendons are slack, by tendon and instant, of tensions (T, tendons) [N] at the drives."""
    instants = np.asarray(t, dtype=float)
    times = list[SlackTime]()
    for k, tension in enumerate(np.asarray(tensions, dtype=float).T):
        slack = np.concatenate([[False], tension < least_pull(finger.tendon_list[k]), [False]])
        starts = np.flatnonzero(np.diff(slack.astype(int)) > 0)
        stops = np.flatnonzero(np.diff(slack.astype(int)) < 0)
        after = [*instants.tolist(), np.inf]
        times += [SlackTime(k + 1, after[a], after[b]) for a, b in zip(starts, stops, strict=True)]
    return times


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


def tension_warnings(finger: Finger, t: NDArray[np.float64], tensions: NDArray[np.float64] | None) -> tuple[str, ...]:
    """Warnings about tensions (T, tendons) [N] that winches and motors leave to the motion."""
    if tensions is None or not finger.winches:
        return ()
    warnings = []
    times = slack_times(finger, t, tensions)
    for k, tendon in enumerate(finger.tendon_list):
        tension = tensions[:, k]
        high = np.flatnonzero(tension > tendon.max_tension)
        if high.size:
            warnings.append(
                f"tendon {k + 1} exceeds max_tension = {tendon.max_tension:g} N at t = {t[high[0]]:g} s (greatest: "
                f"{tension.max():.3g} N)"
            )
        # One that is slack from the start on, as drives may leave it, does not go slack.
        begun = [each for each in times if each.tendon == k + 1 and each.begins > t[0]]
        if begun:
            again = f" until t = {begun[0].ends:g} s" if np.isfinite(begun[0].ends) else ""
            often = f" ({len(begun)} times in all)" if len(begun) > 1 else ""
            warnings.append(
                f"tendon {k + 1} goes slack at t = {begun[0].begins:g} s: nothing pulls there{again}{often}"
            )
    return tuple(warnings)
