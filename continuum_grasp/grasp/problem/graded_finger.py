"""A graded finger of a grasp: the unit finger with curves along it in place of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, cast

import casadi as ca

from continuum_grasp.grasp.problem.graded_backbone import GradedBackbone
from continuum_grasp.grasp.problem.graded_curves import GradedCurves, GradedSpec
from continuum_grasp.grasp.problem.structure import ContactSpec
from continuum_grasp.grasp.problem.unit_finger import UnitFinger


class GradedUnitFinger(UnitFinger):
    """As `UnitFinger`; its elements are moment-linear, whatever stiffness and tendons there are along it."""

    backbone: GradedBackbone

    def _backbone(self) -> GradedBackbone:
        self._curves = GradedCurves(self._graded, self.number("curves", self._graded.size))
        return GradedBackbone(self.model, self._graded)

    @property
    def _graded(self) -> GradedSpec:
        # Fingers without curves are `UnitFinger`s.
        return cast(GradedSpec, self.spec.graded)

    def _along(self) -> list[ca.SX]:
        nodes = self.spec.elements + 1
        curves = self.number("curves", self._graded.size)
        return [curves, self.number("node stiffness", nodes), self.number("node shapes", nodes)]

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

    def drawn(self, q: ca.SX, u: ca.SX) -> ca.SX:
        drawn: ca.SX = self.backbone.drawn(q, u, self.p)
        return drawn

    def places(self, fractions: ca.SX) -> tuple[ca.SX, list[int], ca.SX, ca.SX]:
        picks, elements, start = [], [], 0
        for element, count in enumerate(self.backbone.node_counts):
            few = min(count, self.guards)
            picks += [start + int((k + 0.5) * count / few) for k in range(few)]
            elements += [element] * few
            start += count
        points, at = self.backbone.nodes(self.q, self.u, self.p)
        probed = self.backbone.places(self.probes)(self.q, self.u, fractions, self.p)
        starts, columns = [ca.SX(0.0), *self._places], ca.horzsplit(fractions)
        deep = [
            a + f * (b - a) for (a, b), own in zip(pairwise(starts), columns, strict=True) for f in ca.vertsplit(own)
        ]
        thick = [self._curves.at("thickness", s) for s in (*ca.vertsplit(at[picks]), *self._places, *deep)]
        return points[:, picks], elements, probed, self.number("length") * ca.vertcat(*thick)

    def curvatures(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        at, bends = self.backbone.curvatures(self.q, self.u, self.p)
        if not self.spec.strained:
            return at, at, bends
        return (
            self.backbone.strains(self.q, self.u, self.number("strain probes", self.spec.elements), self.p),
            at,
            bends,
        )

    def stored(self) -> list[ca.SX]:
        """As of a uniform finger; in place of coordinates moments at the nodes (N + 1,), less those of the tendons that
        belong to the shape.
        """
        nodal = self.backbone.nodal_moments(self.q, self.u, self.p)
        return [nodal, self.p[: self.spec.elements], nodal[-1], self.pulls, self.base]
