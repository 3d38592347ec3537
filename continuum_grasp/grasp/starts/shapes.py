"""Convex parts of an object for the search: signed distances and walks along the outline, many points at once.

Planar vectors are complex numbers x + i y. A shape is a part grown by the fingers' half thickness; a walk along it
is a number w that runs once round in [0, period): along faces it counts metres, on corners it turns the normal while
the point stays (or runs along the rounding). So faces and corners are one smooth family of contacts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene.parts import Part

__all__ = ["Frame", "PolygonShape", "Shape", "SuperellipseShape", "Walk", "make_shape"]

Array = NDArray[Any]

_SETTLED = 1e-7
"""Change of the polar angle, whose square is left, up to which a nearest place counts as found."""


@dataclass(frozen=True)
class Frame:
    """A change of coordinates z -> turn * z + shift, or turn * conj(z) + shift where mirrored, times a scale.

    Attributes
    ----------
    turn : complex
        Of modulus one.
    shift : complex
        In the new coordinates.
    scale : float
        New lengths per old ones.
    mirrored : bool
    """

    turn: complex = 1.0 + 0.0j
    shift: complex = 0.0j
    scale: float = 1.0
    mirrored: bool = False

    def point(self, z: Array | complex) -> Any:
        """New coordinates of points."""
        return self.turn * self.scale * (np.conj(z) if self.mirrored else z) + self.shift

    def angle(self, angle: float | Array) -> Any:
        """New angle of directions [rad]."""
        return math.atan2(self.turn.imag, self.turn.real) + (-angle if self.mirrored else angle)

    def back(self, z: Array | complex) -> Any:
        """Old coordinates of points."""
        old = (z - self.shift) / (self.turn * self.scale)
        return np.conj(old) if self.mirrored else old

    def angle_back(self, angle: float | Array) -> Any:
        """Old angle of directions [rad]."""
        old = angle - math.atan2(self.turn.imag, self.turn.real)
        return -old if self.mirrored else old


@dataclass(frozen=True)
class Walk:
    """Places on the outline of a grown shape: all arrays of one shape.

    Attributes
    ----------
    point : ndarray of complex
        On the grown outline.
    angle : ndarray
        Of the outward normal [rad].
    dpoint, dangle : ndarray
        Derivatives with respect to w.
    """

    point: Array
    angle: Array
    dpoint: Array
    dangle: Array


class PolygonShape:
    """A rounded polygon (a disc: one vertex) grown by a distance."""

    def __init__(self, vertices: Array, radius: float, grown: float) -> None:
        self.vertices = vertices
        self.radius = radius
        self.grown = radius + grown
        size = len(vertices)
        extent = float(np.abs(vertices - vertices.mean()).max()) if size > 1 else 0.0
        self._per_angle = self.grown + 0.2 * extent
        self._edges = np.roll(vertices, -1) - vertices if size > 1 else np.zeros(1, complex)
        self._lengths = np.abs(self._edges)
        if size > 1:
            self._along = self._edges / self._lengths
            normals = np.angle(-1j * self._along)
            turns = np.mod(np.roll(normals, -1) - normals, math.tau)
        else:
            self._along, normals, turns = np.ones(1, complex), np.zeros(1), np.full(1, math.tau)
        self._normals, self._turns = normals, turns
        self.face_normals: tuple[float, ...] = tuple(normals.tolist()) if size > 1 else ()
        pieces = np.stack([self._lengths, turns * self._per_angle], axis=1).ravel()
        self._starts = np.concatenate([[0.0], np.cumsum(pieces)])
        self.period = float(self._starts[-1])
        self.centre = complex(vertices.mean())
        self.extent = extent + radius

    def walk(self, w: Array) -> Walk:
        """Places at walks ``w`` (any shape)."""
        w = np.mod(w, self.period)
        piece = np.clip(np.searchsorted(self._starts, w, side="right") - 1, 0, len(self._starts) - 2)
        local = w - self._starts[piece]
        edge, corner = piece // 2, piece % 2 == 1
        turn = np.where(corner, local / self._per_angle, 0.0)
        angle = self._normals[edge] + turn
        normal = np.exp(1j * angle)
        at = self.vertices[edge] + np.where(corner, self._edges[edge], local * self._along[edge])
        dpoint = np.where(corner, 1j * normal * (self.grown / self._per_angle), self._along[edge])
        return Walk(at + self.grown * normal, angle, dpoint, np.where(corner, 1.0 / self._per_angle, 0.0))

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Signed distances of points from the part itself (not grown), and the walks of the nearest places."""
        gap, edge, along = self._nearest_edge(points)
        length = self._lengths[edge]
        start = self._starts[2 * edge]
        before, after = along <= 0.0, along >= length
        vertex = np.where(before, edge, (edge + 1) % len(self.vertices))
        owner = np.where(before, (edge - 1) % len(self.vertices), edge)
        turn = np.mod(np.angle(points - self.vertices[vertex]) - self._normals[owner], math.tau)
        turn = np.where(turn > 0.5 * (self._turns[owner] + math.tau), 0.0, np.minimum(turn, self._turns[owner]))
        corner = self._starts[2 * owner + 1] + turn * self._per_angle
        return gap, np.where((before | after) & (gap > -self.radius), corner, start + np.clip(along, 0.0, length))

    def distance(self, points: Array) -> Array:
        """Signed distances of points from the part itself (not grown)."""
        if len(self.vertices) == 1:
            return np.asarray(np.abs(points - self.vertices[0]) - self.radius)
        return self._nearest_edge(points)[0]

    def _nearest_edge(self, points: Array) -> tuple[Array, Array, Array]:
        if len(self.vertices) == 1:
            zero = np.zeros(points.shape, int)
            return np.abs(points - self.vertices[0]) - self.radius, zero, np.zeros(points.shape)
        turned = (points[..., None] - self.vertices) * np.conj(self._along)
        along, out = turned.real, -turned.imag
        beyond = along - np.clip(along, 0.0, self._lengths)
        square = beyond**2 + out**2
        if len(self.vertices) == 2:
            square = square + np.where(out < 0.0, 1e-9 * self.extent**2, 0.0)
        outside = np.argmin(square, axis=-1)
        core = np.hypot(*(np.take_along_axis(part, outside[..., None], -1)[..., 0] for part in (beyond, out)))
        edge = outside
        if len(self.vertices) > 2:
            depth = np.argmax(out, axis=-1)
            deepest = np.take_along_axis(out, depth[..., None], -1)[..., 0]
            inside = deepest < 0.0
            edge = np.where(inside, depth, outside)
            core = np.where(inside, deepest, core)
        return core - self.radius, edge, np.take_along_axis(along, edge[..., None], -1)[..., 0]

    def extremes(self, direction: complex, flat: float) -> list[tuple[complex, float]]:
        """Outermost points of the part in a direction, and how much less far out they are: one, or the two ends of a
        face that is level to within ``flat``.
        """
        heights = (self.vertices * np.conj(direction)).real
        top = int(np.argmax(heights))
        found = [(complex(self.vertices[top]) + self.radius * direction, 0.0)]
        size = len(self.vertices)
        for other in {(top - 1) % size, (top + 1) % size} - {top}:
            below = float(heights[top] - heights[other])
            if below <= flat:
                found.append((complex(self.vertices[other]) + self.radius * direction, below))
        return found[:2]


