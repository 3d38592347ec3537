"""Nearest points of an object at a pose, and features of its surface, by numpy alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.outline_body import near_part
from continuum_grasp.scene import Face, GraspObject, OffsetPolygon, Part, SuperellipsePart

SPREAD = np.linspace(0.0, 1.0, 33)
"""Places spread along a piece of a curve: along a panel that passes a corner closely, one of them is within 1/64 of the
panel from it; so many points of a quarter of a superellipse, too."""


@dataclass(frozen=True)
class NearestPoints:
    """Points of a surface nearest to n points."""

    distance: Array  # (n,) from the surface [m], negative inside
    point: Array  # (n, 2) of the surface [m]
    normal: Array  # (n, 2) outward unit normal there
    radius: Array  # (n,) of curvature of the surface there [m]: infinite on a flat face, zero at a sharp corner


def nearest(part: Part, points: Array) -> NearestPoints:
    """Points of a part's surface nearest to points (n, 2) [m], both in the object's frame."""
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    distance, normal, radius = near_part(part, points)
    return NearestPoints(distance, points - distance[:, None] * normal, normal, radius)


def support_point(part: Part, direction: Array) -> Array:
    """The point of a part that lies farthest in a direction (unit vector), both in the object's frame [m]."""
    direction = np.asarray(direction, dtype=float)
    if isinstance(part, OffsetPolygon):
        core = np.asarray(part.vertices, dtype=float)
        if part.bends:
            # Of an arc that faces there, the top; its ends are among the corners.
            facing = np.arctan2(direction[1], direction[0])
            arcs = [arc for arc in part.faces if np.mod(facing - arc.normal, 2.0 * np.pi) < arc.turn]
            core = np.vstack([core, *(np.asarray(arc.center) + arc.radius * direction for arc in arcs)])
        return np.asarray(core[np.argmax(core @ direction)] + part.radius * direction)
    part = _superellipse_part(part)
    turn = _turn(part.angle)
    axes = np.asarray(part.semi_axes)
    # Where the gradient of |x/a|^p + |y/b|^p is along the direction, by the dual norm with exponent p / (p - 1).
    share = np.abs(axes * (direction @ turn))
    share = share / share.max()
    dual = part.exponent / (part.exponent - 1.0)
    along = (share / (share**dual).sum() ** (1.0 / dual)) ** (dual - 1.0)
    return np.asarray(part.center + turn @ (np.sign(direction @ turn) * axes * along))


class PlacedObject:
    """The parts of an object at a pose (3,) in the world: x, y [m] and angle [rad]."""

    def __init__(self, body: GraspObject, pose: Array) -> None:
        self.parts = body.parts
        self.position = np.asarray(pose[:2], dtype=float)
        self._turn = _turn(float(pose[2]))
        self.com = self.position + self._turn @ np.asarray(body.com)  # center of mass in the world [m]

    def world(self, points: Array) -> Array:
        """World positions of points of the object's frame [m]."""
        return np.asarray(points @ self._turn.T + self.position)

    def nearest(self, points: Array, part: Part) -> NearestPoints:
        """Points of one part's surface nearest to world points (n, 2)."""
        spot = nearest(part, (points - self.position) @ self._turn)
        return NearestPoints(spot.distance, self.world(spot.point), spot.normal @ self._turn.T, spot.radius)

    def nearest_of(self, points: Array, parts: Sequence[Part]) -> NearestPoints:
        """Nearest points where each point (n, 2) has a part of its own."""
        spots = [self.nearest(point[None], part) for point, part in zip(points, parts, strict=True)]
        return NearestPoints(
            *(np.concatenate([getattr(spot, key.name) for spot in spots]) for key in fields(NearestPoints))
        )

    def touched(self, part: int, point: Array, normal: Array, depth: float) -> Part:
        """Feature of a part that a contact is on, whose center and normal (2,) are given in the world; see
        `touched`.
        """
        return touched(self.parts[part], (point - self.position) @ self._turn, normal @ self._turn, depth)

    def distances(self, points: Array) -> Array:
        """Distance of world points from each part (parts, n) [m], negative inside."""
        return np.stack([self.nearest(points, part).distance for part in self.parts])

    def distance(self, points: Array) -> Array:
        """Distance of world points (n, 2) from the object (n,) [m], negative inside."""
        return np.asarray(self.distances(points).min(axis=0))

    def farthest(self, direction: Array) -> Array:
        """World point of each part that lies farthest in a world direction (parts, 2) [m]."""
        local = np.asarray(np.asarray(direction) @ self._turn)
        return self.world(np.stack([support_point(part, local) for part in self.parts]))

    def corners(self, part: int) -> Array:
        """World positions (m, 2) of the corners of a polygon; none of other parts."""
        shape = self.parts[part]
        return self.world(np.reshape(shape.vertices if isinstance(shape, OffsetPolygon) else (), (-1, 2)))

    def sharp_places(self, radius: float) -> tuple[Array, Array]:
        """World positions (m, 2) where the surface bends sharper than a radius, and how round it is there (m,) [m]."""
        places = [np.zeros((0, 2))]
        rounds = [np.zeros(0)]
        for part in self.parts:
            if isinstance(part, OffsetPolygon):
                sharp = [face for face in part.faces if part.bends and part.circle is None and face.radius < radius]
                if part.bends:
                    # Along an arc that is sharp, and where faces end.
                    ends = np.concatenate([np.zeros((0, 2)), *(_along_face(face) for face in sharp)])
                else:
                    ends = np.asarray(part.vertices, dtype=float)
                if part.radius < radius:
                    places.append(ends)
                    rounds.append(np.full(len(ends), part.radius))
            else:
                spots = nearest(part, np.array(part.outline(4 * SPREAD.size)))
                places.append(spots.point[spots.radius < radius])
                rounds.append(np.zeros(len(places[-1])))
        return self.world(np.concatenate(places)), np.concatenate(rounds)


