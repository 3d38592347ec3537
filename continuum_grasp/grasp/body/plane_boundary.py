"""Distances from closed boundaries in the plane: lines and arcs, and rectangles with round corners."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.scene import Face

_PAIRS = 1_000_000
"""Pairs of points and faces that are in memory together: 100 MB."""
_ON = 1e-9
"""Distance, per size, below which a point counts as on the boundary and takes the normal of a face [1]: rounding leaves
seven digits of the direction from the nearest place."""


class PlaneDistance(NamedTuple):
    """Distance from a boundary in the plane, to second order."""

    distance: Array
    """Signed distances (n,) [m], negative inside."""
    gradient: Array
    """Gradients (n, 2) of the distance, of unit length."""
    curvature: Array
    """Curvatures (n,) of the level lines of the distance through the points [1/m]."""


class Boundary(Protocol):
    """A closed curve in the plane."""

    size: float

    def from_points(self, points: Array) -> PlaneDistance:
        """Return the distance of points (n, 2)."""

    def ring(self) -> tuple[Array, Array]:
        """Points around the boundary (N, 2), and normals there (N, 2), for pictures."""


class RoundedRectangle:
    """Everything within a radius of a rectangle about the origin, of which either half extent may be zero."""

    def __init__(self, half: Sequence[float], radius: float) -> None:
        self.half = np.array(half, dtype=float)
        self.radius = radius
        self.size = float(np.hypot(*self.half)) + radius

    def from_points(self, points: Array) -> PlaneDistance:
        """Return the distance of points (n, 2)."""
        beyond = np.abs(points) - self.half
        outside = np.maximum(beyond, 0.0)
        away = np.hypot(*outside.T)
        # Inside the rectangle, the nearest face is on the axis along which the point is least deep.
        face = np.eye(2)[beyond.argmax(axis=1)]
        gradient = np.where(away[:, None] > 0.0, outside / np.maximum(away, 1e-300)[:, None], face)
        at_corner = ((outside > 0.0) | (self.half == 0.0)).all(axis=1)
        curvature = np.where(at_corner & (away > 0.0), 1.0 / np.maximum(away, 1e-300), 0.0)
        distance = away + np.minimum(beyond.max(axis=1), 0.0) - self.radius
        return PlaneDistance(distance, gradient * np.copysign(1.0, points), curvature)

    def ring(self) -> tuple[Array, Array]:
        """Points around the boundary (N, 2), and normals there (N, 2), for pictures."""
        turn = np.linspace(0.0, 0.5 * np.pi, 17)[:, None] + 0.5 * np.pi * np.arange(4)
        normal = np.stack([np.cos(turn), np.sin(turn)], axis=2).transpose(1, 0, 2)
        corner = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * self.half
        return (corner[:, None] + self.radius * normal).reshape(-1, 2), normal.reshape(-1, 2)


class PlaneBoundary:
    """A closed boundary of lines and arcs, counter-clockwise, which a part may grow by a radius.

    A point and a segment (two lines, there and back) have no inside.
    """

    def __init__(self, faces: Sequence[Face], grown: float = 0.0) -> None:
        self.start = np.array([face.start for face in faces])
        self.end = np.array([face.end for face in faces])
        self.normal = np.array([face.normal for face in faces])
        self.turn = np.array([face.turn for face in faces])
        radius = np.array([face.radius for face in faces])
        self.is_arc = (self.turn != 0.0) & (radius != 0.0)
        self.radius = np.where(self.is_arc, radius, 1.0)
        self._direction = np.column_stack([np.cos(self.normal), np.sin(self.normal)])
        self.center = self.start - self.radius[:, None] * self._direction
        self._span = self.end - self.start
        # 1e-300: a line of no length is its start
        self._square = np.maximum((self._span**2).sum(axis=1), 1e-300)
        self.size = float(np.ptp(self.start, axis=0).max() + np.abs(radius).max()) + grown
        self._has_inside = len(faces) > 2 or bool(self.is_arc.any())
        # A circle around each face: no place of an arc is farther from its middle than its ends, or than half a turn.
        every = np.arange(len(faces))
        self._middle = self.at(every, np.full(len(faces), 0.5))
        arcs = 2.0 * np.abs(radius) * np.sin(0.5 * np.minimum(0.5 * np.abs(self.turn), np.pi))
        lines = 0.5 * np.hypot(*self._span.T)
        self._reach = np.where(self.is_arc, arcs, lines)

    def at(self, face: Array, share: Array) -> Array:
        """Points (N, 2) of faces at shares of their lengths."""
        angle = self.normal[face] + share * self.turn[face]
        arc = self.center[face] + self.radius[face, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        line = self.start[face] + share[:, None] * self._span[face]
        return np.asarray(np.where(self.is_arc[face, None], arc, line))

    def from_points(self, points: Array) -> PlaneDistance:
        """Return the distance of points (n, 2); of points that are not finite, all numbers are NaN."""
        finite = np.asarray(np.isfinite(points).all(axis=1))
        there = np.where(finite.reshape(-1, 1), points, self.start[0])
        step = max(1, _PAIRS // len(self.start))
        parts = [self._from_few(there[k : k + step]) for k in range(0, max(len(there), 1), step)]
        found = [np.concatenate(part) for part in zip(*parts, strict=True)]
        for part in found:
            part[~finite] = np.nan
        return PlaneDistance(*found)

    def _from_few(self, points: Array) -> PlaneDistance:
        apart = np.hypot(*(points.T[:, :, None] - self._middle.T[:, None]))
        # Pairs of points and the faces that may be as near as the nearest middle of a face.
        owner, face = np.nonzero(apart - self._reach <= apart.min(axis=1, keepdims=True) + _ON * self.size)
        place, outward, curvature = self._nearest(points[owner], face)
        away = points[owner] - place
        apart = np.hypot(*away.T)
        first = np.searchsorted(owner, np.arange(len(points)))
        least = np.minimum.reduceat(apart, first) if len(points) else np.zeros(0)
        nearest = np.flatnonzero(apart == least[owner])
        best = nearest[np.searchsorted(owner[nearest], np.arange(len(points)))]
        # At a corner both sides say together where a point is.
        heights = np.where(apart <= (least + _ON * self.size)[owner], (away * outward).sum(axis=1), 0.0)
        height = np.add.reduceat(heights, first) if len(points) else least
        sign = np.where(self._has_inside & (height < 0.0), -1.0, 1.0)
        on = least <= _ON * self.size
        toward = sign[:, None] * away[best] / np.maximum(least, 1e-300)[:, None]
        # Of the level through the point, not of the boundary; a corner is an arc of no radius.
        bent = curvature[best]
        distance = sign * least
        radius = np.where(np.isinf(bent), 0.0, 1.0 / np.where((bent == 0.0) | np.isinf(bent), 1.0, bent)) + distance
        tiny = 1e-9 * self.size
        level = np.where(bent == 0.0, 0.0, 1.0 / np.where(np.abs(radius) < tiny, tiny, radius))
        return PlaneDistance(distance, np.where(on[:, None], outward[best], toward), level)

    def _nearest(self, points: Array, face: Array) -> tuple[Array, Array, Array]:
        """Nearest places (N, 2) of faces (N,), outward normals there, and curvatures (N,), infinite at ends."""
        start = self.start[face]
        span = self._span[face]
        share = ((points - start) * span).sum(axis=1) / self._square[face]
        place = start + np.clip(share, 0.0, 1.0)[:, None] * span
        outward = self._direction[face]
        curvature = np.where((share < 0.0) | (share > 1.0) | (self._square[face] < 1e-200), np.inf, 0.0)
        arcs = np.flatnonzero(self.is_arc[face])
        if not len(arcs):
            return place, outward, curvature
        face = face[arcs]
        radius = self.radius[face]
        side = np.sign(radius)
        whole = np.abs(self.turn[face])
        away = side[:, None] * (points[arcs] - self.center[face])
        turned = (side * (np.arctan2(away[:, 1], away[:, 0]) - self.normal[face])) % (2.0 * np.pi)
        inside = turned <= whole
        turned = np.where(inside, turned, np.where(turned < 0.5 * whole + np.pi, whole, 0.0))
        angle = self.normal[face] + side * turned
        outward[arcs] = np.column_stack([np.cos(angle), np.sin(angle)])
        place[arcs] = self.center[face] + radius[:, None] * outward[arcs]
        curvature[arcs] = np.where(inside, 1.0 / radius, np.inf)
        return place, outward, curvature

    def ring(self) -> tuple[Array, Array]:
        """Points around the boundary (N, 2) from face to face, and normals there (N, 2), for pictures."""
        pieces = np.where(self.is_arc, np.maximum(1, np.ceil(np.abs(self.turn) / 0.1)), 1).astype(int) + 1
        owner = np.repeat(np.arange(len(pieces)), pieces)
        share = np.concatenate([np.linspace(0.0, 1.0, n) for n in pieces])
        angle = self.normal[owner] + share * self.turn[owner]
        return self.at(owner, share), np.column_stack([np.cos(angle), np.sin(angle)])
