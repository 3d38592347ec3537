"""The three curvature families: which unknowns they have, and which links, stiffness and damping these give.

The unknowns of a family are its *full coordinates*: the bending angles of the arcs, or all nodal curvatures of the
clothoids. Matched clothoids are clothoids whose last nodal curvature is not an unknown: the tip balance imposes it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from continuum_grasp.model.arc import Arc
from continuum_grasp.model.clothoid import Clothoid
from continuum_grasp.model.link import LoadedLink
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.quadrature import node_count
from continuum_grasp.model.stumpff import ROUNDING

__all__ = ["ArcFamily", "ClothoidFamily", "Family", "Rod"]


@dataclass(frozen=True)
class Rod:
    """What a family needs to know of the rod."""

    lengths: tuple[Scalar, ...]
    ranges: tuple[float, ...]
    linear_density: Scalar
    rotary_inertia: Scalar
    masses: tuple[tuple[int, float, Scalar], ...]
    """(element, fraction of its length, mass)."""


class Family(ABC):
    """A curvature family on given elements."""

    def __init__(self, elements: int, accuracy: float | None) -> None:
        self.elements = elements
        self.accuracy = accuracy

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of full coordinates."""

    @property
    @abstractmethod
    def labels(self) -> list[str]:
        """Name and unit of each full coordinate."""

    @abstractmethod
    def local(self, element: int) -> tuple[int, ...]:
        """Full coordinates that bend an element."""

    def shape(self, element: int, q: Sequence[Scalar]) -> list[Scalar]:
        """What bends an element: its coordinates, with the jumps of the rest curvature at its ends."""
        return [q[a] for a in self.local(element)]

    @abstractmethod
    def links(self, q: Sequence[Scalar], rod: Rod) -> list[LoadedLink]:
        """The chain's links."""

    @abstractmethod
    def stiffness(self, lengths: Sequence[Scalar]) -> list[list[Scalar]]:
        """Integral of the products of the curvature shapes, per EI."""

    @abstractmethod
    def rest(self, lengths: Sequence[float], pieces: Sequence[tuple[float, float, float]]) -> list[float]:
        """Integral of the rest curvature, less what is in the shape already, times each curvature shape."""

    def rest_energy(self, lengths: Sequence[float], pieces: Sequence[tuple[float, float, float]]) -> float:
        """Half the integral of the square of the same."""
        return sum(0.5 * (b - a) * value**2 for a, b, value in pieces)

    @abstractmethod
    def bend_gradient(self, element: int, lengths: Sequence[Scalar]) -> list[Scalar]:
        """Derivative of an element's bending angle with respect to the full coordinates; constant."""

    @abstractmethod
    def rest_uniform(self, lengths: Sequence[Scalar]) -> list[Scalar]:
        """``rest`` for a rest curvature of one."""


class ArcFamily(Family):
    """Constant curvature on each element; the unknowns are the bending angles [rad]."""

    @property
    def size(self) -> int:
        return self.elements

    @property
    def labels(self) -> list[str]:
        return [f"theta_{k + 1} [rad]" for k in range(self.elements)]

    def local(self, element: int) -> tuple[int, ...]:
        return (element,)

    def links(self, q: Sequence[Scalar], rod: Rod) -> list[LoadedLink]:
        accuracy = self.accuracy or ROUNDING
        return [
            LoadedLink(
                Arc(q[k], h, rod.linear_density, rod.rotary_inertia, reach, accuracy),
                tuple((fraction, mass) for element, fraction, mass in rod.masses if element == k),
            )
            for k, (h, reach) in enumerate(zip(rod.lengths, rod.ranges, strict=True))
        ]

    def stiffness(self, lengths: Sequence[Scalar]) -> list[list[Scalar]]:
        n = self.elements
        return [[1.0 / lengths[i] if i == j else 0.0 for j in range(n)] for i in range(n)]

    def rest(self, lengths: Sequence[float], pieces: Sequence[tuple[float, float, float]]) -> list[float]:
        result = []
        start = 0.0
        for h in lengths:
            result.append(sum(_overlap(start, start + h, a, b) * value for a, b, value in pieces) / h)
            start += h
        return result

    def rest_uniform(self, lengths: Sequence[Scalar]) -> list[Scalar]:
        return [1.0 for _ in lengths]

    def bend_gradient(self, element: int, lengths: Sequence[Scalar]) -> list[Scalar]:
        return [1.0 if k == element else 0.0 for k in range(self.elements)]


