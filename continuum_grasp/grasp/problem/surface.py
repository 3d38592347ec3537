"""Where a contact sits on an object's part: expressions, and the numbers of the feature that it sits on.

A rounded polygon is touched on a *feature*: a face or a corner of its core, and every point there is

    p = a + sigma (b - a) + r n(alpha),     n(alpha) = (cos alpha, sin alpha)

On a face alpha is the face's normal and sigma in [0, 1] is free: the contact slides along the face. On a corner a = b
and alpha is free between the normals of the faces next to it. So faces, corners, slots and discs differ by numbers
only. On a superellipse, (xi, eta) = (x / A, y / B) are free on |xi|^p + |eta|^p = 1 and the normal is the gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from continuum_grasp.scene.parts import Part

__all__ = ["Feature", "SurfacePoint", "features", "nearest_feature"]

SHARP = 1e-7
"""Radius of what counts as a sharp corner [m]."""
_TINY = 1e-10
"""Rounding of |xi|^2 on superellipses [1]."""


@dataclass(frozen=True)
class SurfacePoint:
    """A point on a part, as expressions in the object's frame.

    Attributes
    ----------
    point, normal : casadi.SX
        (2, 1) each.
    on_surface : casadi.SX
        Zero on the surface; empty where that is so by construction.
    curvature : casadi.SX or None
        Of a superellipse's surface; None where it is a number of the feature.
    """

    point: ca.SX
    normal: ca.SX
    on_surface: ca.SX
    curvature: ca.SX | None = None

    @staticmethod
    def on_polygon(place: ca.SX, feature: ca.SX) -> SurfacePoint:
        """On a feature (a, b, r) of a rounded polygon; ``place`` is (sigma, alpha)."""
        normal = ca.vertcat(ca.cos(place[1]), ca.sin(place[1]))
        a, b = feature[:2], feature[2:4]
        return SurfacePoint(a + place[0] * (b - a) + feature[4] * normal, normal, ca.SX(0, 1))

    @staticmethod
    def on_superellipse(place: ca.SX, feature: ca.SX) -> SurfacePoint:
        """On a superellipse (A, B, p, centre, angle); ``place`` is (xi, eta)."""
        a, b, power, angle = feature[0], feature[1], feature[2], feature[5]
        square = place**2 + _TINY
        slope = place * square ** (0.5 * power - 1.0) / ca.vertcat(a, b)
        turn = ca.vertcat(ca.horzcat(ca.cos(angle), -ca.sin(angle)), ca.horzcat(ca.sin(angle), ca.cos(angle)))
        point = feature[3:5] + turn @ (ca.vertcat(a, b) * place)
        size = ca.norm_2(slope)
        bend = (power - 1.0) * square ** (0.5 * power - 1.0) / ca.vertcat(a, b) ** 2
        curvature = (bend[0] * slope[1] ** 2 + bend[1] * slope[0] ** 2) / size**3
        return SurfacePoint(point, turn @ (slope / size), ca.sum1(square ** (0.5 * power)) - 1.0, curvature)


@dataclass(frozen=True)
class Feature:
    """A face or corner of a rounded polygon, or a whole superellipse: numbers and bounds of a contact on it.

    Attributes
    ----------
    numbers : tuple of float
        (a, b, r), five numbers, or (A, B, p, centre, angle), six; lengths in m.
    lower, upper : (float, float)
        Bounds of the two unknowns of the contact's place.
    """

    numbers: tuple[float, ...]
    lower: tuple[float, float]
    upper: tuple[float, float]

    @property
    def curvature(self) -> float:
        """Curvature of the surface [1/m]: 0 on a face; a sharp corner's is a large number. Not of superellipses."""
        ax, ay, bx, by, r = self.numbers
        return 0.0 if (ax, ay) != (bx, by) else 1.0 / max(r, SHARP)

    def place(self, part: Part, point: tuple[float, float], normal_angle: float) -> tuple[float, float]:
        """The unknowns for a point on it, in the object's frame [m]."""
        if part.is_superellipse:
            c, s = math.cos(part.angle), math.sin(part.angle)
            x, y = point[0] - part.center[0], point[1] - part.center[1]
            return (c * x + s * y) / part.semi_axes[0], (c * y - s * x) / part.semi_axes[1]
        ax, ay, bx, by, r = self.numbers
        dx, dy = bx - ax, by - ay
        size = dx * dx + dy * dy
        x, y = point[0] - r * math.cos(normal_angle), point[1] - r * math.sin(normal_angle)
        share = 0.0 if size == 0.0 else min(max(((x - ax) * dx + (y - ay) * dy) / size, 0.0), 1.0)
        middle = 0.5 * (self.lower[1] + self.upper[1])
        angle = middle + math.remainder(normal_angle - middle, math.tau) if math.isfinite(middle) else normal_angle
        return share, min(max(angle, self.lower[1]), self.upper[1])


def features(part: Part) -> list[Feature]:
    """All faces and corners of a rounded polygon, counter-clockwise; or the superellipse."""
    if part.is_superellipse:
        numbers = (*part.semi_axes, part.exponent, *part.center, part.angle)
        return [Feature(numbers, (-1.5, -1.5), (1.5, 1.5))]
    core, r = part.vertices, part.radius
    if len(core) == 1:
        return [Feature((*core[0], *core[0], r), (0.0, -math.inf), (0.0, math.inf))]
    found = []
    for k, (a, b) in enumerate(pairwise([*core, core[0]])):
        normal = math.atan2(a[0] - b[0], b[1] - a[1])
        before = core[k - 1]
        last = math.atan2(before[0] - a[0], a[1] - before[1])
        low = normal - (normal - last) % math.tau
        found.append(Feature((*a, *a, r), (0.0, low), (0.0, normal)))
        found.append(Feature((*a, *b, r), (0.0, normal), (1.0, normal)))
    return found


def nearest_feature(part: Part, point: tuple[float, float], normal_angle: float) -> int:
    """Index among `features` of that on which a surface point with this outward normal lies best."""
    best, index = math.inf, 0
    for k, feature in enumerate(features(part)):
        if part.is_superellipse:
            return 0
        share, angle = feature.place(part, point, normal_angle)
        ax, ay, bx, by, r = feature.numbers
        x = ax + share * (bx - ax) + r * math.cos(angle) - point[0]
        y = ay + share * (by - ay) + r * math.sin(angle) - point[1]
        turn = abs(math.remainder(angle - normal_angle, math.tau))
        size = float(np.ptp(np.array(part.vertices), axis=0).max()) + part.radius
        cost = math.hypot(x, y) / size + turn + (1e-9 if ax == bx and ay == by and len(part.vertices) > 1 else 0.0)
        if cost < best:
            best, index = cost, k
    return index
