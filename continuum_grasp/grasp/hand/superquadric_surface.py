"""Distance of points from superquadrics, by their gauge: the factor by which the body must grow to reach a point."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.frames import of_grid

GRID = 40
"""Points along an edge of the cube on whose six faces samples of the surface begin."""
STEPS = 60
"""Steps toward the nearest point at most; from the nearest sample, 4 to 8 are enough."""
LEAST = 0.2
"""Least factor 1 + d k between a curvature k of the surface and that at a distance d: deep inside, no surface is
nearest."""


class SuperquadricSurface:
    """A superquadric along its axes."""

    def __init__(self, solid: Any) -> None:
        self.half, (self.p, self.q) = 0.5 * np.array(solid.extents), solid.exponents
        self.size = float(self.half.max())
        side = np.tan(np.linspace(-0.25, 0.25, GRID) * np.pi)
        u, v = (part.ravel() for part in np.meshgrid(side, side))
        ones = np.ones(u.size)
        cube = [np.roll(np.column_stack([sign * ones, u, v]), k, axis=1) for k in range(3) for sign in (-1.0, 1.0)]
        # Beside points in even directions, some where the surface bends most: powers of 2 / p bring them there.
        even = np.concatenate(cube)
        round_ = np.sign(even) * np.abs(even / np.linalg.norm(even, axis=1)[:, None]) ** (2.0 / max(self.p, self.q))
        directions = np.concatenate([even, round_]) * self.half
        self.samples = directions / self.gauge(directions)[0][:, None]
        self.tree = cKDTree(self.samples)
        self.normals, shape = self._bending(self.samples)
        bends, axes = np.linalg.eigh(shape)
        # Of the three eigenvectors one is the normal, whose curvature is none.
        order = np.argsort(np.abs(np.einsum("nij,ni->nj", axes, self.normals)), axis=1)[:, :2]
        self.bends = np.take_along_axis(bends, order, axis=1)
        self.directions = np.take_along_axis(axes, order[:, None, :], axis=2)

    def gauge(self, points: Array) -> tuple[Array, Array, Array]:
        """The gauge (N,), its gradient (N, 3) and Hessian (N, 3, 3) at points (N, 3)."""
        p, q = self.p, self.q
        u = np.abs(points) / self.half
        sign = np.sign(points) / self.half
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

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Distance (N,) of points (N, 3), and outward normals (N, 3), by the paraboloid at the nearest sample."""
        k = self.tree.query(points)[1]
        away = points - self.samples[k]
        normal = self.normals[k]
        height = (away * normal).sum(axis=1)
        aside = np.einsum("nij,ni->nj", self.directions[k], away)
        moved = aside * self.bends[k] / np.maximum(1.0 + height[:, None] * self.bends[k], LEAST)
        distance = height + 0.5 * (aside * moved).sum(axis=1)
        normal = normal + np.einsum("nij,nj->ni", self.directions[k], moved)
        return distance, normal / np.linalg.norm(normal, axis=1)[:, None]

    def near(self, points: Array) -> tuple[Array, Array, Array]:
        """Distance (K,), outward normals (K, 3) and Hessians of the distance (K, 3, 3)."""
        place = self.samples[self.tree.query(points)[1]]
        best = np.linalg.norm(points - place, axis=1)
        for _ in range(STEPS):
            normal, shape = self._bending(place)
            away = points - place
            height = (away * normal).sum(axis=1)
            aside = away - height[:, None] * normal
            if float(np.abs(aside).max()) <= 1e-15 * self.size:
                break
            step = np.linalg.solve(_grown(shape, height), aside[:, :, None])[:, :, 0]
            share = np.ones(len(points))
            done = np.zeros(len(points), dtype=bool)
            for _ in range(12):  # halvings of a step that leads farther away
                trial = place + share[:, None] * step
                trial = trial / self.gauge(trial)[0][:, None]
                apart = np.linalg.norm(points - trial, axis=1)
                # 1e-14: near the nearest point, rounding
                closer = ~done & ((apart <= best * (1.0 + 1e-14)) | (height < 0.0))
                place = np.where(closer[:, None], trial, place)
                best = np.where(closer, apart, best)
                done |= closer
                if done.all():
                    break
                share *= 0.5
        normal, shape = self._bending(place)
        height = ((points - place) * normal).sum(axis=1)
        hessian = np.linalg.solve(_grown(shape, height), shape)
        return height, normal, 0.5 * (hessian + hessian.transpose(0, 2, 1))

    def convex_parts(self) -> list[Array]:
        """Points (N, 3) of the convex surface, in its own frame [m]."""
        return [self.samples]

    def triangles(self) -> tuple[Array, Array]:
        """Corners (V, 3) and triangles (T, 3) of it, for pictures."""
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
