"""The surface of a superellipse |x / a|^p + |y / b|^p = 1 with p >= 2.

On it a contact of a grasp has the unknowns (xi, eta) = (x / a, y / b) with |xi|^p + |eta|^p = 1; the normal is the
gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.model.planar import Scalar, Vec, rotated
from continuum_grasp.model.surfaces.surface import (
    TINY,
    Feature,
    Nearest,
    PartOutline,
    Surface,
    SurfacePoint,
    Walk,
    length,
    picked,
)
from continuum_grasp.scene import SuperellipsePart

_STEPS, _FEWER_STEPS = 3, 2  # see below
_PLAIN_EXPONENT, _PLAIN_ASPECT = 4.0, 1.6
"""Newton steps to the nearest point, and exponent and ratio of the half axes up to which fewer do: the nearest point is
then exact to 1e-7 of the shorter half axis for points nearer than 0.4 of it."""
_SETTLED = 1e-7
"""Greatest last change of the polar angle of a nearest place [rad]; the square of the change remains as an error."""


@dataclass(frozen=True)
class SuperellipseSurface(Surface[SuperellipsePart]):
    """The surface of superellipses; numbers of a part and of its one feature are (a, b, p, center, angle)."""

    place_count = 2
    number_count = 6
    feature_count = 6

    # -- contact in motion

    def nearest(self, part: SuperellipsePart, at: Vec) -> Nearest:
        turn = rotated(part.angle)
        local = turn.transposed().apply(at - Vec(*part.center))
        spot = _from_superellipse(*part.semi_axes, part.exponent, local)
        return Nearest(spot.distance, turn.apply(spot.normal))

    def lowest_points(self, part: SuperellipsePart, direction: Vec) -> list[Vec]:
        # The gradient of the support function, whose exponent q = p / (p - 1) is dual.
        turn, (a, b) = rotated(part.angle), part.semi_axes
        n = turn.transposed().apply(direction)
        if part.exponent == 2.0:
            reach = ca.sqrt(a * a * n.x * n.x + b * b * n.y * n.y)
            return [Vec(*part.center) + turn.apply(Vec(a * a * n.x / reach, b * b * n.y / reach))]
        dual = part.exponent / (part.exponent - 1.0)
        u, v = a * n.x, b * n.y
        power = [(each * each + TINY) ** (0.5 * dual - 1.0) for each in (u, v)]
        reach = (power[0] * u * u + power[1] * v * v) ** (1.0 - 1.0 / dual)
        return [Vec(*part.center) + turn.apply(Vec(a * power[0] * u / reach, b * power[1] * v / reach))]

    # -- contact of a grasp

    def point(self, place: ca.SX, feature: ca.SX) -> SurfacePoint:
        a = feature[0]
        b = feature[1]
        power = feature[2]
        angle = feature[5]
        # |xi|^p as (xi^2)^(p / 2): even powers of a signed unknown, without its sign.
        # 1e-10: rounding of a contact's place, whose second derivatives IPOPT needs: rounds |xi| below 1e-5
        square = place**2 + 1e-10
        slope = place * square ** (0.5 * power - 1.0) / ca.vertcat(a, b)
        turn = ca.vertcat(ca.horzcat(ca.cos(angle), -ca.sin(angle)), ca.horzcat(ca.sin(angle), ca.cos(angle)))
        point = feature[3:5] + turn @ (ca.vertcat(a, b) * place)
        size = ca.norm_2(slope)
        bend = (power - 1.0) * square ** (0.5 * power - 1.0) / ca.vertcat(a, b) ** 2
        curvature = (bend[0] * slope[1] ** 2 + bend[1] * slope[0] ** 2) / size**3
        return SurfacePoint(point, turn @ (slope / size), ca.sum1(square ** (0.5 * power)) - 1.0, curvature)

    def wall_clearance(self, normal: ca.SX, point: ca.SX, angle: ca.SX, pose: ca.SX, numbers: ca.SX) -> list[ca.SX]:
        beta = angle + ca.pi - pose[2]
        return [ca.dot(normal, pose[:2] - point) - smooth_support(beta, numbers)]

    def numbers(self, part: SuperellipsePart, unit: float) -> list[float]:
        return self.feature_numbers(self.feature(part, 0, 0.0), unit)

    def feature_numbers(self, feature: Feature, unit: float) -> list[float]:
        a, b, power, x, y, angle = feature.numbers
        return [a / unit, b / unit, power, x / unit, y / unit, angle]

    def feature(self, part: SuperellipsePart, piece: int, grown: float) -> Feature:
        numbers = (*part.semi_axes, part.exponent, *part.center, part.angle)
        # |xi| <= 1 on the outline: these bounds are never active.
        return Feature(numbers, (-1.5, -1.5), (1.5, 1.5))

    def near(self, part: SuperellipsePart, point: tuple[float, float], normal_angle: float, grown: float) -> Feature:
        return self.feature(part, 0, grown)

    def place(
        self, part: SuperellipsePart, feature: Feature, point: tuple[float, float], normal_angle: float
    ) -> tuple[float, float]:
        c = math.cos(part.angle)
        s = math.sin(part.angle)
        x = point[0] - part.center[0]
        y = point[1] - part.center[1]
        return (c * x + s * y) / part.semi_axes[0], (c * y - s * x) / part.semi_axes[1]

    # -- search of a grasp

    def new_outline(self, part: SuperellipsePart) -> PartOutline:
        return _SuperellipseOutline(complex(*part.center), part.angle, part.semi_axes, part.exponent)


def smooth_support(beta: ca.SX, shape: ca.SX) -> ca.SX:
    """Support function of a superellipse (a, b, p, center, angle)."""
    a = shape[0]
    b = shape[1]
    dual = shape[2] / (shape[2] - 1.0)
    # 1e-14: rounding of the support function [1, in squared units of the problem]
    square = (ca.vertcat(a * ca.cos(beta - shape[5]), b * ca.sin(beta - shape[5]))) ** 2 + 1e-14
    center = ca.cos(beta) * shape[3] + ca.sin(beta) * shape[4]
    return center + ca.sum1(square ** (0.5 * dual)) ** (1.0 / dual)


def _from_superellipse(a: float, b: float, power: float, at: Vec) -> Nearest:
    """Newton's method on the distance along r(t) (a cos t, b sin t), with (cos t, sin t) as the unknown."""
    # The point's own direction in the unit superellipse: exact on the axes and on the outline.
    way = Vec(at.x / a, at.y / b)
    way = way.scaled(1.0 / length(way))
    plain = power <= _PLAIN_EXPONENT and max(a / b, b / a) <= _PLAIN_ASPECT
    for _ in range(_FEWER_STEPS if plain else _STEPS):
        point, slope, normal, curvature = _on_superellipse(a, b, power, way)
        away = at - point
        # Second derivative of half the squared distance, from below by 0.3: inside, past the center of curvature,
        # it would change its sign and the step its direction.
        size = slope.dot(slope) * ca.fmax(1.0 + away.dot(normal) * curvature, 0.3)
        step = away.dot(slope) / size
        # 0.5: longest step of the search on superellipses, as an angle of its parameter [rad]: Newton's method
        # overshoots where the curvature changes by its own size, which it does within half a radian
        step = step / ca.sqrt(1.0 + (step / 0.5) ** 2)  # a smooth limit
        way = way + way.perp().scaled(step)
        way = way.scaled(1.0 / length(way))
    point, _, normal, _ = _on_superellipse(a, b, power, way)
    return Nearest((at - point).dot(normal), normal)


