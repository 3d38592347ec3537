"""What the certificate checks, and what it finds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np

EXACT = 1e-6
"""Limit of what an exact solution leaves: of gaps and positions per length of the finger (of supports, per size of the
object), of directions [rad], of forces per greatest force, of moments per greatest force and size, and share by which
a limit may be exceeded."""
CLEAR = 1e-4
"""Limit of the depth of bodies in each other between contacts, per length of the finger: the problem keeps clear at
some fifty places along each finger."""


class Property(Enum):
    """A property of a grasp that must hold; the value says it in words."""

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
    TENSION = "tension of a tendon"
    STRAIN = "bending strain"
    DEPTH = "depth in the object"
    SUPPORT_DEPTH = "depth in a support"
    OBJECT_DEPTH = "depth of the object in a support"
    CURLED = "depth in itself"
    CROSSED = "depth in another finger"
    FORCE = "balance of forces"
    MOMENT = "balance of moments"


@dataclass(frozen=True)
class Finding:
    """The value of a property, and the greatest that passes.

    Examples
    --------
    >>> gap = Finding(Property.GAP, "finger.tip", 1e-9, 2e-7, "m")
    >>> gap.passed, Finding(Property.GAP, "finger.tip", float("nan"), 2e-7, "m").passed
    (True, False)
    """

    property: Property
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

    def __str__(self) -> str:
        of = f", {self.subject}" if self.subject else ""
        return f"{self.property.value}{of}: {self.value:.3g} {self.unit} (limit {self.limit:.3g})"


def greatest(values: Iterable[float]) -> float:
    """The greatest of some values; NaN where one is, minus infinity of none."""
    return float(np.max(np.array([-np.inf, *values], dtype=float)))
