"""The surface of an offset polygon: everything within a distance of a simple polygon, a segment or a point.

A contact of a grasp sits on a *feature*, a face or a corner of the core, and every point there is

    p = a + sigma (b - a) + r n(alpha),     n(alpha) = (cos alpha, sin alpha)

On a face alpha is the face's normal and sigma in [0, 1] is free: the contact slides along the face. On a corner a = b
and alpha is free between the normals of the faces next to it. So faces, corners, stadiums and discs differ by numbers
only. Reflex corners are no features: nothing round touches them but both their faces.

The nearest edge says how far the core is, and on which side of it a point lies whether inside. Where a corner is as
near by both its edges, it is the edge of which the point is higher above or below the line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.planar import Rotation, Scalar, Vec
from continuum_grasp.model.surfaces.surface import (
    Feature,
    Frame,
    GrownOutline,
    Nearest,
    Surface,
    SurfacePoint,
    Walk,
    chosen,
    length,
    picked,
)
from continuum_grasp.scene import OffsetPolygon

SHARP = 1e-7
"""Radius that a sharp corner has where contacts roll over it [m]: far below any real edge, and its curvature of 1e7 1/m
is still exact beside those of fingers."""
BLUNT, SPAN = 0.1, 0.3
"""Turn of the normal at a corner [rad] up to which it is blunt, and on either side of a contact that of blunt corners
that a circle stands for."""
_SKIN = 1e-9
"""Distance up to which a point outside a sharp polygon is treated as one on its face [m]: below, the direction to the
nearest point is lost in rounding."""
_SLOT = 1e-9
"""Squared preference, per squared extent, of the side of a segment on which a point lies."""


@dataclass(frozen=True)
class PolygonSurface(Surface[OffsetPolygon]):
    """The surface of offset polygons with this many corners: one for a disc, two for a stadium."""

    corners: int

    feature_count = 5

    @property
    def number_count(self) -> int:  # type: ignore[override]
        return 2 * self.corners + 1

    # -- contact in motion

    def nearest(self, part: OffsetPolygon, at: Vec) -> Nearest:
        core = part.vertices
        if len(core) == 1:
            away = at - Vec(*core[0])
            size = length(away)
            return Nearest(size - part.radius, away.scaled(1.0 / size))
        # A rectangle is symmetric: folded into one quadrant it takes fewer instructions than four edges.
        spot = _from_rectangle(core, at) if _is_rectangle(core) else _from_polygon(core, at)
        return Nearest(spot.distance - part.radius, spot.normal)

    def lowest_points(self, part: OffsetPolygon, direction: Vec) -> list[Vec]:
        return [Vec(*part.vertices[k]) + direction.scaled(part.radius) for k in _outermost(part.vertices)]

    # -- contact of a grasp

    def point(self, place: ca.SX, feature: ca.SX) -> SurfacePoint:
        normal = ca.vertcat(ca.cos(place[1]), ca.sin(place[1]))
        a, b = feature[:2], feature[2:4]
        return SurfacePoint(a + place[0] * (b - a) + feature[4] * normal, normal, ca.SX(0, 1))

    def wall_clearance(self, normal: ca.SX, point: ca.SX, angle: ca.SX, pose: ca.SX, numbers: ca.SX) -> list[ca.SX]:
        c, s = ca.cos(pose[2]), ca.sin(pose[2])
        turn = ca.vertcat(ca.horzcat(c, -s), ca.horzcat(s, c))
        corners = [pose[:2] + turn @ numbers[2 * k : 2 * k + 2] for k in range(self.corners)]
        return [ca.dot(normal, corner - point) - numbers[-1] for corner in corners]

    def numbers(self, part: OffsetPolygon, unit: float) -> list[float]:
        return [*(c / unit for v in part.vertices for c in v), part.radius / unit]

    def feature_numbers(self, feature: Feature, unit: float) -> list[float]:
        return [c / unit for c in feature.numbers]

    def features(self, part: OffsetPolygon) -> list[Feature]:
        core, r = part.vertices, part.radius
        # Counter-clockwise, each corner before the face that begins there: its normal turns from the face before it.
        bend = 1.0 / max(r, SHARP)
        if len(core) == 1:
            return [Feature((*core[0], *core[0], r), (0.0, -math.inf), (0.0, math.inf), bend)]
        features = []
        for (a, b), (_, turn) in zip(pairwise([*core, core[0]]), part.turns, strict=True):
            normal = math.atan2(a[0] - b[0], b[1] - a[1])
            if turn > 0.0:
                features.append(Feature((*a, *a, r), (0.0, normal - turn), (0.0, normal), bend))
            features.append(Feature((*a, *b, r), (0.0, normal), (1.0, normal)))
        return features

    def beyond(self, part: OffsetPolygon, feature: Feature, side: int) -> tuple[Feature, tuple[float, float]] | None:
        every = self.features(part)
        other = every[(every.index(feature) + side) % len(every)]
        # Faces follow each other at a reflex corner, where the normal jumps.
        both = feature.is_face and other.is_face
        return None if both else (other, other.lower if side > 0 else other.upper)

    def smoothed(self, part: OffsetPolygon, feature: Feature) -> Feature | None:
        every = self.features(part)
        ends = [end for side in (-1, 1) if (end := _blunt_end(every, every.index(feature), side)) is not None]
        if len(ends) < 2:
            return None
        # The circle through three points.
        middle = 0.5 * (np.array(feature.numbers[:2]) + feature.numbers[2:4])
        across = np.array(ends) - middle
        x, y = (middle + np.linalg.solve(2.0 * across, (across**2).sum(axis=1))).tolist()
        low, high = (math.atan2(end[1] - y, end[0] - x) for end in ends)
        size = math.dist((x, y), middle) + part.radius
        return Feature((x, y, x, y, size), (0.0, low), (0.0, high + math.tau * (high < low)), 1.0 / size)

    def place(
        self, part: OffsetPolygon, feature: Feature, point: tuple[float, float], normal_angle: float
    ) -> tuple[float, float]:
        ax, ay, bx, by, r = feature.numbers
        dx, dy = bx - ax, by - ay
        size = dx * dx + dy * dy
        x, y = point[0] - r * math.cos(normal_angle), point[1] - r * math.sin(normal_angle)
        share = 0.0 if size == 0.0 else min(max(((x - ax) * dx + (y - ay) * dy) / size, 0.0), 1.0)
        middle = 0.5 * (feature.lower[1] + feature.upper[1])
        angle = middle + math.remainder(normal_angle - middle, math.tau) if math.isfinite(middle) else normal_angle
        return share, min(max(angle, feature.lower[1]), feature.upper[1])

    def near(self, part: OffsetPolygon, point: tuple[float, float], normal_angle: float) -> list[Feature]:
        size = float(np.ptp(np.array(part.vertices), axis=0).max()) + part.radius

        def misfit(feature: Feature) -> float:
            share, angle = self.place(part, feature, point, normal_angle)
            ax, ay, bx, by, r = feature.numbers
            x = ax + share * (bx - ax) + r * math.cos(angle) - point[0]
            y = ay + share * (by - ay) + r * math.sin(angle) - point[1]
            turn = abs(math.remainder(angle - normal_angle, math.tau))
            # At the end of a face the corner fits as well: prefer the face, along which a contact can slide.
            corner = ax == bx and ay == by and len(part.vertices) > 1
            return math.hypot(x, y) / size + turn + (1e-9 if corner else 0.0)

        return sorted(self.features(part), key=misfit)

    # -- search of a grasp

    def outline(self, part: OffsetPolygon, frame: Frame, grown: float) -> GrownOutline:
        vertices = frame.point(np.array([complex(*v) for v in part.vertices]))
        return _PolygonOutline(vertices[::-1] if frame.mirrored else vertices, part.radius * frame.scale, grown)


def _blunt_end(every: Sequence[Feature], at: int, side: int) -> tuple[float, float] | None:
    """Place where blunt corners after (+1) or before (-1) a feature turn by `SPAN` in all; None if others end them."""
    turned = 0.5 * every[at].turn
    while every[at].turn < BLUNT and turned < SPAN:
        before, at = every[at], (at + side) % len(every)
        if before.is_face and every[at].is_face:
            return None
        turned += every[at].turn
    x, y, *_ = every[at].numbers
    return (x, y) if every[at].turn < BLUNT else None


def _is_rectangle(core: Sequence[tuple[float, float]]) -> bool:
    if len(core) != 4:
        return False
    # A parallelogram (its diagonals share their middle) whose diagonals are equally long.
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = core
    size = math.dist(core[0], core[2])
    middles = math.dist((ax + cx, ay + cy), (bx + dx, by + dy))
    return middles < 1e-12 * size and abs(size - math.dist(core[1], core[3])) < 1e-12 * size


def _from_rectangle(core: Sequence[tuple[float, float]], at: Vec) -> Nearest:
    (ax, ay), (bx, by), (cx, cy), _ = core
    width, height = math.dist(core[0], core[1]), math.dist(core[1], core[2])
    turn = Rotation(*(0.0 if abs(v) < 1e-15 else v for v in ((bx - ax) / width, (by - ay) / width)))
    local = turn.transposed().apply(at - Vec(0.5 * (ax + cx), 0.5 * (ay + cy)))
    x, y = ca.fabs(local.x) - 0.5 * width, ca.fabs(local.y) - 0.5 * height
    beyond = Vec(ca.fmax(x, 0.0), ca.fmax(y, 0.0))
    size = length(beyond)
    deepest = ca.fmax(x, y)
    inside = deepest <= _SKIN
    normal = chosen(inside, Vec(x > y, x <= y), beyond.scaled(1.0 / size))
    # Signs that are never zero: on an axis of the rectangle either side will do.
    signs = Vec(2.0 * (local.x >= 0.0) - 1.0, 2.0 * (local.y >= 0.0) - 1.0)
    return Nearest(ca.if_else(inside, deepest, size), turn.apply(Vec(signs.x * normal.x, signs.y * normal.y)))


def _outermost(core: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the corners of the convex hull, counter-clockwise."""
    if len(core) < 4:
        return list(range(len(core)))
    from scipy.spatial import ConvexHull

    corners = ConvexHull(np.array(core)).vertices.tolist()
    first = corners.index(min(corners))
    return [*corners[first:], *corners[:first]]