class SuperellipseShape:
    """A superellipse grown by a distance; w is the polar angle of the scaled superellipse."""

    period = math.tau

    def __init__(self, center: complex, angle: float, semi_axes: tuple[float, float], exponent: float, grown: float):
        self.centre, self.angle, self.grown = center, angle, grown
        self.axes, self.exponent = semi_axes, exponent
        self.extent = math.hypot(*semi_axes)
        tilts = np.linspace(0.0, 0.5 * math.pi, 17)
        ratio = (semi_axes[1] / semi_axes[0]) * np.tan(tilts[1:-1])
        turns = np.arctan(ratio ** (1.0 / (exponent - 1.0)))
        self._table = np.unique(np.concatenate([np.linspace(0.0, 0.5 * math.pi, 13), turns]))
        point, normal, _, _ = self._quadrant(self._table)
        self._normal = normal
        self._reach = (point * np.conj(normal)).real

    def _quadrant(self, turn: Array) -> tuple[Array, Array, Array, Array]:
        """Point, normal, speed, and turning of the normal, at polar angles of the first quadrant."""
        (a, b), p = self.axes, self.exponent
        c, s = np.maximum(np.cos(turn), 0.0), np.sin(turn)
        cp, sp = c ** (p - 1.0), s ** (p - 1.0)
        norm = (cp * c + sp * s) ** (1.0 / p)
        along, across = b * cp, a * sp
        size = np.hypot(along, across)
        point = (a * c + 1j * b * s) / norm
        turning = a * b * (p - 1.0) * (c * s) ** (p - 2.0) / size**2
        return point, (along + 1j * across) / size, size / norm ** (p + 1.0), turning

    def walk(self, w: Array) -> Walk:
        """Places at walks ``w`` (any shape)."""
        w = np.mod(w, math.tau)
        left, low = (w > 0.5 * math.pi) & (w <= 1.5 * math.pi), w > math.pi
        turn = np.where(left, np.where(low, w - math.pi, math.pi - w), np.where(low, math.tau - w, w))
        point, normal, speed, turning = self._quadrant(turn)
        flip_x, flip_y = np.where(left, -1.0, 1.0), np.where(low, -1.0, 1.0)
        point = flip_x * point.real + 1j * flip_y * point.imag
        normal = flip_x * normal.real + 1j * flip_y * normal.imag
        axis = np.exp(1j * self.angle)
        return Walk(
            self.centre + axis * (point + self.grown * normal),
            np.angle(normal) + self.angle,
            1j * axis * normal * (speed + self.grown * turning),
            turning,
        )

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Signed distances of points from the superellipse itself (not grown), and the walks of the nearest places."""
        local = (points - self.centre) * np.exp(-1j * self.angle)
        corner = np.abs(local.real) + 1j * np.abs(local.imag)
        gap = (corner[..., None].real * self._normal.real + corner[..., None].imag * self._normal.imag) - self._reach
        best = np.argmax(gap, axis=-1)
        low = self._table[np.maximum(best - 1, 0)]
        high = self._table[np.minimum(best + 1, len(self._table) - 1)]
        turn = self._table[best]
        out: Array = np.zeros(points.shape)
        for _ in range(6):
            at, normal, speed, turning = self._quadrant(turn)
            off = (corner - at) * np.conj(normal)
            out, slide = off.real, off.imag
            low, high = np.where(slide > 0.0, turn, low), np.where(slide > 0.0, high, turn)
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

    def distance(self, points: Array) -> Array:
        """Signed distances of points from the superellipse itself (not grown)."""
        return self.nearest(points)[0]

    def extremes(self, direction: complex, flat: float) -> list[tuple[complex, float]]:
        """The outermost point of the superellipse in a direction."""
        local = direction * np.exp(-1j * self.angle)
        (a, b), dual = self.axes, self.exponent / (self.exponent - 1.0)
        u, v = a * abs(local.real), b * abs(local.imag)
        norm = (u**dual + v**dual) ** (1.0 / self.exponent)
        x = math.copysign(a * u ** (dual - 1.0) / norm, local.real)
        y = math.copysign(b * v ** (dual - 1.0) / norm, local.imag)
        return [(complex(self.centre + complex(x, y) * np.exp(1j * self.angle)), 0.0)]


Shape = PolygonShape | SuperellipseShape


def make_shape(part: Part, frame: Frame, grown: float) -> Shape:
    """A part in other coordinates, grown by a distance of these coordinates."""
    if part.is_superellipse:
        axes = (part.semi_axes[0] * frame.scale, part.semi_axes[1] * frame.scale)
        return SuperellipseShape(
            complex(frame.point(complex(*part.center))), frame.angle(part.angle), axes, part.exponent, grown
        )
    vertices = frame.point(np.array([complex(*v) for v in part.vertices]))
    return PolygonShape(vertices[::-1] if frame.mirrored else vertices, part.radius * frame.scale, grown)
