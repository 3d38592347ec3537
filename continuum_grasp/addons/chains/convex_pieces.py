"""Cut a triangulated solid into convex pieces, because MuJoCo collides a mesh as its convex hull.

Planes through concave edges cut the solid one after the other, until every piece lies within a tolerance of the solid.
Three planes through the deepest edge compete; the cut that leaves the least volume of convex hulls wins. The library
manifold3d cuts.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from continuum_grasp.base import Array, InputError

_PER_PIECE = 1e-3
"""Volume that a cut must save for each piece that it adds, per volume of the solid [1]. Of two cuts that save the same
volume, the search thus takes the one with fewer pieces."""
_FLAT = 1e-9
"""An edge is flat if a neighbor's corner is above a triangle by less than this per size of the solid [1]: rounding."""
_SLIVER = 1e-9
"""Share of the solid's volume below which a piece is rounding of a cut [1]."""
_MOST = 300
"""Greatest number of pieces: a blob of 20,000 triangles and 30 mm radius with twenty hollows is then within 0.07 mm."""
_SIMPLER = 0.25
"""Share of the tolerance by which the simplification of the mesh may move its triangles [1]."""


@dataclass(frozen=True)
class HollowEdges:
    """Concave edges of a closed surface of triangles."""

    ends: Array  # (E, 2) corners
    normals: Array  # (E, 2, 3) of the triangles on both sides
    depth: Array  # (E,) greatest depth of their ends and middles within the convex hull [m]

    @staticmethod
    def of(corners: Array, triangles: Array) -> HollowEdges:
        """Return the concave edges of a closed surface with corners (V, 3) and triangles (T, 3)."""
        places = corners[triangles]
        across = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
        doubled = np.linalg.norm(across, axis=1)
        size = float(np.ptp(corners, axis=0).max())
        normals = across / np.maximum(doubled, 1e-300)[:, None]
        ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        beyond = np.concatenate([triangles[:, 2], triangles[:, 0], triangles[:, 1]])
        owner = np.tile(np.arange(len(triangles)), 3)
        count = len(corners)
        keys = ends[:, 0] * count + ends[:, 1]
        order = np.argsort(keys)
        opposite = order[np.minimum(np.searchsorted(keys[order], ends[:, 1] * count + ends[:, 0]), len(order) - 1)]
        height = ((corners[beyond[opposite]] - corners[ends[:, 0]]) * normals[owner]).sum(axis=1)
        # A needle has no normal to rely on.
        sound = doubled > (_FLAT * size) ** 2
        hollow = (height > _FLAT * size) & (ends[:, 0] < ends[:, 1]) & sound[owner] & sound[owner[opposite]]
        ends = ends[hollow]
        sides = np.stack([normals[owner[hollow]], normals[owner[opposite[hollow]]]], axis=1)
        if not len(ends):
            return HollowEdges(ends, sides, np.zeros(0))
        first, last = corners[ends[:, 0]], corners[ends[:, 1]]
        planes = ConvexHull(corners).equations
        places = np.stack([first, 0.5 * (first + last), last])
        depth = np.zeros(len(ends))
        for rows in places:
            depth = np.maximum(depth, _depth(rows, planes))
        return HollowEdges(ends, sides, depth)

    @property
    def deepest(self) -> float:
        """Return the greatest depth of any edge within the convex hull [m]; zero for a convex solid."""
        return float(self.depth.max(initial=0.0))

    def planes(self, corners: Array) -> list[tuple[Array, float]]:
        """Unit normals and heights of planes through the deepest edge: halfway between its sides, and along them."""
        if not len(self.depth):
            return []
        k = int(self.depth.argmax())
        first, second = self.normals[k]
        normals = [normal / np.linalg.norm(normal) for normal in (first - second, first, second)]
        return [(normal, float(normal @ corners[self.ends[k, 0]])) for normal in normals]


def _depth(points: Array, planes: Array) -> Array:
    """Depths (N,) of points within planes (H, 4) of a convex hull."""
    # 1e7: products in memory at a time
    rows = max(1, int(1e7) // len(planes))
    parts = [points[k : k + rows] @ planes[:, :3].T + planes[:, 3] for k in range(0, len(points), rows)]
    return np.concatenate([-part.max(axis=1) for part in parts])


def convex_pieces(corners: Array, triangles: Array, tolerance: float) -> list[Array]:
    """Return the corners (N, 3) of convex bodies whose union is the solid within closed triangles (T, 3).

    If the solid is convex within the tolerance [m], the only body is its convex hull.

    Raises
    ------
    InputError
        If the solid is not convex, and manifold3d is not installed.
    """
    hull = ConvexHull(corners)
    volume = float(np.linalg.det(corners[triangles]).sum()) / 6.0
    if _overreach(HollowEdges.of(corners, triangles), hull.volume - volume, hull.area) <= tolerance:
        return [np.asarray(corners[hull.vertices])]
    try:
        from manifold3d import Manifold, Mesh64
    except ImportError:
        raise InputError(
            "it is not convex, and manifold3d, which cuts it into convex pieces for MuJoCo, is not installed: "
            "pip install 'continuum-grasp[mujoco]'",
            key="object",
        ) from None
    whole = Manifold(Mesh64(np.array(corners, dtype=float), np.array(triangles, dtype=np.uint64)))
    whole = whole.simplify(_SIMPLER * tolerance)
    done: list[Array] = []
    # Cut the worst piece first: at the greatest number of pieces none is then much worse than the others.
    waiting = [_Waiting(body) for body in whole.decompose()]
    while waiting:
        worst = heappop(waiting)
        fits = worst.overreach <= tolerance or len(done) + len(waiting) >= _MOST
        parts = [] if fits else _best_cut(worst.body, worst.planes, volume)
        if not parts:
            done.append(worst.corners)
        for part in parts:
            if part.volume() > _SLIVER * volume:
                heappush(waiting, _Waiting(part))
    return done


class _Waiting:
    """Body of manifold3d, and the distance by which its convex hull exceeds the body [m]."""

    def __init__(self, body: Any) -> None:
        mesh = body.to_mesh64()
        self.body = body
        self.corners = np.array(mesh.vert_properties)[:, :3]
        edges = HollowEdges.of(self.corners, np.array(mesh.tri_verts).astype(int))
        hull = body.hull()
        self.overreach = _overreach(edges, hull.volume() - body.volume(), hull.surface_area())
        self.planes = edges.planes(self.corners)

    def __lt__(self, other: _Waiting) -> bool:
        return self.overreach > other.overreach


def _overreach(edges: HollowEdges, hollow: float, area: float) -> float:
    """Estimate the distance by which a convex hull of an area [m2] exceeds its solid [m]; ``hollow`` is the extra
    volume [m3].

    Hollows between thin walls are deep, but their edges are near the hull: the volume shows them.
    """
    return max(edges.deepest, hollow / area)


def _best_cut(body: Any, planes: list[tuple[Array, float]], volume: float) -> list[Any]:
    """Cut a body by the plane that leaves the least volume of convex hulls; no parts if no plane cuts the body."""
    best, least = list[Any](), np.inf
    for normal, height in planes:
        parts = [part for half in body.split_by_plane(tuple(normal), height) for part in half.decompose()]
        if len(parts) < 2:
            continue
        cost = sum(part.hull().volume() for part in parts) + _PER_PIECE * volume * len(parts)
        if cost < least:
            best, least = parts, cost
    return best
