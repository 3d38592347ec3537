"""The outline of an offset polygon as numbers, for searches: walked along, nearest faces of points, extremes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model.surfaces.surface import PartOutline, Walk, picked
from continuum_grasp.scene import SAME, Face

SHARP = 1e-7
"""Radius of a sharp corner for contacts that roll over it [m]: far below any real edge, and its curvature of 1e7 1/m is
still exact in sums with curvatures of fingers."""
CHORD = 0.02
"""Turn of chords that replace arcs in rough distances [rad]: their error is a sixteenth of its square, per radius."""
_SLOT = 1e-9
"""Squared preference for the point's own side of a segment, per squared extent [1]."""


def outermost(core: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the corners of the convex hull, counter-clockwise."""
    if len(core) < 4:
        return list(range(len(core)))
    from scipy.spatial import ConvexHull

    corners = ConvexHull(np.array(core)).vertices.tolist()
    first = corners.index(min(corners))
    return [*corners[first:], *corners[:first]]


class PolygonOutline(PartOutline):
    """Outline of an offset polygon: faces, each with the corner at its end, which may be smooth."""

    def __init__(self, faces: Sequence[Face], radius: float) -> None:
        self.radius = radius
        count = len(faces)
        self._start = np.array([complex(*face.start) for face in faces])
        self._end = np.array([complex(*face.end) for face in faces])
        self._low, self._bent, self._reach = np.array([(f.normal, f.turn, f.radius) for f in faces]).T
        self._is_line = self._bent == 0.0
        self._span = np.where(self._is_line, self._end - self._start, 0.0)
        self._lengths = np.abs(self._span)
        self._along = np.where(self._is_line, self._span, 1.0) / np.where(self._is_line, self._lengths, 1.0)
        # On a line its start, of an arc its center.
        self._base = self._start - np.where(self._is_line, 0.0, self._reach * np.exp(1j * self._low))
        normals = self._low + self._bent
        turns = np.mod(np.roll(self._low, -1) - normals, math.tau)
        reflex = turns > math.pi + SHARP
        # A reflex corner is passed at once, and so is a smooth one.
        turns[reflex | (turns < SAME)] = 0.0
        if count == 1:
            turns = np.zeros(1)
            reflex = np.zeros(1, bool)
        self._normals = normals
        self._turns = turns
        # Those of both faces at a corner, for the side of a point.
        self._before = np.exp(1j * normals) + np.roll(np.exp(1j * self._low), -1)
        extent = float(np.abs(self._start - self._start.mean()).max()) if count > 1 else float(self._reach[0])
        # Meters of walk per radian of a corner: some length even where the corner is sharp.
        self._per_angle = radius + (0.2 * extent if count > 1 else float(self._reach[0]))
        curved = np.where(self._bent > 0.0, self._reach + radius, self._per_angle)
        self._rates = np.stack([np.where(self._is_line, 0.0, 1.0 / curved), np.full(count, 1.0 / self._per_angle)], 1)
        pieces = np.stack([self._lengths + self._bent * curved, turns * self._per_angle], axis=1).ravel()
        self._starts = np.concatenate([[0.0], np.cumsum(pieces)])
        self.joints = self._starts[:-1]
        self.period = float(self._starts[-1])
        self.breaks = self._starts[:-1:2][np.roll(reflex, 1)]
        bulge = self._reach * (1.0 - np.cos(0.5 * self._bent)) if count > 1 else np.zeros(1)
        self._extent = extent + float(bulge.max()) + radius
        self.is_round = count == 1

    @cached_property
    def face_normals(self) -> tuple[float, ...]:  # type: ignore[override]
        points = [(z.real, z.imag) for z in self._start.tolist()]
        hull = outermost(points)
        sides = zip(hull, [*hull[1:], *hull[:1]], strict=True)
        # Faces of the hull, also those in front of reflex corners; an arc is no such face.
        flat = [(a, b) for a, b in sides if self._is_line[a] or b != (a + 1) % len(points)] if len(hull) > 1 else []
        return tuple(float(np.angle(-1j * (self._start[b] - self._start[a]))) for a, b in flat)

    def walk(self, w: Array) -> Walk:
        w = np.mod(w, self.period)
        piece = np.clip(np.searchsorted(self._starts, w, side="right") - 1, 0, len(self._starts) - 2)
        local = w - self._starts[piece]
        face = piece // 2
        corner = piece % 2 == 1
        rate = self._rates[face, piece % 2]
        angle = np.where(corner, self._normals[face], self._low[face]) + local * rate
        normal = np.exp(1j * angle)
        along = np.where(self._is_line[face] & ~corner, local, 0.0) * self._along[face]
        at = np.where(corner, self._end[face], self._base[face]) + along
        reach = self.radius + np.where(corner, 0.0, self._reach[face])
        dpoint = np.where(self._is_line[face] & ~corner, self._along[face], 1j * normal * reach * rate)
        return Walk(at + reach * normal, angle, dpoint, rate)

    def nearest(self, points: Array) -> tuple[Array, Array]:
        gap, face, along = self._nearest_face(points)
        length = np.where(self._is_line, self._lengths, self._bent)[face]
        start = self._starts[2 * face]
        before = along <= 0.0
        after = along >= length
        owner = np.where(before, (face - 1) % len(self._start), face)
        turn = np.mod(np.angle(points - self._end[owner]) - self._normals[owner], math.tau)
        turn = np.where(turn > 0.5 * (self._turns[owner] + math.tau), 0.0, np.minimum(turn, self._turns[owner]))
        corner = self._starts[2 * owner + 1] + turn * self._per_angle
        on_face = np.clip(along, 0.0, length) / np.where(self._is_line[face], 1.0, self._rates[face, 0])
        if self.is_round:
            return gap, start + on_face
        return gap, np.where((before | after) & (gap > -self.radius), corner, start + on_face)

    def distance(self, points: Array) -> Array:
        return self._nearest_face(points)[0]

    @property
    def rough_numbers(self) -> list[float]:
        if self.is_round:
            start = self._base
            along = np.zeros(1, complex)
            radius = self.radius + float(self._reach[0])
        else:
            start = self._chords()
            radius = self.radius
            along = np.roll(start, -1) - start
        length = np.abs(along)
        unit = np.where(length > 0.0, along, 1.0) / np.where(length > 0.0, length, 1.0)
        each = [start.real, start.imag, unit.real, unit.imag, length]
        numbers = [radius, _SLOT * self._extent**2, *np.stack(each, axis=1).ravel().tolist()]
        return [0.0, len(start), len(numbers), *numbers]

    def _chords(self) -> Array:
        """Corners of a polygon that replaces the core; its chords stay near the arcs."""
        corners = []
        for start, base, low, turn, reach in zip(
            self._start, self._base, self._low, self._bent, self._reach, strict=True
        ):
            count = math.ceil(turn / CHORD)
            step = turn / max(count, 1)
            inner = low + step * np.arange(1, count)
            # Half of what a chord is off is outside the arc, half inside.
            corners += [[start], base + reach * (1.0 + step**2 / 16.0) * np.exp(1j * inner)]
        return np.concatenate(corners)

    def _nearest_face(self, points: Array) -> tuple[Array, Array, Array]:
        """Distances of points from the part, the nearest faces, and the places along these: lengths on lines, turns of
        the normal on arcs, beyond their ends where a corner is nearest.
        """
        if self.is_round:
            off = points - self._base[0]
            turn = np.mod(np.angle(off) - self._low[0], math.tau)
            return np.abs(off) - self._reach[0] - self.radius, np.zeros(points.shape, int), turn
        along, square, height = (np.empty((*points.shape, len(self._start))) for _ in range(3))
        line = self._is_line
        turned = (points[..., None] - self._start[line]) * np.conj(self._along[line])
        on = turned.real
        out = -turned.imag
        beyond = on - np.clip(on, 0.0, self._lengths[line])
        along[..., line], square[..., line], height[..., line] = on, beyond**2 + out**2, out
        if not line.all():
            off = points[..., None] - self._base[~line]
            span = self._bent[~line]
            turn = np.mod(np.angle(off) - self._low[~line], math.tau)
            turn = np.where(turn > 0.5 * (span + math.tau), turn - math.tau, turn)
            within = np.clip(turn, 0.0, span)
            normal = np.exp(1j * (self._low[~line] + within))
            foot = off - self._reach[~line] * normal
            along[..., ~line], square[..., ~line] = turn, np.abs(foot) ** 2
            height[..., ~line] = (foot * np.conj(normal)).real
        # A segment is two edges back to back: the side of the point decides.
        if len(self._start) == 2 and line.all():
            square = square + np.where(height < 0.0, _SLOT * self._extent**2, 0.0)
        face = np.argmin(square, axis=-1)
        walked = picked(along, face)
        core = np.sqrt(picked(square, face))
        if len(self._start) == 2 and line.all():
            over = walked - np.clip(walked, 0.0, self._lengths[face])
            return np.hypot(over, picked(height, face)) - self.radius, face, walked
        # Both faces of a corner together show the side of a point; at an acute corner, one is not enough.
        length = np.where(line, self._lengths, self._bent)[face]
        owner = np.where(walked < 0.0, (face - 1) % len(self._start), face)
        both = ((points - self._end[owner]) * np.conj(self._before[owner])).real
        side = np.where((walked < 0.0) | (walked > length), both, picked(height, face))
        return np.where(side < 0.0, -core, core) - self.radius, face, walked

    def extremes(self, direction: complex, flat: float) -> list[tuple[complex, float]]:
        if self.is_round:
            return [(complex(self._base[0]) + (self.radius + self._reach[0]) * direction, 0.0)]
        points = self._end
        heights = (points * np.conj(direction)).real
        turned = np.mod(np.angle(direction) - self._low, math.tau) < self._bent
        # An arc that faces there reaches farther than its ends.
        tops = self._base[turned] + self._reach[turned] * direction
        points = np.append(points, tops)
        heights = np.append(heights, (tops * np.conj(direction)).real)
        below = heights.max() - heights
        if below[len(self._end) :].min(initial=1.0) == 0.0:
            return [(complex(points[int(np.argmin(below))]) + self.radius * direction, 0.0)]
        level = np.flatnonzero(below <= flat)
        along = (points[level] * np.conj(1j * direction)).real
        ends = {int(level[along.argmin()]), int(level[along.argmax()])}
        extremes = [(complex(points[k]) + self.radius * direction, float(below[k])) for k in ends]
        return sorted(extremes, key=lambda end: end[1])