def _on_superellipse(a: float, b: float, power: float, way: Vec) -> tuple[Vec, Vec, Vec, Scalar]:
    """Point in a direction, its derivative with respect to the direction's angle, outward normal, curvature."""
    c, s = way.x, way.y
    if power == 2.0:
        point = Vec(a * c, b * s)
        slope = Vec(-a * s, b * c)
        size = length(slope)
        return point, slope, Vec(slope.y / size, -slope.x / size), a * b / size**3
    cs = [(each * each + TINY) ** (0.5 * power - 1.0) for each in (c, s)]
    total = cs[0] * c * c + cs[1] * s * s
    r = total ** (-1.0 / power)
    drift = r * c * s * (cs[0] - cs[1]) / total
    point = Vec(a * r * c, b * r * s)
    slope = Vec(a * (drift * c - r * s), b * (drift * s + r * c))
    # On the outline, |xi|^(p - 2) is the value for the direction times r^(p - 2).
    lift = r ** (power - 2.0)
    gradient = Vec(lift * cs[0] * r * c / a, lift * cs[1] * r * s / b)
    size = length(gradient)
    bend = (power - 1.0) * lift
    curvature = bend * (cs[0] / a**2 * gradient.y * gradient.y + cs[1] / b**2 * gradient.x * gradient.x) / size**3
    return point, slope, gradient.scaled(1.0 / size), curvature


