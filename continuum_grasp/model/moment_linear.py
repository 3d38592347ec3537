"""Moment-linear elements: the bending moment is linear along each element and continuous, and gives the curvature.

With the bending stiffness B(s) and the curvature at rest k*(s),

    k(s) = k*(s) + sum_i q_i N_i(s) B(s_i) / B(s) + sum_j v_j G_j(s),

where N_i are hat functions, q_i the elastic curvatures at the nodes, and G_j the bend by a known moment of the input in
addition to its values at the nodes. On a uniform rod these elements are clothoids.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.collocated import CollocatedLink
from continuum_grasp.model.family import Family, Mesh, RodProperties, mean
from continuum_grasp.model.graded import CurvatureShapes, GradedLink, measured_rule
from continuum_grasp.model.node_counts import node_count
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.quadrature import collocation
from continuum_grasp.scene import ONE_TURN, Curve


class Clothoid(CollocatedLink):
    """A link of uniform section; its local coordinates are the curvatures [1/m] at its ends, linear in between."""

    def _angles(self, fraction: Scalar, piece: int) -> tuple[Scalar, Scalar]:
        late = 0.5 * (fraction * fraction)
        return fraction - late, late

    @cached_property
    def _rise(self) -> Scalar:
        start, end = self._local
        return end - start

    def _turns(self, fraction: Scalar) -> list[Scalar]:
        # The mean curvature between two nodes is that at the middle, and the rule is symmetric: products are shared.
        rise = self._rise * fraction
        reach = fraction * self._length
        middle = reach * (self._local[0] + 0.5 * rise)
        lean = reach * rise
        angles = []
        for step, offset in zip(self.rule.steps.tolist(), self.rule.offsets.tolist(), strict=True):
            bend = step * middle
            shift = abs(offset) * lean
            angles.append(bend + shift if offset > 0.0 else bend - shift)
        return angles

    @property
    def curvatures(self) -> list[Scalar]:
        return self._local


class MomentLinearFamily(Family):
    """Bending moment linear on each element and continuous; the coordinates are the elastic curvatures at the nodes.

    Where the moments of the input are known, the tip's curvature is no coordinate, and neither are bends between
    the nodes, where a tendon ends or a couple acts.
    """

    degree = 1
    continuous = True
    order = 4
    folds_masses = True

    def __init__(self, mesh: Mesh, accuracy: float | None) -> None:
        super().__init__(mesh, accuracy)
        ends = np.array(mesh.ends)
        self._at_nodes = mesh.stiffness(ends)
        self._moments = [moment(ends) for moment in mesh.moments]
        # Moments that are more than their values at the nodes.
        known = mesh.moments if mesh.known else ()
        every = range(self.elements)
        self._left = [k for k, moment in enumerate(known) if any(self._rest_of(moment, j) for j in every)]
        elements = [self._shapes(k) for k in range(self.elements)]
        self._elements = [shapes for shapes, _ in elements]
        self._are_clothoids = [uniform for _, uniform in elements]

    def _rest_of(self, moment: Curve, element: int) -> bool:
        start, end = self.mesh.span(element)
        parts = self.mesh.panels(element, moment)
        s = np.concatenate([np.linspace(a, b, 7)[1:-1] for a, b in parts])
        first, last = moment([start, end])
        line = first + (last - first) * (s - start) / (end - start)
        # 1e-12: share of a moment; a smaller rest between the nodes is rounding
        return bool(np.abs(moment(s) - line).max() > 1e-12 * np.abs(moment(self.mesh.ends)).max())

    def _shapes(self, element: int) -> tuple[CurvatureShapes, bool]:
        """Shapes of an element, and whether it is a clothoid."""
        mesh, (start, end) = self.mesh, self.mesh.span(element)
        left = [k for k in self._left if self._rest_of(mesh.moments[k], element)]
        curves = (mesh.stiffness, mesh.linear_density, mesh.rotary_inertia, mesh.rest)
        first, last = self._at_nodes[element : element + 2].tolist()
        # After a jump of the stiffness, the curvature at the start differs from the node's.
        same = first == last == mesh.constant(mesh.stiffness, element)
        if not left and same and all(mesh.constant(curve, element) is not None for curve in curves):
            one = Curve.along(mesh.ends[-1], 1.0)
            hats = ((1.0, 0.0), (0.0, 1.0))
            return CurvatureShapes(start, end, one, mesh.rest, mesh.panels(element), hats, (None, None), one, one), True
        base = float(self._at_nodes[0])
        taken = [(-base * float(m[element]), -base * float(m[element + 1])) for m in (self._moments[k] for k in left)]
        moments = [mesh.moments[k] for k in left]
        parts = mesh.panels(element, *curves, *moments)
        values = ((first, 0.0), (0.0, last), *taken)
        beside = (None, None, *(moment.scaled(base) for moment in moments))
        densities = mesh.linear_density, mesh.rotary_inertia
        return CurvatureShapes(start, end, mesh.stiffness, mesh.rest, parts, values, beside, *densities), False

    @property
    def size(self) -> int:
        return self.elements + 1 + len(self._left)

    @property
    def known(self) -> Array:
        if not self.mesh.known:
            return super().known
        tip = [m[-1] / self._at_nodes[-1] for m in self._moments]
        left = [[(k == at) / self._at_nodes[0] for k in range(len(self._moments))] for at in self._left]
        return np.array([tip, *left], dtype=float)

    @property
    def nodal(self) -> Array | None:
        if not self.mesh.known:
            return None
        return (np.array(self._moments).reshape(-1, self.elements + 1) / self._at_nodes)[:, :-1].T

    @property
    def default_accuracy(self) -> float:
        """As good as the family itself: its error in frequency is 1.7e-3 at two elements, and falls with their fourth
        power down to rounding.
        """
        return max(2e-3 * (2.0 / self.elements) ** 4, 1e-13)

    @property
    def labels(self) -> list[str]:
        inside = [f"kappa_of_moment_{k + 1} [1/m]" for k in self._left]
        return [f"kappa_{k} [1/m]" for k in range(self.elements + 1)] + inside

    def local(self, element: int) -> tuple[int, ...]:
        left = [self.elements + 1 + j for j, k in enumerate(self._left) if self._rest_of(self.mesh.moments[k], element)]
        return (element, element + 1, *left)

    def curvature_at_coordinates(self, ends: Sequence[Sequence[Scalar]]) -> list[Scalar]:
        return [ends[0][0], *(row[1] for row in ends)]

    def peak(self, element: int, coordinate: int) -> float:
        return float(self._elements[element].peaks[self.local(element).index(coordinate)])

    def coordinates(self, bends: Array, curvatures: Array) -> Array:
        ends = np.array(self.mesh.ends)
        first = curvatures[:, 0] - self.mesh.rest(ends[:-1], tip_side=True)
        last = curvatures[:, 1] - self.mesh.rest(ends[1:])
        # The moment is continuous: both sides of a node give it, by the stiffness there.
        after = first * (self.mesh.stiffness(ends[:-1], tip_side=True) / self._at_nodes[:-1])
        nodes = np.concatenate([after[:1], 0.5 * (last[:-1] + after[1:]), last[-1:]])
        return np.concatenate([nodes, np.zeros(len(self._left))])

    def link(self, element: int, local: Sequence[Scalar], rod: RodProperties, end_mass: float) -> CollocatedLink:
        mesh = self.mesh
        reach = self.mesh.ranges[element]
        accuracy = self.accuracy or self.default_accuracy
        made, uniform = self._elements[element], self._are_clothoids[element]
        if uniform and reach <= ONE_TURN:
            rule = collocation(node_count(reach, accuracy))
        else:
            rule = measured_rule(made, reach, accuracy)
        if not uniform:
            return GradedLink(local, made, rod, reach, rule, end_mass)
        rest = mean(mesh, element, mesh.rest) if rod.rest is None else rod.rest
        density = mean(mesh, element, mesh.linear_density) * rod.linear_density
        rotary = mean(mesh, element, mesh.rotary_inertia) * rod.rotary_inertia
        return Clothoid([kappa + rest for kappa in local], rod.lengths[element], density, rotary, reach, rule, end_mass)

    def block(self, element: int, length: Scalar) -> list[list[Scalar]]:
        if not self._are_clothoids[element]:
            return list(self._elements[element].gram.tolist())
        # Integrals of the products of the shapes 1 - u and u.
        scale = mean(self.mesh, element, self.mesh.stiffness)
        return [[scale * (weight * length) for weight in row] for row in ((1 / 3, 1 / 6), (1 / 6, 1 / 3))]

    def work(self, element: int, lengths: Sequence[Scalar], moment: Curve | None = None) -> list[Scalar]:
        work: list[Scalar] = [0.0] * self.size
        value = 1.0 if moment is None else self.mesh.constant(moment, element)
        if self._are_clothoids[element] and value is not None:
            parts: list[Scalar] = [0.5 * value * lengths[element]] * 2
        else:
            parts = self._elements[element].work(moment or Curve.along(self.mesh.ends[-1], 1.0)).tolist()
        for a, part in zip(self.local(element), parts, strict=True):
            work[a] = part
        return work

    def shapes_at(self, element: int, s: Array) -> Array:
        return self._elements[element].on(s)

    def curvature_shapes(self, lengths: Sequence[float]) -> Array:
        shapes = np.zeros((self.elements, 2, self.size))
        for k, made in enumerate(self._elements):
            shapes[k][:, self.local(k)] = made.sides[:-1, [0, -1]].T
        return shapes