def segment_distance(points: Array, start: Array, end: Array) -> Array:
    """Distances of points (..., 2) from segments between points that broadcast with them (...) [m]."""
    span, off = end - start, points - start
    share = (off * span).sum(axis=-1) / np.maximum((span * span).sum(axis=-1), 1e-300)
    rest = off - np.clip(share, 0.0, 1.0)[..., None] * span
    return np.asarray(np.hypot(rest[..., 0], rest[..., 1]))


def _superellipse_part(part: Part) -> SuperellipsePart:
    if not isinstance(part, SuperellipsePart):
        raise TypeError(f"the certificate has no surface of {type(part).__name__}: add one here, on its own")
    return part


def _turn(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _along_face(face: Face) -> Array:
    """Points (m, 2) along a face of a core, a tenth of a radian apart on an arc, with both ends [m]."""
    turns = face.normal + np.linspace(0.0, face.turn, 2 + int(10.0 * face.turn))
    arc = np.asarray(face.center) + face.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return np.vstack([arc if face.turn else np.asarray(face.start)[None], np.asarray(face.end)[None]])


def _edges(core: Array) -> tuple[Array, Array, Array]:
    """Directions, outward normals (m, 2) and lengths (m,) of the edges of a core."""
    span = np.roll(core, -1, axis=0) - core
    length = np.hypot(span[:, 0], span[:, 1])
    along = span / length[:, None]
    return along, np.stack([along[:, 1], -along[:, 0]], axis=1), length


def _seen(core: Array, points: Array) -> tuple[Array, Array, Array]:
    """Distance of each point (rows) along each edge (columns), above it, and beside its ends."""
    along, out, length = _edges(core)
    walked = points @ along.T - (core * along).sum(axis=1)
    return walked, points @ out.T - (core * out).sum(axis=1), walked - np.clip(walked, 0.0, length)


def touched(part: Part, point: Array, normal: Array, depth: float) -> Part:
    """Piece of a part that a contact at a point (2,) with a normal (2,) may roll or slide on: a convex piece of its
    outline.

    What does not lie behind it is left to the checks of clearance. Of edges that are as near but for a ``depth`` that a
    finger may have [m], as where a tip lies in a notch, it is that with this normal.
    """
    if not isinstance(part, OffsetPolygon) or len(part.vertices) < 3:
        return part
    core = np.asarray(part.vertices, dtype=float)
    along, out, _ = _edges(core)
    convex = (np.roll(along, 1, axis=0) * out).sum(axis=1) > 0.0  # at the corner where each edge starts
    if convex.all():
        return part
    _, height, beside = (row[0] for row in _seen(core, point[None]))
    away = np.hypot(height, beside)
    agrees = (height * (out @ normal) + beside * (along @ normal)) / np.maximum(away, 1e-300)
    edge = int(np.where(away <= away.min() + depth, agrees, -np.inf).argmax())
    count = len(core)
    first = last = edge
    while convex[first % count] and (first == edge or out[first % count] @ normal > 0.0):
        first -= 1
    while convex[(last + 1) % count] and (last == edge or out[last % count] @ normal > 0.0):
        last += 1
    corners = np.arange(first, last + 2) % count
    bends = (*(part.bends[k] for k in corners[:-1]), (0.0, 0.0)) if part.bends else ()
    return OffsetPolygon(tuple(map(tuple, core[corners].tolist())), part.radius, bends)
