"""Places along a finger at which laws of the sections see how it bends: means over parts, points of quadrature."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.family import Family, Mesh
from continuum_grasp.model.laws.section import Port
from continuum_grasp.scene import SAME, Curve


def cells(family: Family, count: int) -> tuple[Port, ...]:
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


def points(family: Family, count: int, *curves: Curve) -> tuple[Port, ...]:
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


def linear_points(family: Family) -> tuple[Port, ...]:
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