class ClothoidFamily(Family):
    """Curvature linear on each element and continuous; the unknowns are the nodal curvatures [1/m].

    Where the rest curvature jumps at a node, the curvature jumps with it and the unknown is the mean of both sides.

    Parameters
    ----------
    elements : int
    accuracy : float or None
    jumps : sequence of float, optional
        Jump of the rest curvature at each inner node [1/m].
    """

    def __init__(self, elements: int, accuracy: float | None, jumps: Sequence[float] = ()) -> None:
        super().__init__(elements, accuracy)
        inner = tuple(jumps) or (0.0,) * (elements - 1)
        self._steps = tuple(zip((0.0, *(0.5 * j for j in inner)), (*(-0.5 * j for j in inner), 0.0), strict=True))
        """What is added to the curvatures at both ends of each element [1/m]."""

    def shape(self, element: int, q: Sequence[Scalar]) -> list[Scalar]:
        return [q[element + k] + step for k, step in enumerate(self._steps[element])]

    @property
    def size(self) -> int:
        return self.elements + 1

    @property
    def labels(self) -> list[str]:
        return [f"kappa_{k} [1/m]" for k in range(self.elements + 1)]

    def local(self, element: int) -> tuple[int, ...]:
        return (element, element + 1)

    def links(self, q: Sequence[Scalar], rod: Rod) -> list[LoadedLink]:
        links = []
        for k, (h, reach) in enumerate(zip(rod.lengths, rod.ranges, strict=True)):
            masses = [(fraction, mass) for element, fraction, mass in rod.masses if element == k]
            folds = isinstance(h, float) and isinstance(rod.linear_density, float)
            folded = [mass for fraction, mass in masses if folds and fraction == 1.0 and isinstance(mass, float)]
            kept = tuple(
                (fraction, mass)
                for fraction, mass in masses
                if not (folds and fraction == 1.0 and isinstance(mass, float))
            )
            first, last = self.shape(k, q)
            link = Clothoid(
                first,
                last,
                h,
                rod.linear_density,
                rod.rotary_inertia,
                reach,
                node_count(reach, self.accuracy or _default_accuracy(self.elements)),
                end_mass=sum(folded),
            )
            links.append(LoadedLink(link, kept))
        return links

    def stiffness(self, lengths: Sequence[Scalar]) -> list[list[Scalar]]:
        matrix: list[list[Scalar]] = [[0.0] * self.size for _ in range(self.size)]
        for k, h in enumerate(lengths):
            for i, j, weight in ((0, 0, 1 / 3), (0, 1, 1 / 6), (1, 0, 1 / 6), (1, 1, 1 / 3)):
                matrix[k + i][k + j] += weight * h
        return matrix

    def rest(self, lengths: Sequence[float], pieces: Sequence[tuple[float, float, float]]) -> list[float]:
        result = [0.0] * self.size
        start = 0.0
        for k, h in enumerate(lengths):
            for a, b, value in pieces:
                lo, hi = max(start, a), min(start + h, b)
                if hi > lo:
                    rising = ((hi - start) ** 2 - (lo - start) ** 2) / (2 * h)
                    result[k] += value * (hi - lo - rising)
                    result[k + 1] += value * rising
            left, right = self._steps[k]
            result[k] -= h * (left / 3 + right / 6)
            result[k + 1] -= h * (left / 6 + right / 3)
            start += h
        return result

    def rest_energy(self, lengths: Sequence[float], pieces: Sequence[tuple[float, float, float]]) -> float:
        energy, start = 0.0, 0.0
        for h, (left, right) in zip(lengths, self._steps, strict=True):
            for a, b, value in pieces:
                lo, hi = max(start, a), min(start + h, b)
                if hi > lo:
                    first, last = (value - left - (right - left) * (at - start) / h for at in (lo, hi))
                    energy += (hi - lo) * (first**2 + first * last + last**2) / 6
            start += h
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


def _default_accuracy(elements: int) -> float:
    """As good as the family itself, whose error in frequency is 1.7e-3 at two elements and falls with the fourth power
    of their number.
    """
    return max(2e-3 * (2.0 / elements) ** 4, 1e-13)


def _overlap(a: float, b: float, c: float, d: float) -> float:
    return max(0.0, min(b, d) - max(a, c))
