"""Parts of objects in plain numbers: polygons with an offset, and superellipses."""

from __future__ import annotations

import cmath
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise

from continuum_grasp.scene.polygons import (
    PlanePoint,
    convex_pieces,
    edge_normal,
    polygon_distance,
    segment_distance,
    turns_of,
)
from continuum_grasp.scene.value import SAME

_DIRECTIONS = 256
"""Directions among which the nearest supporting line of a superellipse is sought: directions for an exponent of 12
turn by a tenth of a radian at its corners."""


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
        return polygon_distance(point, self.outline())


@dataclass(frozen=True)
class Face:
    """A line or a convex arc of an outline, counter-clockwise."""

    start: PlanePoint
    """Start point of the face [m]."""
    end: PlanePoint
    """End point of the face [m]."""
    normal: float
    """Angle of the outward normal at the start [rad]."""
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
    """For each edge, the angles between the edge and the convex curve that replaces it, at its start and at its end
    [rad]. Both are zero for a straight edge; empty: all edges are straight."""

    def placed(self, position: PlanePoint, angle: float) -> OffsetPolygon:
        return replace(self, vertices=tuple(map(_mover(position, angle), self.vertices)))

    @cached_property
    def faces(self) -> tuple[Face, ...]:
        """Lines and arcs of the core, counter-clockwise.

        A curve is two arcs that share a tangent at their joint and have the tangents of its ends. Arcs of the same
        circle are joined. A disc has one arc of radius zero, and a segment has two sides.
        """
        if len(self.vertices) == 1:
            return (Face(self.vertices[0], self.vertices[0], 0.0, math.tau),)
        ring = [*self.vertices, self.vertices[0]]
        edges = zip(pairwise(ring), self.bends or [(0.0, 0.0)] * len(self.vertices), strict=True)
        faces = [face for (a, b), bend in edges for face in faces_between(a, b, *bend)]
        return joined(faces, SAME * self.extent) if self.bends else tuple(faces)

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
        return turns_of(self.vertices) if len(self.vertices) > 1 else ((0.0, math.tau),)

    @cached_property
    def pieces(self) -> tuple[OffsetPolygon, ...]:
        """Convex parts between corners of the core, which overlap no more than the offset makes them."""
        if all(turn > 0.0 for _, turn in self.turns):
            return (self,)
        ring = [*self.vertices, self.vertices[0]]
        bends = dict(zip(pairwise(ring), self.bends, strict=True)) if self.bends else {}
        pieces = []
        for piece in convex_pieces(self.vertices):
            own = tuple(bends.get(edge, (0.0, 0.0)) for edge in pairwise([*piece, piece[0]]))
            pieces.append(OffsetPolygon(piece, self.radius, own if any(map(any, own)) else ()))
        return tuple(pieces)

    def curvature(self, point: PlanePoint, tolerance: float) -> float:
        # On the rounding of a corner no edge is nearer than its ends.
        turns = (after.normal - before.normal - before.turn for before, after in pairwise((*self.faces, self.faces[0])))
        ends = zip(self.faces, turns, strict=True) if len(self.vertices) > 1 else [(self.faces[0], math.pi)]
        corners = [face.end for face, turn in ends if math.remainder(turn, math.tau) > SAME]
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
            return polygon_distance(point, self.vertices) - self.radius
        near = []
        for face in self.faces:
            (x, y), normal, off = face.start, face.normal, 0.0
            if face.turn:
                cx, cy = face.center
                normal += _within(math.atan2(point[1] - cy, point[0] - cx) - normal, face.turn)
                x, y = cx + face.radius * math.cos(normal), cy + face.radius * math.sin(normal)
                off = math.dist(point, (x, y))
            else:
                off = segment_distance(point, face.start, face.end)
            near.append((off, (point[0] - x) * math.cos(normal) + (point[1] - y) * math.sin(normal)))
        away = min(near)[0]
        # Both sides of a corner together show where a point is; at an acute corner, one side is not enough.
        height = sum(above for off, above in near if off <= away + SAME * self.extent)
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
    """From the object's axes to the axes of the superellipse [rad]."""

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
        # For an implicit curve f = 0; its mixed derivative is zero here.
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


def _within(angle: float, turn: float) -> float:
    """An angle, brought into [0, turn] or to the nearer of its ends [rad]."""
    angle %= math.tau
    return angle if angle <= turn else (turn if angle < 0.5 * (turn + math.tau) else 0.0)


def faces_between(a: PlanePoint, b: PlanePoint, low: float, high: float) -> list[Face]:
    """Return the line between two points, or two arcs that leave the line by one angle and return by another [rad].

    Of all such pairs of arcs, this pair has end tangents of equal length up to the common tangent: K. M. Bolton,
    "Biarc curves", Computer-Aided Design 7 (1975), doi:10.1016/0010-4485(75)90086-X.
    """
    normal, size = edge_normal(a, b), math.dist(a, b)
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


def joined(faces: list[Face], near: float) -> tuple[Face, ...]:
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


def rounded(vertices: tuple[PlanePoint, ...], radius: float) -> OffsetPolygon:
    """Return the part with a sharp outline whose corners, except reflex ones, are rounded off inside it."""
    if radius == 0.0:
        return OffsetPolygon(vertices)
    core = []
    for (x, y), (low, turn) in zip(vertices, turns_of(vertices), strict=True):
        # The center of an arc tangent to both edges is on the bisector, radius / cos(half) inside the corner.
        reach, middle = radius / math.cos(0.5 * turn), low + 0.5 * turn
        core.append((x - reach * math.cos(middle), y - reach * math.sin(middle)))
    return OffsetPolygon(tuple(core), radius)
