"""Distances from lines and arcs, superquadrics and triangles for the verification of grasps; the optimizer has others.

Nothing here is shared with the surfaces of the search: winding numbers in place of heights over sampled boundaries,
Lagrange's equations in place of shape operators, trimesh's closest point in place of own triangles.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.scene import Face

_STEPS = 60
"""Newton steps toward the nearest point of a superquadric at most; from the nearest start 5 to 10 are enough."""
_STARTS = 81
"""Starts along an edge of each of the three faces of an octant."""
_ON_EDGE = 1e-9
"""Barycentric coordinate below which a place is on an edge of its triangle [1]: rounding."""
_LEAN = 0.05
"""Part of its distance by which a point may be farther from the place whose normal it has than from the nearest one."""
_GROWN = 1000.0
"""Size to which a mesh grows for trimesh, which takes places whose squared distances differ by 1e-8 for one."""


def loop_distance(points: Array, faces: Sequence[Face]) -> tuple[Array, Array]:
    """Signed distances (n,) of points (n, 2) from a closed boundary of lines and arcs, and their gradients (n, 2).

    Inside, the boundary turns once about a point.
    """
    z = points[:, 0] + 1j * points[:, 1]
    best = np.full(z.size, np.inf)
    turned = np.zeros(z.size)
    place = np.zeros(z.size, complex)
    outward = np.zeros(z.size, complex)
    for a, b, middle, center, radius, half in _pieces(faces):
        turned += np.angle((b - z) / np.where(a == z, 1e-300, a - z))
        if half == 0.0:
            share = np.clip(((z - a) / (b - a)).real, 0.0, 1.0)
            at = a + share * (b - a)
            normal = np.full(z.size, middle)
        else:
            spoke = radius * middle
            normal = middle * np.exp(1j * np.clip(np.angle((z - center) / spoke), -abs(half), abs(half)))
            at = center + radius * normal
            # Between chord and arc, the arc turns once more about a point than its chord, or once less.
            beyond = (np.abs(z - center) < abs(radius)) & (((z - a) / (b - a)).imag * half < 0.0)
            turned += np.where(beyond, math.copysign(2.0 * np.pi, half), 0.0)
        away = np.abs(z - at)
        closer = away < best
        best, place, outward = np.where(closer, [away, at, normal], [best, place, outward])
    best = best.real
    sign = np.where(np.abs(turned) > np.pi, -1.0, 1.0)
    gradient = np.where(best > 0.0, sign * (z - place) / np.maximum(best, 1e-300), outward)
    return sign * best, np.column_stack([gradient.real, gradient.imag])


def _pieces(faces: Sequence[Face]) -> list[tuple[complex, complex, complex, complex, float, float]]:
    """Ends, unit normal in the middle, center, radius and half the turn of lines, and of arcs cut to one radian."""
    pieces = []
    for face in faces:
        a = complex(*face.start)
        b = complex(*face.end)
        unit = complex(np.exp(1j * face.normal))
        if face.turn == 0.0 or face.radius == 0.0:
            pieces += [(a, b, unit, 0j, 0.0, 0.0)] if a != b else []
            continue
        center = a - face.radius * unit
        count = max(1, math.ceil(abs(face.turn)))
        marks = [unit * complex(np.exp(1j * face.turn * k / (2 * count))) for k in range(2 * count + 1)]
        ends = [center + face.radius * mark for mark in marks[::2]]
        half = 0.5 * face.turn / count
        pieces += [(ends[k], ends[k + 1], marks[2 * k + 1], center, face.radius, half) for k in range(count)]
    return pieces


def superquadric_distance(points: Array, half: Array, exponents: tuple[float, float]) -> tuple[Array, Array]:
    """Signed distances (n,) of points (n, 3) from a superquadric and outward normals (n, 3).

    By Newton's method on ``y + t grad f(y) = |p|, f(y) = 1`` in the octant where all coordinates are positive.
    """
    size = float(half.max())
    sign = np.copysign(1.0, points)
    half = half / size
    target = np.abs(points) / size
    side = np.linspace(0.0, 1.0, _STARTS)
    u, v = (part.ravel() for part in np.meshgrid(side, side))
    ones = np.ones(u.size)
    starts = np.concatenate([np.column_stack(order) for order in ((ones, u, v), (u, ones, v), (u, v, ones))]) * half
    # f is homogeneous of degree q.
    starts = starts / (_level(starts, half, exponents)[0] ** (1.0 / exponents[1]))[:, None]
    nearest = [int(((starts - one) ** 2).sum(axis=1).argmin()) for one in target]
    y = starts[nearest] if nearest else np.zeros((0, 3))
    slope = _level(y, half, exponents)[1]
    t = ((target - y) * slope).sum(axis=1) / (slope * slope).sum(axis=1)
    missing = _missing(y, t, target, half, exponents)
    for _ in range(_STEPS):
        _, slope, bent = _level(y, half, exponents)
        whole = np.zeros((len(y), 4, 4))
        whole[:, :3, :3] = np.eye(3) + t[:, None, None] * bent
        whole[:, :3, 3] = whole[:, 3, :3] = slope
        step = np.linalg.solve(whole, -missing[:, :, None])[:, :, 0]
        share = np.ones(len(y))
        for _ in range(8):  # halvings of a step that leaves more
            trial = np.maximum(y + share[:, None] * step[:, :3], 0.0), t + share * step[:, 3]
            left = _missing(*trial, target, half, exponents)
            worse = np.linalg.norm(left, axis=1) > np.linalg.norm(missing, axis=1)
            if not worse.any():
                break
            share = np.where(worse, 0.5 * share, share)
        y, t, missing = *trial, left
        if float(np.abs(step).max(initial=0.0)) < 1e-15:
            break
    normal = _level(y, half, exponents)[1]
    normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    return size * ((target - y) * normal).sum(axis=1), normal * sign


def _missing(y: Array, t: Array, target: Array, half: Array, exponents: tuple[float, float]) -> Array:
    """Residuals (n, 4) of Lagrange's equations."""
    value, slope, _ = _level(y, half, exponents)
    return np.column_stack([y + t[:, None] * slope - target, value - 1.0])


