"""The body of an object of a planar scene: a union of polygons with an offset and superellipses."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.body.body import Body, NearBody
from continuum_grasp.grasp.body.plane_boundary import PlaneBoundary, RoundedRectangle
from continuum_grasp.scene import GraspObject, OffsetPolygon, Part, SuperellipsePart

_SPREAD = np.linspace(0.0, 1.0, 33)
"""Shares of a quarter turn at which the search for the nearest point of a superellipse tries points first."""


class NearPart(NamedTuple):
    """Nearest places of a part's surface to n points."""

    distance: Array
    """Signed distances (n,) [m], negative inside."""
    normal: Array
    """Outward unit normals (n, 2) at the nearest places."""
    radius: Array
    """Radii of curvature (n,) of the surface there [m]: infinite on a flat face, zero at a sharp corner."""


class OutlineBody(Body):
    """An object of a planar scene, in its own frame.

    The distance from a union is the least distance from its parts, which is exact outside. Inside, the surface may be
    deeper than that in overlaps of parts, and near reflex corners of a part with an offset.
    """

    dimensions = 2

    def __init__(self, described: GraspObject) -> None:
        self.parts = described.parts
        self.size = described.size
        self.deviation = described.deviation

    @property
    def box(self) -> tuple[Array, Array]:
        reach = np.array([[part.support(0.5 * np.pi * k) for part in self.parts] for k in range(4)]).max(axis=1)
        return -reach[2:], reach[:2]

    def distance(self, points: Array) -> Array:
        return self.near(points).distance

    def near(self, points: Array) -> NearBody:
        points = np.reshape(points, (-1, 2))
        found = [near_part(part, points) for part in self.parts]
        distances, normals, radii = (np.stack(each) for each in zip(*found, strict=True))
        part = distances.argmin(axis=0), np.arange(len(points))
        distance = distances[part]
        bent = 1.0 / np.maximum(radii[part], self.least_radius)
        return NearBody(distance, normals[part], bent)


def near_part(part: Part, points: Array) -> NearPart:
    """Return distances of points (n, 2) from a part, both in the object's frame [m], normals and radii of curvature.

    Raises
    ------
    TypeError
        The part is of a kind that has no distance here.
    """
    if isinstance(part, OffsetPolygon) and part.circle is not None:
        center, size = part.circle
        distance, normal, _ = RoundedRectangle((0.0, 0.0), size).from_points(points - np.array(center))
        return NearPart(distance, normal, np.full(len(points), size))
    if isinstance(part, OffsetPolygon):
        found = _core(part).from_points(points)
        with np.errstate(divide="ignore"):
            radius = np.where(found.curvature == 0.0, np.inf, 1.0 / found.curvature) - found.distance
        return NearPart(found.distance - part.radius, found.gradient, radius + part.radius)
    if not isinstance(part, SuperellipsePart):
        raise TypeError(f"bodies have no distance from {type(part).__name__}: add one here")
    c, s = np.cos(part.angle), np.sin(part.angle)
    turn = np.array([[c, -s], [s, c]])
    distance, normal, radius = _superellipse(part.semi_axes, part.exponent, (points - np.array(part.center)) @ turn)
    return NearPart(distance, normal @ turn.T, radius)


@lru_cache(maxsize=64)
def _core(part: OffsetPolygon) -> PlaneBoundary:
    return PlaneBoundary(part.faces, part.radius)


def _superellipse(axes: tuple[float, float], power: float, points: Array) -> NearPart:
    """Return distances in the superellipse's own frame, sought in the quadrant of each point, where its nearest point
    lies.
    """
    # Newton on the curve's polar angle, safeguarded by bisection between the neighbors of the best point tried.
    scale = max(axes)
    a, b = axes[0] / scale, axes[1] / scale
    sign = np.where(points < 0.0, -1.0, 1.0)
    x, y = np.abs(points / scale).T
    tried = _polar(a, b)
    grid = _curve(a, b, power, tried)[0]
    k = ((x[:, None] - grid[0]) ** 2 + (y[:, None] - grid[1]) ** 2).argmin(axis=1)
    low = tried[np.maximum(k - 1, 0)]
    high = tried[np.minimum(k + 1, tried.size - 1)]
    angle = tried[k]
    for _ in range(60):  # enough for bisection alone to reach rounding
        (px, py), (nx, ny), (dpx, dpy), (dnx, dny) = _curve(a, b, power, angle)
        # the way on is (-ny, nx): on along the curve where the point lies ahead
        ahead = (y - py) * nx - (x - px) * ny
        slope = (y - py) * dnx - (x - px) * dny - (dpy * nx - dpx * ny)
        low = np.where(ahead > 0.0, angle, low)
        high = np.where(ahead < 0.0, angle, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = angle - ahead / slope
        after = np.where((after >= low) & (after <= high), after, 0.5 * (low + high))
        change = np.abs(after - angle).max(initial=0.0)
        angle = after
        if change < 1e-13:
            break
    (px, py), (nx, ny), (dpx, dpy), (dnx, dny) = _curve(a, b, power, angle)
    size = np.hypot(nx, ny)
    nx, ny = nx / size, ny / size
    distance = (x - px) * nx + (y - py) * ny
    bend = np.abs(nx * dny - ny * dnx) / size
    speed = np.hypot(dpx, dpy)
    with np.errstate(divide="ignore"):
        radius = np.where(bend > 0.0, speed / bend, np.inf)
    return NearPart(scale * distance, sign * np.stack([nx, ny], axis=1), scale * radius)


def _polar(a: float, b: float) -> Array:
    """Polar angles of a quadrant, denser where it is elongated."""
    turns = 0.5 * np.pi * _SPREAD
    return np.arctan2(b * np.sin(turns), a * np.cos(turns))


def _curve(a: float, b: float, power: float, angle: Array) -> tuple[tuple[Array, Array], ...]:
    """Points of a quadrant by polar angle, gradients there, and the derivatives of both by the angle."""
    c, s = np.cos(angle), np.sin(angle)
    c = np.maximum(c, 0.0)
    s = np.maximum(s, 0.0)
    cb = (c / a) ** (power - 2.0)
    sb = (s / b) ** (power - 2.0)
    nx, ny = cb * c / a**2, sb * s / b**2
    # On the ray at this angle |x/a|^p + |y/b|^p = g r^p, which is 1 on the curve.
    g = nx * c + ny * s
    r = g ** (-1.0 / power)
    dr = -r / g * (ny * c - nx * s)
    dnx = -(power - 1.0) * cb * s / a**2
    dny = (power - 1.0) * sb * c / b**2
    return (r * c, r * s), (nx, ny), (dr * c - r * s, dr * s + r * c), (dnx, dny)
