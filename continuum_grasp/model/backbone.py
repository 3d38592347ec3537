"""A finger at rest, with all its places and forces written once: for problems that differentiate them twice.

The tangents (-sin phi, cos phi) at the Gauss nodes of each element are written once. Every place on the element is a
weighted sum of them, by the integral of the polynomial through them, and so are the ends of the elements, by the Gauss
weights; the forces that are missing for rest are the gradient of the work of loads. Sines and cosines are instructions
here, not the polynomials of `continuum_grasp.model.stumpff_functions`: their derivatives are each other, so that second
derivatives share them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.collocated import CollocatedLink
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.layout import place_at
from continuum_grasp.model.link import Link
from continuum_grasp.model.node_counts import RANGES, node_count
from continuum_grasp.model.planar import Scalar, column, matrix
from continuum_grasp.model.quadrature import Collocation, collocation, running_weights


class Panel(ABC):
    """A part of an element along which the curvature is smooth, as expressions: all of an element that is uniform.

    It begins at ``start`` along the finger, with a section at ``point`` (2,) with ``angle``.
    """

    def __init__(self, rule: Collocation, start: Scalar, length: Scalar, point: ca.SX, angle: Scalar) -> None:
        self.rule = rule
        self.start = start
        self.length = length
        self.point = point
        self.angle = angle
        _, bends, bend = self.up_to(None)
        self.tangents, self.end_angle = _tangents(angle + bends), angle + bend  # at the nodes (2, m)
        self.end = point + length * (self.tangents @ ca.DM(rule.weights))

    @abstractmethod
    def up_to(self, s: Scalar | None) -> tuple[Scalar, ca.SX, Scalar]:
        """Length of its part up to a place s, or of all of it; bends (m,) from its start to the nodes of that part, and
        to its end.
        """

    @property
    @abstractmethod
    def first_moment(self) -> ca.SX:
        """Integral of density times position along it (2,)."""

    @abstractmethod
    def bends(self, fractions: Array) -> ca.SX:
        """Bends (K,) from its start to fractions of its length."""

    @abstractmethod
    def per_length(self, fractions: Array) -> tuple[ca.SX, ca.SX]:
        """Mass per length, and bending stiffness, at fractions of its length (K,)."""

    def at(self, fractions: Any) -> ca.SX:
        """Positions (2, K) at fractions (1, K) of the length, numbers or expressions: 1e-6 of the length off where the
        curvature changes from one limit to the other, which `section` is not.
        """
        return self.point + self.length * (self.tangents @ ca.SX(running_weights(len(self.rule.nodes), fractions)))

    def section(self, s: Scalar) -> tuple[ca.SX, Scalar]:
        """From its start to a place (2,), and the bend, by the rule on that part alone: as exact as the end."""
        length, bends, bend = self.up_to(s)
        return length * (_tangents(self.angle + bends) @ ca.DM(self.rule.weights)), bend


class _Uniform(Panel):
    """An element that is a link of the model."""

    def __init__(self, link: Link, density: Scalar, stiffness: Scalar, *place: Any) -> None:
        self.link = link
        self.density = density
        self.stiffness = stiffness
        super().__init__(*place)

    def up_to(self, s: Scalar | None) -> tuple[Scalar, ca.SX, Scalar]:
        nodes = ca.SX(ca.DM(self.rule.nodes))
        bend = self.link.bend
        if s is None:
            return self.length, ca.SX(bend(nodes)), bend(1.0)
        reach = ca.fmin(ca.fmax((s - self.start) / self.length, 0.0), 1.0)
        return reach * self.length, ca.SX(bend(reach * nodes)), bend(reach)

    def bends(self, fractions: Array) -> ca.SX:
        return ca.SX(self.link.bend(ca.SX(ca.DM(fractions))))

    def per_length(self, fractions: Array) -> tuple[ca.SX, ca.SX]:
        return self.density * ca.SX.ones(fractions.size), self.stiffness * ca.SX.ones(fractions.size)

    @property
    def first_moment(self) -> ca.SX:
        inside = self.length * (self.tangents @ ca.DM(self.rule.mean_weights))
        return self.density * (self.length * (self.point + inside))


def _tangents(angles: ca.SX) -> ca.SX:
    return ca.vertcat(-ca.sin(angles.T), ca.cos(angles.T))


class Backbone:
    """Functions of the places of a finger of uniform elements, and of its equilibrium; see `backbone_of`.

    ``lengths`` belong to the elements, ``p`` are the run-time arguments of the functions.
    """

    def __init__(self, equations: Equations, lengths: Sequence[Scalar] | None = None, p: ca.SX | None = None) -> None:
        self._eq = equations
        self.lengths = equations.lengths if lengths is None else lengths
        self.p = equations.p if p is None else p
        self.elements: list[list[Panel]] = []
        start: Scalar = ca.SX(0.0)
        point = column(equations._par.vector("base_position"))
        angle = equations._par["base_angle"]
        for k, h in enumerate(self.lengths):
            self.elements.append(self._panels(k, start, point, angle))
            last = self.elements[-1][-1]
            start = start + h
            point = last.end
            angle = last.end_angle

    def _panels(self, k: int, start: Scalar, point: ca.SX, angle: Scalar) -> list[Panel]:
        """Panels of an element, from its first section on."""
        link = self._eq.chain.links[k].link
        made = self._eq.structure
        reach = made.ranges[k]
        accuracy = made.accuracy or made.family.default_accuracy
        if isinstance(link, CollocatedLink):
            rule = link.rule
        else:
            # 16: nodes of arcs beyond one turn: exact to 1e-10 up to two
            rule = collocation(node_count(reach, accuracy) if reach <= RANGES[-1] else 16)
        density = self._eq.rod.linear_density
        stiffness = self._eq._par["bending_stiffness"]
        return [_Uniform(link, density, stiffness, rule, start, self.lengths[k], point, angle)]

    def _function(self, name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
        """Return a function of expressions; it computes common parts once if the whole problem is available."""
        eq = self._eq
        return ca.Function(name, [eq.q, eq.u, *inputs, self.p], [ca.SX(value) for value in outputs])

    @cached_property
    def joints(self) -> ca.Function:
        """``(q, u, p)``: world positions (2, N) and angles (N,) of the ends of the elements."""
        return self._function("joints", [], [self._ends, self._angles])

    @cached_property
    def _ends(self) -> ca.SX:
        return ca.horzcat(*(element[-1].end for element in self.elements))

    @cached_property
    def _angles(self) -> ca.SX:
        return column([element[-1].end_angle for element in self.elements])

    @property
    def panels(self) -> int:
        """Number of panels of each element."""
        return len(self.elements[0])

    def nodes(self, count: int) -> ca.Function:
        """``(q, u, p)``: lengths of the panels; at ``count`` Gauss nodes of each, M in all, positions (2, M), tangents
        (2, M), mass per length (M,) and bending stiffness (M,); beyond each of them the mass (M,), and the integral of
        mass times position (2, M).
        """
        rule = collocation(count)
        panels = [panel for element in self.elements for panel in element]
        points, tangents, densities, stiffness, masses, moments = (list[ca.SX]() for _ in range(6))
        mass = ca.SX(0.0)
        moment = ca.SX.zeros(2)
        for panel in panels:
            density, stiff = panel.per_length(rule.nodes)
            here = panel.at(rule.nodes[None])
            there = here * ca.repmat(density.T, 2, 1)
            points.append(here)
            tangents.append(_tangents(panel.angle + panel.bends(rule.nodes)))
            densities.append(density)
            stiffness.append(stiff)
            # From the base, up to each node.
            masses.append(mass + panel.length * (ca.DM(rule.running) @ density))
            moments.append(ca.repmat(moment, 1, count) + panel.length * (there @ ca.DM(rule.running).T))
            mass = mass + panel.length * ca.dot(ca.DM(rule.weights), density)
            moment = moment + panel.length * (there @ ca.DM(rule.weights))
        beyond = [mass - ca.vertcat(*masses), ca.repmat(moment, 1, count * len(panels)) - ca.horzcat(*moments)]
        lengths = column([panel.length for panel in panels])
        along = [ca.horzcat(*points), ca.horzcat(*tangents), ca.vertcat(*densities), ca.vertcat(*stiffness)]
        return self._function("nodes", [], [lengths, *along, *beyond])

    def places(self, count: int) -> ca.Function:
        """``(q, u, f, p)``: world positions (2, count N) at fractions f (count, N) of the elements."""
        f = ca.SX.sym("f", count, len(self.elements))
        points = [self._at(k, f[:, k].T) for k in range(len(self.elements))]
        return self._function("places", [f], [ca.horzcat(*points)])

    def _at(self, element: int, fractions: Any) -> ca.SX:
        """World positions (2, K) at fractions (1, K) of an element."""
        return self.elements[element][0].at(fractions)

    def fixed_places(self, count: int) -> tuple[ca.Function, list[int]]:
        """``(q, u, p)``: world positions (2, K) of places on every element, ``count`` at most, and where along the
        finger these are (K,); and the elements that they are on.
        """
        even = (np.arange(count) + 0.5) / count
        points = []
        places = []
        for k, element in enumerate(self.elements):
            points.append(self._at(k, even[None]))
            places += [element[0].start + share * self.lengths[k] for share in even.tolist()]
        owners = [k for k in range(len(self.elements)) for _ in even]
        return self._function("fixed_places", [], [ca.horzcat(*points), column(places)]), owners

    @cached_property
    def section(self) -> ca.Function:
        """``(q, u, s, p)``: world position (2,) and angle of the section at s."""
        s = ca.SX.sym("s")
        point, angle = self._section(s, self.elements)
        return self._function("section", [s], [point, ca.SX(angle)])

    def line(self, count: int) -> ca.Function:
        """``(q, u, p)``: evenly along the finger where, world position (2,) and angle of sections: (4, count)."""
        eq = self._eq
        s = ca.SX.sym("s")
        point, angle = self._section(s, self.elements)
        place = ca.Function("place", [s, eq.q, eq.u, self.p], [ca.cse(ca.vertcat(s, point, angle))])
        # Mapped, not unrolled: the expression of one place serves all.
        along = ca.DM(np.linspace(0.0, 1.0, count)).T
        mapped = place.map(count, [False, True, True, True], [False])
        state = [ca.MX.sym(name, symbol.numel()) for name, symbol in (("q", eq.q), ("u", eq.u), ("p", self.p))]
        return ca.Function("line", state, [mapped(along, *state)])

    def _section(self, s: Scalar, elements: Sequence[Sequence[Panel]]) -> tuple[ca.SX, Scalar]:
        """Integrals over each panel of some elements up to s, or all of it: one expression for all s."""
        panels = [panel for element in elements for panel in element]
        point, angle = panels[0].point, panels[0].angle
        for panel in panels:
            way, bend = panel.section(s)
            point, angle = point + way, angle + bend
        return point, angle

    @cached_property
    def curvatures(self) -> ca.Function:
        """``(q, u, f, p)``: curvatures (degree + 1, N) at the ``places`` of the elements, and bends, the curvatures
        times the lengths. Strain limits apply to them, also at fractions f of the elements if the limit changes along
        them.
        """
        eq = self._eq
        at, bends = (matrix(list(zip(*rows, strict=True))) for rows in (eq.curvatures, eq.greatest_bends))
        return self._function("curvatures", [ca.SX.sym("f", 0)], [column(eq.curvature), at, bends])

    @cached_property
    def drawn(self) -> ca.Function:
        """``(q, u, p)``: how far the bend draws in the first tendon, per offset at the base."""
        return self._function("drawn", [], [self._angles[-1]])

    @cached_property
    def stored(self) -> ca.Function:
        """``(q, u, p)``: coordinates, and the curvature at the tip, which a matched tip has from the moments there."""
        return self._function("stored", [], [self._eq.q, ca.SX(self._eq.curvatures[-1][-1])])

    def missing(self, masses: int = 0) -> ca.Function:
        """``(q, u, w, m, history, p)``: missing generalized force (n,) for rest.

        ``m`` (2, masses) has additional masses and their places; ``history`` is as in `FingerModel`, empty without
        friction.
        """
        eq = self._eq
        m = ca.SX.sym("m", 2, masses)
        force = self._resisting() - ca.gradient(self._work(m), eq.q)
        force += column(eq.resting.sections.force("friction")[: eq.q.numel()])
        return self._function("missing", [eq.w, m, eq.history], [force])

    def _resisting(self) -> ca.SX:
        """Generalized force of the elasticity less the force of tendons and couples of the input."""
        elastic, driven = (
            column(force[: self._eq.q.numel()]) for force in (self._eq.elastic, self._eq.resting.actuation)
        )
        return elastic - driven

    @cached_property
    def mean_shares(self) -> ca.Function:
        """``(q, u, history, p)``: mean along the finger of the tension of each tendon, per that at the base."""
        eq = self._eq
        nominal = self._eq.structure.lengths
        shares = list[Scalar]()
        for cells, passed in zip(eq.structure.tendon_sets, eq.resting.tendons.shares, strict=True):
            spans = [cell.length / nominal[cell.element] * eq.lengths[cell.element] for cell in cells.cells]
            for mean in passed.mean:
                whole = sum((h * share for h, share in zip(spans, mean, strict=True)), 0.0)
                shares.append(whole / ca.sum1(column(self.lengths)))
        return self._function("mean_shares", [eq.history], [ca.vertcat(*shares)])

    def _work(self, masses: ca.SX) -> ca.SX:
        """Work of loads and weight, whose gradient are their generalized forces."""
        eq = self._eq
        made = self._eq.structure
        work = ca.SX(0.0)
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
        moment = sum((panel.first_moment for element in self.elements for panel in element), ca.SX.zeros(2))
        for element, fraction, mass in eq.rod.masses:
            moment += mass * self._at(element, fraction)
        for k in range(masses.shape[1]):
            moment += masses[0, k] * self._section(masses[1, k], self.elements)[0]
        return work + ca.dot(weight, moment)
