"""A link shared by all elements of a finger: each element is a row of numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.arc import Arc
from continuum_grasp.model.collocated import CollocatedLink
from continuum_grasp.model.family import Family, RodProperties
from continuum_grasp.model.link import is_end
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.tabulated import TabulatedLink


@dataclass(frozen=True)
class Pattern:
    """A link of local coordinates and of a row (T,), and the rows (N, T)."""

    rows: Array
    link: Callable[[Sequence[Scalar], ca.SX], TabulatedLink | Arc]


def pattern_of(family: Family, rod: RodProperties) -> Pattern | None:
    """The pattern of all elements, without their point masses; None where they are of several kinds.

    Lengths must be numbers; factors of the densities and the curvature at rest may be run-time arguments.
    """
    density, rotary = (1.0 if isinstance(f, float) else f for f in (rod.linear_density, rod.rotary_inertia))
    numeric = [f if isinstance(f, float) else 1.0 for f in (rod.linear_density, rod.rotary_inertia)]
    plain = RodProperties(rod.lengths, numeric[0], numeric[1], None, ())
    links = [loaded.link for loaded in family.links([0.0] * family.size, plain)]
    arcs = [link for link in links if isinstance(link, Arc)]
    if len(arcs) == len(links):
        reach, accuracy = max(arc.angle_range for arc in arcs), min(arc.accuracy for arc in arcs)

        def arc(local: Sequence[Scalar], row: ca.SX) -> Arc:
            theta = local[0] + (row[0] if rod.rest is None else row[1] * rod.rest)
            return Arc(theta, row[1], density * row[2], rotary * row[3], reach, accuracy)

        rows = [(arc.theta, arc.length, arc.linear_density, arc.rotary_inertia) for arc in arcs]
        return Pattern(np.array(rows, dtype=float), arc)
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


def one_link_serves(made: Structure) -> bool:
    """Whether sweeps along the chain may solve the equations of motion: of many elements that differ by numbers, and
    of laws that depend on one element each or on states.
    """
    runtime = made.parameters.is_runtime
    return (
        len(made.lengths) >= FEWEST_ELEMENTS
        # Contact forces depend on the motion of all elements.
        and not made.touches_object
        # The length of all elements depends on the input.
        and made.finger.gyration_radius is None
        and not runtime("element_lengths")
        # A known moment that ends inside an element is a coordinate of that element alone.
        and len({len(made.family.local(k)) for k in range(len(made.lengths))}) == 1
        and all(is_end(at.fraction) and (at == made.tip or not runtime(name)) for name, at in made.masses())
        # Elements in which the rod jumps have more ports of a law than others.
        and all(len(set(Counter(port.element for port in placed.ports).values())) == 1 for placed in made.laws)
    )