def _level(y: Array, half: Array, exponents: tuple[float, float]) -> tuple[Array, Array, Array]:
    """Level f = ((x/a)^p + (y/b)^p)^(q/p) + (z/c)^q at points (n, 3) in the octant, gradient and Hessian."""
    p, q = exponents
    u = y / half
    # 1e-200: on the z axis, where powers of it may be negative
    across = np.maximum((u[:, :2] ** p).sum(axis=1), 1e-200)
    power = q / p
    part = u[:, :2] ** (p - 1.0) / half[:2]
    gradient = q * np.column_stack([across[:, None] ** (power - 1.0) * part, u[:, 2] ** (q - 1.0) / half[2]])
    hessian = np.zeros((len(y), 3, 3))
    mixed = (power - 1.0) * p * across ** (power - 2.0)
    hessian[:, :2, :2] = q * mixed[:, None, None] * part[:, :, None] * part[:, None, :]
    for k in range(2):
        hessian[:, k, k] += q * (p - 1.0) * across ** (power - 1.0) * u[:, k] ** (p - 2.0) / half[k] ** 2
    hessian[:, 2, 2] = q * (q - 1.0) * u[:, 2] ** (q - 2.0) / half[2] ** 2
    return across**power + u[:, 2] ** q, gradient, hessian


