"""A graded finger of a grasp: the unit finger with curves along it in place of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, cast

import casadi as ca

from continuum_grasp.grasp.problem.blocks import rotation
from continuum_grasp.grasp.problem.graded_curves import GradedCurves, GradedSpec
from continuum_grasp.grasp.problem.graded_model import GradedModel
from continuum_grasp.grasp.problem.structure import ContactSpec
from continuum_grasp.grasp.problem.unit_finger import ACCURACY, PRESLIDING, UnitFinger
from continuum_grasp.scene.families import FAMILIES


class GradedUnitFinger(UnitFinger):
    """As `UnitFinger`; its elements are moment-linear, whatever stiffness and tendons there are along it."""

    def _build(self) -> int:
        spec = self.spec
        self.statics = GradedModel(
            self._graded,
            spec.elements,
            spec.before,
            matched=FAMILIES[spec.family].matches_tip,
            bending_range=spec.bending_range,
            accuracy=spec.accuracy or ACCURACY,
            friction_cells=spec.friction_cells,
            presliding=PRESLIDING,
            bending_cells=spec.bending_cells,
            branches=spec.branches,
        )
        self._curves = GradedCurves(self._graded, self.number("curves", self._graded.size))
        return self.statics.n

    @property
    def _graded(self) -> GradedSpec:
        # Fingers without curves are `UnitFinger`s.
        return cast(GradedSpec, self.spec.graded)

    def _parameters(self) -> ca.SX:
        nodes, channels = self.spec.elements + 1, self._graded.channels
        weight = rotation(-self.base[2]) @ self.number("weight", 2) if self.spec.weighs else ca.SX.zeros(2)
        return ca.vertcat(
            *self.element_lengths(self.joints),
            weight,
            self.number("curves", self._graded.size),
            self.number("node stiffness", nodes),
            self.number("node shapes", channels * nodes),
            self.number("arms", 2 * channels),
            *([self.number("tendon_friction")] if self.spec.friction_cells else []),
            *(
                self.number(f"dry_friction_{k + 1}_{key}")
                for k in range(self.spec.branches)
                for key in ("stiffness", "moment")
            ),
        )

    @cached_property
    def _places(self) -> list[ca.SX]:
        """Where the elements end."""
        return ca.vertsplit(ca.cumsum(ca.vertcat(*self.element_lengths(self.joints))))

    def element_lengths(self, joints: Sequence[Any]) -> list[Any]:
        """Element lengths for positions of the middle contacts: in the shares of the start between them."""
        shares, start, lengths = self.number("shares", self.spec.elements), 0, []
        for (a, b), end in zip(pairwise([0.0, *joints, 1.0]), (*self.spec.before, self.spec.elements), strict=True):
            lengths += [(b - a) * shares[k] for k in range(start, end)]
            start = end
        return lengths

    def half_at(self, end: int) -> ca.SX:
        return self._curves.at("thickness", self._places[end])

    def lean(self, contact: ContactSpec) -> ca.SX:
        return self._curves.slope("thickness", self._places[self.end_of(contact)])

    def joints_at(self, q: ca.SX, u: ca.SX) -> tuple[ca.SX, ca.SX]:
        ends, angles = self.statics.joints(q, u, self.p)
        return ends, angles

    def drawn(self, q: ca.SX, u: ca.SX) -> ca.SX:
        drawn: ca.SX = self.statics.drawn(q, u, self.p)
        return drawn

    @property
    def loads_size(self) -> int:
        return self.statics.nw

    @property
    def friction_states(self) -> int:
        return self.spec.elements * (self.spec.friction_cells + self.spec.bending_cells * self.spec.branches)

    def mean_shares(self) -> ca.SX:
        means: ca.SX = self.statics.mean_shares(self.q, self.u, *self.history, self.p)
        return means

    def places(self, fractions: ca.SX) -> tuple[ca.SX, list[int], ca.SX, ca.SX]:
        picks, elements, start = [], [], 0
        for element, count in enumerate(self.statics.waypoint_counts):
            few = min(count, self.guards)
            picks += [start + int((k + 0.5) * count / few) for k in range(few)]
            elements += [element] * few
            start += count
        points, thick = self.statics.waypoints(self.q, self.u, self.p)
        probed, deep = self.statics.probes(self.probes)(self.q, self.u, fractions, self.p)
        joints = [self.half_at(k) for k in range(self.spec.elements)]
        return points[:, picks], elements, probed, self.number("length") * ca.vertcat(thick[picks], *joints, deep)

    def section(self, s: ca.SX) -> tuple[ca.SX, ca.SX]:
        point, angle = self.statics.section(self.q, self.u, s, self.p)
        return point, angle

    def input(self, pulls: ca.SX, couple: ca.SX) -> ca.SX:
        return ca.vertcat(pulls, couple)

    def missing_force(self, q: ca.SX, u: ca.SX, w: ca.SX) -> ca.SX:
        return self.statics.missing(q, u, w, *(self.history or [ca.SX(0, 1)]), self.p)

    def curvatures(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        at, bends = self.statics.curvatures(self.q, self.u, self.p)
        if not self.spec.strained:
            return at, at, bends
        return self.statics.strains(self.q, self.u, self.number("strain probes", self.spec.elements), self.p), at, bends

    def stored(self) -> list[ca.SX]:
        """As of a uniform finger; in place of coordinates moments at the nodes (N + 1,), less those of the tendons that
        belong to the shape.
        """
        nodal = self.statics.nodal_moments(self.q, self.u, self.p)
        return [nodal, self.p[: self.spec.elements], nodal[-1], self.pulls, self.base]
