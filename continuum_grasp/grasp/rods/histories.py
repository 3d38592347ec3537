"""Histories of friction: directions of all frictions in all stages, as a row of numbers, and the worst ones.

At what drives hold, the greatest friction margin of a grasp depends on the directions z from -1 to 1 in which friction
acts. To first order, in a posture that stays, it is the optimum of a linear problem with z on its right-hand side, so
concave in z: it is least at a vertex. Its slope follows from the multipliers: d margin / d z = - forces . d rows / d z.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.scene import FingerSetup

_STEP = 1e-4
"""Step of differences in a direction of friction [1], which the rows of a stage depend on nearly linearly."""
_NOTHING = 1e-4
"""Share of the greatest slope below which a direction stays as it is [1]."""


def frictions_of(setup: FingerSetup) -> list[str]:
    """Frictions of a finger, in words: of its tendons, and each branch of dry friction in bending."""
    tendons = ["of the tendons"] * (setup.tendons.friction > 0.0)
    return tendons + ["in bending"] * len(setup.finger.damping.dry_friction)


@dataclass(frozen=True)
class HistoryColumns:
    """Directions of friction of all fingers in one row."""

    sizes: tuple[tuple[int, int], ...]
    """Stages and frictions of each finger; no frictions where its history does not matter."""
    pulled: tuple[Array, ...]
    """History of each finger where there are no columns."""

    @staticmethod
    def of(scene: Any, problem: GraspRods) -> HistoryColumns:
        """The columns of a scene and the problem of its grasp."""
        fingers, sizes = problem.numbers.fingers, list[tuple[int, int]]()
        for finger, part in zip(fingers, problem.parts, strict=True):
            frictions = len(finger.section.form.history_names) - 1
            sizes.append((len(part.nodes) - 1, frictions if scene.friction_states == "any" else 0))
        return HistoryColumns(tuple(sizes), tuple(finger.section.pulled[None] for finger in fingers))

    @property
    def size(self) -> int:
        """Count of all directions."""
        return sum(stages * frictions for stages, frictions in self.sizes)

    @property
    def extremes(self) -> Array:
        """Rows with directions that are alike all along each finger, and those that turn at half of one finger."""
        signs = [(1.0, -1.0) if frictions else (0.0,) for _, frictions in self.sizes]
        alike = [
            self._row(np.full(size, sign) for size, sign in zip(self.sizes, each, strict=True))
            for each in product(*signs)
        ]
        turned = [row * self._row(self._half(k, size) for k, size in enumerate(self.sizes)) for row in alike]
        return np.array([*alike, *turned] if self.size else alike)

    def words(self, scene: Any, states: Array) -> str:
        """Directions from base to tip, by their signs where all are at their bounds."""
        found = list[str]()
        for setup, part in zip(scene.setups, self.split(states) if states.size else (), strict=False):
            of = f" of {setup.name}" * (len(scene.setups) > 1)
            for name, each in zip(frictions_of(setup), part.T, strict=False):
                signs = "".join("+" if z > 0.0 else "-" for z in each)
                shown = signs if (np.abs(each) == 1.0).all() else " ".join(f"{z:+.3g}" for z in each)
                found.append(f"friction states {name}{of} {shown}")
        return ", ".join(found)

    @staticmethod
    def _half(index: int, size: tuple[int, int]) -> Array:
        """Directions that turn at half of a finger."""
        half = np.ones(size)
        half[size[0] // 2 :] = -1.0
        return half

    @staticmethod
    def _row(parts: Any) -> Array:
        return np.concatenate([np.ravel(part) for part in parts])

    def split(self, states: Array) -> list[Array]:
        """Directions (stages, frictions) of each finger."""
        ends = np.cumsum([stages * frictions for stages, frictions in self.sizes])
        return [part.reshape(size) for part, size in zip(np.split(states, ends[:-1]), self.sizes, strict=True)]

    def of_fingers(self, states: Array) -> list[Array]:
        """History of each finger: pulling, if there are no directions."""
        if not states.size:
            return list(self.pulled)
        each = zip(self.split(states), self.pulled, strict=True)
        return [np.insert(part, 0, 0.0, axis=1) if part.size else pulled for part, pulled in each]

    def slope(self, problem: GraspRods, x: Array, forces: Array) -> Array:
        """Derivative of the Lagrange function by all directions, at unknowns and multipliers of the rows."""
        return self._row(_slope(problem, k, x, forces)[:, :frictions] for k, (_, frictions) in enumerate(self.sizes))

    def worse(self, states: Array, problem: GraspRods, x: Array, forces: Array) -> Array:
        """The vertex to which the slope of a margin points, of the solution with the greatest margin."""
        slope = self.slope(problem, x, forces)
        # The margin's cost is -1: its slope has the other sign.
        clear = np.abs(slope) > _NOTHING * np.abs(slope).max(initial=0.0)
        return np.where(clear, np.sign(slope), states)


def _slope(problem: GraspRods, index: int, x: Array, forces: Array) -> Array:
    """Derivative of forces times rows (stages, frictions) by the directions in each stage of a finger."""
    finger, part, geometry = problem.numbers.fingers[index], problem.parts[index], problem.geometry
    form = finger.section.form
    first, count = geometry.dimensions + 1, len(form.history_names) - 1
    size = kinds.states(geometry, form)
    ends = {int(node[0]): k for k, node in enumerate(part.nodes)}
    slopes = np.zeros((len(part.nodes) - 1, count))
    for kind, at, rows, data in problem.of_kind(kinds.stage_kind(geometry, form).name):
        node = ends.get(int(at[size]))
        if node is None or not np.abs(forces[rows]).any():
            continue
        for j in range(count):
            values = []
            # Inward, where a direction is at its bound.
            z = data[first + j]
            low, high = max(z - _STEP, -1.0), min(z + _STEP, 1.0)
            for other in (low, high):
                changed = data.copy()
                changed[first + j] = other
                values.append(kind.value(x[at], changed, problem.table))
            slopes[node - 1, j] = forces[rows] @ (values[1] - values[0]) / (high - low)
    return slopes
