"""Statics of a finger that changes along its length, in units of its own: length and mean bending stiffness are 1.

The bending moment is m(s) = r(s) + K(s), with r linear on each element and continuous, and K the moment of the tendons,
of families whose tip is matched; of others K is part of the loads and not of the shape. The curvature is
k*(s) + m(s) / EI(s), by Gauss-Legendre collocation in every part of an element between two breaks of the curves.
Elements move along the finger, so a part without length stands for each break that is elsewhere: exact, and smooth
where a contact passes one.

The laws of tendons and sections come from the model: they see of each element integrals over its parts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, cast

import casadi as ca

from continuum_grasp.base import Array
from continuum_grasp.model.backbone import Backbone, Panel
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.laws.ports import PlacedLaw, Port
from continuum_grasp.model.node_counts import node_count
from continuum_grasp.model.planar import Scalar, column, matrix
from continuum_grasp.model.quadrature import collocation, running_weights
from continuum_grasp.model.runtime_curves import CurvesSpec
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.tendon_friction import Cell

if TYPE_CHECKING:
    from continuum_grasp.model.finger_model import FingerModel

_GRADED_NODES = 2
"""Nodes beside a uniform element's: a taper of 1:4 in four elements is then within 1e-7 (tests measure it)."""


def backbone_of(model: FingerModel, curves: CurvesSpec) -> Backbone:
    """Places and equilibrium of a finger, written for problems that differentiate them; curves that change along it
    belong to its problem.

    They are as accurate as the model, by the nodes of its elements; arcs get the nodes for its accuracy.
    """
    return GradedBackbone(model.structure, curves) if curves.graded else Backbone(model._equations)


class _Part(Panel):
    """A part of an element between two breaks of the curves."""

    def __init__(self, backbone: GradedBackbone, element: int, number: int, *place: Any) -> None:
        self._backbone = backbone
        self._element = element
        self._number = number
        super().__init__(*place)

    def up_to(self, s: Scalar | None) -> tuple[Scalar, ca.SX, Scalar]:
        width = self.length
        curvature = self._backbone.curvature
        if s is not None:
            width = ca.fmin(ca.fmax(s, self.start), self.start + self.length) - self.start
        places = [self.start + width * u for u in self.rule.nodes.tolist()]
        bent = column([curvature(self._element, s, self._backbone.curves.on(self._number, s)) for s in places])
        return width, width * (ca.DM(self.rule.running) @ bent), width * ca.dot(ca.DM(self.rule.weights), bent)

    def bends(self, fractions: Array) -> ca.SX:
        places = [self.start + self.length * u for u in self.rule.nodes.tolist()]
        curvature, curves = self._backbone.curvature, self._backbone.curves
        bent = column([curvature(self._element, s, curves.on(self._number, s)) for s in places])
        return self.length * (ca.DM(running_weights(len(places), fractions[None])).T @ bent)

    def per_length(self, fractions: Array) -> tuple[ca.SX, ca.SX]:
        curves = [self._backbone.curves.on(self._number, self.start + self.length * u) for u in fractions.tolist()]
        weighs = "density" in self._backbone.curves.names
        density = [value("density") if weighs else ca.SX(1.0) for value in curves]
        return column(density), column([value("stiffness") for value in curves])

    @property
    def points(self) -> ca.SX:
        """Positions (2, m) of the nodes."""
        return self.point + self.length * (self.tangents @ ca.DM(self.rule.running).T)

    @property
    def first_moment(self) -> ca.SX:
        nodes = zip(self.rule.nodes.tolist(), self.rule.weights.tolist(), strict=True)
        density = self._backbone.curves.on
        masses = [weight * density(self._number, self.start + self.length * u)("density") for u, weight in nodes]
        return self.points @ (self.length * column(masses))


