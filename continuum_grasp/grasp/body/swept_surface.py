"""Distance of points from solids of revolution and extruded outlines, by the lines and arcs of their sections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.body.plane_boundary import Boundary, PlaneBoundary, PlaneDistance
from continuum_grasp.grasp.body.surface import SolidSurface, of_grid
from continuum_grasp.scene import Face

TURNS = 97
"""Points around a circle, for pictures."""
ROUNDED = 32
"""Number of points around the edge of a convex part: chords deviate by 0.5 % of its radius."""


class TurnedSurface(SolidSurface):
    """A solid of revolution about its z axis."""

    def __init__(self, section: Boundary, size: float) -> None:
        self.section = section
        self.size = size

    def scan(self, points: Array) -> tuple[Array, Array]:
        found, out, _ = self._from(points)
        return found.distance, np.column_stack([found.gradient[:, :1] * out, found.gradient[:, 1]])

    def to_second_order(self, points: Array) -> tuple[Array, Array, Array]:
        found, out, radial = self._from(points)
        normal = np.column_stack([found.gradient[:, :1] * out, found.gradient[:, 1]])
        along = np.column_stack([-found.gradient[:, 1:] * out, found.gradient[:, 0]])
        around = np.column_stack([-out[:, 1], out[:, 0], np.zeros(len(points))])
        on_axis = radial < 1e-9 * self.section.size
        bent = np.where(on_axis, found.curvature, found.gradient[:, 0] / np.where(on_axis, 1.0, radial))
        hessian = found.curvature[:, None, None] * _outer(along) + bent[:, None, None] * _outer(around)
        return found.distance, normal, hessian

    def _from(self, points: Array) -> tuple[PlaneDistance, Array, Array]:
        radial = np.hypot(points[:, 0], points[:, 1])
        out = np.where(radial[:, None] > 0.0, points[:, :2] / np.maximum(radial, 1e-300)[:, None], [1.0, 0.0])
        return self.section.from_points(np.column_stack([radial, points[:, 2]])), out, radial

    def triangles(self) -> tuple[Array, Array]:
        return of_grid(self._grid(TURNS))

    def _grid(self, turns: int) -> Array:
        """Points on circles about the axis (N, turns, 3), from below up."""
        ring, _ = self.section.ring()
        if ring[:, 0].min() < 0.0:  # a whole section: of its halves that at x > 0, from the axis to the axis
            inside = ring[:, 0] > 0.0
            first = int(np.flatnonzero(inside & ~np.roll(inside, 1))[0])
            half = np.roll(ring, -first, axis=0)[: int(inside.sum())]
            low, high = ring[:, 1].min(), ring[:, 1].max()
            ring = np.concatenate([[[0.0, low]], half, [[0.0, high]]])
        else:
            ring = np.concatenate([ring, ring[:1]])
        turn = np.linspace(0.0, 2.0 * np.pi, turns)
        around = [ring[:, :1] * np.cos(turn), ring[:, :1] * np.sin(turn), ring[:, 1:] + 0.0 * turn]
        return np.stack(around, axis=2)


class ExtrudedSurface(SolidSurface):
    """Everything within a radius of a core: an outline between two heights, -half and half."""

    def __init__(
        self, core: Boundary, half: float, radius: float, size: float, pieces: Sequence[Sequence[Face]] = ()
    ) -> None:
        self.core = core
        self.half = half
        self.radius = radius
        self.size = size
        self._pieces = pieces

    def scan(self, points: Array) -> tuple[Array, Array]:
        distance, normal, *_ = self._from(points)
        return distance, normal

    def to_second_order(self, points: Array) -> tuple[Array, Array, Array]:
        distance, normal, found, across, above = self._from(points)
        flat = np.column_stack([found.gradient, np.zeros(len(points))])
        along = np.column_stack([-found.gradient[:, 1], found.gradient[:, 0], np.zeros(len(points))])
        is_across = (across > 0.0) | (normal[:, 2] == 0.0)
        bent = np.where(is_across, np.maximum(across, 0.0) * found.curvature, 0.0)
        total = bent[:, None, None] * _outer(along)
        total += np.where(is_across[:, None, None], _outer(flat), 0.0)
        total += np.where(((above > 0.0) | ~is_across)[:, None, None], np.diag([0.0, 0.0, 1.0]), 0.0)
        reach = np.hypot(np.maximum(across, 0.0), np.maximum(above, 0.0))
        inside = reach <= 1e-12
        hessian = (total - _outer(normal)) / np.where(inside, 1.0, reach)[:, None, None]
        # Deep inside, the nearest side or cap decides.
        deep = np.where(is_across, found.curvature, 0.0)[:, None, None] * _outer(along)
        return distance, normal, np.where(inside[:, None, None], deep, hessian)

    def _from(self, points: Array) -> tuple[Array, Array, PlaneDistance, Array, Array]:
        found = self.core.from_points(points[:, :2])
        above = np.abs(points[:, 2]) - self.half
        across = found.distance
        u = np.maximum(across, 0.0)
        v = np.maximum(above, 0.0)
        reach = np.hypot(u, v)
        inside = reach <= 1e-12
        to_side = np.where(inside, across >= above, False)
        share = np.where(inside, to_side, u / np.where(inside, 1.0, reach))
        up = np.where(inside, ~to_side, v / np.where(inside, 1.0, reach))
        normal = np.column_stack([share[:, None] * found.gradient, up * np.copysign(1.0, points[:, 2])])
        distance = np.where(inside, np.maximum(across, above), reach) - self.radius
        return distance, normal, found, across, above

    @property
    def box(self) -> tuple[Array, Array]:
        ring, _ = self.core.ring()
        low, high = np.append(ring.min(axis=0), -self.half), np.append(ring.max(axis=0), self.half)
        return low - self.radius, high + self.radius

    def triangles(self) -> tuple[Array, Array]:
        ring, outward = self.core.ring()
        return of_grid(self._grid(ring, outward))

    def convex_parts(self) -> list[Array]:
        """Corners (N, 3) of the grown pieces of the core [m]."""
        turn = np.linspace(0.0, 2.0 * np.pi, ROUNDED + 1)[:-1]
        around = np.column_stack([np.cos(turn), np.sin(turn)])
        rings = [PlaneBoundary(piece).ring()[0] for piece in self._pieces]
        grids = [self._grid(np.repeat(ring, ROUNDED, axis=0), np.tile(around, (len(ring), 1))) for ring in rings]
        return [grid.reshape(-1, 3) for grid in grids]

    def _grid(self, ring: Array, outward: Array) -> Array:
        """Points of caps and rims (14, N + 1, 3) around points of the core with normals there (N, 2)."""
        quarter = np.linspace(0.0, 0.5 * np.pi, 6)
        ends = [(-self.half, quarter - 0.5 * np.pi), (self.half, quarter)]
        rows = [
            np.column_stack([ring + self.radius * np.cos(a) * outward, np.full(len(ring), z + self.radius * np.sin(a))])
            for z, rise in ends
            for a in rise
        ]
        middle = ring.mean(axis=0)
        caps = [np.column_stack([np.tile(middle, (len(ring), 1)), row[:, 2]]) for row in (rows[0], rows[-1])]
        grid = np.array([caps[0], *rows, caps[1]])
        return np.concatenate([grid, grid[:, :1]], axis=1)


def _outer(vectors: Array) -> Array:
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])