class _SuperellipseOutline(PartOutline):
    """Outline of a superellipse; w is the polar angle of the scaled superellipse."""

    def __init__(self, center: complex, angle: float, semi_axes: tuple[float, float], exponent: float) -> None:
        self.center = center
        self.angle = angle
        self.axes = semi_axes
        self.exponent = exponent
        self.extent = math.hypot(*semi_axes)
        # A table of places: even in the polar angle, and even in the normal's angle, which changes fast at corners.
        tilts = np.linspace(0.0, 0.5 * math.pi, 17)
        ratio = (semi_axes[1] / semi_axes[0]) * np.tan(tilts[1:-1])
        turns = np.arctan(ratio ** (1.0 / (exponent - 1.0)))
        self._table = np.unique(np.concatenate([np.linspace(0.0, 0.5 * math.pi, 13), turns]))
        point, normal, _, _ = self._quadrant(self._table)
        self._normal = normal
        self._reach = (point * np.conj(normal)).real

    @cached_property
    def _lines(self) -> tuple[Array, Array, Array, Array]:
        """Tangents of the first quadrant: points, normals, distances from the center, and radii of curvature."""
        at, normal, speed, turning = self._quadrant(self._table)
        with np.errstate(divide="ignore"):
            return at, normal, self._reach, np.where(turning > 0.0, speed / turning, np.inf)

    def _quadrant(self, turn: Array) -> tuple[Array, Array, Array, Array]:
        """Point, normal, speed, and turning of the normal, at polar angles of the first quadrant."""
        (a, b), p = self.axes, self.exponent
        c = np.maximum(np.cos(turn), 0.0)
        s = np.sin(turn)
        cp, sp = c ** (p - 1.0), s ** (p - 1.0)
        norm = (cp * c + sp * s) ** (1.0 / p)
        along, across = b * cp, a * sp
        size = np.hypot(along, across)
        point = (a * c + 1j * b * s) / norm
        turning = a * b * (p - 1.0) * (c * s) ** (p - 2.0) / size**2
        return point, (along + 1j * across) / size, size / norm ** (p + 1.0), turning

    def walk(self, w: Array) -> Walk:
        w = np.mod(w, math.tau)
        # By symmetry from the first quadrant.
        left = (w > 0.5 * math.pi) & (w <= 1.5 * math.pi)
        low = w > math.pi
        turn = np.where(left, np.where(low, w - math.pi, math.pi - w), np.where(low, math.tau - w, w))
        point, normal, speed, turning = self._quadrant(turn)
        flip_x = np.where(left, -1.0, 1.0)
        flip_y = np.where(low, -1.0, 1.0)
        point = flip_x * point.real + 1j * flip_y * point.imag
        normal = flip_x * normal.real + 1j * flip_y * normal.imag
        axis = np.exp(1j * self.angle)
        return Walk(
            self.center + axis * point,
            np.angle(normal) + self.angle,
            1j * axis * normal * speed,
            turning,
        )

    @property
    def rough_numbers(self) -> list[float]:
        at, normal, reach, radius = self._lines
        axis = np.exp(1j * self.angle)
        numbers = np.concatenate([normal.real, normal.imag, reach, at.real, at.imag, radius]).tolist()
        entries = [self.center.real, self.center.imag, axis.real, axis.imag, *numbers]
        return [1.0, len(at), len(entries), *entries]

    def rough_distance(self, points: Array) -> Array:
        local = (points - self.center) * np.exp(-1j * self.angle)
        x = np.abs(local.real)
        y = np.abs(local.imag)
        at, normal, reach, radius = self._lines
        # The farthest of tangents, and how much farther that between them is which the point faces: to second order in
        # the angle between both, which is slide / (gap + radius).
        tangents = x[..., None] * normal.real + y[..., None] * normal.imag
        tangents -= reach
        best = np.argmax(tangents, axis=-1)
        gap = picked(tangents, best)
        slide = (y - at.imag[best]) * normal.real[best] - (x - at.real[best]) * normal.imag[best]
        return np.asarray(gap + 0.5 * slide**2 / np.maximum(gap + radius[best], 4.0 * np.abs(slide) + 1e-12))

    def nearest(self, points: Array) -> tuple[Array, Array]:
        local = (points - self.center) * np.exp(-1j * self.angle)
        corner = np.abs(local.real) + 1j * np.abs(local.imag)
        gap = (corner[..., None].real * self._normal.real + corner[..., None].imag * self._normal.imag) - self._reach
        best = np.argmax(gap, axis=-1)
        low = self._table[np.maximum(best - 1, 0)]
        high = self._table[np.minimum(best + 1, len(self._table) - 1)]
        turn = self._table[best]
        out: Array = np.zeros(points.shape)
        # Newton's method between the table's neighbors; a step that leaves the bracket is replaced by bisection.
        for _ in range(6):
            at, normal, speed, turning = self._quadrant(turn)
            off = (corner - at) * np.conj(normal)
            out, slide = off.real, off.imag
            low = np.where(slide > 0.0, turn, low)
            high = np.where(slide > 0.0, high, turn)
            change = slide / np.maximum(speed + turning * out, 1e-12 * self.extent)
            aim = turn + change
            turn = np.where((aim < low) | (aim > high), 0.5 * (low + high), aim)
            if np.abs(change).max(initial=0.0) < _SETTLED:
                break
        at, normal, _, _ = self._quadrant(turn)
        out = ((corner - at) * np.conj(normal)).real
        left, down = local.real < 0.0, local.imag < 0.0
        walk = np.where(
            left,
            np.where(down, math.pi + turn, math.pi - turn),
            np.where(down, np.mod(math.tau - turn, math.tau), turn),
        )
        return out, walk

    def extremes(self, direction: complex, flat: float) -> list[tuple[complex, float]]:
        local = direction * np.exp(-1j * self.angle)
        (a, b), dual = self.axes, self.exponent / (self.exponent - 1.0)
        # Gradient of the support function, the dual norm of (a u, b v).
        u = a * abs(local.real)
        v = b * abs(local.imag)
        norm = (u**dual + v**dual) ** (1.0 / self.exponent)
        x = math.copysign(a * u ** (dual - 1.0) / norm, local.real)
        y = math.copysign(b * v ** (dual - 1.0) / norm, local.imag)
        return [(complex(self.center + complex(x, y) * np.exp(1j * self.angle)), 0.0)]
