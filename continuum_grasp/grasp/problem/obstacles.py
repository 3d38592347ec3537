"""What keeps a section of a finger out of a convex part: a line that separates the two.

A point x is at least d away from a convex part if there is a direction n(beta) with

    n . x - H(beta) >= d,     H the part's support function,

and the distance itself is the greatest of these. So beta is an unknown of the problem, one per place that is kept
clear. For a rounded polygon H is the greatest of n . v + r over its corners v; the corner nearest to the place and its
two neighbours are enough, and the search renews them. A disc needs no direction.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene.parts import Part

__all__ = ["CORNERS", "Nearest", "nearest", "separation", "smooth_support"]

Array = NDArray[Any]
Nearest = tuple[Array, Array, Array]
"""Directions (K,) of the nearest surface points' normals, distances (K,), and corners (K, 2 * `CORNERS`)."""

CORNERS = 3
"""Corners of a polygon that a place is kept clear of."""
_TINY = 1e-14
_COUNT = 129
_SPACING = 0.5 * np.pi / (_COUNT - 1)


def separation(point: ca.SX, beta: ca.SX, corners: ca.SX) -> ca.SX:
    """Heights (M,) of a point above lines through the corners (2, M) whose normal is in direction ``beta``."""
    normal = ca.vertcat(ca.cos(beta), ca.sin(beta))
    return ca.vertcat(*(ca.dot(normal, point - corners[:, k]) for k in range(corners.shape[1])))


def smooth_support(beta: ca.SX, shape: ca.SX) -> ca.SX:
    """Support function of a superellipse (A, B, p, centre, angle)."""
    a, b, dual = shape[0], shape[1], shape[2] / (shape[2] - 1.0)
    square = (ca.vertcat(a * ca.cos(beta - shape[5]), b * ca.sin(beta - shape[5]))) ** 2 + _TINY
    centre = ca.cos(beta) * shape[3] + ca.sin(beta) * shape[4]
    return centre + ca.sum1(square ** (0.5 * dual)) ** (1.0 / dual)


def nearest(part: Part, points: Array) -> Nearest:
    """Where a part is nearest to points.

    Parameters
    ----------
    part : Part
    points : ndarray, shape (K, 2)
        In the object's frame [m].

    Returns
    -------
    directions : ndarray, shape (K,)
        Of the outward normal at the nearest surface point [rad].
    distances : ndarray, shape (K,)
        From the surface [m], negative inside.
    corners : ndarray, shape (K, 6)
        Nearest corner of the core and its neighbours, x and y one after the other [m].
    """
    return _superellipse(part, points) if part.is_superellipse else _polygon(part, points)


def _polygon(part: Part, points: Array) -> Nearest:
    core = np.array(part.vertices)
    count = len(core)
    off = points[:, None, :] - core
    away = np.linalg.norm(off, axis=2)
    close = away.argmin(axis=1)
    corners = np.concatenate([core[(close + k) % count] for k in (-1, 0, 1)], axis=1)
    rows = np.arange(len(points))
    if count == 1:
        return np.arctan2(off[:, 0, 1], off[:, 0, 0]), away[:, 0] - part.radius, corners
    edge = np.roll(core, -1, axis=0) - core
    size = np.linalg.norm(edge, axis=1)
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / size[:, None]
    height = (off * normal).sum(axis=2)
    share = np.clip((off * edge).sum(axis=2) / size**2, 0.0, 1.0)
    arm = off - share[:, :, None] * edge
    reach = np.linalg.norm(arm, axis=2)
    inside = (height < 0.0).all(axis=1) if count > 2 else np.zeros(len(points), dtype=bool)
    pick = np.where(inside, height.argmax(axis=1), reach.argmin(axis=1))
    far = reach[rows, pick]
    on = inside | (far < 1e-12)
    direction = np.where(on[:, None], normal[pick], arm[rows, pick] / np.maximum(far, 1e-300)[:, None])
    distance = np.where(inside, height[rows, pick], far)
    return np.arctan2(direction[:, 1], direction[:, 0]), distance - part.radius, corners


def _superellipse(part: Part, points: Array) -> Nearest:
    (a, b), power = part.semi_axes, part.exponent
    c, s = np.cos(part.angle), np.sin(part.angle)
    turn = np.array([[c, -s], [s, c]])
    local = (points - part.center) @ turn
    t = _nearest_parameter(np.abs(local), a, b, power)
    sign = np.where(local < 0.0, -1.0, 1.0)
    foot, normal, _ = _at(t, a, b, power)
    foot, normal = foot * sign, normal * sign
    distance = ((local - foot) * normal).sum(axis=1)
    world = normal @ turn.T
    return np.arctan2(world[:, 1], world[:, 0]), distance, np.zeros((len(points), 2 * CORNERS))


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
