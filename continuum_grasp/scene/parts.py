"""Parts of objects in plain numbers: polygons with an offset, and superellipses."""

from __future__ import annotations

import cmath
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TypeAlias

PlanePoint: TypeAlias = tuple[float, float]

_DIRECTIONS = 256
"""Directions among which the nearest supporting line of a superellipse is sought: those of an exponent of 12 turn by
a tenth of a radian at its corners."""
_IN_LINE = 1e-9
"""Turn of the normal at a corner [rad] up to which its edges are in line: below, rounding decides its sign."""
_BLUNT, _SPAN = 0.1, 0.3
"""Turn of the normal at a corner [rad] below which it may be a point of a curve, and what such corners, one after the
other, turn at least in all: a corner alone, however blunt, is a corner."""
_UNEVEN = 3.0
"""Ratio of the lengths of two edges from which on the longer one is a straight line that a curve leaves along it."""
SHARE = 1e-3
"""Distance of a polygon from the curve that it stands for, per longer side of the object [1], by default and at most: a
circle that is drawn has 64 corners then."""
_NEAR, _ALIKE = 2e-5, 1e-9
"""Distance, per extent of the part, up to which arcs pass by the corners of a curve: the rounding of coordinates in
whole micrometers, for a few centimeters; and of the centers of arcs that are one: rounding of numbers."""
_BENT = 0.1, 1.0
"""Turn of the normal between three corners whose circle gives the tangent at the middle one, where they are as close;
and greatest turn along two arcs [rad]."""


class Part(ABC):
    """A part of an object in plain numbers, in the object's frame [m].

    The mathematics that contacts and grasps need of it lies in `continuum_grasp.model.surfaces`.
    """

    @abstractmethod
    def placed(self, position: PlanePoint, angle: float) -> Part:
        """The part after a turn about the origin and a shift."""

    @abstractmethod
    def support(self, angle: float) -> float:
        """Support function [m]: greatest extent from the origin in the direction of an angle [rad]."""

    @abstractmethod
    def outline(self, count: int = 240) -> list[PlanePoint]:
        """Points on the boundary, counter-clockwise [m]."""

    @abstractmethod
    def curvature(self, point: PlanePoint, tolerance: float) -> float:
        """Curvature of the boundary at a point of it [1/m]; infinite at a sharp corner, which is ``tolerance`` wide."""

    @property
    @abstractmethod
    def extent(self) -> float:
        """A distance from the origin that no point of the part exceeds [m]."""

    @property
    def pieces(self) -> tuple[Part, ...]:
        """Convex parts that the part consists of."""
        return (self,)

    def distance(self, point: PlanePoint) -> float:
        """Distance of a point of the object's frame from the boundary [m], negative inside."""
        return _polygon_distance(point, self.outline())


@dataclass(frozen=True)
class Face:
    """A line or a convex arc of an outline, counter-clockwise."""

    start: PlanePoint
    """Point at which the face begins [m]."""
    end: PlanePoint
    """Point at which the face ends [m]."""
    normal: float
    """Angle of the outward normal where it begins [rad]."""
    turn: float = 0.0
    """By how much the normal turns along it [rad]; 0 on a line."""
    radius: float = 0.0
    """Radius of the arc [m]; 0 for a line, and for a point about which the normal turns."""

    @property
    def center(self) -> PlanePoint:
        """Center of the arc [m]."""
        x, y = self.start
        return x - self.radius * math.cos(self.normal), y - self.radius * math.sin(self.normal)


