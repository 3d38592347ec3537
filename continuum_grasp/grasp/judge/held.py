"""A grasp as plain numbers: all that the certificate takes on trust, to test it against the scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from continuum_grasp.base import Numbers as Array

UNKNOWN = float("nan")


@dataclass(frozen=True, eq=False)
class HeldContact:
    """A contact of the object with a finger or a support, in the world.

    Examples
    --------
    >>> HeldContact("finger.tip", force=np.array([2.0, 0.0, 0.0]), place=0.2).force
    array([2., 0., 0.])
    """

    name: str
    force: Array
    """Force (3,) on what touches the object [N]."""
    place: float = UNKNOWN
    """Position along the finger [m]; NaN of supports."""
    moment: float = 0.0
    """Moment about the outward normal of the object, on the finger [N m]."""
    position: Array | None = None
    """Position (3,) of a contact with a support [m]; None of fingers, whose contacts follow from their shapes."""

    @property
    def numbers(self) -> Array:
        """All numbers of the contact."""
        place = [self.place] if self.position is None else self.position
        return np.concatenate([np.ravel(self.force), np.ravel(place), [self.moment]])


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
    moment: Array = field(default_factory=lambda: np.zeros(3))
    """Moment (3,) in the base in the world [N m]. It only says which of several equilibria is meant: the certificate
    begins there and finds the moment anew."""

    @property
    def numbers(self) -> Array:
        """All numbers of the finger."""
        own = [self.position, self.axes, self.tensions, self.moment]
        return np.concatenate([np.ravel(part) for part in (*own, *(c.numbers for c in self.contacts))])


@dataclass(frozen=True, eq=False)
class HeldRods:
    """Fingers that hold an object."""

    position: Array
    """Position (3,) of the object's frame [m]."""
    axes: Array
    """Columns (3, 3): the axes of the object's frame in the world."""
    fingers: tuple[HeldFinger, ...]
    supports: tuple[HeldContact, ...] = ()
    """Contacts of the object with palms, lines, pegs and tables."""

    @property
    def contacts(self) -> Iterator[HeldContact]:
        """All contacts."""
        for finger in self.fingers:
            yield from finger.contacts
        yield from self.supports

    @property
    def not_finite(self) -> int:
        """Count of NaN and infinite numbers."""
        parts = [np.ravel(self.position), np.ravel(self.axes)]
        parts += [finger.numbers for finger in self.fingers] + [contact.numbers for contact in self.supports]
        return int((~np.isfinite(np.concatenate(parts))).sum())


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
