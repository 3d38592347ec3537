"""Statics of a graded finger in units of its own: length and mean bending stiffness are 1.

The bending moment is m(s) = r(s) + K(s), with r linear on each element and continuous, and K the moment of the tendons,
of families whose tip is matched; of others K is part of the loads and not of the shape. The curvature is
k*(s) + m(s) / EI(s), and the generalized force that is missing is the gradient of the potential

    V = int (m / 2 - K) m / EI ds - int (mass beyond s) g . t ds - forces . positions - couples . angles

where tendons with friction have no K: what they exert is their tensions times what a bend draws in of each cell,
by Gauss-Legendre collocation in every part of an element between two breaks of the curves. Elements move along the
finger, so a part without length stands for each break that is elsewhere: exact, and smooth where a contact passes one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.grasp.problem.graded_curves import GradedCurves, GradedSpec
from continuum_grasp.model.memory import Memory
from continuum_grasp.model.planar import Scalar, column
from continuum_grasp.model.quadrature import collocation, node_count
from continuum_grasp.model.tendon_friction import Shares, rounded, shares

_GRADED_NODES = 2
"""Nodes beside those of a uniform element: a taper of 1:4 in four elements is then within 1e-7 (tests measure it)."""


@dataclass(frozen=True)
class _State:
    """A section, as expressions: position (2,) and angle."""

    point: ca.SX
    angle: ca.SX


class GradedModel:
    """The functions of a graded finger that a grasp needs.

    ``u`` are the tensions, as moments at the base, then a couple on the tip; ``w`` the forces at the middle contacts
    and the tip, then the couples at the middle contacts; ``p`` the lengths of the elements, weight (2,), curves, the
    moment per coordinate at each node and each channel's shape there, at the places where the search began, and the
    moments of the channels per tension.
    """

    def __init__(
        self,
        spec: GradedSpec,
        elements: int,
        contacts: Sequence[int],
        *,
        matched: bool,
        bending_range: float,
        accuracy: float,
        arms: int = 2,
        friction_cells: int = 0,
        presliding: float = 1.0,
        bending_cells: int = 0,
        branches: int = 0,
    ) -> None:
        self.elements, self.matched, self._contacts = elements, matched, tuple(contacts)
        self.n = elements if matched else elements + 1
        nodes, channels = elements + 1, spec.channels
        self.nw = 3 * len(contacts) + 2
        self._cells, self._presliding, self._bending_cells = friction_cells, presliding, bending_cells
        sizes = (
            *(elements, 2, spec.size, nodes, channels * nodes, channels * arms),
            *(int(friction_cells > 0), 2 * branches),
        )
        # As of `FingerModel`: states of the cells, and whether the finger was bent from straight.
        states = elements * (friction_cells + bending_cells * branches)
        self.history = ca.SX.sym("history", (states + 1) * (states > 0))
        self.q, self.u, self.w = ca.SX.sym("q", self.n), ca.SX.sym("u", arms + 1), ca.SX.sym("w", self.nw)
        self.p = ca.SX.sym("p", sum(sizes))
        parts = ca.vertsplit(self.p, np.cumsum([0, *sizes]).tolist())
        lengths, self._weight, numbers, self._scales, known, arm, self._friction, dry = parts
        self._branches = list(zip(*[iter(ca.vertsplit(dry))] * 2, strict=True))  # stiffness and moment of each
        self.curves = GradedCurves(spec, numbers)
        ends = [ca.SX(0.0)]
        for k in range(elements):
            ends.append(ends[-1] + lengths[k])
        self.ends = ends
        self._arms = ca.reshape(arm, channels, arms)
        self._amplitudes = self._arms @ self.u[:arms]
        self._known = ca.reshape(known, channels, nodes)
        self._couple = self.u[arms]
        self._channels = channels
        varies = any(curve.name == "stiffness" and curve.degree for curve in spec.curves)
        count = node_count(bending_range, accuracy) + (_GRADED_NODES if varies else 0)
        self._rule = collocation(min(count, 16))

    # -- curvature -----------------------------------------------------------------------------------------------

    @cached_property
    def nodal(self) -> list[ca.SX]:
        """Moments r at the nodes."""
        if self.matched:
            inner = self._scales[: self.n] * self.q - self._known[:, : self.n].T @ self._amplitudes
            return [*ca.vertsplit(inner), self._couple]
        return list(ca.vertsplit(self._scales * self.q))

    def _linear(self, k: int, s: Any) -> ca.SX:
        a, b = self.ends[k], self.ends[k + 1]
        total: ca.SX = self.nodal[k] + (self.nodal[k + 1] - self.nodal[k]) * ((s - a) / (b - a))
        return total

    def _drive(self, shapes: Sequence[ca.SX]) -> ca.SX:
        return ca.dot(self._amplitudes, ca.vertcat(*shapes)) if shapes else ca.SX(0.0)

    def _curvature(self, k: int, s: Any, *, tip_side: bool = False) -> ca.SX:
        """Curvature anywhere on an element."""
        curves, side = self.curves, {"tip_side": tip_side}
        moment = self._linear(k, s)
        if self.matched:
            moment += self._drive([curves.at(f"channel_{c}", s, **side) for c in range(self._channels)])
        return curves.at("rest", s, **side) + moment / curves.at("stiffness", s, **side)

    @cached_property
    def _at_ends(self) -> ca.SX:
        """Curvature (2, N) at both ends of each element, from inside."""
        columns = [
            ca.vertcat(self._curvature(k, self.ends[k], tip_side=True), self._curvature(k, self.ends[k + 1]))
            for k in range(self.elements)
        ]
        return ca.horzcat(*columns)

    def _bent(self, k: int, panel: int, s: Any) -> tuple[ca.SX, ca.SX]:
        """Moment of the tendons in a panel of an element, and its curvature above rest."""
        drive = self._drive([self.curves.on(f"channel_{c}", panel, s) for c in range(self._channels)])
        moment = self._linear(k, s) + (drive if self.matched else 0.0)
        return drive, moment / self.curves.on("stiffness", panel, s)

    # -- geometry ------------------------------------------------------------------------------------------------

    def _walk(self, k: int, start: _State, end: Any, record: list[Any] | None = None) -> tuple[_State, ca.SX]:
        """From the start of an element to a place in it: the section there, and the potential between, without loads
        that act at joints. Gauss nodes are recorded as (place, position).
        """
        rule, curves = self._rule, self.curves
        point, angle, potential = start.point, start.angle, ca.SX(0.0)
        for panel, (a, b) in enumerate(pairwise(self._edges(self.ends[k], end))):
            width = b - a
            places = [a + width * float(u) for u in rule.nodes]
            elastic, turned, work = [], [], []
            for s in places:
                drive, bent = self._bent(k, panel, s)
                moment = self._linear(k, s) + (drive if self.matched else 0.0)
                elastic.append(bent)
                work.append((0.5 * moment - (0.0 if self._cells else drive)) * bent)
                turned.append(curves.on("rest", panel, s) + bent)
            angles = angle + width * (ca.DM(rule.running) @ column(turned))
            tangents = ca.horzcat(-ca.sin(angles), ca.cos(angles))
            if "mass" in curves.names:
                along = tangents @ self._weight
                work = [
                    v - curves.on("mass", panel, s) * along[g]
                    for g, (v, s) in enumerate(zip(work, places, strict=True))
                ]
            potential += width * ca.dot(ca.DM(rule.weights), column(work))
            if record is not None:
                inside = width * (ca.DM(rule.running) @ tangents)
                record += [(s, point + inside[g, :].T) for g, s in enumerate(places)]
            point = point + width * (tangents.T @ ca.DM(rule.weights))
            angle = angle + width * ca.dot(ca.DM(rule.weights), column(turned))
        return _State(point, angle), potential

    @cached_property
    def _chain(self) -> tuple[list[_State], ca.SX, list[list[Any]]]:
        """Sections at the ends of the elements from the base on, the potential, and the Gauss nodes."""
        states, total, nodes = [_State(ca.SX.zeros(2), ca.SX(0.0))], ca.SX(0.0), []
        for k in range(self.elements):
            record: list[Any] = []
            state, potential = self._walk(k, states[-1], self.ends[k + 1], record)
            states.append(state)
            total += potential
            nodes.append(record)
        return states, total, nodes

    def _function(self, name: str, arguments: list[ca.SX], values: list[ca.SX]) -> ca.Function:
        return ca.Function(name, arguments, ca.cse(values))

    @cached_property
    def joints(self) -> ca.Function:
        """``(q, u, p)``: positions (2, N) and angles (N,) of the ends of the elements."""
        states = self._chain[0][1:]
        points, angles = ca.horzcat(*(s.point for s in states)), ca.vertcat(*(s.angle for s in states))
        return self._function("joints", [self.q, self.u, self.p], [points, angles])

    # -- tendons with friction -------------------------------------------------------------------------------------

    def _drawn(self, k: int, a: Any, b: Any) -> ca.SX:
        """Of a part of an element: its bend along the tendons (1), with their shape (1), and with its place too (1)."""
        total = ca.SX.zeros(3)
        for panel, (low, high) in enumerate(pairwise(self._edges(a, b))):
            width = high - low
            for u, weight in zip(self._rule.nodes, self._rule.weights, strict=True):
                s = low + width * float(u)
                shape = self.curves.on("channel_0", panel, s)
                own = (width * float(weight)) * (self.curves.on("rest", panel, s) + self._bent(k, panel, s)[1])
                total += ca.vertcat(ca.if_else(shape != 0.0, own, 0.0), shape * own, shape * own * s)
        return total

    @cached_property
    def drawn(self) -> ca.Function:
        """``(q, u, p)``: how far the bend draws in a tendon of the first channel, per offset at the base."""
        whole = sum((self._drawn(k, a, b)[1] for k, (a, b) in enumerate(pairwise(self.ends))), ca.SX(0.0))
        return self._function("drawn", [self.q, self.u, self.p], [whole])

    @cached_property
    def _halves(self) -> list[tuple[Any, Any, ca.SX, ca.SX]]:
        """Both ends of each friction cell, and what is drawn in along its halves."""
        found = []
        for k, (start, end) in enumerate(pairwise(self.ends)):
            places = [start + (j / (2 * self._cells)) * (end - start) for j in range(2 * self._cells)] + [end]
            for j in range(0, 2 * self._cells, 2):
                a, middle, b = places[j : j + 3]
                found.append((a, b, self._drawn(k, a, middle), self._drawn(k, middle, b)))
        return found

    @cached_property
    def _shares(self) -> Shares:
        """Shares of the tensions along the cells, by the capstan law of ``model.tendon_friction``."""
        beyond, travel = ca.SX(0.0), list[Scalar]()
        for *_, early, late in reversed(self._halves):
            travel.insert(0, (beyond + late[1]) * (1.0 / self._presliding))
            beyond += early[1] + late[1]
        states = ca.vertsplit(self.history)[: self.elements * self._cells]
        ways = Memory(self.history[-1]).ways(states, lambda: travel)
        halves = [
            0.5 * self._friction * (way * rounded(early[0] + late[0], b - a))
            for way, (a, b, early, late) in zip(ways, self._halves, strict=True)
        ]
        return shares(halves, None, (1.0, -1.0))

    @cached_property
    def mean_shares(self) -> ca.Function:
        """``(q, u, history, p)``: mean along the finger of the tension of each tendon, per that at the base."""
        spans = [b - a for a, b, *_ in self._halves]
        means = [sum((h * share for h, share in zip(spans, mean, strict=True)), ca.SX(0)) for mean in self._shares.mean]
        return self._function("mean_shares", [self.q, self.u, self.history, self.p], [column(means) / self.ends[-1]])

    @cached_property
    def _pulled(self) -> ca.SX:
        """Generalized force of the tendons: mean tensions times what a cell draws in, and their loss times its lean."""
        ports, forces = [], []
        for k, (a, b, early, late) in enumerate(self._halves):
            whole = early + late
            lean = (whole[2] - 0.5 * (a + b) * whole[1]) / (b - a)
            pulls = [self._arms[0, j] * self.u[j] * self._shares.mean[j][k] for j in (0, 1)]
            ports += [whole[1], lean]
            forces += [pulls[0] + pulls[1], -2.0 * self._shares.halves[k] * (pulls[0] - pulls[1])]
        return ca.jtimes(ca.vertcat(*ports), self.q, ca.vertcat(*forces), True)

    @cached_property
    def _held(self) -> ca.SX:
        """Generalized force of dry friction in bending, against it: moments at the base times what a cell bends."""
        at_base, states = self.curves.at("stiffness", 0.0), ca.vertsplit(self.history)[self.elements * self._cells : -1]
        ports, forces, count = [], [], len(self._branches)
        for k, (start, end) in enumerate(pairwise(self.ends)):
            for j in range(self._bending_cells):
                a, b = (start + (i / self._bending_cells) * (end - start) for i in (j, j + 1))
                bent, measure = (b - a) * self._linear(k, 0.5 * (a + b)) / at_base, ca.SX(0.0)
                for panel, (low, high) in enumerate(pairwise(self._edges(a, b))):
                    for u, weight in zip(self._rule.nodes, self._rule.weights, strict=True):
                        stiffness = self.curves.on("stiffness", panel, low + (high - low) * float(u))
                        measure += ((high - low) * float(weight)) * (stiffness / at_base)
                first = (k * self._bending_cells + j) * count
                ports.append(bent)
                forces.append(self._dry_moment(bent / measure, states[first : first + count]))
        return ca.jtimes(ca.vertcat(*ports), self.q, ca.vertcat(*forces), True)

    def _dry_moment(self, curvature: ca.SX, states: Sequence[Scalar]) -> Scalar:
        """Moment of dry friction at the base by the curvature above rest, as of ``model.laws.dry_friction``."""
        travel = [stiffness / moment * curvature for stiffness, moment in self._branches]
        ways = Memory(self.history[-1]).ways(states, lambda: travel)
        return sum((moment * way for (_, moment), way in zip(self._branches, ways, strict=True)), 0.0)

    def _edges(self, a: Any, b: Any) -> list[Any]:
        """Ends of the panels between two places of an element, some without length."""
        return [a, *(ca.fmin(ca.fmax(at, a), b) for at in self.curves.breaks), b]

    @cached_property
    def missing(self) -> ca.Function:
        """``(q, u, w, history, p)``: generalized force that is missing for rest."""
        states, potential, _ = self._chain
        count = len(self._contacts)
        for j, element in enumerate((*self._contacts, self.elements)):
            potential -= ca.dot(self.w[2 * j : 2 * j + 2], states[element].point)
            couple = self.w[2 * count + 2 + j] if j < count else self._couple
            potential -= couple * states[element].angle
        force = ca.gradient(potential, self.q)
        if self._cells:
            force -= self._pulled
        if self._branches:
            force += self._held
        return self._function("missing", [self.q, self.u, self.w, self.history, self.p], [force])

    @cached_property
    def waypoints(self) -> ca.Function:
        """``(q, u, p)``: positions (2, K) of the Gauss nodes, and half the thickness there (K,)."""
        nodes = [node for element in self._chain[2] for node in element]
        thick = [self.curves.at("thickness", s) for s, _ in nodes]
        return self._function(
            "waypoints", [self.q, self.u, self.p], [ca.horzcat(*(at for _, at in nodes)), ca.vertcat(*thick)]
        )

    @cached_property
    def waypoint_counts(self) -> list[int]:
        """Number of waypoints of each element."""
        return [len(element) for element in self._chain[2]]

    def probes(self, count: int) -> ca.Function:
        """``(q, u, f, p)``: positions (2, count N) at fractions f (count, N) of the elements, half the thickness."""
        f = ca.SX.sym("f", count, self.elements)
        points, thick = [], []
        for k in range(self.elements):
            for j in range(count):
                s = self.ends[k] + f[j, k] * (self.ends[k + 1] - self.ends[k])
                points.append(self._walk(k, self._chain[0][k], s)[0].point)
                thick.append(self.curves.at("thickness", s))
        return self._function("probes", [self.q, self.u, f, self.p], [ca.horzcat(*points), ca.vertcat(*thick)])

    @cached_property
    def section(self) -> ca.Function:
        """``(q, u, s, p)``: position (2,) and angle at a place."""
        s, state = ca.SX.sym("s"), _State(ca.SX.zeros(2), ca.SX(0.0))
        for k in range(self.elements):
            state, _ = self._walk(k, state, ca.fmin(ca.fmax(s, self.ends[k]), self.ends[k + 1]))
        return self._function("section", [self.q, self.u, s, self.p], [state.point, state.angle])

    @cached_property
    def curvatures(self) -> ca.Function:
        """``(q, u, p)``: curvature (2, N) at both ends of each element, and the same times lengths."""
        lengths, at = self.p[: self.elements].T, self._at_ends
        return self._function("curvatures", [self.q, self.u, self.p], [at, at * ca.repmat(lengths, 2, 1)])

    @cached_property
    def strains(self) -> ca.Function:
        """``(q, u, f, p)``: curvature times half the depth at both ends of each element, and at a fraction f (N,)."""
        f, found, curves = ca.SX.sym("f", self.elements), [], self.curves
        for k, (a, b) in enumerate(pairwise(self.ends)):
            for s, tip_side in ((a, True), (b, False), (a + f[k] * (b - a), False)):
                found.append(self._curvature(k, s, tip_side=tip_side) * curves.at("depth", s, tip_side=tip_side))
        return self._function("strains", [self.q, self.u, f, self.p], [ca.vertcat(*found)])

    @cached_property
    def nodal_moments(self) -> ca.Function:
        """``(q, u, p)``: moments r (N + 1,) at the nodes."""
        return self._function("nodal", [self.q, self.u, self.p], [column(self.nodal)])
