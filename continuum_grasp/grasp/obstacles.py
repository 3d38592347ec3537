"""What keeps a section of a finger out of a convex part: the feature of the part that is nearest to it.

Near a face the part is a half plane, near a corner a disc, near a superellipse its circle of curvature. Each of these
is a few numbers, so one constraint serves all shapes:

    (1 - w) n . (x - v) + w |x - v| >= r + h

They are exact for polygons and discs as long as the nearest feature stays the same, and exact to second order on
superellipses; the search renews them until they hold.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene.objects import Part

__all__ = ["SIZE", "distance_to", "nearest_obstacles"]

Array = NDArray[Any]

SIZE = 6
"""Numbers of an obstacle: w, n (2), v (2), r."""
_FLAT = 50.0
"""Radius of curvature, in sizes of the part, from which on a superellipse counts as flat."""
_COUNT = 129
_SPACING = 0.5 * np.pi / (_COUNT - 1)


def distance_to(point: ca.SX, obstacle: ca.SX) -> ca.SX:
    """Distance of a point from an obstacle, both in the same frame and unit."""
    away = point - obstacle[3:5]
    w = obstacle[0]
    straight = ca.dot(obstacle[1:3], away)
    return (1.0 - w) * straight + w * ca.sqrt(ca.sumsqr(away) + 1e-24) - obstacle[5]


def nearest_obstacles(part: Part, points: Array) -> tuple[Array, Array]:
    """The obstacle nearest to each point, and its distance.

    Parameters
    ----------
    part : Part
    points : ndarray, shape (K, 2)
        In the object's frame [m].

    Returns
    -------
    obstacles : ndarray, shape (K, 6)
        w, normal (2), v (2) [m], r [m].
    distance : ndarray, shape (K,)
        From the part's surface [m], negative inside.
    """
    return _superellipse(part, points) if part.is_superellipse else _polygon(part, points)


def _polygon(part: Part, points: Array) -> tuple[Array, Array]:
    core = np.array(part.vertices)
    out = np.zeros((len(points), SIZE))
    out[:, 5] = part.radius
    if len(core) == 1:
        away = points - core[0]
        out[:, 0], out[:, 3:5] = 1.0, core[0]
        size = np.linalg.norm(away, axis=1)
        out[:, 1:3] = away / np.maximum(size, 1e-300)[:, None]
        return out, size - part.radius
    a, b = core, np.roll(core, -1, axis=0)
    edge = b - a
    size = np.linalg.norm(edge, axis=1)
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / size[:, None]
    off = points[:, None, :] - a
    height = (off * normal).sum(axis=2)
    share = np.clip((off * edge).sum(axis=2) / size**2, 0.0, 1.0)
    reach = np.linalg.norm(off - share[:, :, None] * edge, axis=2)
    inside = (height < 0.0).all(axis=1) if len(core) > 2 else np.zeros(len(points), dtype=bool)
    pick = np.where(inside, height.argmax(axis=1), reach.argmin(axis=1))
    rows = np.arange(len(points))
    distance = np.where(inside, height[rows, pick], reach[rows, pick])
    at = share[rows, pick]
    corner = ~inside & ((at <= 0.0) | (at >= 1.0))
    out[:, 0] = corner
    out[:, 1:3] = normal[pick]
    out[:, 3:5] = np.where((corner & (at >= 1.0))[:, None], b[pick], a[pick])
    if len(core) == 2:  # a slot: both sides are one edge, seen from either side
        flat = ~corner & (height[rows, pick] < 0.0)
        out[flat, 1:3] *= -1.0
    return out, distance - part.radius


def _superellipse(part: Part, points: Array) -> tuple[Array, Array]:
    (a, b), power = part.semi_axes, part.exponent
    c, s = np.cos(part.angle), np.sin(part.angle)
    turn = np.array([[c, -s], [s, c]])
    local = (points - part.center) @ turn
    t = _nearest_parameter(np.abs(local), a, b, power)
    sign = np.where(local < 0.0, -1.0, 1.0)
    foot, normal, radius = _at(t, a, b, power)
    foot, normal = foot * sign, normal * sign
    distance = ((local - foot) * normal).sum(axis=1)
    flat = radius > _FLAT * max(a, b)
    out = np.zeros((len(points), SIZE))
    out[:, 0] = ~flat
    out[:, 1:3] = normal @ turn.T
    kept = np.where(flat, 0.0, radius)
    out[:, 3:5] = (foot - kept[:, None] * normal) @ turn.T + np.asarray(part.center)
    out[:, 5] = kept
    return out, distance


def _at(t: Array, a: float, b: float, power: float) -> tuple[Array, Array, Array]:
    """Point, normal and radius of curvature in the first quadrant at a parameter from 0 to pi/2."""
    c, s = np.cos(t), np.sin(t)
    norm = (c**power + s**power) ** (-1.0 / power)
    xi, eta = c * norm, s * norm
    fx, fy = xi ** (power - 1.0) / a, eta ** (power - 1.0) / b
    size = np.hypot(fx, fy)
    with np.errstate(divide="ignore", invalid="ignore"):
        fxx = (power - 1.0) * xi ** (power - 2.0) / a**2
        fyy = (power - 1.0) * eta ** (power - 2.0) / b**2
        radius = size**3 / (fxx * fy**2 + fyy * fx**2)
    radius = np.where(np.isfinite(radius), radius, np.inf)
    return np.stack([a * xi, b * eta], axis=1), np.stack([fx, fy], axis=1) / size[:, None], radius


def _nearest_parameter(points: Array, a: float, b: float, power: float) -> Array:
    """Parameter of the surface point nearest to each point of the first quadrant: a scan, then Newton's method along
    the circle of curvature.
    """
    grid, foot = _scan(a, b, power)
    t = grid[((points[:, None, :] - foot) ** 2).sum(axis=2).argmin(axis=1)]
    for _ in range(8):
        at, normal, radius = _at(t, a, b, power)
        step = 1e-6 * np.where(t > 0.7, -1.0, 1.0)
        speed = np.linalg.norm(_at(t + step, a, b, power)[0] - at, axis=1) / np.abs(step)
        away = points - at
        along = away[:, 1] * normal[:, 0] - away[:, 0] * normal[:, 1]  # counter-clockwise, as t grows
        bent = np.maximum(1.0 + (away * normal).sum(axis=1) / radius, 0.2)
        change = np.clip(along / bent / np.maximum(speed, 1e-300), -_SPACING, _SPACING)
        t = np.clip(t + change, 0.0, 0.5 * np.pi)
    return np.asarray(t)


@lru_cache(maxsize=64)
def _scan(a: float, b: float, power: float) -> tuple[Array, Array]:
    grid = np.linspace(0.0, 0.5 * np.pi, _COUNT)
    return grid, _at(grid, a, b, power)[0]
