"""One link for all elements of a finger: what it needs to know of each of them is a row of numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from continuum_grasp.model.arc import Arc
from continuum_grasp.model.collocated import CollocatedLink
from continuum_grasp.model.family import Array, Family, Rod
from continuum_grasp.model.link import is_end
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.tabulated import TabulatedLink


@dataclass(frozen=True)
class Pattern:
    """A link of local coordinates and of a row (T,), and the rows (N, T)."""

    rows: Array
    link: Callable[[Sequence[Scalar], ca.SX], TabulatedLink | Arc]


def pattern_of(family: Family, rod: Rod) -> Pattern | None:
    """The pattern of all elements, without their point masses; None where they are of several kinds.

    Lengths must be numbers; factors of the densities and the curvature at rest may be run-time arguments.
    """
    density, rotary = (1.0 if isinstance(f, float) else f for f in (rod.linear_density, rod.rotary_inertia))
    numeric = [f if isinstance(f, float) else 1.0 for f in (rod.linear_density, rod.rotary_inertia)]
    plain = Rod(rod.lengths, numeric[0], numeric[1], None, ())
    links = [loaded.link for loaded in family.links([0.0] * family.size, plain)]
    arcs = [link for link in links if isinstance(link, Arc)]
    if len(arcs) == len(links):
        reach, accuracy = max(arc.angle_range for arc in arcs), min(arc.accuracy for arc in arcs)

        def arc(local: Sequence[Scalar], row: ca.SX) -> Arc:
            theta = local[0] + (row[0] if rod.rest is None else row[1] * rod.rest)
            return Arc(theta, row[1], density * row[2], rotary * row[3], reach, accuracy)

        return Pattern(np.array([arc.numbers for arc in arcs], dtype=float), arc)
    collocated = [link for link in links if isinstance(link, CollocatedLink)]
    if len(collocated) < len(links):
        return None
    # Links of fewer nodes get further ones of no weight.
    count = max(link.count for link in collocated)
    tables = [link.table(count, straight=rod.rest is not None) for link in collocated]
    steps = np.max([link.reach(count) for link in collocated], axis=0).tolist()

    def link(local: Sequence[Scalar], row: ca.SX) -> TabulatedLink:
        table, rest = tables[0].filled(row), 1.0 if rod.rest is None else rod.rest
        return TabulatedLink(table, table.turned(local, rest, steps), 1.0, density, rotary)

    return Pattern(np.array([table.numbers for table in tables]), link)


FEWEST_ELEMENTS = 16
"""Elements from which on sweeps are taken [1]: fewer are one straight program, which vector lanes and derivatives take
as it is (``python -m benchmarks.bench_elements``)."""


def why_dense(made: Structure) -> str:
    """Why a finger solves its equations of motion densely; empty where sweeps along the chain may solve them."""
    if made.around is not None:
        return "an object, whose contact forces depend on the motion of all elements"
    if len(made.lengths) < FEWEST_ELEMENTS:
        return f"fewer than {FEWEST_ELEMENTS} elements"
    if made.parameters.is_runtime("element_lengths"):
        return "element_lengths at run time"
    if made.residual is not None:
        return "a learned residual"
    if len({len(made.family.local(k)) for k in range(len(made.lengths))}) > 1:
        return "a known moment that ends inside an element"
    for name, place in made.masses():
        if not is_end(place.fraction):
            return f"{name} inside an element"
        if place != made.tip and made.parameters.is_runtime(name):
            return f"{name} at run time"
    return ""
