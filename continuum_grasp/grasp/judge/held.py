"""A grasp as plain numbers: all that the certificate takes on trust, to test it against the scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from continuum_grasp.base import Numbers as Array


@dataclass(frozen=True, eq=False)
class HeldContact:
    """A contact of a finger with the object, in the world.

    Examples
    --------
    >>> HeldContact("finger.tip", np.array([2.0, 0.0, 0.0]), place=0.2).force
    array([2., 0., 0.])
    """

    name: str
    force: Array
    """Force (3,) on the finger [N]."""
    place: float
    """Position along the finger [m]."""
    moment: float = 0.0
    """Moment on the finger about the outward normal of the object [N m]."""


@dataclass(frozen=True, eq=False)
class HeldSupport:
    """A contact of a palm, a line, a peg or a table with the object, in the world."""

    name: str
    force: Array
    """Force (3,) on the support [N]."""
    position: Array
    """Position (3,) [m]."""
    moment: float = field(default=0.0, init=False)


@dataclass(frozen=True, eq=False)
class HeldFinger:
    """A finger in the world: its base, what pulls it, and what it touches."""

    name: str
    position: Array
    """Position (3,) of the base [m]."""
    axes: Array
    """Columns (3, 3): X across, Y along the straight finger, Z the normal of the plane in which tendons bend it."""
    tensions: Array
    """Tension of each tendon [N]."""
    contacts: tuple[HeldContact, ...] = ()
    moment: Array | None = None
    """Moment (3,) in the base in the world [N m]: the shape follows from it, and nothing may be left of it at the tip.
    None: the one with which nothing is left is found from the loads, where they leave one shape alone."""

    @property
    def numbers(self) -> Array:
        """All numbers of the finger."""
        touching = (part for c in self.contacts for part in (c.force, c.place, c.moment))
        own = (self.position, self.axes, self.tensions, () if self.moment is None else self.moment)
        return np.concatenate([np.ravel(part) for part in (*own, *touching)])


@dataclass(frozen=True, eq=False)
class HeldRods:
    """Fingers that hold an object."""

    position: Array
    """Position (3,) of the object's frame [m]."""
    axes: Array
    """Columns (3, 3): the axes of the object's frame in the world."""
    fingers: tuple[HeldFinger, ...]
    supports: tuple[HeldSupport, ...] = ()

    @property
    def contacts(self) -> Iterator[HeldContact | HeldSupport]:
        """All contacts."""
        for finger in self.fingers:
            yield from finger.contacts
        yield from self.supports

    @property
    def not_finite(self) -> int:
        """Count of NaN and infinite numbers."""
        parts = [self.position, self.axes, *(finger.numbers for finger in self.fingers)]
        parts += [part for support in self.supports for part in (support.force, support.position)]
        return int((~np.isfinite(np.concatenate([np.ravel(part) for part in parts]))).sum())


def in_plane(pose: Array | tuple[float, float, float]) -> tuple[Array, Array]:
    """Position (3,) and axes (3, 3) of a planar pose: x, y [m] and angle [rad].

    Examples
    --------
    >>> position, axes = in_plane((0.1, 0.2, 0.0))
    >>> position
    array([0.1, 0.2, 0. ])
    """
    x, y, angle = (float(value) for value in pose)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([x, y, 0.0]), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
