"""Supports of the object as data of blocks: flat ones, such as walls, palms and tables, and round pegs.

A contact with a support moves along the object while the object turns. A flat support sees the object as a ball: the
circle that osculates the surface where it touches, which is exact for discs and corners. `RodStart.supports_at` gives
it anew where the object ends, until it stays. A peg sees the table of the object.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.object_numbers import ObjectNumbers
from continuum_grasp.nlp import BlockKind

PARTED = 0.05
"""Way of a contact along the object beyond which another part of it touches [object size]."""
_CLEAR = ", clear"
INDEPENDENT = 1e-6
"""Least singular value of slopes of gaps by the pose, per size, above which they are independent [1]."""


@dataclass(frozen=True, eq=False)
class SupportNumbers(ABC):
    """A support that the object touches, or keeps clear of, with lengths per the object's size."""

    name: str
    across: Array  # (3,) a direction along the surface, or out of the plane
    friction: float
    most: float  # greatest normal force [F0]
    touches: bool
    """Whether the support may exert forces; otherwise the object stays clear of it."""

    @property
    def curvature(self) -> float:
        """Curvature of its surface, convex positive [per object size]."""
        return 0.0

    @abstractmethod
    def gap_block(self, numbers: ObjectNumbers) -> tuple[BlockKind, list[float]]:
        """Kind and data of the gap between object and support [object size]."""

    @abstractmethod
    def force_block(self, numbers: ObjectNumbers) -> tuple[BlockKind, list[float]]:
        """Kind and data of the balance of the object under the support's force."""

    @abstractmethod
    def touched(self, numbers: ObjectNumbers, pose: Array) -> tuple[Array, Array]:
        """Place (3,) of the contact [object size], and outward normal (3,) of the object there."""

    @abstractmethod
    def gap(self, numbers: ObjectNumbers, pose: Array) -> float:
        """Gap at a pose [object size]."""


@dataclass(frozen=True, eq=False)
class FlatSupport(SupportNumbers):
    """A plane that touches the ball of a radius about a point of the object."""

    normal: Array  # (3,) of the object at the contact: into the support
    level: float  # place of the plane along it
    point: Array  # (3,) center of the ball, in the object's frame
    radius: float

    def gap_block(self, numbers: ObjectNumbers) -> tuple[BlockKind, list[float]]:
        """Kind and data of the gap."""
        return kinds.rest_kind(numbers.geometry), [*self._ball, self.level, *numbers.axes]

    def force_block(self, numbers: ObjectNumbers) -> tuple[BlockKind, list[float]]:
        """Kind and data of the balance."""
        return kinds.support_kind(numbers.geometry), [*self._ball, *self.across, *numbers.center, *numbers.axes]

    def touched(self, numbers: ObjectNumbers, pose: Array) -> tuple[Array, Array]:
        """Place of the contact, and normal."""
        place, turn = numbers.geometry.place(pose), np.array(numbers.geometry.turn(pose, numbers.axes), dtype=float)
        return np.array(place) + turn @ self.point + self.radius * self.normal, self.normal

    def gap(self, numbers: ObjectNumbers, pose: Array) -> float:
        """Gap at a pose."""
        return self.level - float(self.normal @ self.touched(numbers, pose)[0])

    @property
    def _ball(self) -> list[float]:
        return [*self.normal, *self.point, self.radius]


@dataclass(frozen=True, eq=False)
class PegSupport(SupportNumbers):
    """A round peg across the plane."""

    position: Array  # (3,)
    radius: float

    def gap_block(self, numbers: ObjectNumbers) -> tuple[BlockKind, list[float]]:
        """Kind and data of the gap."""
        return kinds.peg_gap_kind(numbers.geometry), self._seen(numbers)

    def force_block(self, numbers: ObjectNumbers) -> tuple[BlockKind, list[float]]:
        """Kind and data of the balance."""
        return kinds.peg_kind(numbers.geometry), [*self._seen(numbers), *numbers.center, *self.across]

    def touched(self, numbers: ObjectNumbers, pose: Array) -> tuple[Array, Array]:
        """Place of the contact, and normal."""
        _, normal = numbers.distance(self.position, pose, self.name)
        return self.position - self.radius * normal, normal

    def gap(self, numbers: ObjectNumbers, pose: Array) -> float:
        """Gap at a pose."""
        return numbers.distance(self.position, pose, self.name)[0] - self.radius

    @property
    def curvature(self) -> float:
        """Curvature of its surface; a peg without a radius is a point."""
        return 1.0 / max(self.radius, 1e-9)

    def _seen(self, numbers: ObjectNumbers) -> list[float]:
        return [
            *self.position[: numbers.geometry.dimensions],
            self.radius,
            *numbers.axes,
            *numbers.table.data_at(self.name),
        ]


def pinning(numbers: ObjectNumbers, supports: Sequence[SupportNumbers], pose: Array, free: Array) -> list[bool]:
    """Whether the gap of each support that touches pins down the pose, of which some coordinates are free: others
    follow from those before.
    """
    slopes, pins = list[Array](), list[bool]()
    for support in supports:
        slope = _slope(support, numbers, pose) * free
        rank = np.linalg.matrix_rank(np.array([*slopes, slope]), tol=INDEPENDENT)
        pins.append(bool(support.touches and rank > len(slopes)))
        slopes += [slope] * pins[-1]
    return pins


def _slope(support: SupportNumbers, numbers: ObjectNumbers, pose: Array) -> Array:
    """Slope of a gap by the pose, by central differences."""
    step = 1e-5
    ends = [[support.gap(numbers, pose + sign * step * one) for sign in (1.0, -1.0)] for one in np.eye(len(pose))]
    return np.array([(high - low) / (2.0 * step) for high, low in ends])


def rested(
    numbers: ObjectNumbers,
    supports: Sequence[SupportNumbers],
    found: Sequence[SupportNumbers],
    pose: Array,
    slack: float,
) -> list[SupportNumbers] | None:
    """The supports of a scene where they touch the object at a pose anew, as ``found`` there; None where none has
    moved by more than a slack [object size].

    Where another part of the object is the lowest now, the object keeps clear with the former one, too.
    """
    now = {support.name: support for support in found}
    merged, far = list[SupportNumbers](), False
    for support in supports:
        after = now.pop(support.name, support)
        away = float(np.abs(after.touched(numbers, pose)[0] - support.touched(numbers, pose)[0]).max())
        far = far or away > slack
        merged.append(after)
        if away > PARTED and _CLEAR not in support.name:
            merged.append(replace(support, name=f"{support.name}{_CLEAR}", touches=False))
    entered = [support for support in now.values() if support.gap(numbers, pose) < -slack]
    merged += [replace(support, name=f"{support.name}{_CLEAR}", touches=False) for support in entered]
    return merged if far or entered else None
