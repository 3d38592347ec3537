"""The surface of an offset polygon: everything within a distance of a simple polygon, a segment or a point; edges may
be curves.

A contact of a grasp has one unknown u, its place along the outline grown by what touches there, a round body of radius
g. Lines, arcs and corners are pieces of one kind: on each

    p = c + u d + rho n(alpha),     alpha = alpha_0 + kappa u,     n(alpha) = (cos alpha, sin alpha)

with d = 0 on arcs and corners, kappa = 0 on lines. Several arcs after each other are a window: with s_k, what u has run
on the k-th, p and alpha are sums over pieces of the same terms of s_k. As kappa (rho + g) is the same on all of them,
the grown outline p + g n has one speed: it is C1 in u. A window ends where the curvature of the grown outline jumps, at
the ends of lines and at corners: contact forces act along n, which is not smooth in u there, so that a grasp may be
best at such an end. It is a bound, at which multipliers say whether to go on; a solver would zigzag about a kink.
Reflex corners are no pieces: nothing round touches them but both their faces.

The nearest edge says how far the core is, and on which side of it a point lies whether inside. Where a corner is as
near by both its edges, the edge counts with the point higher above or below its line.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np

from continuum_grasp.model.planar import Rotation, Scalar, Vec
from continuum_grasp.model.surfaces.polygon_outline import SHARP, PolygonOutline, outermost
from continuum_grasp.model.surfaces.surface import (
    Feature,
    Nearest,
    PartOutline,
    Surface,
    SurfacePoint,
    chosen,
    length,
)
from continuum_grasp.scene import SAME, Face, OffsetPolygon

WINDOW = 7
"""Pieces along which a contact may slide in one run of the solver: arcs of a curve, three on either side."""
KINK = 2.0
"""Greatest ratio of the radii of two arcs of the grown outline in one window [1]."""
_FAR = 1e6
"""Length of a piece beyond the end of a window, where bounds keep the unknown in [unknown]."""
_SKIN = 1e-9
"""A point outside a sharp polygon within this distance counts as on its face [m]: the direction to the nearest point
would be rounding."""


@dataclass(frozen=True)
class Piece:
    """A line, an arc or a corner of an offset polygon."""

    base: complex
    """Start of a line of the core, center of an arc, corner of the core [m]."""
    span: complex
    """Vector of a line from its start to its end; zero of others [m]."""
    normal: float
    """Angle of the outward normal at the start [rad]."""
    turn: float
    """By how much the normal turns [rad]; 0 on a line."""
    reach: float
    """Distance of the surface from the line, the center or the corner [m]."""
    after: bool
    """Whether the piece follows the one before it; else a reflex corner is between them."""

    def point(self, share: float) -> complex:
        """Point of the surface at a part of its length."""
        return self.base + share * self.span + cmath.rect(self.reach, self.normal + share * self.turn)

    def share(self, point: complex, normal_angle: float) -> float:
        """Part of its length at a point next to the surface with a normal."""
        if self.turn:
            middle = self.normal + 0.5 * self.turn
            off = math.remainder(normal_angle - middle, math.tau)
            return 0.5 + (off / self.turn if self.turn >= math.tau else min(max(off / self.turn, -0.5), 0.5))
        away = point - self.base - cmath.rect(self.reach, normal_angle)
        return min(max((away * self.span.conjugate()).real / abs(self.span) ** 2, 0.0), 1.0)


@lru_cache(maxsize=256)
def pieces_of(part: OffsetPolygon) -> tuple[Piece, ...]:
    """Lines, arcs and convex corners of a part, counter-clockwise."""
    pieces: list[Piece] = []
    faces, radius = part.faces, part.radius
    after = True
    for face, other in zip(faces, (*faces[1:], faces[0]), strict=True):
        start, end = complex(*face.start), complex(*face.end)
        base, span = (complex(*face.center), 0.0j) if face.turn else (start, end - start)
        pieces.append(Piece(base, span, face.normal, face.turn, face.radius + radius, after))
        end_normal = face.normal + face.turn
        turn = (other.normal - end_normal) % math.tau
        reflex = turn > math.pi + SHARP and turn < math.tau - SAME
        after = not reflex
        if len(faces) > 1 and not reflex and SAME < turn < math.tau - SAME:
            pieces.append(Piece(end, 0.0j, end_normal, turn, radius, True))
    return (replace(pieces[0], after=after), *pieces[1:])


@dataclass(frozen=True)
class PolygonSurface(Surface[OffsetPolygon]):
    """Surface of offset polygons with a number of corners, one for a disc, two for a stadium, and a number of arcs
    between them.
    """

    corners: int
    arcs: int = 0

    place_count = 1
    feature_count = 3 + 8 * WINDOW

    @staticmethod
    def of(part: OffsetPolygon) -> PolygonSurface:
        """The surface of a part."""
        return PolygonSurface(len(_corners(part)), len(_arcs(part)))

    @property
    def number_count(self) -> int:  # type: ignore[override]
        return 2 * self.corners + 5 * self.arcs + 1

    # -- contact in motion

    def nearest(self, part: OffsetPolygon, at: Vec) -> Nearest:
        core, circle = part.vertices, part.circle
        if circle is not None:
            away = at - Vec(*circle[0])
            size = length(away)
            return Nearest(size - circle[1], away.scaled(1.0 / size))
        # A rectangle is symmetric: folded into one quadrant it takes fewer instructions than four edges.
        spot = _from_rectangle(core, at) if _is_rectangle(core) else _from_polygon(core, at)
        return Nearest(spot.distance - part.radius, spot.normal)

    def lowest_points(self, part: OffsetPolygon, direction: Vec) -> list[Vec]:
        if part.circle is not None:
            return [Vec(*part.circle[0]) + direction.scaled(part.circle[1])]
        return [Vec(*part.vertices[k]) + direction.scaled(part.radius) for k in outermost(part.vertices)]

    # -- contact of a grasp

    def point(self, place: ca.SX, feature: ca.SX) -> SurfacePoint:
        point = feature[:2]
        angle = feature[2]
        for k in range(WINDOW):
            start, low, high, dx, dy, normal, bend, reach = ca.vertsplit(feature[3 + 8 * k : 11 + 8 * k])
            run = ca.fmin(ca.fmax(place - start, low), high)
            turned = normal + bend * run
            point += run * ca.vertcat(dx, dy) + reach * ca.vertcat(ca.cos(turned), ca.sin(turned))
            angle += bend * run
        return SurfacePoint(point, ca.vertcat(ca.cos(angle), ca.sin(angle)), ca.SX(0, 1))

    def wall_clearance(self, normal: ca.SX, point: ca.SX, angle: ca.SX, pose: ca.SX, numbers: ca.SX) -> list[ca.SX]:
        c = ca.cos(pose[2])
        s = ca.sin(pose[2])
        turn = ca.vertcat(ca.horzcat(c, -s), ca.horzcat(s, c))
        radius = numbers[-1]
        outermost = [numbers[2 * k : 2 * k + 2] for k in range(self.corners)]
        for k in range(self.arcs):
            x, y, reach, middle, half = ca.vertsplit(numbers[2 * self.corners + 5 * k :][:5])
            # On an arc, the point whose normal is nearest to the wall's.
            off = angle + ca.pi - pose[2] - middle
            facing = middle + ca.fmin(ca.fmax(ca.atan2(ca.sin(off), ca.cos(off)), -half), half)
            outermost.append(ca.vertcat(x + reach * ca.cos(facing), y + reach * ca.sin(facing)))
        return [ca.dot(normal, pose[:2] + turn @ place - point) - radius for place in outermost]

    def numbers(self, part: OffsetPolygon, unit: float) -> list[float]:
        radius = part.radius if part.circle is None else part.circle[1]
        places = [c / unit for corner in _corners(part) for c in corner]
        for arc in _arcs(part):
            places += [*(c / unit for c in arc.center), arc.radius / unit, arc.normal + 0.5 * arc.turn, 0.5 * arc.turn]
        return [*places, radius / unit]

    def feature_numbers(self, feature: Feature, unit: float) -> list[float]:
        numbers = np.array(feature.numbers)
        lengths = numbers[3:].reshape(WINDOW, 8)
        numbers[:2] /= unit
        lengths[:, [3, 4, 7]] /= unit
        return [float(number) for number in numbers]

    def feature(self, part: OffsetPolygon, piece: int, grown: float) -> Feature:
        every = pieces_of(part)
        middle = every[piece]
        count = len(every)
        before, after = [piece], [piece]
        for side, ends in ((-1, before), (1, after)):
            while abs(ends[-1] - piece) < WINDOW // 2 and len(before) + len(after) <= count:
                if not _joins(every, ends[-1] % count, (ends[-1] + side) % count, grown):
                    break
                ends.append(ends[-1] + side)
        window = [*before[:0:-1], *after]
        # A line from zero to one; of arcs the unknown is the angle on the one in the middle.
        speed = middle.reach + grown if middle.turn else abs(middle.span)
        lengths = [_length(every[k % count], speed, grown) for k in window]
        start = -float(sum(lengths[: len(before) - 1]))
        rows = []
        anchor = every[window[0] % count].point(0.0)
        low = start
        for k, size in zip(window, lengths, strict=True):
            at = every[k % count]
            first = k == window[0]
            last = k == window[-1]
            anchor -= cmath.rect(at.reach, at.normal)
            # The arc continues beyond the window, so that derivatives at its ends are not those of a limit.
            span = at.span / size
            limits = -_FAR if first else 0.0, _FAR if last else size
            rows.append((start, *limits, span.real, span.imag, at.normal, at.turn / size, at.reach))
            start += size
        rows += [(0.0,) * 8] * (WINDOW - len(rows))
        numbers = (anchor.real, anchor.imag, every[window[0] % count].normal, *(v for row in rows for v in row))
        whole = middle.turn >= math.tau
        lower, upper = (-math.inf, math.inf) if whole else (low, start)
        return Feature(numbers, (lower,), (upper,), _curvature(middle), piece, grown)

    def beyond(self, part: OffsetPolygon, feature: Feature, side: int) -> tuple[Feature, tuple[float, ...]] | None:
        every = pieces_of(part)
        count = len(pieces_of(part))
        used = [row for row in np.reshape(feature.numbers[3:], (WINDOW, 8)).tolist() if row[1] != row[2]]
        starts = sum(row[0] < -SAME for row in used)
        last = feature.piece + (len(used) - 1 - starts if side > 0 else -starts)
        other = (last + side) % count
        if not every[other if side > 0 else last % count].after:
            return None
        following = self.feature(part, other, feature.grown)
        middle = every[other]
        speed = middle.reach + feature.grown if middle.turn else abs(middle.span)
        return following, (0.0 if side > 0 else _length(middle, speed, feature.grown),)

    def place(
        self, part: OffsetPolygon, feature: Feature, point: tuple[float, float], normal_angle: float
    ) -> tuple[float, ...]:
        at = pieces_of(part)[feature.piece]
        speed = at.reach + feature.grown if at.turn else abs(at.span)
        return (at.share(complex(*point), normal_angle) * _length(at, speed, feature.grown),)

    def near(self, part: OffsetPolygon, point: tuple[float, float], normal_angle: float, grown: float) -> Feature:
        every = pieces_of(part)
        size = float(np.ptp(np.array(part.vertices), axis=0).max()) + part.radius

        def misfit(number: int) -> float:
            piece = every[number]
            share = piece.share(complex(*point), normal_angle)
            away = abs(piece.point(share) - complex(*point)) / size
            turn = abs(math.remainder(piece.normal + share * piece.turn - normal_angle, math.tau))
            # At the end of a face the corner fits as well: prefer the face, along which a contact can slide.
            corner = piece.turn > 0.0 and piece.reach == part.radius and len(every) > 1
            return away + turn + (1e-9 if corner else 0.0)

        return self.feature(part, min(range(len(every)), key=misfit), grown)

    # -- search of a grasp

    def new_outline(self, part: OffsetPolygon) -> PartOutline:
        return PolygonOutline(part.faces, part.radius)


def _length(piece: Piece, speed: float, grown: float) -> float:
    """Return the length of a piece; the unknown has a speed on the grown outline."""
    return piece.turn * (piece.reach + grown) / speed if piece.turn and speed > 0.0 else piece.turn or 1.0


def _joins(every: Sequence[Piece], number: int, other: int, grown: float) -> bool:
    """Whether two pieces are of one window."""
    first, second = every[number], every[other]
    if not (first.turn and second.turn) or number == other or max(first.turn, second.turn) >= math.tau:
        return False
    sizes = sorted((first.reach + grown, second.reach + grown))
    return sizes[0] > 0.0 and sizes[1] <= KINK * sizes[0]


def _curvature(piece: Piece) -> float:
    """Curvature of the surface [1/m]: 0 on a line, large on a sharp corner."""
    return 1.0 / max(piece.reach, SHARP) if piece.turn else 0.0


def _corners(part: OffsetPolygon) -> list[tuple[float, float]]:
    """Return the points between faces that do not join smoothly, or the center of a disc."""
    if part.circle is not None:
        return [part.circle[0]]
    faces = part.faces
    pairs = zip((faces[-1], *faces[:-1]), faces, strict=True)
    turns = (math.remainder(face.normal - before.normal - before.turn, math.tau) for before, face in pairs)
    return [face.start for face, turn in zip(faces, turns, strict=True) if abs(turn) > SAME]


def _arcs(part: OffsetPolygon) -> list[Face]:
    """Arcs between the corners."""
    return [] if part.circle is not None else [face for face in part.faces if face.turn]


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
    width = math.dist(core[0], core[1])
    height = math.dist(core[1], core[2])
    turn = Rotation(*(0.0 if abs(v) < 1e-15 else v for v in ((bx - ax) / width, (by - ay) / width)))
    local = turn.transposed().apply(at - Vec(0.5 * (ax + cx), 0.5 * (ay + cy)))
    x = ca.fabs(local.x) - 0.5 * width
    y = ca.fabs(local.y) - 0.5 * height
    beyond = Vec(ca.fmax(x, 0.0), ca.fmax(y, 0.0))
    size = length(beyond)
    deepest = ca.fmax(x, y)
    inside = deepest <= _SKIN
    normal = chosen(inside, Vec(x > y, x <= y), beyond.scaled(1.0 / size))
    # Signs that are never zero: on an axis of the rectangle either side will do.
    signs = Vec(2.0 * (local.x >= 0.0) - 1.0, 2.0 * (local.y >= 0.0) - 1.0)
    return Nearest(ca.if_else(inside, deepest, size), turn.apply(Vec(signs.x * normal.x, signs.y * normal.y)))


def _from_polygon(core: Sequence[tuple[float, float]], at: Vec) -> Nearest:
    """By the nearest of the edges; two vertices are a segment, which has no inside."""
    # All edges are compared at run time: a chain of selections, since branches have no derivative.
    edges = list(pairwise([*core, core[0]])) if len(core) > 2 else [(core[0], core[1])]
    seen: list[tuple[Scalar, Scalar, Vec, Vec]] = []
    for (ax, ay), (bx, by) in edges:
        long = math.hypot(bx - ax, by - ay)
        along = Vec((bx - ax) / long, (by - ay) / long)
        normal = Vec((by - ay) / long, (ax - bx) / long)
        away = at - Vec(ax, ay)
        s, height = along.dot(away), normal.dot(away)
        over = s - ca.fmin(ca.fmax(s, 0.0), long)
        seen.append((over, height, along.scaled(over) + normal.scaled(height), normal))
    sides: list[tuple[Scalar, Scalar, Vec, Vec]] = []
    for k, (past, above, offset, normal) in enumerate(seen):
        # Both faces of a corner together show the side of a point; at an acute corner, one is not enough.
        before = seen[k - 1][1]
        after = seen[(k + 1) % len(seen)][1]
        side = above + before * ca.SX(past < 0.0) + after * ca.SX(past > 0.0)
        sides.append((offset.dot(offset), side, offset, normal))
    least, height, away, face = sides[0]
    for other, above, offset, normal in sides[1:]:
        nearer = ca.SX(other < least)
        least = ca.fmin(other, least)
        height = height + (above - height) * nearer
        away = chosen(nearer, offset, away)
        face = chosen(nearer, normal, face)
    size = length(away)
    if len(core) == 2:
        return Nearest(size, away.scaled(1.0 / size))
    sign = 2.0 * (height > 0.0) - 1.0
    on_face = size <= _SKIN
    return Nearest(ca.if_else(on_face, height, sign * size), chosen(on_face, face, away.scaled(sign / size)))
