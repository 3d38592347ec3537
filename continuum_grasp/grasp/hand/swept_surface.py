"""Distance of points from solids of revolution and extruded outlines, by the lines and arcs of their sections."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.frames import of_grid
from continuum_grasp.scene import Face

SAMPLES = 2000
"""Points along a boundary among which the nearest one says which line or arc is nearest, and its neighbors: of scans,
whose points need not be exact where two are nearly as near."""
FEW = 64
"""Points up to which all lines and arcs are looked at."""
TURNS = 97
"""Points around a circle, for pictures."""
ROUNDED = 32
"""Number of points around the edge of a convex part: chords deviate by 0.5 % of its radius."""


class PlaneDistance(NamedTuple):
    """Signed distance (N,) from a boundary in the plane, its gradient (N, 2), and the curvature (N,) of its level."""

    distance: Array
    gradient: Array
    curvature: Array


class PlaneBoundary:
    """A closed boundary of lines and arcs, counter-clockwise."""

    def __init__(self, faces: Sequence[Face]) -> None:
        self.start = np.array([face.start for face in faces])
        self.end = np.array([face.end for face in faces])
        self.normal = np.array([face.normal for face in faces])
        self.turn = np.array([face.turn for face in faces])
        radius = np.array([face.radius for face in faces])
        self.is_arc = (self.turn != 0.0) & (radius != 0.0)
        self.radius = np.where(self.is_arc, radius, 1.0)
        direction = np.column_stack([np.cos(self.normal), np.sin(self.normal)])
        self.center = self.start - self.radius[:, None] * direction
        self.size = float(np.ptp(self.start, axis=0).max() + np.abs(radius).max())
        count = len(faces)
        self.neighbors = (np.arange(count)[:, None] + np.array([-1, 0, 1])) % count
        lengths = np.where(self.is_arc, radius * self.turn, np.linalg.norm(self.end - self.start, axis=1))
        pieces = np.maximum(4, np.ceil(SAMPLES * lengths / lengths.sum())).astype(int)
        owner = np.repeat(np.arange(count), pieces)
        share = np.concatenate([(np.arange(n) + 0.5) / n for n in pieces])
        self.owner, self.samples = owner, self.at(owner, share)
        self.tree = cKDTree(self.samples)

    def at(self, face: Array, share: Array) -> Array:
        """Points (N, 2) of faces at shares of their lengths."""
        angle = self.normal[face] + share * self.turn[face]
        arc = self.center[face] + self.radius[face, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        line = self.start[face] + share[:, None] * (self.end - self.start)[face]
        return np.asarray(np.where(self.is_arc[face, None], arc, line))

    def from_points(self, points: Array) -> PlaneDistance:
        """Distance of points (N, 2)."""
        if len(points) <= FEW:
            chosen = np.broadcast_to(np.arange(len(self.start)), (len(points), len(self.start)))
        else:
            chosen = self.neighbors[self.owner[self.tree.query(points)[1]]]
        place, outward, curvature = self._nearest(points[:, None], chosen)
        away = points[:, None] - place
        apart = np.linalg.norm(away, axis=2)
        best = apart.argmin(axis=1)[:, None]
        least = np.take_along_axis(apart, best, axis=1)
        # At a corner both sides say together where a point is.
        near = apart <= least + 1e-9 * self.size
        height = np.where(near, (away * outward).sum(axis=2), 0.0).sum(axis=1)
        sign = np.where(height < 0.0, -1.0, 1.0)
        pick = best[:, :, None]
        away, outward = (np.take_along_axis(part, pick, axis=1)[:, 0] for part in (away, outward))
        on = least[:, 0] <= 1e-12 * self.size
        gradient = np.where(on[:, None], outward, sign[:, None] * away / np.maximum(least, 1e-300))
        distance = sign * least[:, 0]
        bent = np.take_along_axis(curvature, best, axis=1)[:, 0]
        # Of the level through the point, not of the boundary; a corner is an arc of no radius.
        reach = np.where(np.isinf(bent), 0.0, 1.0 / np.where((bent == 0.0) | np.isinf(bent), 1.0, bent)) + distance
        level = np.where(bent == 0.0, 0.0, 1.0 / np.where(np.abs(reach) < 1e-9 * self.size, 1e-9 * self.size, reach))
        return PlaneDistance(distance, gradient, level)

    def _nearest(self, points: Array, face: Array) -> tuple[Array, Array, Array]:
        """Nearest places (N, K, 2) of faces (N, K), outward normals there, and curvatures (N, K), infinite at ends."""
        start = self.start[face]
        span = (self.end - self.start)[face]
        share = ((points - start) * span).sum(axis=2) / np.maximum((span * span).sum(axis=2), 1e-300)
        line = start + np.clip(share, 0.0, 1.0)[..., None] * span
        side = np.sign(self.radius[face])
        whole = np.abs(self.turn[face])
        away = side[..., None] * (points - self.center[face])
        turned = (side * (np.arctan2(away[..., 1], away[..., 0]) - self.normal[face])) % (2.0 * np.pi)
        inside = turned <= whole
        turned = np.where(inside, turned, np.where(turned < 0.5 * whole + np.pi, whole, 0.0))
        angle = self.normal[face] + np.where(self.is_arc[face], side * turned, 0.0)
        outward = np.stack([np.cos(angle), np.sin(angle)], axis=2)
        arc = self.center[face] + self.radius[face][..., None] * outward
        is_arc = self.is_arc[face]
        ends = np.where(is_arc, ~inside, (share < 0.0) | (share > 1.0))
        curvature = np.where(ends, np.inf, np.where(is_arc, 1.0 / self.radius[face], 0.0))
        return np.where(is_arc[..., None], arc, line), outward, curvature

    def ring(self) -> tuple[Array, Array]:
        """Points around the boundary (N, 2) from face to face, and normals there (N, 2), for pictures."""
        pieces = np.where(self.is_arc, np.maximum(1, np.ceil(np.abs(self.turn) / 0.1)), 1).astype(int) + 1
        owner = np.repeat(np.arange(len(pieces)), pieces)
        share = np.concatenate([np.linspace(0.0, 1.0, n) for n in pieces])
        angle = self.normal[owner] + share * self.turn[owner]
        return self.at(owner, share), np.column_stack([np.cos(angle), np.sin(angle)])


class TurnedSurface:
    """A solid of revolution about its z axis."""

    def __init__(self, solid: Any) -> None:
        self.section = PlaneBoundary(solid.section)

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Distance (N,) of points (N, 3), and outward normals (N, 3)."""
        found, out, _ = self._from(points)
        return found.distance, np.column_stack([found.gradient[:, :1] * out, found.gradient[:, 1]])

    def near(self, points: Array) -> tuple[Array, Array, Array]:
        """Distance (K,), outward normals (K, 3) and Hessians of the distance (K, 3, 3)."""
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
        """Corners (V, 3) and triangles (T, 3) of it, for pictures."""
        return of_grid(self._grid(TURNS))

    def _grid(self, turns: int) -> Array:
        """Points on circles about the axis (N, turns, 3), from below up."""
        ring, _ = self.section.ring()
        if ring[:, 0].min() < 0.0:  # a whole section: of its halves that at x > 0, from the axis to the axis
            inside = ring[:, 0] > 0.0
            first = int(np.flatnonzero(inside & ~np.roll(inside, 1))[0])
            half = np.roll(ring, -first, axis=0)[: int(inside.sum())]
            ring = np.concatenate([[[0.0, half[0, 1]]], half, [[0.0, half[-1, 1]]]])
        else:
            ring = np.concatenate([ring, ring[:1]])
        turn = np.linspace(0.0, 2.0 * np.pi, turns)
        around = [ring[:, :1] * np.cos(turn), ring[:, :1] * np.sin(turn), ring[:, 1:] + 0.0 * turn]
        return np.stack(around, axis=2)


