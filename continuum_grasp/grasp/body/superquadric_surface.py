"""Distance of points from superquadrics, by their gauge: the factor by which the body must grow to reach a point."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.body.surface import SolidSurface, of_grid

GRID = 21
"""Points along an edge of the three faces of a cube on which samples of an octant begin."""
STEPS = 60
"""Steps toward the nearest point at most; from the nearest sample, 4 to 8 are enough."""
LEAST = 0.2
"""Least factor 1 + d k between a curvature k of the surface and that at a distance d: deep inside, no surface is
nearest."""
CLOSE, NEARLY = 1e-14, 1e-8
"""Distances [1], per size, between a place and the normal line through the point at which the place counts as nearest:
rounding; and for distances alone, whose error is its square."""


class SuperquadricSurface(SolidSurface):
    """A superquadric along its axes; an ellipsoid if both exponents are 2. Its samples are in one octant."""

    def __init__(self, extents: Sequence[float], exponents: Sequence[float], size: float) -> None:
        self.half, (self.p, self.q) = 0.5 * np.array(extents), exponents
        self.size = size
        side = np.tan(np.linspace(0.0, 0.25, GRID) * np.pi)
        u, v = (part.ravel() for part in np.meshgrid(side, side))
        cube = [np.roll(np.column_stack([np.ones(u.size), u, v]), k, axis=1) for k in range(3)]
        # Beside points in even directions, some where the surface bends most: powers of 2 / p bring them there.
        even = np.concatenate(cube)
        round_ = (even / np.linalg.norm(even, axis=1)[:, None]) ** (2.0 / max(self.p, self.q))
        directions = np.concatenate([even, round_]) * self.half
        self.samples = directions / self.gauge(directions)[0][:, None]
        self.tree = cKDTree(self.samples)
        self.normals, shape = self._bending(self.samples)
        bends, axes = np.linalg.eigh(shape)
        # Of the three eigenvectors one is the normal, whose curvature is none.
        order = np.argsort(np.abs(np.einsum("nij,ni->nj", axes, self.normals)), axis=1)[:, :2]
        self.bends = np.take_along_axis(bends, order, axis=1)
        self.directions = np.take_along_axis(axes, order[:, None, :], axis=2)

    def value(self, points: Array) -> Array:
        """The gauge (N,) at points (N, 3)."""
        u = np.abs(points) / self.half
        across = (u[:, 0] ** self.p + u[:, 1] ** self.p) ** (self.q / self.p)
        return np.asarray((across + u[:, 2] ** self.q) ** (1.0 / self.q))

    def gauge(self, points: Array) -> tuple[Array, Array, Array]:
        """The gauge (N,), its gradient (N, 3) and Hessian (N, 3, 3) at points (N, 3)."""
        p, q = self.p, self.q
        u = np.abs(points) / self.half
        # On z = 0, too, the surface bends along z.
        sign = np.copysign(1.0, points) / self.half
        top = np.maximum(u[:, :2].max(axis=1), 1e-12)[:, None]
        # 1e-12: on the z axis, where its gradient is none
        across = np.maximum(top[:, 0] * ((u[:, :2] / top) ** p).sum(axis=1) ** (1.0 / p), 1e-12)
        ratio = u[:, :2] / across[:, None]
        of_across = ratio ** (p - 1.0) * sign[:, :2]
        bent = np.einsum("ni,ij->nij", ratio ** (p - 2.0) / self.half[:2] ** 2, np.eye(2))
        bent = (p - 1.0) * (bent - of_across[:, :, None] * of_across[:, None, :]) / across[:, None, None]
        pair = np.column_stack([across, u[:, 2]])
        top = pair.max(axis=1)[:, None]
        value = top[:, 0] * ((pair / top) ** q).sum(axis=1) ** (1.0 / q)
        ratio = pair / value[:, None]
        slope = ratio ** (q - 1.0)
        outer = np.einsum("ni,ij->nij", ratio ** (q - 2.0), np.eye(2)) - slope[:, :, None] * slope[:, None, :]
        outer = (q - 1.0) * outer / value[:, None, None]
        inner = np.zeros((len(points), 2, 3))
        inner[:, 0, :2], inner[:, 1, 2] = of_across, sign[:, 2]
        gradient = np.einsum("ni,nij->nj", slope, inner)
        hessian = np.einsum("nai,nab,nbj->nij", inner, outer, inner)
        hessian[:, :2, :2] += slope[:, 0, None, None] * bent
        return value, gradient, hessian

    def _bending(self, points: Array) -> tuple[Array, Array]:
        """Outward normals (N, 3) and shape operators (N, 3, 3) at points of the surface."""
        _, gradient, hessian = self.gauge(points)
        slope = np.linalg.norm(gradient, axis=1)
        normal = gradient / slope[:, None]
        flat = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        return normal, flat @ (hessian / slope[:, None, None]) @ flat

    def scan(self, points: Array) -> tuple[Array, Array]:
        """Distance (N,) of points (N, 3), and outward normals (N, 3), by the paraboloid at the nearest sample."""
        k = self.tree.query(np.abs(points))[1]
        away = np.abs(points) - self.samples[k]
        normal = self.normals[k]
        height = (away * normal).sum(axis=1)
        aside = np.einsum("nij,ni->nj", self.directions[k], away)
        moved = aside * self.bends[k] / np.maximum(1.0 + height[:, None] * self.bends[k], LEAST)
        distance = height + 0.5 * (aside * moved).sum(axis=1)
        normal = normal + np.einsum("nij,nj->ni", self.directions[k], moved)
        return distance, np.copysign(normal / np.linalg.norm(normal, axis=1)[:, None], points)

    def distance(self, points: Array) -> Array:
        points = np.abs(np.reshape(points, (-1, 3)))
        place = self._nearest(points, NEARLY)
        return np.asarray(((points - place) * self._bending(place)[0]).sum(axis=1))

    def on_grid(self, axes: tuple[Array, ...]) -> Array:
        # Mirror images of a place are as far: 1e-12 m tells places apart.
        halves, images = zip(
            *(np.unique(np.round(np.abs(axis), 12), return_inverse=True) for axis in axes), strict=True
        )
        return super().on_grid(halves)[np.ix_(*images)]

    def to_second_order(self, points: Array) -> tuple[Array, Array, Array]:
        sign = np.copysign(1.0, points)
        place = self._nearest(np.abs(points), CLOSE)
        normal, shape = self._bending(place)
        height = ((np.abs(points) - place) * normal).sum(axis=1)
        hessian = np.linalg.solve(_grown(shape, height), shape)
        hessian = 0.5 * (hessian + hessian.transpose(0, 2, 1))
        return height, sign * normal, sign[:, :, None] * hessian * sign[:, None, :]

    def _nearest(self, points: Array, close: float) -> Array:
        """Places of the surface nearest to points (N, 3) of the octant of the samples."""
        distance, normal = self.scan(points)
        place = np.abs(points - distance[:, None] * normal)
        place = place / self.value(place)[:, None]
        apart, k = self.tree.query(points)
        missed = np.linalg.norm(points - place, axis=1) > apart
        place[missed] = self.samples[k[missed]]
        apart = np.linalg.norm(points - place, axis=1)
        left = np.arange(len(points))
        for _ in range(STEPS):
            normal, shape = self._bending(place[left])
            away = points[left] - place[left]
            height = (away * normal).sum(axis=1)
            aside = away - height[:, None] * normal
            open_ = np.abs(aside).max(axis=1) > close * self.size
            left = left[open_]
            if not len(left):
                break
            step = np.linalg.solve(_grown(shape[open_], height[open_]), aside[open_, :, None])[:, :, 0]
            share = np.ones(len(left))
            done = np.zeros(len(left), dtype=bool)
            for _ in range(12):  # halvings of a step that leads farther away
                trial = np.abs(place[left] + share[:, None] * step)
                trial = trial / self.value(trial)[:, None]
                farther = np.linalg.norm(points[left] - trial, axis=1)
                # 1e-14: near the nearest point, rounding
                closer = ~done & (farther <= apart[left] * (1.0 + 1e-14))
                place[left[closer]] = trial[closer]
                apart[left[closer]] = farther[closer]
                done |= closer
                if done.all():
                    break
                share *= 0.5
            left = left[done]
        return np.asarray(place)

    def convex_parts(self) -> list[Array]:
        """Points (N, 3) of the convex surface [m]."""
        signs = np.array(list(product((1.0, -1.0), repeat=3)))
        return [(signs[:, None] * self.samples).reshape(-1, 3)]

    def triangles(self) -> tuple[Array, Array]:
        up = np.linspace(0.0, np.pi, 41)[:, None]
        around = np.linspace(0.0, 2.0 * np.pi, 81)
        ball = np.stack([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up) + 0.0 * around], axis=2)
        grid = np.sign(ball) * np.abs(ball) ** (2.0 / max(self.p, self.q)) * self.half
        scale = self.gauge(grid.reshape(-1, 3))[0].reshape(grid.shape[:2])
        return of_grid((grid / scale[..., None])[:, ::-1])


def _grown(shape: Array, height: Array) -> Array:
    """Matrices 1 + d S (N, 3, 3), none of whose eigenvalues is below the least factor."""
    if (height >= 0.0).all():
        return np.asarray(np.eye(3) + height[:, None, None] * shape)
    bends, axes = np.linalg.eigh(shape)
    return np.asarray(np.einsum("nij,nj,nkj->nik", axes, np.maximum(1.0 + height[:, None] * bends, LEAST), axes))
