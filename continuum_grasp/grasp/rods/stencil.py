"""Scenes along a direction of designs, by which the numbers of a scene are differentiated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from continuum_grasp.base import InputError
from continuum_grasp.scene import GraspScene

_SHAPES = (
    # Offsets and weights of differences of fourth order: central, forward, backward.
    ((-2, -1, 1, 2), (1 / 12, -8 / 12, 8 / 12, -1 / 12)),
    ((0, 1, 2, 3, 4), (-25 / 12, 48 / 12, -36 / 12, 16 / 12, -3 / 12)),
    ((0, -1, -2, -3, -4), (25 / 12, -48 / 12, 36 / 12, -16 / 12, 3 / 12)),
)
STEP = 1e-3
"""Step of these differences, per range of a variable: they are then good to 1e-11, as much as rounding."""


class StructureChanges(InputError):
    """Scenes next to each other have grasp problems of different structure, as where a rest curvature vanishes."""


@dataclass(frozen=True)
class Stencil:
    """Scenes along a direction of designs, by which numbers are differentiated; ``offsets`` are in steps from here."""

    offsets: tuple[int, ...]
    weights: tuple[float, ...]
    scenes: tuple[GraspScene, ...]

    @classmethod
    def of(cls, along: Callable[[float], GraspScene]) -> Stencil:
        """The first stencil whose scenes, by their distance from here, make sense: to both sides, else to one.

        InputError where there is none.
        """
        failures: list[InputError] = []
        for offsets, weights in _SHAPES:
            try:
                return cls(offsets, weights, tuple(along(offset * STEP) for offset in offsets))
            except InputError as error:
                failures.append(error)
        raise failures[0]

    def difference(self, values: Sequence[Any]) -> Any:
        """Derivative of numbers or arrays, given for each scene."""
        return sum(weight * value for weight, value in zip(self.weights, values, strict=True)) / STEP

    def change(self, change: Callable[[GraspScene], GraspScene]) -> Stencil:
        return replace(self, scenes=tuple(change(scene) for scene in self.scenes))
