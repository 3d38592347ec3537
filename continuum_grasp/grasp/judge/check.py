"""Requirements of a grasp, checks of them, and their limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
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
YIELDS = 0.1
"""Distance by which an object that fingers alone hold may move as friction, its errors or disturbances change: part of
its size, and rad."""


class Requirement(Enum):
    """A requirement that a grasp must meet; the value names it for people."""

    NUMBERS = "non-finite numbers"
    ARRAYS = "missing or misshapen arrays"
    CONTACTS = "contacts match the scene"
    LAWS = "laws that are not certified"
    STORED = "stored numbers"
    POSE = "object pose"
    BASE = "base"
    SHAPE = "finger equilibrium"
    GAP = "contact gap"
    TANGENT = "finger along the surface"
    PLACE = "position along the finger"
    PRESSING = "normal force"
    FRICTION = "friction cone"
    HISTORIES = "friction cone whatever the friction states"
    TENSION = "tendon tension"
    DRIVE = "tendons of one pulley"
    TORQUE = "torque"
    STRAIN = "bending strain"
    DEPTH = "penetration into the object"
    SUPPORT_DEPTH = "penetration into a support"
    OBJECT_DEPTH = "penetration of the object into a support"
    CURLED = "passes through itself"
    CROSSED = "overlap of fingers"
    FORCE = "object force balance"
    MOMENT = "object moment balance"
    PUSH = "push in every direction"


@dataclass(frozen=True)
class Check:
    """The value measured for a requirement, and the greatest value that passes.

    Attributes
    ----------
    requirement : Requirement
    subject : str
        Name of the finger, contact or support, or of several; empty: the object, or the whole grasp.
    value, limit : float
        The value found, and the greatest that passes, in ``unit``.
    unit : str

    Examples
    --------
    >>> gap = Check(Requirement.GAP, "finger.tip", 1e-9, 2e-7, "m")
    >>> gap.name, gap.passed
    ('contact gap, finger.tip', True)
    >>> Check(Requirement.GAP, "finger.tip", float("nan"), 2e-7, "m").passed
    False
    """

    requirement: Requirement
    subject: str
    value: float
    limit: float
    unit: str = "1"

    @property
    def name(self) -> str:
        """Requirement and subject in words."""
        return f"{self.requirement.value}, {self.subject}" if self.subject else self.requirement.value

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
        """The check as plain data."""
        numbers = {"value": self.value, "limit": self.limit, "unit": self.unit}
        return {"name": self.name, **numbers, "passed": self.passed}

    def __str__(self) -> str:
        return f"{self.name}: {self.value:.3g} {self.unit} (limit {self.limit:.3g})"


def greatest(values: Iterable[float]) -> float:
    """The greatest of some values; NaN where one is, minus infinity of none."""
    return float(np.max(np.array([-np.inf, *values], dtype=float)))
