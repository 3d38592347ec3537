"""Ports, where section laws read the curvature of an element, and the generalized forces of all laws.

A port is the curvature at a point of an element, or its mean over a part of it. Its measure has the stiffness of the
section per stiffness of the rod itself at the base, since the moments of laws go with it along the finger. By virtual
work, a moment m at a port of the mean shapes c and the measure l [m] exerts l m c on the coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.family import Family, Mesh, gathered
from continuum_grasp.model.laws.section import Bend, Kind, SectionLaw
from continuum_grasp.model.memory import Instant
from continuum_grasp.model.planar import Scalar, is_zero
from continuum_grasp.scene import SAME, Curve


@dataclass(frozen=True)
class Port:
    """Part of an element from which a law reads the mean curvature."""

    element: int
    measure: Scalar  # [m]
    shapes: Sequence[Scalar]  # mean shape of each of the element's coordinates along the port
    rest: float  # curvature at rest [1/m]
    own: tuple[float, ...] = ()  # values of ``SectionLaw.own`` there


@dataclass(frozen=True)
class PlacedLaw:
    """A law of the sections and the ports at which the elements of a finger see the curvature for it."""

    law: SectionLaw
    ports: tuple[Port, ...]

    @classmethod
    def on(cls, family: Family, law: SectionLaw) -> PlacedLaw:
        """Place a law on the elements of a family."""
        count = law.port_rule.count
        match law.port_rule.name:
            case "cells":
                return cls(law, _cells(family, count))
            case "points":
                return cls(law, _points(family, count, *law.own))
        return cls(law, _linear_points(family))


class SectionForces:
    """Generalized forces of laws, and the rates of their states: law by law, port by port.

    ``states`` belong to the laws, by kind, ``rest`` is the curvature at rest [1/m] where it is a run-time argument.
    """

    def __init__(
        self,
        laws: Sequence[PlacedLaw],
        family: Family,
        at: Instant,
        states: Mapping[str, Sequence[Scalar]],
        rest: Scalar | None = None,
    ) -> None:
        self._family, self._rest, self._at = family, rest, at
        self._ports: list[tuple[SectionLaw, Port, Sequence[Scalar]]] = []
        left = {group: iter(entries) for group, entries in states.items()}
        for placed in laws:
            law = placed.law
            for k, port in enumerate(placed.ports, start=1):
                self._ports.append((law, port, [next(left[law.kind]) for _ in law.names(k)]))

    def _weights(self, port: Port) -> tuple[Scalar, list[Scalar]]:
        """Measure of a port, and that times its shapes; its element may have another length at run time."""
        length_factors = self._family.length_factors(port.element, self._at.lengths)
        weights = [port.measure * shape * factor for shape, factor in zip(port.shapes, length_factors, strict=True)]
        h, nominal = self._at.lengths[port.element], self._family.mesh.lengths[port.element]
        return port.measure if isinstance(h, float) else port.measure * (h / nominal), weights

    @cached_property
    def _acting(self) -> list[tuple[SectionLaw, Port, Bend]]:
        acting = []
        for law, port, states in self._ports:
            curvature, rate = (self._mean(port, values) for values in (self._at.full, self._at.rates))
            rest = port.rest if self._rest is None else self._rest
            acting.append((law, port, Bend(curvature, rest, rate, self._at.memory, port.own, states)))
        return acting

    def _mean(self, port: Port, values: Sequence[Scalar]) -> Scalar:
        measure, weights = self._weights(port)
        local = self._family.local(port.element)
        return sum(((w / measure) * values[a] for a, w in zip(local, weights, strict=True) if not is_zero(w)), 0.0)

    def on_elements(self, *kinds: Kind) -> list[list[Scalar]]:
        """Generalized forces of the laws of kinds on the local coordinates of every element, against the bending."""
        total: list[list[Scalar]] = [[0.0] * len(self._family.local(k)) for k in range(self._family.elements)]
        for law, port, bend in self._acting:
            if law.kind in kinds:
                moment = law.moment(bend)
                for i, weight in enumerate(self._weights(port)[1]):
                    if not is_zero(weight):
                        total[port.element][i] += weight * moment
        return total

    def force(self, *kinds: Kind) -> list[Scalar]:
        """Generalized forces of the laws of kinds on all coordinates, against the bending."""
        return gathered(self._family, self.on_elements(*kinds))

    def rates(self, kind: Kind) -> list[Scalar]:
        return [rate for law, _, bend in self._acting if law.kind == kind for rate in law.rates(bend)]

    @property
    def travel(self) -> list[Scalar]:
        """Travel of all friction states since the unloaded shape, per the sliding travel of each [1]."""
        return [way for law, _, bend in self._acting for way in law.travel(bend)]

    @property
    def stored_energy(self) -> Scalar:
        """Energy that the laws store [J]."""
        return sum((self._weights(port)[0] * law.energy(bend) for law, port, bend in self._acting), 0.0)


def _cells(family: Family, count: int) -> tuple[Port, ...]:
    """The mean curvature of equal parts, ``count`` on each element; of the whole element where the curvature is
    constant.

    A law of the moment m has there the work of an even moment on the turn of a part, by its mean stiffness: a linear
    law acts as the elasticity does where elements bend as evenly as they can. For an even moment this is the harmonic
    mean, by which a soft piece beside a stiff one counts by its bend; of a constant curvature the plain one.
    """
    mesh = family.mesh
    base = family.mesh.own_stiffness
    ports = list[Port]()
    count, power = (count, -1.0) if family.degree else (1, 1.0)
    for element in range(family.elements):

        def turned(s: Array, element: int = element) -> Array:
            return np.vstack([family.shapes_at(element, s), np.ones_like(s)])

        for a, b in pairwise(np.linspace(*mesh.span(element), count + 1).tolist()):
            *total, length = mesh.integral(a, b, turned, mesh.stiffness, mesh.rest).tolist()
            powers, ones = (
                float(mesh.integral(a, b, each, mesh.stiffness))
                for each in (lambda s: (mesh.stiffness(s) / base) ** power, np.ones_like)
            )
            *shapes, rest = (each / length for each in total)
            ports.append(Port(element, length * (powers / ones) ** power, _clean(np.array(shapes)), rest))
    return tuple(ports)


def _points(family: Family, count: int, *curves: Curve) -> tuple[Port, ...]:
    """The curvature at ``count`` points of each part of an element between jumps of the rod or of curves, by Gauss
    quadrature, with the values of curves there.
    """
    mesh = family.mesh
    ports = list[Port]()
    for element, h in enumerate(mesh.lengths):
        start, end = mesh.span(element)
        edges = [start, *_jumps(mesh, start, end, mesh.stiffness, mesh.rest, *curves), end]
        # A whole element has the length that it is said to have, to the last bit.
        parts = [(a, b - a) for a, b in pairwise(edges)] if len(edges) > 2 else [(start, h)]
        ports += [port for part in parts for port in _gauss(family, element, *part, count, curves)]
    return tuple(ports)


def _linear_points(family: Family) -> tuple[Port, ...]:
    """Ports by which a law linear in the curvature acts as the elasticity does, one per coordinate of an element.

    With the integrals G of B f f' and A of B s f f' over an element, of its stiffness B and its shapes f, they are the
    solutions of A v = s G v: then G is the sum of G v v' G. Along a uniform rod these are Gauss's points and weights
    (G. H. Golub, J. H. Welsch, Math. Comp. 23 (1969), doi:10.1090/S0025-5718-69-99647-1).
    """
    from scipy.linalg import eigh

    mesh = family.mesh
    ports = list[Port]()
    for element, h in enumerate(mesh.lengths):
        start, end = mesh.span(element)
        if mesh.constant(mesh.stiffness, element) is not None:
            ports += _gauss(family, element, start, h, family.degree + 1)
            continue

        def products(s: Array, element: int = element, start: float = start) -> Array:
            bent = family.shapes_at(element, s)[:-1]
            return (np.stack([np.ones_like(s), s - start])[:, None, None] * bent[:, None] * bent) * mesh.stiffness(s)

        gram, first = mesh.integral(start, end, products, mesh.stiffness) / mesh.own_stiffness
        places, vectors = eigh(first, gram)
        for place, share in zip(places, (gram @ vectors).T, strict=True):
            *there, rest = family.shapes_at(element, np.array([start + place]))[:, 0].tolist()
            # In units of the curvature there, whichever sign the vector has.
            scale = float(np.dot(there, there) / np.dot(share, there))
            ports.append(Port(element, scale**-2, _clean(scale * share), rest))
    return tuple(ports)


def _jumps(mesh: Mesh, start: float, end: float, *curves: Curve) -> list[float]:
    """Places between two others where curves jump [m], increasing."""
    least = SAME * mesh.ends[-1]
    return sorted({at for curve in curves for at in curve.jumps if start + least < at < end - least})


def _gauss(
    family: Family, element: int, start: float, length: float, count: int, curves: Sequence[Curve] = ()
) -> Iterator[Port]:
    """Ports at Gauss's points of a part of an element."""
    mesh, (nodes, weights) = family.mesh, np.polynomial.legendre.leggauss(count)
    s = start + 0.5 * length * (nodes + 1.0)
    measures = 0.5 * length * weights * mesh.stiffness(s) / mesh.own_stiffness
    numbers = np.array([curve(s) for curve in curves]).reshape(len(curves), count)
    for measure, (*shapes, rest), own in zip(measures, family.shapes_at(element, s).T, numbers.T, strict=True):
        yield Port(element, float(measure), _clean(np.array(shapes)), float(rest), tuple(own.tolist()))


def _clean(shapes: Array) -> list[float]:
    """Without terms of rounding, which would cost an instruction."""
    cleaned: list[float] = np.where(np.abs(shapes) < 1e-12 * np.abs(shapes).max(), 0.0, shapes).tolist()
    return cleaned
