"""Distance and outward normal from the surfaces of an object, by numpy alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.scene import Face, GraspObject, OffsetPolygon, Part, SuperellipsePart

SPREAD = np.linspace(0.0, 1.0, 33)
"""Places spread along a piece of a curve: along a panel that passes a corner closely, one of them is within 1/64 of the
panel from it; of the quarter of a circle, where the points of a superellipse that are tried first would be without its
elongation."""


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
    if isinstance(part, OffsetPolygon):
        if part.circle is not None:
            return _disc(np.asarray(part.circle[0]), part.circle[1], points)
        if part.bends:
            return _curved_polygon(part, points)
        return _rounded_polygon(np.asarray(part.vertices, dtype=float), part.radius, points)
    part = _superellipse_part(part)
    turn = _turn(part.angle)
    center = np.asarray(part.center)
    spot = _superellipse(part.semi_axes, part.exponent, (points - center) @ turn)
    return NearestPoints(spot.distance, spot.point @ turn.T + center, spot.normal @ turn.T, spot.radius)


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
                part = _superellipse_part(part)
                (a, b), turn = part.semi_axes, _turn(part.angle)
                quadrant = np.stack(_curve(a, b, part.exponent, _polar(a, b))[0], axis=1)
                spots = _superellipse(part.semi_axes, part.exponent, quadrant)
                bent = spots.point[spots.radius < radius]
                both = np.concatenate([bent * sign for sign in ((1, 1), (-1, 1), (1, -1), (-1, -1))])
                places.append(both @ turn.T + np.asarray(part.center))
                rounds.append(np.zeros(len(both)))
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


def _rounded_polygon(core: Array, radius: float, points: Array) -> NearestPoints:
    """Everything within ``radius`` of a core: two points (a slot), or a simple polygon."""
    count = np.arange(len(points))
    along, out, length = _edges(core)
    walked, height, beside = _seen(core, points)
    # A ray to the right crosses the outline of what it starts in an odd number of times.
    below = core[:, 1] <= points[:, 1:]
    passes = (below != np.roll(below, -1, axis=1)) & ((height < 0.0) == (along[:, 1] > 0.0))
    side = np.where(passes.sum(axis=1) % 2 == 1, -1.0, 1.0)
    edge = np.hypot(height, beside).argmin(axis=1)
    height = height[count, edge]
    beside = beside[count, edge]
    walked = walked[count, edge]
    away = np.hypot(height, beside)
    at_corner = beside != 0.0
    foot = core[edge] + np.clip(walked, 0.0, length[edge])[:, None] * along[edge]
    normal = height[:, None] * out[edge] + beside[:, None] * along[edge]
    normal = side[:, None] * normal / np.maximum(away, 1e-300)[:, None]
    # As near to a sharp corner as rounding the way to it means nothing.
    normal = np.where((away > ROUNDING * length.max())[:, None], normal, out[edge])
    return NearestPoints(side * away - radius, foot + radius * normal, normal, np.where(at_corner, radius, np.inf))


def _disc(center: Array, radius: float, points: Array) -> NearestPoints:
    off = points - center
    away = np.hypot(off[:, 0], off[:, 1])
    normal = np.where(away[:, None] > 0.0, off / np.maximum(away, 1e-300)[:, None], np.array([1.0, 0.0]))
    return NearestPoints(away - radius, center + radius * normal, normal, np.full(len(points), radius))


def _curved_polygon(part: OffsetPolygon, points: Array) -> NearestPoints:
    """Everything within a radius of a core of lines and arcs, by the nearest point of each of them."""
    core = np.asarray(part.vertices, dtype=float)
    rows = np.arange(len(points))
    feet, normals, radii = [], [], []
    for face in part.faces:
        start = np.asarray(face.start)
        end = np.asarray(face.end)
        if face.turn:
            center = start - face.radius * np.array([np.cos(face.normal), np.sin(face.normal)])
            off = points - center
            # From the middle of the arc, either way to its ends.
            middle = face.normal + 0.5 * face.turn
            turn = np.arctan2(off[:, 1], off[:, 0]) - middle
            turn = np.clip(turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi)), -0.5 * face.turn, 0.5 * face.turn)
            normal = np.stack([np.cos(middle + turn), np.sin(middle + turn)], axis=1)
            feet.append(center + face.radius * normal)
        else:
            span = end - start
            share = np.clip((points - start) @ span / (span @ span), 0.0, 1.0)
            normal = np.broadcast_to(np.array([span[1], -span[0]]) / np.hypot(*span), points.shape)
            feet.append(start + share[:, None] * span)
        normals.append(normal)
        radii.append(face.radius if face.turn else np.inf)
    off = points - np.stack(feet)
    away = np.hypot(off[..., 0], off[..., 1])
    nearest = away.argmin(axis=0)
    away = away[nearest, rows]
    off = off[nearest, rows]
    normal = np.stack(normals)[nearest, rows]
    foot = np.stack(feet)
    foot = foot[nearest, rows]
    height = (off * normal).sum(axis=1)
    extent = float(np.ptp(core, axis=0).max())
    # Along the normal there is no corner. At one, chords say on which side a point is: arcs beside it are no nearer.
    at_corner = np.abs(off[:, 0] * normal[:, 1] - off[:, 1] * normal[:, 0]) > ROUNDING * extent
    side = np.where(at_corner, np.where(_is_inside(core, points), -1.0, 1.0), np.where(height < 0.0, -1.0, 1.0))
    towards = side[:, None] * off / np.maximum(away, 1e-300)[:, None]
    normal = np.where(at_corner[:, None], towards, normal)
    bent = np.where(at_corner, 0.0, np.asarray(radii)[nearest]) + part.radius
    return NearestPoints(side * away - part.radius, foot + part.radius * normal, normal, bent)


def _is_inside(core: Array, points: Array) -> Array:
    """Whether points (n,) are inside a polygon: a ray to the right crosses the outline an odd number of times."""
    after = np.roll(core, -1, axis=0)
    passes = (core[:, 1] <= points[:, 1:]) != (after[:, 1] <= points[:, 1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        across = core[:, 0] + (points[:, 1:] - core[:, 1]) / (after[:, 1] - core[:, 1]) * (after[:, 0] - core[:, 0])
    return np.asarray((passes & (points[:, :1] < across)).sum(axis=1) % 2 == 1)


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


def _superellipse(axes: tuple[float, float], power: float, points: Array) -> NearestPoints:
    """In the superellipse's own frame; sought in the quadrant of each point, where its nearest point lies."""
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
    return NearestPoints(
        scale * distance, scale * sign * np.stack([px, py], axis=1), sign * np.stack([nx, ny], axis=1), scale * radius
    )


def _polar(a: float, b: float) -> Array:
    """Polar angles of a quadrant, denser where it is elongated."""
    turns = 0.5 * np.pi * SPREAD
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
