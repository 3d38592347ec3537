"""Distances from the surface of an object's parts, and the points with which they lie on a wall.

Everything is in the object's frame, with numbers for the shapes and expressions for the places.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca

from continuum_grasp.model.planar import Rotation, Scalar, Vec
from continuum_grasp.scene.parts import Part

__all__ = ["Nearest", "lowest_points", "nearest"]

_TINY = 1e-30
"""Keeps roots differentiable [m2]; far below rounding."""
_SKIN = 1e-9
"""Distance up to which a point outside a sharp polygon is treated as one on its face [m]."""
_STEPS, _FEWER_STEPS = 3, 2
_PLAIN_EXPONENT, _PLAIN_ASPECT = 4.0, 1.6
"""Exponent and ratio of the half axes up to which fewer steps do."""
_LONGEST = 0.5
"""Longest step of the search on superellipses, as an angle of its parameter [rad]."""


@dataclass(frozen=True)
class Nearest:
    """Signed distance from a surface [m], negative inside, and the outward normal at the nearest point."""

    distance: Scalar
    normal: Vec

    def or_nearer(self, other: Nearest) -> Nearest:
        """The one with the smaller distance."""
        own = ca.SX(self.distance) <= ca.SX(other.distance)
        return Nearest(ca.fmin(self.distance, other.distance), _chosen(own, self.normal, other.normal))


def nearest(parts: Sequence[Part], at: Vec) -> Nearest:
    """Distance of a point from the surface of a union of convex parts; that of the nearest part.

    Rounded polygons are exact outside their core, and inside it up to half the least width. On superellipses the
    nearest point is found by two or three Newton steps along the outline from the point in the same direction: exact
    to 1e-7 of the shorter half axis for points nearer than 0.4 of it, and never negative outside.

    Parameters
    ----------
    parts : sequence of Part
    at : Vec
        The point [m].
    """
    found = [_from_part(part, at) for part in parts]
    best = found[0]
    for other in found[1:]:
        best = best.or_nearer(other)
    return best


def lowest_points(part: Part, direction: Vec) -> list[Vec]:
    """Points of a part that may reach farthest in a direction (a unit vector), one of which does.

    One for a disc or a superellipse, one per corner of a polygon.
    """
    if not part.is_superellipse:
        return [Vec(*v) + direction.scaled(part.radius) for v in part.vertices]
    # The gradient of the support function, whose exponent is dual.
    turn, (a, b) = _turn(part.angle), part.semi_axes
    n = turn.transposed().apply(direction)
    if part.exponent == 2.0:
        reach = ca.sqrt(a * a * n.x * n.x + b * b * n.y * n.y)
        return [Vec(*part.center) + turn.apply(Vec(a * a * n.x / reach, b * b * n.y / reach))]
    dual = part.exponent / (part.exponent - 1.0)
    u, v = a * n.x, b * n.y
    power = [(each * each + _TINY) ** (0.5 * dual - 1.0) for each in (u, v)]
    reach = (power[0] * u * u + power[1] * v * v) ** (1.0 - 1.0 / dual)
    return [Vec(*part.center) + turn.apply(Vec(a * power[0] * u / reach, b * power[1] * v / reach))]


def _from_part(part: Part, at: Vec) -> Nearest:
    if part.is_superellipse:
        turn = _turn(part.angle)
        local = turn.transposed().apply(at - Vec(*part.center))
        found = _from_superellipse(*part.semi_axes, part.exponent, local)
        return Nearest(found.distance, turn.apply(found.normal))
    core = part.vertices
    if len(core) == 1:
        away = at - Vec(*core[0])
        size = _length(away)
        return Nearest(size - part.radius, away.scaled(1.0 / size))
    found = _from_rectangle(core, at) if _is_rectangle(core) else _from_polygon(core, at)
    return Nearest(found.distance - part.radius, found.normal)


# -- polygons ----------------------------------------------------------------------------------------------------------


def _is_rectangle(core: Sequence[tuple[float, float]]) -> bool:
    if len(core) != 4:
        return False
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
    size = _length(beyond)
    deepest = ca.fmax(x, y)
    inside = deepest <= _SKIN
    normal = _chosen(inside, Vec(x > y, x <= y), beyond.scaled(1.0 / size))
    # Signs that are never zero: on an axis of the rectangle either side will do.
    signs = Vec(2.0 * (local.x >= 0.0) - 1.0, 2.0 * (local.y >= 0.0) - 1.0)
    return Nearest(ca.if_else(inside, deepest, size), turn.apply(Vec(signs.x * normal.x, signs.y * normal.y)))


def _from_polygon(core: Sequence[tuple[float, float]], at: Vec) -> Nearest:
    """By the nearest of the edges; two vertices are a segment, which has no inside."""
    edges = list(pairwise([*core, core[0]])) if len(core) > 2 else [(core[0], core[1])]
    heights: list[Scalar] = []
    best: tuple[Scalar, Vec, Vec] | None = None
    for (ax, ay), (bx, by) in edges:
        length = math.hypot(bx - ax, by - ay)
        along, normal = Vec((bx - ax) / length, (by - ay) / length), Vec((by - ay) / length, (ax - bx) / length)
        away = at - Vec(ax, ay)
        s, height = along.dot(away), normal.dot(away)
        over = s - ca.fmin(ca.fmax(s, 0.0), length)
        offset = along.scaled(over) + normal.scaled(height)
        heights.append(height)
        square = over * over + height * height
        if best is None:
            best = (square, offset, normal)
            continue
        nearer = square < best[0]
        best = (ca.fmin(square, best[0]), _chosen(nearer, offset, best[1]), _chosen(nearer, normal, best[2]))
    if best is None:
        raise ValueError("a polygon without edges")
    size = ca.sqrt(best[0] + _TINY)
    outward = best[1].scaled(1.0 / size)
    if len(core) == 2:
        return Nearest(size, outward)
    top = heights[0]
    for height in heights[1:]:
        top = ca.fmax(top, height)
    inside = top <= _SKIN
    return Nearest(ca.if_else(inside, top, size), _chosen(inside, best[2], outward))


# -- superellipses -----------------------------------------------------------------------------------------------------


def _from_superellipse(a: float, b: float, power: float, at: Vec) -> Nearest:
    """Newton's method on the distance along r(t) (a cos t, b sin t), with (cos t, sin t) as the unknown."""
    way = Vec(at.x / a, at.y / b)
    way = way.scaled(1.0 / _length(way))
    plain = power <= _PLAIN_EXPONENT and max(a / b, b / a) <= _PLAIN_ASPECT
    for _ in range(_FEWER_STEPS if plain else _STEPS):
        point, slope, normal, curvature = _on_superellipse(a, b, power, way)
        away = at - point
        size = slope.dot(slope) * ca.fmax(1.0 + away.dot(normal) * curvature, 0.3)
        step = away.dot(slope) / size
        step = step / ca.sqrt(1.0 + (step / _LONGEST) ** 2)
        way = way + way.perp().scaled(step)
        way = way.scaled(1.0 / _length(way))
    point, _, normal, _ = _on_superellipse(a, b, power, way)
    return Nearest((at - point).dot(normal), normal)