def _from_polygon(core: Sequence[tuple[float, float]], at: Vec) -> Nearest:
    """By the nearest of the edges; two vertices are a segment, which has no inside."""
    # All edges are compared at run time: a chain of selections, since branches have no derivative.
    edges = list(pairwise([*core, core[0]])) if len(core) > 2 else [(core[0], core[1])]
    seen: list[tuple[Scalar, Scalar, Vec, Vec]] = []
    for (ax, ay), (bx, by) in edges:
        long = math.hypot(bx - ax, by - ay)
        along, normal = Vec((bx - ax) / long, (by - ay) / long), Vec((by - ay) / long, (ax - bx) / long)
        away = at - Vec(ax, ay)
        s, height = along.dot(away), normal.dot(away)
        over = s - ca.fmin(ca.fmax(s, 0.0), long)
        seen.append((over, height, along.scaled(over) + normal.scaled(height), normal))
    sides: list[tuple[Scalar, Scalar, Vec, Vec]] = []
    for k, (past, above, offset, normal) in enumerate(seen):
        # At a corner both faces say together on which side a point lies: one alone does not, where it is acute.
        before, after = seen[k - 1][1], seen[(k + 1) % len(seen)][1]
        side = above + before * ca.SX(past < 0.0) + after * ca.SX(past > 0.0)
        sides.append((offset.dot(offset), side, offset, normal))
    least, height, away, face = sides[0]
    for other, above, offset, normal in sides[1:]:
        nearer = ca.SX(other < least)
        least, height = ca.fmin(other, least), height + (above - height) * nearer
        away, face = chosen(nearer, offset, away), chosen(nearer, normal, face)
    size = length(away)
    if len(core) == 2:
        return Nearest(size, away.scaled(1.0 / size))
    sign = 2.0 * (height > 0.0) - 1.0
    on_face = size <= _SKIN
    return Nearest(ca.if_else(on_face, height, sign * size), chosen(on_face, face, away.scaled(sign / size)))


