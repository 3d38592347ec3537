"""What a starting point of the search is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ContactStart", "FingerStart", "Start"]

Array = NDArray[Any]


@dataclass(frozen=True)
class FingerStart:
    """One finger of a start.

    Attributes
    ----------
    base : (float, float, float)
        World x, y [m] and angle [rad] of the base.
    joints : tuple of float
        Positions along the finger of all middle contacts, on or off, increasing [m].
    sides : tuple of int
        Per middle contact: the object's outward normal there is side * (cos, sin) of the section's angle; +1: the
        object is on the finger's left (-X).
    knots : tuple of float
        Positions along the finger, from 0 to its length [m].
    curvatures : tuple of float
        At the knots, linear between them [1/m].
    """

    base: tuple[float, float, float]
    joints: tuple[float, ...]
    sides: tuple[int, ...]
    knots: tuple[float, ...]
    curvatures: tuple[float, ...]

    def bends(self, ends: Array) -> Array:
        """Bending angles (N,) of the elements between positions ``ends`` (N + 1,) [m, rad]."""
        knots, bent = np.asarray(self.knots), np.asarray(self.curvatures)
        turned = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(knots) * (bent[1:] + bent[:-1]))])
        k = np.clip(np.searchsorted(knots, ends, side="right") - 1, 0, len(knots) - 2)
        u = ends - knots[k]
        slope = (bent[k + 1] - bent[k]) / (knots[k + 1] - knots[k])
        return np.asarray(np.diff(turned[k] + u * (bent[k] + 0.5 * slope * u)))


@dataclass(frozen=True)
class ContactStart:
    """One contact of a start.

    Attributes
    ----------
    part : int
        Index of the object's part that is touched.
    point : (float, float)
        On its surface, in the object's frame [m].
    normal_angle : float
        Of the outward normal, in the object's frame [rad].
    """

    part: int
    point: tuple[float, float]
    normal_angle: float


@dataclass(frozen=True)
class Start:
    """One start.

    Attributes
    ----------
    label : str
        Where it comes from: "scan" (touches as it should), "near" (the closest there is) or "random".
    object_pose : (float, float, float)
        World x, y [m] and angle [rad] of the object.
    fingers : dict of str to FingerStart
    contacts : dict of str to ContactStart
        All contacts that are on, those with supports included.
    forces : dict of str to (float, float, float)
        Normal, friction and lift at the contacts that balance the object as nearly as they can [N]; signs as in a
        result's ``contact_forces``; may be empty.
    tensions : dict of str to (float, float)
        Of the fingers' tendons that go with them [N]; may be empty.
    """

    label: str
    object_pose: tuple[float, float, float]
    fingers: dict[str, FingerStart]
    contacts: dict[str, ContactStart]
    forces: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    tensions: dict[str, tuple[float, float]] = field(default_factory=dict)