def _on_superellipse(a: float, b: float, power: float, way: Vec) -> tuple[Vec, Vec, Vec, Scalar]:
    """Point in a direction, its derivative with respect to the direction's angle, outward normal, curvature."""
    c, s = way.x, way.y
    if power == 2.0:
        point, slope = Vec(a * c, b * s), Vec(-a * s, b * c)
        size = _length(slope)
        return point, slope, Vec(slope.y / size, -slope.x / size), a * b / size**3
    cs = [(each * each + _TINY) ** (0.5 * power - 1.0) for each in (c, s)]
    total = cs[0] * c * c + cs[1] * s * s
    r = total ** (-1.0 / power)
    drift = r * c * s * (cs[0] - cs[1]) / total
    point = Vec(a * r * c, b * r * s)
    slope = Vec(a * (drift * c - r * s), b * (drift * s + r * c))
    # On the outline, |xi|^(p - 2) is that of the direction times r^(p - 2).
    lift = r ** (power - 2.0)
    gradient = Vec(lift * cs[0] * r * c / a, lift * cs[1] * r * s / b)
    size = _length(gradient)
    bend = (power - 1.0) * lift
    curvature = bend * (cs[0] / a**2 * gradient.y * gradient.y + cs[1] / b**2 * gradient.x * gradient.x) / size**3
    return point, slope, gradient.scaled(1.0 / size), curvature


# -- helpers -----------------------------------------------------------------------------------------------------------


def _turn(angle: float) -> Rotation:
    return Rotation(math.cos(angle), math.sin(angle)) if angle != 0.0 else Rotation(1.0, 0.0)


def _length(v: Vec) -> ca.SX:
    return ca.sqrt(v.dot(v) + _TINY)


def _chosen(condition: ca.SX | bool, first: Vec, second: Vec) -> Vec:
    return second + (first - second).scaled(ca.SX(condition))