class ExtrudedSurface:
    """Everything within a radius of a core: an outline between two heights."""

    def __init__(self, solid: Any) -> None:
        self.core = PlaneBoundary(solid.core)
        self.half = solid.half_height
        self.radius = solid.edge_radius
        self._pieces = solid.core_pieces

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Distance (N,) of points (N, 3), and outward normals (N, 3)."""
        distance, normal, *_ = self._from(points)
        return distance, normal

    def near(self, points: Array) -> tuple[Array, Array, Array]:
        """Distance (K,), outward normals (K, 3) and Hessians of the distance (K, 3, 3)."""
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

    def triangles(self) -> tuple[Array, Array]:
        """Corners (V, 3) and triangles (T, 3) of it, for pictures."""
        ring, outward = self.core.ring()
        return of_grid(self._grid(ring, outward))

    def convex_parts(self) -> list[Array]:
        """Corners (N, 3) of convex bodies whose union is the solid, in its own frame [m]: the grown pieces of the
        core.
        """
        turn = np.linspace(0.0, 2.0 * np.pi, ROUNDED + 1)[:-1]
        around = np.column_stack([np.cos(turn), np.sin(turn)])
        rings = [PlaneBoundary(piece).ring()[0] for piece in self._pieces]
        grids = [self._grid(np.repeat(ring, ROUNDED, axis=0), np.tile(around, (len(ring), 1))) for ring in rings]
        return [grid.reshape(-1, 3) for grid in grids]

    def _grid(self, ring: Array, outward: Array) -> Array:
        """Points of caps and rims (12, N + 1, 3) around points of the core with normals there (N, 2)."""
        rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 10)
        rows = [
            np.column_stack([ring + r * np.cos(a) * outward, np.full(len(ring), z + r * np.sin(a))])
            for a in rise
            for r, z in [(self.radius, np.copysign(self.half, a))]
        ]
        middle = ring.mean(axis=0)
        caps = [np.column_stack([np.tile(middle, (len(ring), 1)), row[:, 2]]) for row in (rows[0], rows[-1])]
        grid = np.array([caps[0], *rows, caps[1]])
        return np.concatenate([grid, grid[:, :1]], axis=1)


def _outer(vectors: Array) -> Array:
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])