class _PolygonOutline(GrownOutline):
    """Outline of an offset polygon."""

    def __init__(self, vertices: Array, radius: float, grown: float) -> None:
        self.corners = vertices
        self.radius = radius
        self.grown = radius + grown
        size = len(vertices)
        extent = float(np.abs(vertices - vertices.mean()).max()) if size > 1 else 0.0
        # Meters of walk per radian of a corner: some length even where the corner is sharp and not grown.
        self._per_angle = self.grown + 0.2 * extent
        self._edges = np.roll(vertices, -1) - vertices if size > 1 else np.zeros(1, complex)
        self._lengths = np.abs(self._edges)
        if size > 1:
            self._along = self._edges / self._lengths
            normals = np.angle(-1j * self._along)
            # A reflex corner is passed at once.
            turns = np.mod(np.roll(normals, -1) - normals, math.tau)
            turns[turns > math.pi + SHARP] = 0.0
        else:
            self._along, normals, turns = np.ones(1, complex), np.zeros(1), np.full(1, math.tau)
        self._normals, self._turns = normals, turns
        pieces = np.stack([self._lengths, turns * self._per_angle], axis=1).ravel()
        self._starts = np.concatenate([[0.0], np.cumsum(pieces)])
        self.joints, self.period = self._starts[:-1], float(self._starts[-1])
        self.breaks = self._starts[:-1:2][np.roll(turns == 0.0, 1)]
        self.center = complex(vertices.mean())
        self.extent = extent + radius

    @cached_property
    def face_normals(self) -> tuple[float, ...]:  # type: ignore[override]
        corners = self.corners[_outermost([(z.real, z.imag) for z in self.corners.tolist()])]
        return tuple(np.angle(-1j * (np.roll(corners, -1) - corners)).tolist()) if len(corners) > 1 else ()

    def walk(self, w: Array) -> Walk:
        w = np.mod(w, self.period)
        piece = np.clip(np.searchsorted(self._starts, w, side="right") - 1, 0, len(self._starts) - 2)
        local = w - self._starts[piece]
        edge, corner = piece // 2, piece % 2 == 1
        turn = np.where(corner, local / self._per_angle, 0.0)
        angle = self._normals[edge] + turn
        normal = np.exp(1j * angle)
        at = self.corners[edge] + np.where(corner, self._edges[edge], local * self._along[edge])
        dpoint = np.where(corner, 1j * normal * (self.grown / self._per_angle), self._along[edge])
        return Walk(at + self.grown * normal, angle, dpoint, np.where(corner, 1.0 / self._per_angle, 0.0))

    def nearest(self, points: Array) -> tuple[Array, Array]:
        gap, edge, along = self._nearest_edge(points)
        length = self._lengths[edge]
        start = self._starts[2 * edge]
        before, after = along <= 0.0, along >= length
        vertex = np.where(before, edge, (edge + 1) % len(self.corners))
        owner = np.where(before, (edge - 1) % len(self.corners), edge)
        turn = np.mod(np.angle(points - self.corners[vertex]) - self._normals[owner], math.tau)
        turn = np.where(turn > 0.5 * (self._turns[owner] + math.tau), 0.0, np.minimum(turn, self._turns[owner]))
        corner = self._starts[2 * owner + 1] + turn * self._per_angle
        return gap, np.where((before | after) & (gap > -self.radius), corner, start + np.clip(along, 0.0, length))

    def distance(self, points: Array) -> Array:
        return self._nearest_edge(points)[0]

    @property
    def rough_numbers(self) -> list[float]:
        each = [self.corners.real, self.corners.imag, self._along.real, self._along.imag, self._lengths]
        numbers = [self.radius, _SLOT * self.extent**2, *np.stack(each, axis=1).ravel().tolist()]
        return [0.0, len(self.corners), len(numbers), *numbers]

    def _nearest_edge(self, points: Array) -> tuple[Array, Array, Array]:
        if len(self.corners) == 1:
            zero = np.zeros(points.shape, int)
            return np.abs(points - self.corners[0]) - self.radius, zero, np.zeros(points.shape)
        turned = (points[..., None] - self.corners) * np.conj(self._along)
        along, out = turned.real, -turned.imag
        beyond = along - np.clip(along, 0.0, self._lengths)
        square = beyond**2 + out**2
        # A segment is two edges back to back: the side on which the point lies decides.
        if len(self.corners) == 2:
            square = square + np.where(out < 0.0, _SLOT * self.extent**2, 0.0)
        edge = np.argmin(square, axis=-1)
        over, height = picked(beyond, edge), picked(out, edge)
        core = np.hypot(over, height)
        if len(self.corners) > 2:
            # At a corner both faces say together on which side a point lies: one alone does not, where it is acute.
            other = (edge + np.sign(over).astype(int)) % len(self.corners)
            core = np.where(height + np.where(over == 0.0, 0.0, picked(out, other)) < 0.0, -core, core)
        return core - self.radius, edge, picked(along, edge)

    def extremes(self, direction: complex, flat: float) -> list[tuple[complex, float]]:
        heights = (self.corners * np.conj(direction)).real
        below = heights.max() - heights
        level = np.flatnonzero(below <= flat)
        along = (self.corners[level] * np.conj(1j * direction)).real
        ends = {int(level[along.argmin()]), int(level[along.argmax()])}
        extremes = [(complex(self.corners[k]) + self.radius * direction, float(below[k])) for k in ends]
        return sorted(extremes, key=lambda end: end[1])
