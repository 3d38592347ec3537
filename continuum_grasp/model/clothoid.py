"""Clothoids: curvature linear along each element."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np

from continuum_grasp.model.collocated import CollocatedLink
from continuum_grasp.model.family import Array, Family, Pattern, Pieces, Rod, overlaps
from continuum_grasp.model.link import LoadedLink
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.quadrature import node_count
from continuum_grasp.model.tabulated import TabulatedLink


class Clothoid(CollocatedLink):
    """A link whose curvature is linear in the arc length; its local coordinates are those at its ends [1/m]."""

    def _angles(self, fraction: Scalar) -> tuple[Scalar, Scalar]:
        late = 0.5 * (fraction * fraction)
        return fraction - late, late

    @cached_property
    def _rise(self) -> Scalar:
        start, end = self._local
        return end - start

    def _turns(self, fraction: Scalar) -> list[Scalar]:
        # The mean curvature between two nodes is that at the middle, and the rule is symmetric: products are shared.
        rise = self._rise * fraction
        reach = fraction * self._length
        middle, lean = reach * (self._local[0] + 0.5 * rise), reach * rise
        angles = []
        for step, offset in zip(self._rule.steps.tolist(), self._rule.offsets.tolist(), strict=True):
            bend, shift = step * middle, abs(offset) * lean
            angles.append(bend + shift if offset > 0.0 else bend - shift)
        return angles


class ClothoidFamily(Family):
    """Curvature linear on each element and continuous; the coordinates are the nodal curvatures [1/m].

    Where the rest curvature jumps at a node, the curvature jumps with it and the coordinate is the mean of both sides.
    """

    degree = 1
    continuous = True
    order = 4

    def __init__(self, elements: int, accuracy: float | None, jumps: Sequence[float] = ()) -> None:
        super().__init__(elements, accuracy, jumps)
        # Added to the curvatures at both ends of each element [1/m]: half the jump after it, less half the one before.
        sides = zip((0.0, *(0.5 * j for j in self.jumps)), (*(-0.5 * j for j in self.jumps), 0.0), strict=True)
        self._steps = tuple(sides)

    def shape(self, element: int, q: Sequence[Scalar]) -> list[Scalar]:
        return [q[element + k] + step for k, step in enumerate(self._steps[element])]

    @property
    def size(self) -> int:
        return self.elements + 1

    @property
    def default_accuracy(self) -> float:
        """As good as the family itself: its error in frequency is 1.7e-3 at two elements, and falls with their fourth
        power down to rounding.
        """
        return max(2e-3 * (2.0 / self.elements) ** 4, 1e-13)

    @property
    def labels(self) -> list[str]:
        return [f"kappa_{k} [1/m]" for k in range(self.elements + 1)]

    def local(self, element: int) -> tuple[int, ...]:
        return (element, element + 1)

    def coordinates(self, bends: Array, curvatures: Array) -> Array:
        first, last = curvatures.T
        return np.concatenate([first[:1], 0.5 * (last[:-1] + first[1:]), last[-1:]])

    def links(self, q: Sequence[Scalar], rod: Rod) -> list[LoadedLink]:
        links = []
        for k, (h, reach) in enumerate(zip(rod.lengths, rod.ranges, strict=True)):
            # A numeric mass at the end of a numeric element costs no instruction: it goes into the link's constants.
            folds, folded = isinstance(h, float) and isinstance(rod.linear_density, float), 0.0
            carried = []
            for element, fraction, mass in rod.masses:
                if element == k and folds and fraction == 1.0 and isinstance(mass, float):
                    folded += mass
                elif element == k:
                    carried.append((fraction, mass))
            link = Clothoid(
                self.shape(k, q),
                h,
                rod.linear_density,
                rod.rotary_inertia,
                reach,
                node_count(reach, self.accuracy or self.default_accuracy),
                end_mass=folded,
            )
            links.append(LoadedLink(link, tuple(carried)))
        return links

    def pattern(self, rod: Rod) -> Pattern:
        runtime = not isinstance(rod.linear_density, float)
        plain = replace(rod, linear_density=1.0, masses=()) if runtime else replace(rod, masses=())
        links = [loaded.link for loaded in self.links([0.0] * self.size, plain)]
        tables = [link.table for link in links if isinstance(link, Clothoid)]
        reach = np.max([link.reach for link in links if isinstance(link, Clothoid)], axis=0).tolist()
        density = rod.linear_density if runtime else 1.0

        def link(local: Sequence[Scalar], row: ca.SX) -> TabulatedLink:
            return TabulatedLink(local, tables[0].filled(row), reach, density, rod.rotary_inertia)

        return Pattern(np.array([table.numbers for table in tables]), link)

    def stiffness(self, lengths: Sequence[Scalar]) -> list[list[Scalar]]:
        matrix: list[list[Scalar]] = [[0.0] * self.size for _ in range(self.size)]
        for k, h in enumerate(lengths):
            # Integrals of the products of the shapes 1 - u and u.
            for i, j, weight in ((0, 0, 1 / 3), (0, 1, 1 / 6), (1, 0, 1 / 6), (1, 1, 1 / 3)):
                matrix[k + i][k + j] += weight * h
        return matrix

    def rest(self, lengths: Sequence[float], pieces: Pieces) -> list[float]:
        result = [0.0] * self.size
        for k, (h, (left, right), parts) in enumerate(
            zip(lengths, self._steps, overlaps(lengths, pieces), strict=True)
        ):
            for start, low, high, value in parts:
                # Integral of the shape that rises from 0 to 1 along the element.
                rising = ((high - start) ** 2 - (low - start) ** 2) / (2 * h)
                result[k] += value * (high - low - rising)
                result[k + 1] += value * rising
            result[k] -= h * (left / 3 + right / 6)
            result[k + 1] -= h * (left / 6 + right / 3)
        return result

    def rest_energy(self, lengths: Sequence[float], pieces: Pieces) -> float:
        energy = 0.0
        for h, (left, right), parts in zip(lengths, self._steps, overlaps(lengths, pieces), strict=True):
            for start, low, high, value in parts:
                first, last = (value - left - (right - left) * (at - start) / h for at in (low, high))
                # Half the integral of the square of what is linear from first to last.
                energy += (high - low) * (first**2 + first * last + last**2) / 6
        return energy

    def rest_uniform(self, lengths: Sequence[Scalar]) -> list[Scalar]:
        result: list[Scalar] = [0.0] * self.size
        for k, h in enumerate(lengths):
            result[k] += 0.5 * h
            result[k + 1] += 0.5 * h
        return result

    def bend_gradient(self, element: int, lengths: Sequence[Scalar]) -> list[Scalar]:
        half = 0.5 * lengths[element]
        return [half if k in (element, element + 1) else 0.0 for k in range(self.size)]
