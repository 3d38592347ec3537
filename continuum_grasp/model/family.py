"""What every curvature family answers: its coordinates, and the links, stiffness and limits that these give.

The unknowns of a family are its *full coordinates*. The curvature is a polynomial on each element and depends linearly
on them. Where the tip's curvature is set by the moment balance there, the last full coordinate is no coordinate of the
model but a function of its input.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.model.link import Link, LoadedLink
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.tabulated import TabulatedLink
from continuum_grasp.scene.families import FAMILIES

Array = NDArray[np.float64]
Pieces = Sequence[tuple[float, float, float]]
"""Start [m], end [m] and value [1/m] of the pieces of a rest curvature."""


@dataclass(frozen=True)
class Rod:
    """What a family needs to know of the rod."""

    lengths: tuple[Scalar, ...]  # of the elements [m]
    ranges: tuple[float, ...]  # greatest bends [rad]
    linear_density: Scalar  # rho A [kg/m]
    rotary_inertia: Scalar  # rho I [kg m]
    masses: tuple[tuple[int, float, Scalar], ...]  # (element, fraction of its length, mass [kg])


@dataclass(frozen=True)
class Pattern:
    """One link for all elements: what it needs to know of each is a row of numbers."""

    rows: Array  # (N, T)
    link: Callable[[Sequence[Scalar], ca.SX], Link | TabulatedLink]  # of local coordinates and a row (T,)


class Family(ABC):
    """A curvature family on given elements, with the jump of the rest curvature at each inner boundary [1/m].

    ``accuracy`` is that of the evaluation, relative; None: ``default_accuracy``.
    """

    degree: ClassVar[int]  # of the polynomial that the curvature is on each element
    continuous: ClassVar[bool]  # whether the curvature jumps between elements only where the rest curvature does
    order: ClassVar[int]  # in the elements' length, with which the shape converges to that of the exact rod
    force_unit: ClassVar[str] = "N m2"  # of a generalized force: energy per coordinate

    def __init__(self, elements: int, accuracy: float | None, jumps: Sequence[float] = ()) -> None:
        self.elements = elements
        self.accuracy = accuracy
        self.jumps = tuple(jumps) or (0.0,) * (elements - 1)

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of full coordinates."""

    @property
    @abstractmethod
    def labels(self) -> list[str]:
        """Name and unit of each full coordinate."""

    @property
    @abstractmethod
    def default_accuracy(self) -> float:
        """Relative accuracy of the evaluation where none is asked for."""

    @abstractmethod
    def local(self, element: int) -> tuple[int, ...]:
        """Full coordinates that bend an element."""

    def shape(self, element: int, q: Sequence[Scalar]) -> list[Scalar]:
        """Local coordinates of an element: its full ones, with the jumps of the rest curvature at its ends."""
        return [q[a] for a in self.local(element)]

    def curvature(self, element: int, q: Sequence[Scalar], length: Scalar) -> list[Scalar]:
        """Curvature [1/m] at the ``places`` of an element."""
        return self.shape(element, q)

    def bends(self, element: int, q: Sequence[Scalar], length: Scalar) -> list[Scalar]:
        """The same times the element's length [rad], which the bending range limits."""
        return [length * kappa for kappa in self.curvature(element, q, length)]

    def profile(self, q: Sequence[Scalar], lengths: Sequence[Scalar]) -> list[Scalar]:
        """Curvature [1/m] that belongs to each full coordinate, base to tip."""
        return list(q)

    def coordinate_size(self, bend: Any, length: float) -> Any:
        """Size of a coordinate that bends an element of a length [m] by an angle [rad]; numbers or arrays."""
        return bend / length

    @property
    def places(self) -> Array:
        """The ``degree + 1`` fractions of an element's length at which ``curvature`` is given; its middle for arcs."""
        return np.linspace(0.0, 1.0, self.degree + 1) if self.degree else np.array([0.5])

    @abstractmethod
    def coordinates(self, bends: Array, curvatures: Array) -> Array:
        """Full coordinates near a shape of bends (N,) [rad] and curvatures (N, degree + 1) [1/m]."""

    @abstractmethod
    def links(self, q: Sequence[Scalar], rod: Rod) -> list[LoadedLink]:
        """The chain's links."""

    def pattern(self, rod: Rod) -> Pattern | None:
        """One link for all, without point masses, of numeric lengths; None where there is none."""
        return None

    @abstractmethod
    def stiffness(self, lengths: Sequence[Scalar]) -> list[list[Scalar]]:
        """Integral of the products of the curvature shapes, per EI."""

    @abstractmethod
    def rest(self, lengths: Sequence[float], pieces: Pieces) -> list[float]:
        """Integral of the rest curvature, less what is in the shape already, times each curvature shape."""

    def rest_energy(self, lengths: Sequence[float], pieces: Pieces) -> float:
        """Half the integral of the square of the same."""
        return sum(0.5 * (b - a) * value**2 for a, b, value in pieces)

    @abstractmethod
    def rest_uniform(self, lengths: Sequence[Scalar]) -> list[Scalar]:
        """``rest`` for a rest curvature of one."""

    @abstractmethod
    def bend_gradient(self, element: int, lengths: Sequence[Scalar]) -> list[Scalar]:
        """Derivative of an element's bending angle with respect to the full coordinates; constant."""

    def curvature_shapes(self, lengths: Sequence[float]) -> Array:
        """Derivative (N, degree + 1, size) of the curvature with respect to the full coordinates."""

        def sampled(q: list[float]) -> Array:
            return np.array([self.curvature(k, q, h) for k, h in enumerate(lengths)], dtype=float)

        # Affine, for jumps of the rest curvature: differences to the curvature at zero are exact derivatives.
        straight = sampled([0.0] * self.size)
        return np.stack([sampled(row) - straight for row in np.eye(self.size).tolist()], axis=-1)


def overlaps(lengths: Sequence[float], pieces: Pieces) -> Iterator[list[tuple[float, float, float, float]]]:
    """Per element its overlaps with pieces: start of the element, start and end of the overlap [m], value [1/m]."""
    start = 0.0
    for h in lengths:
        spans = [(max(start, a), min(start + h, b), value) for a, b, value in pieces]
        yield [(start, low, high, value) for low, high, value in spans if high > low]
        start += h


def family_class(name: str) -> type[Family]:
    """Import the equations of a family by its name."""
    module, _, cls = FAMILIES[name].equations.partition(":")
    found: type[Family] = getattr(import_module(module), cls)
    return found