@dataclass(frozen=True)
class OffsetPolygon(Part):
    """Everything within a distance of a simple polygon, of a segment (a stadium), or of a point (a disc)."""

    vertices: tuple[PlanePoint, ...]
    """Counter-clockwise corners of the core; one for a disc, two for a stadium [m]."""
    radius: float = 0.0
    """The part is everything within this distance of the core [m]."""
    bends: tuple[PlanePoint, ...] = ()
    """Per edge, the angles by which a convex curve in its place leaves it at its start and comes back at its end [rad],
    both zero for a straight edge; empty: all are straight."""

    def placed(self, position: PlanePoint, angle: float) -> OffsetPolygon:
        return replace(self, vertices=tuple(map(_mover(position, angle), self.vertices)))

    @cached_property
    def faces(self) -> tuple[Face, ...]:
        """Lines and arcs of the core, counter-clockwise: a curve is two arcs with one tangent where they meet and those
        of its ends; arcs of one circle are one. A disc has one of radius zero, a segment its two sides.
        """
        if len(self.vertices) == 1:
            return (Face(self.vertices[0], self.vertices[0], 0.0, math.tau),)
        ring = [*self.vertices, self.vertices[0]]
        edges = zip(pairwise(ring), self.bends or [(0.0, 0.0)] * len(self.vertices), strict=True)
        faces = [face for (a, b), bend in edges for face in _faces(a, b, *bend)]
        return _joined(faces, _ALIKE * self.extent) if self.bends else tuple(faces)

    @property
    def circle(self) -> tuple[PlanePoint, float] | None:
        """Center and radius of a disc [m]; None of others."""
        face = self.faces[0]
        return (face.center, face.radius + self.radius) if len(self.faces) == 1 else None

    def support(self, angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        most = max(c * x + s * y for x, y in self.vertices)
        for face in self.faces if self.bends else ():
            if (angle - face.normal) % math.tau < face.turn:
                x, y = face.center
                most = max(most, c * x + s * y + face.radius)
        return most + self.radius

    def outline(self, count: int = 240) -> list[PlanePoint]:
        if self.radius == 0.0:
            return list(self.vertices)
        # An arc about each corner, from the normal of the edge before it to that of the edge after it; where the corner
        # is reflex, the edges meet.
        points = []
        for (x, y), (low, turn) in zip(self.vertices, self.turns, strict=True):
            steps = max(2, round(count * turn / math.tau))
            # A disc closes on itself: its last point would be its first.
            angles = [low + turn * j / steps for j in range(steps + (len(self.vertices) > 1))]
            reach = self.radius
            if turn < 0.0:
                reach, angles = self.radius / math.cos(0.5 * turn), [low + 0.5 * turn]
            points += [(x + reach * math.cos(t), y + reach * math.sin(t)) for t in angles]
        return points

    @cached_property
    def turns(self) -> tuple[PlanePoint, ...]:
        """At each corner of the core the angle of the outward normal before it, and by how much the normal turns
        there, negative where the corner is reflex [rad].
        """
        return _turns(self.vertices) if len(self.vertices) > 1 else ((0.0, math.tau),)

    @cached_property
    def pieces(self) -> tuple[OffsetPolygon, ...]:
        """Convex parts between corners of the core, which overlap no more than the offset makes them."""
        if all(turn > 0.0 for _, turn in self.turns):
            return (self,)
        ring = [*self.vertices, self.vertices[0]]
        bends = dict(zip(pairwise(ring), self.bends, strict=True)) if self.bends else {}
        pieces = []
        for piece in _convex_pieces(self.vertices):
            own = tuple(bends.get(edge, (0.0, 0.0)) for edge in pairwise([*piece, piece[0]]))
            pieces.append(OffsetPolygon(piece, self.radius, own if any(map(any, own)) else ()))
        return tuple(pieces)

    def curvature(self, point: PlanePoint, tolerance: float) -> float:
        # On the rounding of a corner no edge is nearer than its ends.
        turns = (after.normal - before.normal - before.turn for before, after in pairwise((*self.faces, self.faces[0])))
        ends = zip(self.faces, turns, strict=True) if len(self.vertices) > 1 else [(self.faces[0], math.pi)]
        corners = [face.end for face, turn in ends if math.remainder(turn, math.tau) > _IN_LINE]
        if corners and min(math.dist(point, corner) for corner in corners) <= self.radius + tolerance:
            return 1.0 / self.radius if self.radius > 0.0 else math.inf
        arcs = [face for face in self.faces if face.turn > 0.0 and face.radius > 0.0]
        off = [abs(math.dist(point, arc.center) - arc.radius - self.radius) for arc in arcs]
        for away, arc in sorted(zip(off, arcs, strict=True), key=lambda pair: pair[0]):
            angle = math.atan2(point[1] - arc.center[1], point[0] - arc.center[0])
            if away <= tolerance and (angle - arc.normal) % math.tau <= arc.turn:
                return 1.0 / (arc.radius + self.radius)
        return 0.0

    @property
    def extent(self) -> float:
        return max(math.hypot(*v) for v in self.vertices) + self.radius

    def distance(self, point: PlanePoint) -> float:
        if not self.bends:
            return _polygon_distance(point, self.vertices) - self.radius
        near = []
        for face in self.faces:
            (x, y), normal, off = face.start, face.normal, 0.0
            if face.turn:
                cx, cy = face.center
                normal += _within(math.atan2(point[1] - cy, point[0] - cx) - normal, face.turn)
                x, y = cx + face.radius * math.cos(normal), cy + face.radius * math.sin(normal)
                off = math.dist(point, (x, y))
            else:
                off = _segment_distance(point, face.start, face.end)
            near.append((off, (point[0] - x) * math.cos(normal) + (point[1] - y) * math.sin(normal)))
        away = min(near)[0]
        # At a corner both sides say together where a point is: one alone does not, where it is acute.
        height = sum(above for off, above in near if off <= away + _IN_LINE * self.extent)
        return math.copysign(away, height) - self.radius


@dataclass(frozen=True)
class SuperellipsePart(Part):
    """A superellipse |x/a|^p + |y/b|^p <= 1 in axes of its own."""

    semi_axes: PlanePoint
    """Semi-axes a and b [m]."""
    exponent: float = 2.0
    """Exponent p; 2 is an ellipse."""
    center: PlanePoint = (0.0, 0.0)
    angle: float = 0.0
    """From the object's axes to those of the superellipse [rad]."""

    def placed(self, position: PlanePoint, angle: float) -> SuperellipsePart:
        return replace(self, center=_mover(position, angle)(self.center), angle=self.angle + angle)

    def support(self, angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        # Hoelder's inequality: the support function of a p-norm ball is the norm of the dual exponent p / (p - 1).
        (a, b), dual = self.semi_axes, self.exponent / (self.exponent - 1.0)
        u, v = a * abs(math.cos(angle - self.angle)), b * abs(math.sin(angle - self.angle))
        return float(c * self.center[0] + s * self.center[1] + (u**dual + v**dual) ** (1.0 / dual))

    def outline(self, count: int = 240) -> list[PlanePoint]:
        move, power = _mover(self.center, self.angle), 2.0 / self.exponent
        # x = a |cos t|^(2/p) satisfies the equation exactly, with the sign of the quadrant.
        turns = (math.tau * k / count for k in range(count))
        return [
            move(
                (
                    self.semi_axes[0] * math.copysign(abs(math.cos(t)) ** power, math.cos(t)),
                    self.semi_axes[1] * math.copysign(abs(math.sin(t)) ** power, math.sin(t)),
                )
            )
            for t in turns
        ]

    def curvature(self, point: PlanePoint, tolerance: float) -> float:
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = point[0] - self.center[0], point[1] - self.center[1]
        (a, b), p = self.semi_axes, self.exponent
        u, v = abs(c * x + s * y) / a, abs(c * y - s * x) / b
        fx, fy = u ** (p - 1.0) / a, v ** (p - 1.0) / b  # a p-th of the gradient of |x/a|^p + |y/b|^p
        fxx = (p - 1.0) * u ** (p - 2.0) / a**2
        fyy = (p - 1.0) * v ** (p - 2.0) / b**2
        # Of an implicit curve f = 0, whose mixed derivative is zero here.
        return float((fxx * fy**2 + fyy * fx**2) / (fx**2 + fy**2) ** 1.5)

    def distance(self, point: PlanePoint) -> float:
        # The farthest supporting line of a convex body is as far as its boundary, from either side.
        def away(angle: float) -> float:
            return math.cos(angle) * point[0] + math.sin(angle) * point[1] - self.support(angle)

        step = math.tau / _DIRECTIONS
        best = max((step * k for k in range(_DIRECTIONS)), key=away)
        low, high = best - step, best + step
        while high - low > 1e-8:  # distances of maxima are exact to the square of an angle
            third = (high - low) / 3.0
            low, high = (low + third, high) if away(low + third) < away(high - third) else (low, high - third)
        return away(0.5 * (low + high))

    @property
    def extent(self) -> float:
        return math.hypot(*self.center) + math.hypot(*self.semi_axes)


@lru_cache(maxsize=256)
def farthest(part: Part, point: PlanePoint) -> float:
    return max(math.dist(point, p) for p in part.outline())


def _mover(position: PlanePoint, angle: float) -> Callable[[PlanePoint], PlanePoint]:
    c, s = math.cos(angle), math.sin(angle)
    return lambda p: (position[0] + c * p[0] - s * p[1], position[1] + s * p[0] + c * p[1])


def _edge_normal(a: PlanePoint, b: PlanePoint) -> float:
    """Angle of the outward normal of an edge of a counter-clockwise polygon [rad]."""
    return math.atan2(a[0] - b[0], b[1] - a[1])


def _turns(vertices: Sequence[PlanePoint]) -> tuple[PlanePoint, ...]:
    """Angle of the outward normal before each corner, and the turn of the normal there, up to half a turn [rad]."""
    turns = []
    for before, here, after in zip((vertices[-1], *vertices), vertices, (*vertices[1:], vertices[0]), strict=False):
        low = _edge_normal(before, here)
        turn = (_edge_normal(here, after) - low) % math.tau
        # The ends of a segment turn by half a turn, but for rounding.
        turns.append((low, turn if turn < math.pi + _IN_LINE else turn - math.tau))
    return tuple(turns)


def _within(angle: float, turn: float) -> float:
    """An angle, brought into [0, turn] or to the nearer of its ends [rad]."""
    angle %= math.tau
    return angle if angle <= turn else (turn if angle < 0.5 * (turn + math.tau) else 0.0)


def _faces(a: PlanePoint, b: PlanePoint, low: float, high: float) -> list[Face]:
    """The line from one point to another, or two arcs in its place that leave it by an angle and come back by another
    one [rad].

    Of all such pairs it is that whose tangents at the ends are as long up to the tangent that both arcs share: K. M.
    Bolton, "Biarc curves", Computer-Aided Design 7 (1975), doi:10.1016/0010-4485(75)90086-X.
    """
    normal, size = _edge_normal(a, b), math.dist(a, b)
    if low == 0.0 or high == 0.0:
        return [Face(a, b, normal)]
    # With tangents t and u there, v from a to b and both tangents d long: v^2 = 2 d v (t + u) + 2 d^2 (1 - t u), solved
    # without a difference of nearly equal numbers. Complex numbers, x along the chord.
    along = size * (math.cos(low) + math.cos(high))
    reach = size**2 / (along + math.sqrt(along**2 + 2.0 * (1.0 - math.cos(low + high)) * size**2))
    first, last = reach * cmath.rect(1.0, -low), size - reach * cmath.rect(1.0, high)
    turn = cmath.phase(last - first) + low
    met = complex(*a) + 0.5 * (first + last) * complex(b[0] - a[0], b[1] - a[1]) / size
    middle, rest = (met.real, met.imag), low + high - turn
    return [
        Face(a, middle, normal - low, turn, reach / math.tan(0.5 * turn)),
        Face(middle, b, normal - low + turn, rest, reach / math.tan(0.5 * rest)),
    ]


def _joined(faces: list[Face], near: float) -> tuple[Face, ...]:
    """Faces with those joined that are arcs of one circle, whose centers are as ``near`` [m]."""
    joined: list[Face] = []
    for face in faces:
        if joined and _is_one(joined[-1], face, near):
            joined[-1] = replace(joined[-1], end=face.end, turn=joined[-1].turn + face.turn)
        else:
            joined.append(face)
    if len(joined) > 1 and _is_one(joined[-1], joined[0], near):
        last = joined.pop()
        joined[0] = replace(last, end=joined[0].end, turn=last.turn + joined[0].turn)
    return tuple(joined) if len(joined) > 1 else (replace(joined[0], turn=math.tau),)


def _is_one(face: Face, other: Face, near: float) -> bool:
    """Whether both are arcs of one circle."""
    return bool(face.turn and other.turn) and math.dist(face.center, other.center) <= near


def curved(part: OffsetPolygon) -> OffsetPolygon:
    """The part with curves in place of edges between corners that are points of a curve.

    These are convex corners as blunt as `_BLUNT`, several after each other that turn by `_SPAN` in all. The curve has
    the tangents of circles through three corners, and is nowhere farther from the polygon than `SHARE` of its extent:
    what is drawn is known no better. Corners at which lines meet, and reflex ones, are what they are.
    """
    core, count = part.vertices, len(part.vertices)
    if count < 3 or part.radius > 0.0:
        return part
    turns = [turn for _, turn in part.turns]
    sizes = [math.dist(a, b) for a, b in pairwise((*core, core[0]))]
    most = SHARE * max(max(z) - min(z) for z in zip(*core, strict=True))
    smooth = [0.0 < turn < _BLUNT for turn in turns]
    while any(smooth := _in_runs(smooth, turns)):
        bends = _bends(core, turns, sizes, smooth)
        refused = set[int]()
        for k, (size, (low, high)) in enumerate(zip(sizes, bends, strict=True)):
            # 8: a chord is its length times the angle to the tangents over 4 away from its arc
            if (low > 0.0) != (high > 0.0) or size * (low + high) > 8.0 * most:
                refused |= {k, (k + 1) % count}
        refused = {k for k in refused if smooth[k]}
        if not refused:
            return _fitted(part, bends, smooth)
        smooth = [on and k not in refused for k, on in enumerate(smooth)]
    return part


def _fitted(part: OffsetPolygon, bends: list[tuple[float, float]], smooth: list[bool]) -> OffsetPolygon:
    """The part with few arcs in place of runs of bent edges, on which it has its corners."""
    core, count = part.vertices, len(part.vertices)
    normals = [_edge_normal(a, b) for a, b in pairwise((*core, core[0]))]
    inner = [smooth[k] and bends[k] != (0.0, 0.0) != bends[k - 1] for k in range(count)]
    first = inner.index(False) if False in inner else 0
    ring, places = [(first + k) % count for k in range(count)], list[tuple[PlanePoint, float, float]]()
    while ring:
        edge, run = ring[0], [ring.pop(0)]
        while ring and inner[ring[0]] and bends[edge] != (0.0, 0.0):
            run.append(ring.pop(0))
        ends = normals[edge] - bends[edge][0], normals[run[-1]] + bends[run[-1]][1]
        corners = [core[k] for k in (*run, (run[-1] + 1) % count)]
        if bends[edge] == (0.0, 0.0):
            places.append((corners[0], ends[0], ends[0]))
            continue
        tangents = _tangents(corners, ends, closed=all(inner))
        places += _on_arcs(corners, tangents, _NEAR * part.extent)
        places[-1] = (*places[-1][:2], places[-1][2])
    vertices = tuple(point for point, _, _ in places)
    edges = zip(pairwise((*vertices, vertices[0])), places, (*places[1:], places[0]), strict=True)
    fitted = []
    for (a, b), (_, after, end), _ in edges:
        normal = _edge_normal(a, b)
        low, high = math.remainder(normal - after, math.tau), math.remainder(end - normal, math.tau)
        fitted.append((low, high) if min(low, high) > 1e-12 else (0.0, 0.0))
    return replace(part, vertices=vertices, bends=tuple(fitted))


def _tangents(corners: list[PlanePoint], ends: tuple[float, float], *, closed: bool) -> list[float]:
    """Angles of the normals at the corners of a run [rad], with those at its ends: of circles through three corners,
    which are as far apart as the normal turns little, so that rounding of coordinates matters less.
    """
    count = len(corners)
    normals = [_edge_normal(a, b) for a, b in pairwise(corners)]
    angles = [ends[0]]
    for k in range(0 if closed else 1, count - 1):
        reach = 1
        while closed or (k > reach and k + reach + 1 < count):
            a, b = (corners[(k + side * (reach + 1)) % (count - 1 if closed else count)] for side in (-1, 1))
            turn = _edge_normal(corners[k], b) - _edge_normal(a, corners[k])
            if not 0.0 < math.remainder(2.0 * turn, math.tau) < _BENT[0]:
                break
            reach += 1
        a, b = (corners[(k + side * reach) % (count - 1 if closed else count)] for side in (-1, 1))
        # The angle of tangent and chord is that at the third corner.
        off = math.remainder(_edge_normal(corners[k], b) - _edge_normal(a, b), math.tau)
        angle = _edge_normal(a, corners[k]) + off
        angles.append(normals[k] + math.remainder(angle - normals[k], math.tau))
    if closed:
        return [*angles[1:], angles[1]]
    return [*angles, ends[1]]


def _on_arcs(corners: list[PlanePoint], angles: list[float], near: float) -> list[tuple[PlanePoint, float, float]]:
    """Corners of a run, but for the last, moved onto arcs with given normals at some of them, which come as ``near``
    [m] to all: places, and angles of the normals where an edge begins and where it ends [rad].
    """
    count, begin, places = len(corners), 0, list[tuple[PlanePoint, float, float]]()
    while begin < count - 1:
        # As many as fit, by doubling and halving the step.
        size, step, best = 1, 1, [(corners[begin], angles[begin])]
        while step:
            last = begin + size + step
            found = _over(corners[begin : last + 1], angles[begin], angles[last], near) if last < count else None
            if found is not None:
                size, step, best = size + step, 2 * step, found
            else:
                step //= 2
        begin += size
        turns = [angle for _, angle in best]
        places += [(point, a, b) for (point, a), b in zip(best, [*turns[1:], angles[begin]], strict=True)]
    return places


def _over(corners: list[PlanePoint], first: float, last: float, near: float) -> list[tuple[PlanePoint, float]] | None:
    """Corners but for the last on two arcs from the first to the last one, where the normals have these angles.

    With them, the place where both arcs meet, and the angles of the normals; None where some corner is not near.
    """
    a, b = corners[0], corners[-1]
    normal = _edge_normal(a, b)
    low, high = math.remainder(normal - first, math.tau), math.remainder(last - normal, math.tau)
    if min(low, high) <= 0.0 or low + high > _BENT[1]:
        return None
    pair = _faces(a, b, low, high)
    if min(face.turn for face in pair) <= 0.0:
        return None
    places = [(a, first), (pair[1].start, first + pair[0].turn)]
    for corner in corners[1:-1]:
        angles = [math.atan2(corner[1] - arc.center[1], corner[0] - arc.center[0]) - arc.normal for arc in pair]
        turned = math.remainder(angles[0], math.tau)
        arc, turned = (pair[0], turned) if turned < pair[0].turn else (pair[1], math.remainder(angles[1], math.tau))
        if not 0.0 < turned < arc.turn or abs(math.dist(corner, arc.center) - arc.radius) > near:
            return None
        angle = arc.normal + turned
        x, y = arc.center
        at = x + arc.radius * math.cos(angle), y + arc.radius * math.sin(angle)
        places.append((at, first + math.remainder(angle - first, math.tau)))
    places.sort(key=lambda place: place[1])
    steps = [other[1] - place[1] for place, other in pairwise(places)]
    # 1e-3: an edge that is shorter than so much of the arcs is left out, with the corner, not the place, at its end.
    spare = {places[k][0] for k, step in enumerate(steps) if step < 1e-3 * (low + high) and k > 0}
    return [place for place in places if place[0] not in spare]


def _in_runs(smooth: list[bool], turns: list[float]) -> list[bool]:
    """Corners that are smooth with others beside them that turn by `_SPAN` in all."""
    count = len(turns)
    if all(smooth):
        return smooth
    long = list(smooth)
    for k in range(count):
        if smooth[k] and not smooth[k - 1]:
            run = [k]
            while smooth[(run[-1] + 1) % count]:
                run.append((run[-1] + 1) % count)
            if sum(turns[j] for j in run) < _SPAN:
                for j in run:
                    long[j] = False
    return long


def _bends(
    core: tuple[PlanePoint, ...], turns: list[float], sizes: list[float], smooth: list[bool]
) -> list[tuple[float, float]]:
    """Per edge, the angles by which a curve through smooth corners leaves it and comes back [rad]."""
    count = len(core)
    low, high = [0.0] * count, [0.0] * count
    for k in (k for k in range(count) if smooth[k]):
        before, after = sizes[k - 1], sizes[k]
        if before > _UNEVEN * after:
            low[k] = turns[k]
        elif after > _UNEVEN * before:
            high[k - 1] = turns[k]
        else:
            # Half the diameter of the circle through three corners: the law of sines.
            radius = math.dist(core[k - 1], core[(k + 1) % count]) / (2.0 * math.sin(turns[k]))
            low[k] = math.asin(min(after / (2.0 * radius), math.sin(turns[k])))
            high[k - 1] = turns[k] - low[k]
    for k in range(count):
        # Into a corner that is none of the curve's, it goes on as a circle.
        ends = (smooth[k], turns[k]), (smooth[(k + 1) % count], turns[(k + 1) % count])
        if low[k] > 0.0 == high[k] and not ends[1][0] and ends[1][1] > 2.0 * low[k]:
            high[k] = low[k]
        elif high[k] > 0.0 == low[k] and not ends[0][0] and ends[0][1] > 2.0 * high[k]:
            low[k] = high[k]
    return list(zip(low, high, strict=True))


def _segment_distance(p: PlanePoint, a: PlanePoint, b: PlanePoint) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    # 1e-300: a segment of no length is its start.
    share = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / max(dx * dx + dy * dy, 1e-300)
    share = min(max(share, 0.0), 1.0)
    return math.dist(p, (a[0] + share * dx, a[1] + share * dy))


def _polygon_distance(point: PlanePoint, vertices: Sequence[PlanePoint]) -> float:
    """Distance of a point from a simple polygon, a segment or a point [m], negative inside the polygon."""
    x, y = point
    nearest, inside = math.inf, False
    for a, b in pairwise([*vertices, vertices[0]]):
        nearest = min(nearest, _segment_distance(point, a, b))
        # A ray to the right crosses the outline of what it starts in an odd number of times.
        inside ^= (a[1] > y) != (b[1] > y) and x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
    return -nearest if inside else nearest


def polygon_moments(vertices: Sequence[PlanePoint], about: PlanePoint = (0.0, 0.0)) -> tuple[float, PlanePoint, float]:
    """Area [m2], first moments [m3] and polar second moment [m4] about a point; negative for clockwise corners."""
    area = x = y = second = 0.0
    points = [(px - about[0], py - about[1]) for px, py in vertices]
    # Green's theorem: each edge spans a triangle with the point.
    for (ax, ay), (bx, by) in pairwise([*points, points[0]]):
        cross = ax * by - ay * bx
        area += 0.5 * cross
        x, y = x + cross / 6.0 * (ax + bx), y + cross / 6.0 * (ay + by)
        second += cross * (ax * ax + ax * bx + bx * bx + ay * ay + ay * by + by * by) / 12.0
    return area, (x, y), second


def polygon_centroid(vertices: tuple[PlanePoint, ...]) -> PlanePoint:
    area, (x, y), _ = polygon_moments(vertices)
    return x / area, y / area


def corners_of(vertices: Sequence[PlanePoint]) -> tuple[PlanePoint, ...]:
    """The corners of a simple polygon counter-clockwise, without those in line with their neighbors."""
    ring = tuple(vertices) if polygon_moments(vertices)[0] > 0.0 else tuple(vertices[::-1])
    return tuple(corner for corner, (_, turn) in zip(ring, _turns(ring), strict=True) if abs(turn) > _IN_LINE)


def check_simple(vertices: Sequence[PlanePoint], key: str = "vertices") -> None:
    """Refuse an outline that crosses or touches itself, at a key."""
    import shapely

    reason = shapely.is_valid_reason(shapely.Polygon(vertices))
    if reason != "Valid Geometry" or len(set(vertices)) < len(vertices):
        what, _, place = reason.removeprefix("Ring ").partition("[")
        where = f" at ({', '.join(f'{float(c):.4g}' for c in place[:-1].split())}) m" if place else ""
        raise ValueError(
            f"{key} must be the corners of a simple polygon, in order, each once: "
            f"{what.lower() if place else 'a corner is there twice'}{where}"
        )


def _convex_pieces(vertices: tuple[PlanePoint, ...]) -> list[tuple[PlanePoint, ...]]:
    """Convex polygons between the corners of a simple one, at most four times as many as are needed.

    Of the triangles of Delaunay those are joined whose common side no reflex corner needs: S. Hertel and K. Mehlhorn,
    "Fast triangulation of simple polygons", Foundations of Computation Theory, 1983.
    """
    import shapely

    triangles = shapely.constrained_delaunay_triangles(shapely.Polygon(vertices)).geoms
    pieces = [corners_of([(x, y) for x, y in triangle.exterior.coords[:-1]]) for triangle in triangles]
    owner = {side: piece for piece in pieces for side in pairwise([*piece, piece[0]])}
    sides = [(a, b) for a, b in owner if (b, a) in owner and a < b]
    for a, b in sorted(sides, key=lambda side: -math.dist(*side)):
        polygon, other = owner[a, b], owner[b, a]
        k, j = polygon.index(b), other.index(a)
        whole = (*polygon[k:], *polygon[:k], *other[j + 1 :], *other[:j])[:-1]
        if all(turn > _IN_LINE for _, turn in _turns(whole)):
            owner |= dict.fromkeys(pairwise([*whole, whole[0]]), whole)
            del owner[a, b], owner[b, a]
    return list(dict.fromkeys(owner.values()))


def rounded(vertices: tuple[PlanePoint, ...], radius: float) -> OffsetPolygon:
    """The part whose sharp outline is given and whose corners are rounded off inside it, but for reflex ones."""
    if radius == 0.0:
        return OffsetPolygon(vertices)
    core = []
    for (x, y), (low, turn) in zip(vertices, _turns(vertices), strict=True):
        # The center of an arc tangent to both edges is on the bisector, radius / cos(half) inside the corner.
        reach, middle = radius / math.cos(0.5 * turn), low + 0.5 * turn
        core.append((x - reach * math.cos(middle), y - reach * math.sin(middle)))
    return OffsetPolygon(tuple(core), radius)