class GradedBackbone(Backbone):
    """As `Backbone`, of curves along the finger that are run-time arguments.

    These are the lengths of the elements, the curves, the moment per coordinate at each node and the tendons' shape
    there, at the places where the search began, then the numbers of a model of a uniform finger of the same structure.
    """

    def __init__(self, made: Structure, spec: CurvesSpec) -> None:
        count = len(made.lengths)
        self._matched = made.matched
        sizes = {"lengths": count, "curves": spec.size, "scales": count + 1, "known": count + 1}
        symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        self.curves = spec.expressions(symbols["curves"])
        self._scales = symbols["scales"]
        self._known = symbols["known"]
        lengths = ca.vertsplit(symbols["lengths"])
        self.ends = [ca.SX(0.0), *accumulate(lengths)]
        varies = any(curve.name == "stiffness" and curve.degree for curve in spec.curves)
        accuracy = made.accuracy or made.family.default_accuracy
        nodes = node_count(made.ranges[0], accuracy) + (_GRADED_NODES if varies else 0)
        self._rule = collocation(min(nodes, 16))
        equations = Equations(self._along(made))
        self._pulls = 0.0 if made.cell_sets else equations.commanded[0].moment
        super().__init__(equations, lengths, ca.vertcat(*symbols.values(), equations.p))

    def _along(self, made: Structure) -> Structure:
        """The structure, whose laws see the curves."""
        structure = copy(made)
        count = len(made.lengths)
        structure.tendon_sets = tuple(
            replace(cells, cells=tuple(self._cells(len(cells.cells) // count))) for cells in made.tendon_sets
        )
        structure.laws = tuple(
            PlacedLaw(placed.law, tuple(self._ports(len(placed.ports) // count))) for placed in made.laws
        )
        return structure

    # -- curvature -----------------------------------------------------------------------------------------------

    @cached_property
    def nodal(self) -> list[ca.SX]:
        """Moments r at the nodes."""
        moments = self._scales[: self._eq.q.numel()] * self._eq.q
        couple = self._eq.u[-1]
        if not self._matched:
            return list(ca.vertsplit(moments))
        return [*ca.vertsplit(moments - self._known[:-1] * self._pulls), couple]

    def _late(self, k: int, s: Any) -> ca.SX:
        """Share of the moment at a place on an element that belongs to its end."""
        late: ca.SX = (s - self.ends[k]) / (self.ends[k + 1] - self.ends[k])
        return late

    def _hats(self, k: int, s: Any) -> ca.SX:
        """Moment at a place on an element per coordinate (2,) of its ends."""
        late = self._late(k, s)
        return ca.vertcat(1.0 - late, late) * self._scales[k : k + 2]

    def _moment(self, k: int, s: Any) -> ca.SX:
        return self.nodal[k] + (self.nodal[k + 1] - self.nodal[k]) * self._late(k, s)

    def curvature(self, k: int, s: Any, value: Callable[[str], ca.SX]) -> ca.SX:
        """Curvature at a place on an element, by the values of the curves there."""
        moment = self._moment(k, s)
        if self._matched:
            moment += self._pulls * value("channel")
        return value("rest") + moment / value("stiffness")

    def _nodes(self, a: Any, b: Any) -> list[tuple[Callable[[str], ca.SX], ca.SX, ca.SX]]:
        """Gauss nodes between two places of an element: values of the curves there, places, and weights."""
        rule = list(zip(self._rule.nodes.tolist(), self._rule.weights.tolist(), strict=True))
        nodes = []
        for part, (low, high) in enumerate(pairwise(self._edges(a, b))):
            places = [(low + (high - low) * u, (high - low) * weight) for u, weight in rule]
            nodes += [(self.curves.on(part, s), s, weight) for s, weight in places]
        return nodes

    def _edges(self, a: Any, b: Any) -> list[Any]:
        """Ends of the parts between two places of an element, some without length."""
        return [a, *(ca.fmin(ca.fmax(at, a), b) for at in self.curves.breaks), b]

    def _panels(self, k: int, start: Scalar, point: ca.SX, angle: Scalar) -> list[Panel]:
        panels: list[Panel] = []
        for number, (a, b) in enumerate(pairwise(self._edges(self.ends[k], self.ends[k + 1]))):
            panels.append(_Part(self, k, number, self._rule, a, b - a, point, angle))
            point, angle = panels[-1].end, panels[-1].end_angle
        return panels

    def _at(self, element: int, fractions: Any) -> ca.SX:
        start, length = self.ends[element], self.lengths[element]
        places = ca.horzsplit(start + ca.SX(fractions) * length)
        return ca.horzcat(*(self._section(s, [self.elements[element]])[0] for s in places))

    # -- what laws see -------------------------------------------------------------------------------------------

    def _integrals(self, k: int, a: Any, b: Any) -> list[ca.SX]:
        """Along each part of an element between breaks, of what both coordinates bend, and of the curvature at rest
        (3, 3): plain, where the tendons run; with their shape; and with the place too.
        """
        parts = [ca.SX.zeros(3, 3) for _ in self._edges(a, b)[1:]]
        nodes = self._nodes(a, b)
        for j, (value, s, weight) in enumerate(nodes):
            shape = value("channel")
            hats = self._hats(k, s) / value("stiffness")
            integrand = weight * ca.vertcat(hats, value("rest"))
            plain = ca.if_else(shape != 0.0, integrand, 0.0)
            parts[j * len(parts) // len(nodes)] += ca.horzcat(plain, shape * integrand, shape * integrand * s)
        return parts

    def _bounds(self, count: int) -> Iterator[tuple[int, Any, Any]]:
        """Elements, and both ends of as many equal parts of each."""
        for k, (start, end) in enumerate(pairwise(self.ends)):
            yield from (
                (k, *part) for part in pairwise([*(start + (j / count) * (end - start) for j in range(count)), end])
            )

    def _cells(self, count: int) -> list[Cell]:
        """Friction cells of the tendons, so many on each element."""
        cells = []
        for k, a, b in self._bounds(count):
            middle = 0.5 * (a + b)
            early, late = self._integrals(k, a, middle), self._integrals(k, middle, b)
            parts = [one + other for one, other in zip(early, late, strict=True)]
            _, drawn, first = ca.horzsplit(sum(parts[1:], parts[0]))
            leaning = (first - middle * drawn) / (b - a)
            work, lean, beyond = (ca.vertsplit(each) for each in (drawn, leaning, sum(late[1:], late[0])[:, 1]))
            cells.append(Cell(k, b - a, b - a, [ca.vertsplit(part[:, 0]) for part in parts], work, lean[:-1], beyond))
        return cells

    def _ports(self, count: int) -> list[Port]:
        """Ports at which the laws of the sections see the curvature above rest, so many on each element."""
        ports = []
        base = self.curves.at(0.0)("stiffness")
        for k, a, b in self._bounds(count):
            turn = ca.SX.zeros(2)
            even = ca.SX(0.0)
            for value, s, weight in self._nodes(a, b):
                turn += weight * (self._hats(k, s) / value("stiffness"))
                even += weight * (base / value("stiffness"))
            # An even moment bends a cell by its harmonic mean stiffness.
            ports.append(Port(k, (b - a) * ((b - a) / even), ca.vertsplit(turn / (b - a)), 0.0))
        return ports

    # -- statics -------------------------------------------------------------------------------------------------

    def _resisting(self) -> ca.SX:
        force = [ca.SX(0.0) for _ in self.ends]
        for k, ends in enumerate(pairwise(self.ends)):
            for value, s, weight in self._nodes(*ends):
                moment = self._moment(k, s)
                if not self._matched:
                    moment -= self._pulls * value("channel")
                early, late = ca.vertsplit(self._hats(k, s) * (weight * moment / value("stiffness")))
                force[k] += early
                force[k + 1] += late
        resistance = column(force[: self._eq.q.numel()])
        return resistance - column(self._eq.resting.tendons.actuation) if self._eq.structure.cell_sets else resistance

    def _work(self, masses: ca.SX) -> ca.SX:
        return super()._work(masses) + self._eq.u[-1] * self._angles[-1]

    # -- functions -----------------------------------------------------------------------------------------------

    @cached_property
    def drawn(self) -> ca.Function:
        """``(q, u, p)``: how far the bend draws in the first tendon, per offset at the base."""
        whole = ca.SX(0.0)
        for k, ends in enumerate(pairwise(self.ends)):
            for value, s, weight in self._nodes(*ends):
                whole += weight * value("channel") * self.curvature(k, s, value)
        return self._function("drawn", [], [whole])

    def fixed_places(self, count: int) -> tuple[ca.Function, list[int]]:
        """Some of the Gauss nodes, which cost nothing."""
        points = list[ca.SX]()
        places = list[Scalar]()
        owners = list[int]()
        for k, element in enumerate(self.elements):
            at = ca.horzsplit(ca.horzcat(*(cast(_Part, part).points for part in element)))
            nodes = [s for _, s, _ in self._nodes(*self.ends[k : k + 2])]
            few = min(len(nodes), count)
            picks = [int((j + 0.5) * len(nodes) / few) for j in range(few)]
            points += [at[j] for j in picks]
            places += [nodes[j] for j in picks]
            owners += [k] * few
        return self._function("fixed_places", [], [ca.horzcat(*points), column(places)]), owners

    @cached_property
    def curvatures(self) -> ca.Function:
        strained = "depth" in self.curves.names
        at = self.curves.at
        f = ca.SX.sym("f", len(self.elements) * strained)
        sides = list[list[ca.SX]]()
        strains = list[ca.SX]()
        for k, (a, b) in enumerate(pairwise(self.ends)):
            sides.append([self.curvature(k, a, at(a, tip_side=True)), self.curvature(k, b, at(b))])
            if strained:
                inside = a + f[k] * (b - a)
                middle = self.curvature(k, inside, at(inside)) * at(inside)("depth")
                strains += [sides[k][0] * at(a, tip_side=True)("depth"), sides[k][1] * at(b)("depth"), middle]
        both = matrix(list(zip(*sides, strict=True)))
        limited = column(strains) if strained else both
        return self._function("curvatures", [f], [limited, both, both * ca.repmat(column(self.lengths).T, 2, 1)])

    @cached_property
    def stored(self) -> ca.Function:
        """Moments r (N + 1,) at the nodes."""
        return self._function("stored", [], [column(self.nodal), self.nodal[-1]])
