"""Interface of curvature families: coordinates, and the links, stiffness and limits that these give.

The unknowns of a family are its *full coordinates*: they bend the finger above its shape at rest, linearly. The last of
them may be no coordinates of the model but functions of its input: where the moment at the tip or a tendon that ends on
the way are taken as known, the curvature that they give is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import accumulate
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.link import Attached, Link, LoadedLink
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import FAMILIES, Curve, Panels


@dataclass(frozen=True)
class Mesh:
    """Elements, and the finger along them. Stiffness, density and rotary inertia are the parameters' times
    these.
    """

    lengths: tuple[float, ...]  # of the elements [m]
    ranges: tuple[float, ...]  # greatest bends [rad]
    stiffness: Curve
    linear_density: Curve
    rotary_inertia: Curve
    rest: Curve  # curvature at rest [1/m]
    own_stiffness: float  # of the rod itself at the base, without chambers
    moments: tuple[Curve, ...] = ()  # shapes of the bending moments of the input [1]
    known: bool = False  # whether what these bend is taken as known

    @property
    def ends(self) -> tuple[float, ...]:
        """Ends of the elements [m]."""
        return (0.0, *accumulate(self.lengths))

    def span(self, element: int) -> tuple[float, float]:
        """Both ends of an element [m]."""
        return self.ends[element], self.ends[element + 1]

    def panels(self, element: int, *curves: Curve) -> Panels:
        """Return the parts of an element with smooth curves [m], from base to tip."""
        return Panels.of(self.ends[-1], curves, *self.span(element))

    def integral(self, a: float, b: float, values: Callable[[Array], Array], *curves: Curve) -> Array:
        """Integral (...) from a to b [m] of values (..., M) at places (M,), smooth where curves are."""
        return Panels.of(self.ends[-1], curves, a, b).integral(values)

    def constant(self, curve: Curve, element: int) -> float | None:
        """Return the value of a curve that is constant on an element; else None."""
        first, *more = self.panels(element, curve)
        middle, inside = 0.5 * sum(first), np.linspace(*first, 5)[1:-1]
        value = float(curve(middle))
        return value if not more and np.all(curve(inside) == value) else None


def gathered(family: Family, on_elements: Sequence[Sequence[Scalar]]) -> list[Scalar]:
    """Forces on all coordinates of those on the local ones of every element."""
    total: list[Scalar] = [0.0] * family.size
    for k, forces in enumerate(on_elements):
        for a, force in zip(family.local(k), forces, strict=True):
            total[a] += force
    return total


def mean(mesh: Mesh, element: int, curve: Curve) -> float:
    constant = mesh.constant(curve, element)
    if constant is not None:
        return constant
    return float(mesh.integral(*mesh.span(element), curve, curve)) / mesh.lengths[element]


@dataclass(frozen=True)
class RodProperties:
    """Properties of the rod that the links of a family need: lengths [m], factors of the mesh's densities, masses."""

    lengths: tuple[Scalar, ...]
    linear_density: Scalar
    rotary_inertia: Scalar
    rest: Scalar | None  # curvature [1/m] as a run-time number; None: the mesh has it
    masses: tuple[tuple[int, float, Scalar], ...]  # (element, fraction of its length, mass [kg])


