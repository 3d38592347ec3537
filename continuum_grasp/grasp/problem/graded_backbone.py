"""Statics of a finger that changes along its length, in units of its own: length and mean bending stiffness are 1.

The bending moment is m(s) = r(s) + K(s), with r linear on each element and continuous, and K the moment of the tendons,
of families whose tip is matched; of others K is part of the loads and not of the shape. The curvature is
k*(s) + m(s) / EI(s), by Gauss-Legendre collocation in every part of an element between two breaks of the curves.
Elements move along the finger, so a part without length stands for each break that is elsewhere: exact, and smooth
where a contact passes one.

The laws of tendons and sections are those of the model: what they see of each element are integrals over its parts.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any

import casadi as ca

from continuum_grasp.grasp.problem.curves import Curves, CurvesSpec
from continuum_grasp.model import FingerModel
from continuum_grasp.model.backbone import Backbone, Panel
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.laws.section import Port
from continuum_grasp.model.planar import Scalar, column, matrix
from continuum_grasp.model.quadrature import collocation, node_count
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.tendon_friction import Cell

_GRADED_NODES = 2
"""Nodes beside those of a uniform element: a taper of 1:4 in four elements is then within 1e-7 (tests measure it)."""


class _Part(Panel):
    """A part of an element between two breaks of the curves."""

    def __init__(self, backbone: GradedBackbone, element: int, number: int, *place: Any) -> None:
        self._backbone, self._on = backbone, (element, number)
        super().__init__(*place)

    def up_to(self, s: Scalar | None) -> tuple[Scalar, ca.SX, Scalar]:
        width = self.length
        if s is not None:
            width = ca.fmin(ca.fmax(s, self.start), self.start + self.length) - self.start
        bent = column([self._backbone.curvature(*self._on, self.start + width * u) for u in self.rule.nodes.tolist()])
        return width, width * (ca.DM(self.rule.running) @ bent), width * ca.dot(ca.DM(self.rule.weights), bent)

    @property
    def nodes(self) -> list[tuple[Scalar, Scalar]]:
        """Places along the finger, and weights of integrals over the part."""
        rule = zip(self.rule.nodes.tolist(), self.rule.weights.tolist(), strict=True)
        return [(self.start + self.length * u, self.length * weight) for u, weight in rule]

    @property
    def points(self) -> ca.SX:
        """Positions (2, m) of the nodes."""
        return self.point + self.length * (self.tangents @ ca.DM(self.rule.running).T)

    @property
    def first_moment(self) -> ca.SX:
        density = [weight * self._backbone.curves.on("density", self._on[1], s) for s, weight in self.nodes]
        return self.points @ column(density)


class GradedBackbone(Backbone):
    """As `Backbone`, of curves along the finger that are run-time arguments.

    These are the lengths of the elements, the curves, the moment per coordinate at each node and the tendons' shape
    there, at the places where the search began, then those of a model of a uniform finger of the same structure.
    """

    elements: list[list[_Part]]  # type: ignore[assignment]

    def __init__(self, model: FingerModel, spec: CurvesSpec) -> None:
        made = model.structure
        count, self._matched = len(made.lengths), made.matched
        sizes = {"lengths": count, "curves": spec.size, "scales": count + 1, "known": count + 1}
        own = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        self.curves, self._scales, self._known = Curves(spec, own["curves"]), own["scales"], own["known"]
        lengths = ca.vertsplit(own["lengths"])
        self.ends = [ca.SX(0.0), *accumulate(lengths)]
        varies = any(curve.name == "stiffness" and curve.degree for curve in spec.curves)
        nodes = node_count(made.ranges[0], made.accuracy) + (_GRADED_NODES if varies else 0)
        self._rule = collocation(min(nodes, 16))
        equations = Equations(self._along(made))
        self._pulls = 0.0 if made.cell_sets else equations.commanded[0].moment
        super().__init__(equations, lengths, ca.vertcat(*own.values(), equations.p))

    def _along(self, made: Structure) -> Structure:
        """The structure, whose laws see the curves."""
        found, count = copy(made), len(made.lengths)
        found.cell_sets = tuple(
            replace(cells, cells=tuple(self._cells(len(cells.cells) // count))) for cells in made.cell_sets
        )
        found.laws = [replace(law, ports=tuple(self._ports(len(law.ports) // count))) for law in made.laws]
        return found

    # -- curvature -----------------------------------------------------------------------------------------------

    @cached_property
    def nodal(self) -> list[ca.SX]:
        """Moments r at the nodes."""
        moments, couple = self._scales[: self._eq.q.numel()] * self._eq.q, self._eq.u[-1]
        if not self._matched:
            return list(ca.vertsplit(moments))
        return [*ca.vertsplit(moments - self._known[:-1] * self._pulls), couple]

    def _late(self, k: int, s: Any) -> Any:
        """Share of the moment at a place on an element that is that of its end."""
        return (s - self.ends[k]) / (self.ends[k + 1] - self.ends[k])

    def _moment(self, k: int, s: Any) -> ca.SX:
        """Moment r."""
        return self.nodal[k] + (self.nodal[k + 1] - self.nodal[k]) * self._late(k, s)

    def curvature(self, k: int, part: int, s: Any) -> ca.SX:
        """Curvature in a part of an element."""
        curves, moment = self.curves, self._moment(k, s)
        if self._matched:
            moment += self._pulls * curves.on("channel", part, s)
        return curves.on("rest", part, s) + moment / curves.on("stiffness", part, s)

    def _curvature(self, k: int, s: Any, *, tip_side: bool = False) -> ca.SX:
        """Curvature anywhere on an element."""
        curves, side, moment = self.curves, {"tip_side": tip_side}, self._moment(k, s)
        if self._matched:
            moment += self._pulls * curves.at("channel", s, **side)
        return curves.at("rest", s, **side) + moment / curves.at("stiffness", s, **side)

    def _edges(self, a: Any, b: Any) -> list[Any]:
        """Ends of the parts between two places of an element, some without length."""
        return [a, *(ca.fmin(ca.fmax(at, a), b) for at in self.curves.breaks), b]

    def _panels(self, k: int, start: Scalar, point: ca.SX, angle: Scalar) -> list[Panel]:
        found: list[Panel] = []
        for number, (a, b) in enumerate(pairwise(self._edges(self.ends[k], self.ends[k + 1]))):
            found.append(_Part(self, k, number, self._rule, a, b - a, point, angle))
            point, angle = found[-1].end, found[-1].end_angle
        return found

    def _at(self, element: int, fractions: Any) -> ca.SX:
        start, length = self.ends[element], self.lengths[element]
        places = ca.horzsplit(start + ca.SX(fractions) * length)
        return ca.horzcat(*(self._section(s, [self.elements[element]])[0] for s in places))

    # -- what laws see -------------------------------------------------------------------------------------------

    def _integrals(self, k: int, a: Any, b: Any) -> ca.SX:
        """Along a part of an element, of what both coordinates bend, and of the curvature at rest (3, 3): plain, where
        the tendons run; with their shape; and with the place too.
        """
        total = ca.SX.zeros(3, 3)
        for part, (low, high) in enumerate(pairwise(self._edges(a, b))):
            for u, weight in zip(self._rule.nodes.tolist(), self._rule.weights.tolist(), strict=True):
                s = low + (high - low) * u
                shape, late = self.curves.on("channel", part, s), self._late(k, s)
                hats = ca.vertcat(1.0 - late, late) * self._scales[k : k + 2] / self.curves.on("stiffness", part, s)
                own = ((high - low) * weight) * ca.vertcat(hats, self.curves.on("rest", part, s))
                total += ca.horzcat(ca.if_else(shape != 0.0, own, 0.0), shape * own, shape * own * s)
        return total

    def _bounds(self, k: int, count: int) -> list[tuple[Any, Any]]:
        """Equal parts of an element."""
        start, end = self.ends[k : k + 2]
        return list(pairwise([*(start + (j / count) * (end - start) for j in range(count)), end]))

    def _cells(self, count: int) -> list[Cell]:
        """Friction cells of the tendons, so many on each element."""
        found = []
        for k in range(len(self.ends) - 1):
            for a, b in self._bounds(k, count):
                middle = 0.5 * (a + b)
                late = self._integrals(k, middle, b)
                bend, work, first = ca.horzsplit(self._integrals(k, a, middle) + late)
                lean = (first - middle * work) / (b - a)
                columns = (ca.vertsplit(column) for column in (bend, work, lean, late[:, 1]))
                (*bend, rest_bend), (*work, rest_work), (*lean, _), (*late, rest_late) = columns
                found.append(Cell(k, b - a, b - a, bend, work, lean, late, rest_bend, rest_work, rest_late))
        return found

    def _ports(self, count: int) -> list[Port]:
        """Where the laws of the sections see the curvature above rest, so many on each element."""
        found, base = [], self.curves.at("stiffness", 0.0)
        for k in range(len(self.ends) - 1):
            for a, b in self._bounds(k, count):
                measure = ca.SX(0.0)
                for part, (low, high) in enumerate(pairwise(self._edges(a, b))):
                    for u, weight in zip(self._rule.nodes.tolist(), self._rule.weights.tolist(), strict=True):
                        stiffness = self.curves.on("stiffness", part, low + (high - low) * u)
                        measure += ((high - low) * weight) * (stiffness / base)
                # By the stiffness, moments are weighted alike.
                late = self._late(k, 0.5 * (a + b))
                hats = ca.vertcat(1.0 - late, late) * self._scales[k : k + 2] * ((b - a) / base / measure)
                found.append(Port(k, measure, ca.vertsplit(hats), 0.0))
        return found

    # -- statics -------------------------------------------------------------------------------------------------

    def _resisting(self) -> ca.SX:
        total = [ca.SX(0.0) for _ in self.ends]
        for k, element in enumerate(self.elements):
            for number, part in enumerate(element):
                for s, weight in part.nodes:
                    moment, late = self._moment(k, s), self._late(k, s)
                    if not self._matched:
                        moment -= self._pulls * self.curves.on("channel", number, s)
                    bent = weight * moment / self.curves.on("stiffness", number, s)
                    total[k] += (1.0 - late) * bent
                    total[k + 1] += late * bent
        size = self._eq.q.numel()
        force = self._scales[:size] * column(total)[:size]
        return force - column(self._eq.resting.tendons.actuation) if self._eq.structure.cell_sets else force

    def _work(self, masses: ca.SX) -> ca.SX:
        return super()._work(masses) + self._eq.u[-1] * self._angles[-1]

    # -- functions -----------------------------------------------------------------------------------------------

    @cached_property
    def drawn(self) -> ca.Function:
        """``(q, u, p)``: how far the bend draws in the first tendon, per offset at the base."""
        parts = [(k, j, part) for k, element in enumerate(self.elements) for j, part in enumerate(element)]
        whole = sum(
            (
                w * self.curves.on("channel", j, s) * self.curvature(k, j, s)
                for k, j, part in parts
                for s, w in part.nodes
            ),
            ca.SX(0.0),
        )
        return self._function("drawn", [], [whole])

    def fixed_places(self, count: int) -> tuple[ca.Function, list[int]]:
        """Some of the Gauss nodes, which cost nothing."""
        points, places, owners = list[ca.SX](), list[Scalar](), list[int]()
        for k, element in enumerate(self.elements):
            at = ca.horzsplit(ca.horzcat(*(part.points for part in element)))
            nodes = [s for part in element for s, _ in part.nodes]
            few = min(len(nodes), count)
            picks = [int((j + 0.5) * len(nodes) / few) for j in range(few)]
            points += [at[j] for j in picks]
            places += [nodes[j] for j in picks]
            owners += [k] * few
        return self._function("fixed_places", [], [ca.horzcat(*points), column(places)]), owners

    @cached_property
    def curvatures(self) -> ca.Function:
        curves, strained = self.curves, "depth" in self.curves.names
        f, sides, strains = ca.SX.sym("f", len(self.elements) * strained), [], []
        for k, (a, b) in enumerate(pairwise(self.ends)):
            sides.append([self._curvature(k, a, tip_side=True), self._curvature(k, b)])
            if strained:
                for s, tip_side in ((a, True), (b, False), (a + f[k] * (b - a), False)):
                    strains.append(self._curvature(k, s, tip_side=tip_side) * curves.at("depth", s, tip_side=tip_side))
        at = matrix(list(zip(*sides, strict=True)))
        limited = column(strains) if strained else at
        return self._function("curvatures", [f], [limited, at, at * ca.repmat(column(self.lengths).T, 2, 1)])

    @cached_property
    def stored(self) -> ca.Function:
        """Moments r (N + 1,) at the nodes."""
        return self._function("stored", [], [column(self.nodal), self.nodal[-1]])
