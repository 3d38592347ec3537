"""Requirements that the certificate checks, findings, and their limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

import numpy as np

EXACT = 1e-6
"""Limit of poses, per length of the finger or size of the object; of gaps at supports, per size of the object; of
forces, per greatest force; and share by which limits of the scene may be exceeded [1]."""
FOLLOWED = 1e-5
"""Limit of what follows from shapes: gaps at contacts and depths in bodies, per length of the finger, directions along
surfaces [rad], friction, per greatest force, and moments, per greatest force and size. Rods of 24 stages leave up to
5e-6, and a sixteenth of it with twice the stages."""
CROSSING = 1e-4
"""Limit of the depth of fingers in each other and in themselves, per length of the finger: the problem looks at chords
between its nodes, and so does the certificate, whose 400 chords are up to 2e-5 off."""
SHORT = 0.01
"""Share of a push that may be missing: the problem has tables of bodies, whose curvatures are up to 1e-3 off, and the
certificate has differences."""


class Requirement(Enum):
    """A requirement that a grasp must meet; the value names it for people."""

    NUMBERS = "numbers are finite"
    CONTACTS = "contacts match the scene"
    POSE = "pose of the object"
    BASE = "base of the finger"
    SHAPE = "moment left at the tip"
    GAP = "gap at the contact"
    TANGENT = "finger along the surface"
    PLACE = "place along the finger"
    PRESSING = "normal force"
    FRICTION = "friction cone"
    HISTORIES = "friction cone whatever the friction states"
    TENSION = "tension of a tendon"
    DRIVE = "tendons on one pulley"
    TORQUE = "torque of a motor"
    STRAIN = "bending strain"
    DEPTH = "depth in the object"
    SUPPORT_DEPTH = "depth in a support"
    OBJECT_DEPTH = "depth of the object in a support"
    CURLED = "depth in itself"
    CROSSED = "depth in another finger"
    FORCE = "balance of forces"
    MOMENT = "balance of moments"
    PUSH = "missing of a push in every direction"


@dataclass(frozen=True)
class Finding:
    """The value measured for a requirement, and the greatest value that passes.

    Examples
    --------
    >>> gap = Finding(Requirement.GAP, "finger.tip", 1e-9, 2e-7, "m")
    >>> gap.passed, Finding(Requirement.GAP, "finger.tip", float("nan"), 2e-7, "m").passed
    (True, False)
    """

    requirement: Requirement
    subject: str
    """Name of the finger, contact or support, or of several; empty: the object."""
    value: float
    limit: float
    unit: str = "1"

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return bool(self.value <= self.limit)

    @property
    def share(self) -> float:
        """Share of the limit that the value takes; infinite of NaN, and of values above a limit of zero."""
        if np.isnan(self.value) or (self.limit == 0.0 and not self.passed):
            return np.inf
        return self.value / self.limit if self.limit else 0.0

    def data(self) -> dict[str, Any]:
        """The finding as plain data."""
        return {**asdict(self), "requirement": self.requirement.value, "passed": self.passed}

    def __str__(self) -> str:
        of = f", {self.subject}" if self.subject else ""
        return f"{self.requirement.value}{of}: {self.value:.3g} {self.unit} (limit {self.limit:.3g})"


def greatest(values: Iterable[float]) -> float:
    """The greatest of some values; NaN where one is, minus infinity of none."""
    return float(np.max(np.array([-np.inf, *values], dtype=float)))
