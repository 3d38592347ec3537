"""The line on which a finger's backbone lies where it touches an object."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely

from benchmarks.grasp_oracle.rod import Array
from continuum_grasp.scene import Part, SuperellipsePart

CORNERS = 0.05
"""Least part of the turns that a corner takes up per radian, so that scans see what happens there."""


class Outline:
    """Outline of a shape in its object's frame, whose pose is world x, y [m] and angle [rad], grown by a length [m]."""

    def __init__(self, part: Part, pose: tuple[float, float, float], grown: float) -> None:
        self.grown = grown
        smooth = part if isinstance(part, SuperellipsePart) else None
        turn = pose[2] + (smooth.angle if smooth else 0.0)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        center = smooth.center if smooth else (0.0, 0.0)
        self._turn = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        self._shift = np.array(pose[:2]) + np.array([[cos, -sin], [sin, cos]]) @ np.array(center)
        self._shape: _Smooth | _Cornered
        if smooth:
            self._shape = _Smooth(smooth.semi_axes, smooth.exponent, grown)
        else:
            cornered = _Cornered if len(part.pieces) == 1 else _Notched
            self._shape = cornered(np.array(part.vertices, dtype=float), part.radius + grown)

    def at(self, u: Any) -> tuple[Array, Array]:
        """Points of the grown outline and outward unit normals, u in turns from 0 to 1: (..., 2) each."""
        point, normal = self._shape.at(np.asarray(u, dtype=float) % 1.0)
        return point @ self._turn.T + self._shift, normal @ self._turn.T

    def gap(self, points: Array) -> Array:
        """Distance of points (..., 2) from the grown outline [m], negative inside."""
        return self._shape.nearest(self._local(points))[0]

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Distance from the grown outline [m] and the outward normal of the object where it is nearest."""
        gap, normal = self._shape.nearest(self._local(points))
        return gap, normal @ self._turn.T

    def _local(self, points: Array) -> Array:
        return (np.asarray(points, dtype=float) - self._shift) @ self._turn


class _Smooth:
    """A superellipse about its center."""

    SAMPLES = 128
    STEPS = 12

    def __init__(self, axes: tuple[float, float], power: float, grown: float) -> None:
        self.a, self.b = axes
        self.power, self.grown = power, grown
        self._turns = np.linspace(-math.pi, math.pi, self.SAMPLES, endpoint=False)
        self._table = self._bare(self._turns)[0]

    def _bare(self, turn: Array) -> tuple[Array, Array]:
        c, s = np.cos(turn), np.sin(turn)
        reach = (np.abs(c) ** self.power + np.abs(s) ** self.power) ** (-1.0 / self.power)
        point = np.stack([self.a * reach * c, self.b * reach * s], axis=-1)
        steep = self.power - 1.0
        normal = np.stack(
            [np.copysign(np.abs(c) ** steep, c) / self.a, np.copysign(np.abs(s) ** steep, s) / self.b], axis=-1
        )
        return point, normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def at(self, u: Array) -> tuple[Array, Array]:
        point, normal = self._bare(2.0 * math.pi * u)
        return point + self.grown * normal, normal

    def _aside(self, turn: Array, points: Array) -> Array:
        """Which way along the outline a point lies from the foot at a place; positive: ahead."""
        foot, normal = self._bare(turn)
        away = points - foot
        return np.asarray(normal[:, 0] * away[:, 1] - normal[:, 1] * away[:, 0])

    def nearest(self, points: Array) -> tuple[Array, Array]:
        flat = points.reshape(-1, 2)
        start = self._turns[np.argmin(((flat[:, None, :] - self._table) ** 2).sum(-1), axis=1)]
        step = 2.0 * math.pi / self.SAMPLES
        low, high = start - step, start + step
        behind, ahead = self._aside(low, flat), self._aside(high, flat)
        before = np.zeros(len(flat))
        for _ in range(self.STEPS):  # Illinois: the secant, with the value halved at an end that stays twice
            turn = low - behind * (high - low) / np.where(ahead == behind, 1.0, ahead - behind)
            turn = np.where((turn >= low) & (turn <= high), turn, 0.5 * (low + high))
            here = self._aside(turn, flat)
            right = here < 0.0
            ahead, behind = (
                np.where(right, here, np.where(before == -1, 0.5 * ahead, ahead)),
                np.where(right, np.where(before == 1, 0.5 * behind, behind), here),
            )
            before = np.where(right, 1, -1)
            low, high = np.where(right, low, turn), np.where(right, turn, high)
        foot, normal = self._bare(turn)
        gap = ((flat - foot) * normal).sum(-1) - self.grown
        return gap.reshape(points.shape[:-1]), normal.reshape(points.shape)


class _Cornered:
    """Everything within a distance of a convex polygon, a segment or a point."""

    def __init__(self, corners: Array, radius: float) -> None:
        self.radius = radius
        self.corners = corners
        count = len(corners)
        after = np.roll(corners, -1, axis=0)
        edge = after - corners
        self.lengths = np.linalg.norm(edge, axis=1)
        if count > 1:
            self.along = edge / self.lengths[:, None]
            self.out = np.stack([self.along[:, 1], -self.along[:, 0]], axis=-1)
            angles = np.arctan2(self.out[:, 1], self.out[:, 0])
            turns = (angles - np.roll(angles, 1)) % (2.0 * math.pi)
            starts = angles - turns
            # At reflex corners there is no arc.
            turns = np.where(turns > math.pi + 1e-9, 0.0, turns)
            starts = np.where(turns > 0.0, starts, angles)
        else:
            turns, starts = np.array([2.0 * math.pi]), np.array([0.0])
        # corner k, then the edge that leaves it
        self._starts, self._turns = starts, turns
        arcs, straight = turns * radius, self.lengths if count > 1 else np.zeros(1)
        arcs = np.maximum(arcs, CORNERS * turns * (arcs.sum() + straight.sum()))
        pieces = np.stack([arcs, straight], axis=1).ravel()
        self._ends = np.cumsum(pieces)
        self._pieces = pieces

    def at(self, u: Array) -> tuple[Array, Array]:
        walked = u * self._ends[-1]
        piece = np.minimum(np.searchsorted(self._ends, walked, side="right"), len(self._pieces) - 1)
        share = (walked - (self._ends[piece] - self._pieces[piece])) / np.maximum(self._pieces[piece], 1e-300)
        corner, straight = piece // 2, piece % 2 == 1
        angle = self._starts[corner] + np.where(straight, self._turns[corner], share * self._turns[corner])
        over = share * self.lengths[corner]
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        tangent = np.stack([-normal[..., 1], normal[..., 0]], axis=-1)
        point = self.corners[corner] + self.radius * normal + np.where(straight, over, 0.0)[..., None] * tangent
        return point, normal

    def nearest(self, points: Array) -> tuple[Array, Array]:
        flat = points.reshape(-1, 2)
        if len(self.corners) == 1:
            away = flat - self.corners[0]
            distance = np.linalg.norm(away, axis=-1)
            normal = away / np.maximum(distance, 1e-300)[:, None]
            return (distance - self.radius).reshape(points.shape[:-1]), normal.reshape(points.shape)
        away = flat[:, None, :] - self.corners
        share = np.clip((away * self.along).sum(-1), 0.0, self.lengths)
        off = away - share[..., None] * self.along
        distance = np.linalg.norm(off, axis=-1)
        height = (away * self.out).sum(-1)
        best = np.argmin(distance, axis=1)
        rows = np.arange(len(flat))
        inside = (height < 0.0).all(axis=1)
        if len(self.corners) == 2:
            inside[:] = False
        shallow = np.argmax(height, axis=1)
        outside = off[rows, best] / np.maximum(distance[rows, best], 1e-300)[:, None]
        normal = np.where(inside[:, None], self.out[shallow], outside)
        gap = np.where(inside, height[rows, shallow], distance[rows, best]) - self.radius
        return gap.reshape(points.shape[:-1]), normal.reshape(points.shape)


class _Notched(_Cornered):
    """Everything within a distance of a simple polygon, by shapely; `at` has places in notches that are too narrow."""

    def __init__(self, corners: Array, radius: float) -> None:
        super().__init__(corners, radius)
        self.solid = shapely.Polygon(corners)
        self.ring = self.solid.exterior
        shapely.prepare([self.solid, self.ring])

    def nearest(self, points: Array) -> tuple[Array, Array]:
        flat = points.reshape(-1, 2)
        spots = shapely.points(flat)
        walked = shapely.line_locate_point(self.ring, spots)
        off = flat - shapely.get_coordinates(shapely.line_interpolate_point(self.ring, walked))
        side = np.where(shapely.contains_xy(self.solid, flat), -1.0, 1.0)
        away = np.linalg.norm(off, axis=1)
        normal = (side / np.maximum(away, 1e-300))[:, None] * off
        return (side * away - self.radius).reshape(points.shape[:-1]), normal.reshape(points.shape)