class TriangleDistance:
    """Distances from a closed surface of triangles by trimesh, with normals that go smoothly over blunt edges.

    The scene has read normals A, B, C at the corners a, b, c of each triangle. Grown along them by t, its corners are
    a + t A, b + t B and c + t C; a point has the normal of the triangle that reaches it so. At an edge where normals
    of both sides differ, the normals between them reach the points; about a sharp corner, directions from it.
    """

    def __init__(self, surface: Any) -> None:
        import trimesh

        self._grown = _GROWN / surface.size
        self._mesh = trimesh.Trimesh(self._grown * surface.corners, surface.triangles, process=False)
        self._normals = surface.normals

    def distance(self, points: Array) -> Array:
        """Signed distances (n,) of points (n, 3)."""
        return np.asarray(self._nearest(points)[0] / self._grown)

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Signed distances (n,) of points (n, 3), and smooth outward normals (n, 3)."""
        distance, toward = self._nearest(points)
        normals = [self._smooth(*one) for one in zip(self._grown * points, distance, toward, strict=True)]
        return distance / self._grown, np.array(normals).reshape(-1, 3)

    def _nearest(self, points: Array) -> tuple[Array, Array]:
        """Signed distances of points from the grown mesh, and directions away from its nearest places."""
        import trimesh

        closest: Any = trimesh.proximity.closest_point
        shares: Any = trimesh.triangles.points_to_barycentric
        place, distance, triangle = closest(self._mesh, self._grown * points)
        share = np.clip(shares(self._mesh.triangles[triangle], place), 0.0, 1.0)
        away = self._grown * points - place
        side = (share[:, :, None] * self._mesh.vertex_normals[self._mesh.faces[triangle]]).sum(axis=1)
        # In the middle of a large triangle its own normal says where a point is.
        side = np.where((share > _ON_EDGE).all(axis=1)[:, None], self._mesh.face_normals[triangle], side)
        sign = np.where((away * side).sum(axis=1) < 0.0, -1.0, 1.0)
        toward = np.where(distance[:, None] > 0.0, (sign / np.maximum(distance, 1e-300))[:, None] * away, side)
        return sign * distance, toward

    def _smooth(self, point: Array, distance: float, toward: Array) -> Array:
        """Normal at a point: of the elements that reach it that which does so first."""
        import trimesh

        closest: Any = trimesh.triangles.closest_point
        reach = (1.0 + _LEAN) * abs(distance)
        normal = toward
        box = np.concatenate([point - reach, point + reach])
        around = np.array(list(self._mesh.triangles_tree.intersection(box)), dtype=int)
        places = closest(self._mesh.triangles[around], np.tile(point, (len(around), 1)))
        apart = np.linalg.norm(places - point, axis=1)
        for k in np.argsort(apart):
            if apart[k] > reach:  # nor do those that are farther reach it first
                break
            for size, other in self._reaching(point, distance, int(around[k])):
                if size < reach:
                    reach, normal = size, other
        return normal

    def _reaching(self, point: Array, distance: float, triangle: int) -> list[tuple[float, Array]]:
        """Distances at which normals of a triangle, and of creases at its edges, reach a point, and these normals."""
        corners = np.asarray(self._mesh.triangles[triangle])
        normals = self._normals[triangle]
        found = []
        for t in _roots(partial(_moved, corners - point, normals), abs(distance)):
            share = np.linalg.lstsq((corners + t * normals).T, point, rcond=None)[0]
            share = share / share.sum() if abs(share.sum()) > 0.5 else np.full(3, -1.0)
            if share.min() >= -_ON_EDGE and t * distance > 0.0:
                normal = share @ normals
                found.append((abs(t) * float(np.linalg.norm(normal)), normal))
        for k, other in self._creases(triangle):
            ends = [(k + 1) % 3, (k + 2) % 3]
            a, b, own = *corners[ends], normals[ends]
            beyond = self._normals[
                other, [self._mesh.faces[other].tolist().index(self._mesh.faces[triangle, j]) for j in ends]
            ]

            # Where both normals at a place of the edge span a plane with the direction to the point.
            first = np.array([own[0], beyond[0], point - a])
            rows = partial(_moved, first, np.array([own[1], beyond[1], point - b]) - first)
            for s in _roots(rows, 1.0):
                one, two, away = rows(s)
                parts = np.linalg.lstsq(np.column_stack([one, two]), away, rcond=None)[0] * np.sign(distance)
                if -_ON_EDGE <= s <= 1.0 + _ON_EDGE and parts.min() >= -_ON_EDGE:
                    found.append((float(np.linalg.norm(away)), np.sign(distance) * away))
        return [(size, normal / np.linalg.norm(normal)) for size, normal in found]

    def _creases(self, triangle: int) -> list[tuple[int, int]]:
        """Edges of a triangle, by the corner opposite, that are creases, and the triangles beyond."""
        faces = self._mesh.faces
        found = []
        for k in range(3):
            ends = [int(faces[triangle, j]) for j in ((k + 1) % 3, (k + 2) % 3)]
            around = (set(self._mesh.vertex_faces[end].tolist()) - {-1, triangle} for end in ends)
            for other in set.intersection(*around):
                there = [faces[other].tolist().index(end) for end in ends]
                off = self._normals[other, there] - self._normals[triangle, [(k + 1) % 3, (k + 2) % 3]]
                found += [(k, int(other))] if float(np.abs(off).max()) > _ON_EDGE else []
        return found


def _moved(first: Array, slope: Array, by: float) -> Array:
    return np.asarray(first + by * slope)


def _roots(rows: Callable[[float], Array], scale: float) -> list[float]:
    """Real zeros of the determinant of three rows that are linear in a number, of whose size this is a scale."""
    at = scale * np.array([-1.5, -0.5, 0.5, 1.5])
    cubic = np.polynomial.Polynomial.fit(at, [float(np.linalg.det(rows(x))) for x in at], 3)
    zeros = cubic.roots()
    return [float(zero.real) for zero in zeros if abs(zero.imag) <= 1e-6 * scale]
