"""Distance of points from a closed surface of triangles, and its smooth normals.

Distances are those from the triangles. Normals go smoothly over blunt edges: those at the corners of triangles are what
the scene has read, N is linear in between, and the normal at a point p is N / |N| of the place q with p = q + t N
(D. Panozzo et al., "Weighted Averages on Surfaces", ACM Trans. Graph. 32, 2013: Phong projection). At creases, the
normals on both sides are mixed linearly; about a sharp corner the normal is the direction from it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.body.evened import evened
from continuum_grasp.grasp.body.surface import SolidSurface

SAMPLES = 40_000
"""Points on the surface, at least one of each triangle, among which a scan looks for the nearest ones."""
CHUNK = 2000
"""Points whose nearest triangles are sought together: 100 MB."""
TRIED = 4
"""Nearest samples whose triangles a scan measures."""
COARSE, BAND = 2000, 0.6
"""Number of samples, and share of the size beyond which a point takes the nearest sample for the surface."""
ON_EDGE = 1e-9
"""Barycentric coordinate below which a place is on an edge [1]: rounding."""
NEAR = 0.7
"""Part of the reach of a table within which its field follows smooth normals [1]; beyond, normals of triangles do."""
PER_FACET = 3.0
"""Steps of the finest grid per facet [1]: with 3.6 the curvature of a ball of 320 facets is off by 0.17, with 6 by
0.13, which takes 6 times as long."""
SLACK = 0.05
"""Part of the distance by which the place of a smooth normal may be farther than the nearest one: normals at corners
lean by 15 degrees at most."""
DRAWN, CELL = 20_000, 0.02
"""Triangles that pictures have at most, and size of the cells in which corners of more become one, per size."""
NEWTON = 6
"""Steps toward the place of a smooth normal, from the nearest place of a triangle; three bring it to rounding."""
INSIDE = 1e-9
"""By how much coordinates of such a place on a triangle may be negative [1]: rounding."""


class MeshSurface(SolidSurface):
    """Triangles of a closed surface."""

    def __init__(self, surface: Any) -> None:
        self.deviation = surface.deviation
        self.corners = surface.corners
        self.triangles_ = surface.triangles
        self.corner_normals = surface.normals
        self.size = surface.size
        count = len(self.triangles_)
        self.places = self.corners[self.triangles_]
        one = self.places[:, 1] - self.places[:, 0]
        two = self.places[:, 2] - self.places[:, 0]
        across = np.cross(one, two)
        doubled = np.linalg.norm(across, axis=1)
        # 1e-300: a needle without area has no normal, and is as near as its neighbors.
        self.flat = across / np.maximum(doubled, 1e-300)[:, None]
        self.area = 0.5 * doubled
        self.middle = self.places.mean(axis=1)
        self.reach = np.linalg.norm(self.places - self.middle[:, None], axis=2).max(axis=1)
        self.middles = cKDTree(self.middle)
        self.neighbor = self._neighbors()
        self.vertex_normals = self._vertex_normals()
        self.owner, samples = self._samples(count)
        self.tree = cKDTree(samples)
        chords, turns = (
            np.linalg.norm(np.roll(part, -1, axis=1) - part, axis=2) for part in (self.places, self.corner_normals)
        )
        # Mean length of the edges of facets that stand for a curve, by the turn of the normals along them.
        self.facet = float((chords * turns).sum() / turns.sum()) if turns.any() else 0.0
        self.least_step = self.facet / PER_FACET
        self.every = 1 + len(samples) // COARSE
        self.coarse = cKDTree(samples[:: self.every])
        self.beyond, self.creased = self._creases()

    # -- of the surface ------------------------------------------------------------------------------------------

    def _neighbors(self) -> Array:
        """Triangles (T, 3) on the other side of the edges opposite of corners 0, 1 and 2."""
        sides = np.stack([self.triangles_[:, [1, 2]], self.triangles_[:, [2, 0]], self.triangles_[:, [0, 1]]], axis=1)
        ends = np.sort(sides.reshape(-1, 2), axis=1)
        order = np.lexsort((ends[:, 1], ends[:, 0]))  # edges one after the other, each twice
        neighbor = np.empty(len(order), dtype=int)
        neighbor[order[0::2]], neighbor[order[1::2]] = order[1::2] // 3, order[0::2] // 3
        return neighbor.reshape(-1, 3)

    def _vertex_normals(self) -> Array:
        """Means of the normals around each corner (V, 3), weighted by angle: what lies outside is on their side (J. A.
        Baerentzen, H. Aanaes, "Signed distance computation using the angle weighted pseudonormal", 2005).
        """
        sums = np.zeros_like(self.corners)
        for k in range(3):
            a, b = (self.places[:, (k + j) % 3] - self.places[:, k] for j in (1, 2))
            angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
            np.add.at(sums, self.triangles_[:, k], angle[:, None] * self.flat)
        return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-300)[:, None])

    def _samples(self, count: int) -> tuple[Array, Array]:
        """Triangles (S,) and points on them (S, 3), spread evenly."""
        number = np.maximum(1, np.ceil(SAMPLES * self.area / self.area.sum())).astype(int) if count < SAMPLES else 1
        owner = np.repeat(np.arange(count), number)
        first = np.repeat(np.cumsum(number) - number, number) if count < SAMPLES else owner
        k = (np.arange(len(owner)) - first)[:, None]
        # The additive recurrence with the plastic number fills a square evenly; the half beyond its diagonal is folded.
        share = (0.5 + k * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0
        share = np.where(share.sum(axis=1, keepdims=True) > 1.0, 1.0 - share, share)
        if count >= SAMPLES:
            share = np.full((count, 2), 1.0 / 3.0)
        weights = np.column_stack([1.0 - share.sum(axis=1), share])
        return owner, (weights[:, :, None] * self.places[owner]).sum(axis=1)

    def _creases(self) -> tuple[Array, Array]:
        """Normals (T, 3, 2, 3) beyond each edge at both of its ends, and whether it is a crease (T, 3)."""
        beyond = np.empty((len(self.triangles_), 3, 2, 3))
        own = np.empty_like(beyond)
        for k in range(3):
            other = self.neighbor[:, k]
            for j in range(2):
                end = (k + 1 + j) % 3
                same = (self.triangles_[other] == self.triangles_[:, [end]]).argmax(axis=1)
                beyond[:, k, j], own[:, k, j] = self.corner_normals[other, same], self.corner_normals[:, end]
        return beyond, np.asarray((np.abs(beyond - own) > 1e-9).any(axis=(2, 3)))

    def edge_distance(self, points: Array) -> Array:
        """Distance (N,) of points (N, 3) from the nearest convex crease [m]; infinite without a crease."""
        triangle, k = np.nonzero(self.creased)
        other = self.neighbor[triangle, k]
        start, end = (self.places[triangle, (k + j) % 3] for j in (1, 2))
        convex = ((self.middle[other] - start) * self.flat[triangle]).sum(axis=1) < 0.0
        start, span = start[convex], (end - start)[convex]
        away = points[:, None] - start
        share = np.clip((away * span).sum(axis=2) / np.maximum((span**2).sum(axis=1), 1e-300), 0.0, 1.0)
        return np.asarray(np.linalg.norm(away - share[:, :, None] * span, axis=2).min(axis=1, initial=np.inf))

    # -- from points ---------------------------------------------------------------------------------------------

    def scan(self, points: Array) -> tuple[Array, Array]:
        """Distance (N,) of points (N, 3), and outward normals (N, 3), of the triangles of the nearest samples."""
        apart, few = self.coarse.query(points)
        near = np.repeat(self.owner[few * self.every][:, None], TRIED, axis=1)
        # Deep inside, thousands are nearly as near: there one of a few samples will do.
        close = apart < BAND * self.size
        near[close] = self.owner[self.tree.query(points[close], k=TRIED)[1]]
        owner = np.repeat(np.arange(len(points)), TRIED)
        return self._signed(points, *self._least(points, owner, near.ravel()))

    def on_grid(self, axes: tuple[Array, ...]) -> Array:
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        points = grid.reshape(-1, 3)
        distance, normal = self.scan(points)
        low, high = self.box
        reach = min(float(min(a - axis[0], axis[-1] - b)) for axis, a, b in zip(axes, low, high, strict=True))
        close = (distance > -self.facet) & (distance < max(NEAR * reach, self.facet))
        distance[close], normal[close], _ = self.to_second_order(points[close])
        step = float(axes[0][1] - axes[0][0])
        return evened(distance.reshape(grid.shape[:-1]), normal.reshape(grid.shape), step, self.facet)

    def distance(self, points: Array) -> Array:
        return self.from_triangles(np.reshape(points, (-1, 3)))[0]

    def from_triangles(self, points: Array) -> tuple[Array, Array]:
        """Distance (K,) of points (K, 3) from the nearest triangle of all, and its gradient (K, 3)."""
        parts = []
        for k in range(0, max(len(points), 1), CHUNK):
            some = points[k : k + CHUNK]
            owner, candidates = self._within(some, np.abs(self.scan(some)[0]))
            parts.append(self._signed(some, *self._least(some, owner, candidates)))
        distance, gradient = zip(*parts, strict=True)
        return np.concatenate(distance), np.concatenate(gradient)

    def to_second_order(self, points: Array) -> tuple[Array, Array, Array]:
        return self.with_slopes(points)[:3]

    def with_slopes(self, points: Array) -> tuple[Array, Array, Array, Array]:
        """Distance (K,), smooth outward normals (K, 3), derivatives (K, 3, 3) of these, gradients of the distance."""
        distance, outward = self.from_triangles(points)
        farthest = (1.0 + SLACK) * np.abs(distance) + 1e-12 * self.size
        owner, candidates = self._within(points, farthest)
        place, share = self._on_triangles(points[owner], candidates)
        as_near = np.linalg.norm(points[owner] - place, axis=1) <= farthest[owner]
        owner, candidates, share = owner[as_near], candidates[as_near], share[as_near]
        normal = outward.copy()
        turning = np.eye(3) - outward[:, :, None] * outward[:, None, :]
        turning = turning / np.maximum(np.abs(distance), 1e-3 * self.size)[:, None, None]
        best = np.full(len(points), np.inf)
        # Triangles: q = a + u (b - a) + v (c - a), and N alike.
        places, normals = self.places[candidates], self.corner_normals[candidates]
        legs = [
            np.stack([part[:, 0], part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]], axis=1)
            for part in (places, normals)
        ]
        zero = np.zeros((len(owner), 3))
        forms = np.stack([*(leg[:, k] for leg in legs for k in range(3)), zero], axis=1)
        self._project(points, distance, owner, forms, share[:, 1:], (best, normal, turning), triangle=True)
        # Creases: q = a + u (b - a), N = (1 - v) (A + u (B - A)) + v (C + u (D - C)).
        pair, k = np.nonzero(self.creased[candidates])
        owner, candidates = owner[pair], candidates[pair]
        ends = np.stack([(k + 1) % 3, (k + 2) % 3], axis=1)
        a, b = (self.places[candidates, ends[:, j]] for j in range(2))
        one, two = (self.corner_normals[candidates, ends[:, j]] for j in range(2))
        three, four = (self.beyond[candidates, k, j] for j in range(2))
        forms = np.stack([a, b - a, np.zeros_like(a), one, two - one, three - one, four - three - two + one], axis=1)
        middle = np.full((len(owner), 2), 0.5)
        self._project(points, distance, owner, forms, middle, (best, normal, turning), triangle=False)
        return distance, normal, turning, outward

    def _project(
        self,
        points: Array,
        distance: Array,
        owner: Array,
        forms: Array,
        start: Array,
        found: tuple[Array, Array, Array],
        *,
        triangle: bool,
    ) -> None:
        """Put in place the smooth normals of points, and the turning of these, where an element has their place.

        An element has q = f0 + f1 u + f2 v and N = f3 + f4 u + f5 v + f6 u v; ``found`` are the least distance of a
        place so far, normals and their derivatives.
        """
        if not len(owner):
            return
        f = np.moveaxis(forms, 1, 0)
        target = points[owner]
        unknown = np.column_stack([start, np.zeros(len(start))])
        unknown[:, 2] = distance[owner]
        for _ in range(NEWTON):
            u, v, t = (unknown[:, [k]] for k in range(3))
            n_u = f[4] + f[6] * v
            n_v = f[5] + f[6] * u
            n = f[3] + f[4] * u + f[5] * v + f[6] * u * v
            missing = f[0] + f[1] * u + f[2] * v + t * n - target
            matrix = np.stack([f[1] + t * n_u, f[2] + t * n_v, n], axis=2)
            # Of elements without extent the determinant vanishes: 1e-30 m3 lets them go far away.
            singular = np.abs(np.linalg.det(matrix)) < 1e-30
            matrix[singular] = np.eye(3)
            inverse = np.linalg.inv(matrix)
            unknown = unknown - np.clip(np.einsum("nij,nj->ni", inverse, missing), -10.0, 10.0)
        u, v, t = unknown.T
        rest = 1.0 - u - v if triangle else np.minimum(1.0 - u, 1.0 - v)
        size = np.linalg.norm(n, axis=1)
        fits = (np.min([u, v, rest], axis=0) >= -INSIDE) & (np.linalg.norm(missing, axis=1) <= 1e-9 * self.size)
        fits &= ~singular & (np.sign(t) == np.sign(distance[owner]))
        away = np.where(fits, np.abs(t) * size, np.inf)
        order = np.lexsort((away, owner))
        _, index = np.unique(owner[order], return_index=True)
        chosen = order[index]
        best, normal, turning = found
        chosen = chosen[away[chosen] < best[owner[chosen]]]
        if not len(chosen):
            return
        who = owner[chosen]
        unit = (n / size[:, None])[chosen]
        slopes = np.stack([n_u, n_v, np.zeros_like(n)], axis=2)[chosen] @ inverse[chosen] / size[chosen, None, None]
        across = np.eye(3) - unit[:, :, None] * unit[:, None, :]
        bent = across @ slopes @ across
        best[who], normal[who], turning[who] = away[chosen], unit, 0.5 * (bent + bent.transpose(0, 2, 1))

    def _within(self, points: Array, distances: Array) -> tuple[Array, Array]:
        """Numbers of points and triangles that may be as near to them as distances (K,), in the order of the points."""
        within = self.middles.query_ball_point(points, distances * (1.0 + 1e-12) + float(self.reach.max()))
        owner = np.repeat(np.arange(len(points)), [len(some) for some in within])
        candidates = np.concatenate([np.array(some, dtype=int) for some in within])
        apart = np.linalg.norm(points[owner] - self.middle[candidates], axis=1) - self.reach[candidates]
        as_near = apart <= distances[owner] * (1.0 + 1e-12) + 1e-15
        return owner[as_near], candidates[as_near]

    def _least(self, points: Array, owner: Array, triangle: Array) -> tuple[Array, Array, Array]:
        """Nearest triangle, place and barycentric coordinates of each point, of pairs of its number and a triangle."""
        place, share = self._on_triangles(points[owner], triangle)
        apart = np.linalg.norm(points[owner] - place, axis=1)
        order = np.lexsort((apart, owner))
        best = order[np.searchsorted(owner[order], np.arange(len(points)))]
        return triangle[best], place[best], share[best]

    def _on_triangles(self, points: Array, triangle: Array) -> tuple[Array, Array]:
        """Places of triangles (N,) nearest to points (N, 3), and their barycentric coordinates (N, 3) (C. Ericson,
        "Real-Time Collision Detection", 2005, section 5.1.5).
        """
        a, b, c = (self.places[triangle, k] for k in range(3))
        ab, ac = b - a, c - a

        def dot(v: Array, w: Array) -> Array:
            return np.asarray((v * w).sum(axis=1))

        d1 = dot(ab, points - a)
        d2 = dot(ac, points - a)
        d3 = dot(ab, points - b)
        d4 = dot(ac, points - b)
        d5 = dot(ab, points - c)
        d6 = dot(ac, points - c)
        va = d3 * d6 - d5 * d4
        vb = d5 * d2 - d1 * d6
        vc = d1 * d4 - d3 * d2
        whole = np.maximum(va + vb + vc, 1e-300)
        v, w = vb / whole, vc / whole

        def ratio(part: Array, rest: Array) -> Array:
            return np.asarray(part / np.where(part + rest == 0.0, 1.0, part + rest))

        on_ab = ratio(d1, -d3)
        on_ac = ratio(d2, -d6)
        on_bc = ratio(d4 - d3, d5 - d6)
        cases = [
            (d1 <= 0.0) & (d2 <= 0.0),
            (d3 >= 0.0) & (d4 <= d3),
            (d6 >= 0.0) & (d5 <= d6),
            (vc <= 0.0) & (d1 >= 0.0) & (d3 <= 0.0),
            (vb <= 0.0) & (d2 >= 0.0) & (d6 <= 0.0),
            (va <= 0.0) & (d4 - d3 >= 0.0) & (d5 - d6 >= 0.0),
        ]
        zero, one = np.zeros_like(v), np.ones_like(v)
        v = np.select(cases, [zero, one, zero, on_ab, zero, 1.0 - on_bc], v)
        w = np.select(cases, [zero, zero, one, zero, on_ac, on_bc], w)
        return a + v[:, None] * ab + w[:, None] * ac, np.column_stack([1.0 - v - w, v, w])

    def _signed(self, points: Array, triangle: Array, place: Array, share: Array) -> tuple[Array, Array]:
        """Signed distances (N,) and their gradients (N, 3)."""
        side = self.flat[triangle]
        on_edge = share <= ON_EDGE
        for k in range(3):  # a place on an edge, of its side and the other, and one at a corner, of all around
            side = side + np.where(on_edge[:, [k]], self.flat[self.neighbor[triangle, k]], 0.0)
        at_corner = on_edge.sum(axis=1) == 2
        side = np.where(at_corner[:, None], self.vertex_normals[self.triangles_[triangle, share.argmax(axis=1)]], side)
        away = points - place
        apart = np.linalg.norm(away, axis=1)
        sign = np.where((away * side).sum(axis=1) < 0.0, -1.0, 1.0)
        on = apart <= 1e-12 * self.size
        side = side / np.maximum(np.linalg.norm(side, axis=1), 1e-300)[:, None]
        return sign * apart, np.where(on[:, None], side, (sign / np.maximum(apart, 1e-300))[:, None] * away)

    def triangles(self) -> tuple[Array, Array]:
        if len(self.triangles_) <= DRAWN:
            return self.corners, self.triangles_
        # Corners in one cell of a grid become one.
        cells = np.round(self.corners / (CELL * self.size)).astype(int)
        _, first, number = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        triangles = number.reshape(-1)[self.triangles_]
        a, b, c = triangles.T
        return self.corners[first], triangles[(a != b) & (b != c) & (c != a)]
