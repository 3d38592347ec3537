"""A finger at rest, with all its places and forces written once: for problems that differentiate them twice.

The tangents (-sin phi, cos phi) at the Gauss nodes of each element are written once. Every place on the element is a
weighted sum of them, by the integral of the polynomial through them, and so are the ends of the elements, by the Gauss
weights; the forces that are missing for rest are the gradient of the work of loads. Sines and cosines are instructions
here, not the polynomials of `continuum_grasp.model.stumpff`: their derivatives are each other, so that second
derivatives share them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.model.collocated import CollocatedLink
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.layout import place_at
from continuum_grasp.model.link import Link
from continuum_grasp.model.planar import Scalar, column
from continuum_grasp.model.quadrature import RANGES, Collocation, collocation, node_count, running_weights

_MOST_NODES = 16
"""Of arcs beyond one turn: exact to 1e-10 up to two [1]."""


@dataclass(frozen=True)
class _Element:
    """An element as expressions."""

    link: Link
    rule: Collocation
    length: Scalar
    point: ca.SX  # of its start (2,)
    angle: Scalar  # of its start
    tangents: ca.SX  # at the nodes (2, m)

    def at(self, fractions: Any) -> ca.SX:
        """Positions (2, K) at fractions (1, K) of the length, numbers or expressions."""
        weights = running_weights(len(self.rule.nodes), fractions)
        return self.point + self.length * (self.tangents @ ca.SX(weights))

    def angle_at(self, fraction: Scalar) -> Scalar:
        return self.angle + self.link.bend(fraction)

    def way_to(self, fraction: Scalar) -> ca.SX:
        """From its start to a fraction (2,), by the rule on that part alone: as exact as the end, which `at` is not
        (1e-6 of the length where the curvature changes from one limit to the other).
        """
        angles = column([self.angle_at(fraction * float(u)) for u in self.rule.nodes]).T
        return fraction * self.length * (ca.vertcat(-ca.sin(angles), ca.cos(angles)) @ ca.DM(self.rule.weights))

    @property
    def end(self) -> ca.SX:
        return self.point + self.length * (self.tangents @ ca.DM(self.rule.weights))

    @property
    def first_moment(self) -> ca.SX:
        """Integral of the position along it (2,)."""
        return self.length * (self.point + self.length * (self.tangents @ ca.DM(self.rule.mean_weights)))


class Backbone:
    """Functions of the places of a finger of uniform elements, and of its equilibrium; see `FingerModel.backbone`."""

    def __init__(self, equations: Equations) -> None:
        self._eq = equations
        self._elements: list[_Element] = []
        structure = equations.structure
        accuracy = structure.accuracy or structure.family.default_accuracy
        point, angle = column(equations._par.vector("base_position")), equations._par["base_angle"]
        links = (loaded.link for loaded in equations.chain.links)
        for link, h, reach in zip(links, equations.lengths, structure.ranges, strict=True):
            if isinstance(link, CollocatedLink):
                rule = link.rule
            else:
                rule = collocation(node_count(reach, accuracy) if reach <= RANGES[-1] else _MOST_NODES)
            angles = column([angle + link.bend(float(u)) for u in rule.nodes]).T
            element = _Element(link, rule, h, point, angle, ca.vertcat(-ca.sin(angles), ca.cos(angles)))
            self._elements.append(element)
            point, angle = element.end, element.angle_at(1.0)

    def _function(self, name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
        eq = self._eq
        return ca.Function(name, [eq.q, eq.u, *inputs, eq.p], ca.cse([ca.SX(value) for value in outputs]))

    @cached_property
    def joints(self) -> ca.Function:
        """``(q, u, p)``: world positions (2, N) and angles (N,) of the ends of the elements."""
        return self._function("joints", [], [self._ends, self._angles])

    @cached_property
    def _ends(self) -> ca.SX:
        return ca.horzcat(*(element.end for element in self._elements))

    @cached_property
    def _angles(self) -> ca.SX:
        return column([element.angle_at(1.0) for element in self._elements])

    def places(self, count: int) -> ca.Function:
        """``(q, u, f, p)``: world positions (2, count N) at fractions f (count, N) of the elements."""
        f = ca.SX.sym("f", count, len(self._elements))
        points = [element.at(f[:, k].T) for k, element in enumerate(self._elements)]
        return self._function("places", [f], [ca.horzcat(*points)])

    def fixed_places(self, fractions: Sequence[float]) -> ca.Function:
        """``(q, u, p)``: world positions (2, count N) at fractions (count,) of every element."""
        points = [element.at(np.array([fractions])) for element in self._elements]
        return self._function("fixed_places", [], [ca.horzcat(*points)])

    @cached_property
    def section(self) -> ca.Function:
        """``(q, u, s, p)``: world position (2,) and angle of the section at s."""
        s = ca.SX.sym("s")
        point, angle = self._section(s)
        return self._function("section", [s], [point, ca.SX(angle)])

    def _section(self, s: Scalar) -> tuple[ca.SX, Scalar]:
        """Each element up to s, or all of it: one expression for all s."""
        first = self._elements[0]
        point, angle, start = first.point, first.angle, ca.SX(0.0)
        for element in self._elements:
            reach = ca.fmin(ca.fmax((s - start) / element.length, 0.0), 1.0)
            point, angle = point + element.way_to(reach), angle + element.link.bend(reach)
            start += element.length
        return point, angle

    def missing(self, masses: int = 0) -> ca.Function:
        """``(q, u, w, m, p)``, or ``(q, u, w, m, history, p)`` of fingers with friction: generalized force (n,) that is
        missing for rest.

        ``m`` (2, masses) are masses and where they are, beside those of the finger; ``history`` is that of
        `FingerModel`.
        """
        eq = self._eq
        m = ca.SX.sym("m", 2, masses)
        elastic, driven = (column(force[: eq.q.numel()]) for force in (eq.elastic, eq.resting.actuation))
        force = elastic - driven - ca.gradient(self._work(m), eq.q)
        force += column(eq.resting.sections.force("friction")[: eq.q.numel()])
        history = [eq.history] if eq.history.numel() else []
        return self._function("missing", [eq.w, m, *history], [force])

    @cached_property
    def mean_shares(self) -> ca.Function:
        """``(q, u, history, p)``: mean along the finger of the tension of each tendon, per that at the base."""
        eq, lengths = self._eq, column(self._eq.lengths)
        found: list[Scalar] = []
        for cells, passed in zip(eq.structure.cell_sets, eq.resting.tendons.shares, strict=True):
            # Of all tendons of the set; cells are equal parts of their elements.
            spans = [eq.lengths[cell.element] * (len(eq.lengths) / len(cells.cells)) for cell in cells.cells]
            for mean in passed.mean:
                found.append(sum((h * share for h, share in zip(spans, mean, strict=True)), 0.0) / ca.sum1(lengths))
        return self._function("mean_shares", [eq.history], [ca.vertcat(*found)])

    def _work(self, masses: ca.SX) -> ca.SX:
        """Work of loads and weight, whose gradient are their generalized forces."""
        eq, made, work = self._eq, self._eq.structure, ca.SX(0.0)
        ends, angles = self._ends, self._angles
        places = [place_at(at, made.lengths).link for at in made.contacts] + [made.tip.link] * made.tip_force
        for k, element in enumerate(places):
            work += ca.dot(eq.w[2 * k : 2 * k + 2], ends[:, element])
        for load, (vector, start) in zip(made.loads, made.load_entries, strict=True):
            if vector == "w":
                work += eq.w[start] * angles[place_at(load.at, made.lengths).link]
        weight = column(eq._par.vector("gravity"))
        if weight.is_zero():
            return work
        moment = eq.rod.linear_density * sum((e.first_moment for e in self._elements), ca.SX.zeros(2))
        for element, fraction, mass in eq.rod.masses:
            moment += mass * self._elements[element].at(fraction)
        for k in range(masses.shape[1]):
            moment += masses[0, k] * self._section(masses[1, k])[0]
        return work + ca.dot(weight, moment)