class Family(ABC):
    """A curvature family on a mesh.

    ``accuracy`` is the relative accuracy of the evaluation; None: ``default_accuracy``.
    """

    degree: ClassVar[int]  # of the polynomial that the bending moment is on each element
    continuous: ClassVar[bool]  # whether the bending moment is continuous
    order: ClassVar[int]  # of the convergence of the shape to the exact rod, in the elements' length
    force_unit: ClassVar[str] = "N m2"  # of a generalized force: energy per coordinate
    folds_masses: ClassVar[bool] = False  # whether links have masses at their ends among their constants

    @staticmethod
    def named(name: str) -> type[Family]:
        """Import the equations of a family by its name."""
        module, _, cls = FAMILIES[name].equations.partition(":")
        family: type[Family] = getattr(import_module(module), cls)
        return family

    def __init__(self, mesh: Mesh, accuracy: float | None) -> None:
        self.mesh = mesh
        self.elements = len(mesh.lengths)
        self.accuracy = accuracy

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of full coordinates."""

    @property
    def known(self) -> Array:
        """Value of the full coordinates at the end that are functions of the input [1/m], per amplitude of each of the
        mesh's moments [N m], times the factor of the stiffness.
        """
        return np.zeros((0, len(self.mesh.moments)))

    @property
    def nodal(self) -> Array | None:
        """Coordinates that balance the moments of the input, per amplitude [1/(N m2)] times the factor of the
        stiffness, if they are known.
        """
        return None

    @property
    @abstractmethod
    def labels(self) -> list[str]:
        """Name and unit of each full coordinate."""

    @property
    @abstractmethod
    def default_accuracy(self) -> float:
        """Default relative accuracy of the evaluation."""

    @abstractmethod
    def local(self, element: int) -> tuple[int, ...]:
        """Full coordinates that bend an element."""

    def curvature_at_coordinates(self, ends: Sequence[Sequence[Scalar]]) -> list[Scalar]:
        """Curvature [1/m] that belongs to each coordinate, of those at the ``places`` of the elements."""
        return [kappa for row in ends for kappa in row]

    def coordinate_size(self, bend: Any, length: float) -> Any:
        """Size of a coordinate that bends an element of a length [m] by an angle [rad]; numbers or arrays."""
        return bend / length

    def peak(self, element: int, coordinate: int) -> float:
        """Greatest bend of an element, as length times curvature, per coordinate of ``coordinate_size`` one."""
        return 1.0

    @property
    def places(self) -> Array:
        """The ``degree + 1`` places of the curvatures, as fractions of an element's length; its middle for arcs."""
        return np.linspace(0.0, 1.0, self.degree + 1) if self.degree else np.array([0.5])

    @abstractmethod
    def coordinates(self, bends: Array, curvatures: Array) -> Array:
        """Full coordinates near a shape of bends (N,) [rad] and curvatures (N, degree + 1) [1/m] at the places."""

    def links(self, q: Sequence[Scalar], rod: RodProperties) -> list[LoadedLink]:
        """The chain's links, with the point masses that they carry."""
        links = []
        for k in range(self.elements):
            # A numeric mass at the end of a numeric element costs no instruction: it goes into the link's constants.
            folds = self.folds_masses and isinstance(rod.lengths[k], float) and isinstance(rod.linear_density, float)
            carried, folded = list[tuple[Scalar, Attached]](), 0.0
            for fraction, mass in ((fraction, mass) for element, fraction, mass in rod.masses if element == k):
                if folds and fraction == 1.0 and isinstance(mass, float):
                    folded += mass
                else:
                    carried.append((fraction, Attached(mass)))
            links.append(LoadedLink(self.link(k, [q[a] for a in self.local(k)], rod, folded), tuple(carried)))
        return links

    @abstractmethod
    def link(self, element: int, local: Sequence[Scalar], rod: RodProperties, end_mass: float) -> Link:
        """The link of an element at its local coordinates; a mass at its end [kg] is among its constants."""

    @abstractmethod
    def block(self, element: int, length: Scalar) -> list[list[Scalar]]:
        """Integral over an element of the mesh's stiffness times the products of the shapes of its coordinates."""

    def stiffness(self, lengths: Sequence[Scalar]) -> list[list[Scalar]]:
        """Stiffness over all elements, of all coordinates."""
        matrix: list[list[Scalar]] = [[0.0] * self.size for _ in range(self.size)]
        for k, h in enumerate(lengths):
            for i, row in zip(self.local(k), self.block(k, h), strict=True):
                for j, entry in zip(self.local(k), row, strict=True):
                    matrix[i][j] += entry
        return matrix

    @abstractmethod
    def work(self, element: int, lengths: Sequence[Scalar], moment: Curve | None = None) -> list[Scalar]:
        """Integral over an element of a bending moment times the curvature shapes; the moment is one by default.

        Without a moment it is the derivative of the element's bending angle.
        """

    def length_factors(self, element: int, lengths: Sequence[Scalar]) -> list[Scalar]:
        """Factors of the integrals of the shapes of an element that has another length than the mesh at run time."""
        local = self.local(element)
        if isinstance(lengths[element], float):
            return [1.0] * len(local)
        work, nominal = self.work(element, lengths), self.work(element, self.mesh.lengths)
        return [work[a] / float(nominal[a]) for a in local]

    @abstractmethod
    def shapes_at(self, element: int, s: Array) -> Array:
        """Shapes (K, M) of the K coordinates that bend an element at positions (M,) on it [m].

        One row more is the rest curvature [1/m].
        """

    @abstractmethod
    def curvature_shapes(self, lengths: Sequence[float]) -> Array:
        """Derivative (N, degree + 1, size) of the curvature at the places with respect to the full coordinates."""
