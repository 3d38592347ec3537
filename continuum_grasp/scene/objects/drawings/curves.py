"""Curves of a drawing, and loops of curves that meet."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from continuum_grasp.base import Array
from continuum_grasp.scene.polygons import PlanePoint
from continuum_grasp.scene.value import WRITTEN

_GAP = 1e-4
"""Gap between ends that meet, as a part of what all open curves measure: files round to 0.01 px or 1e-4 inch, which is
5e-5 of an object that is 200 px or 2 inches large."""


@dataclass(frozen=True)
class DrawnCurve:
    """A curve of a drawing, as a chain of chords.

    Attributes
    ----------
    label : str
        Name in messages: kind, name, layer.
    names : tuple of str
        Names for the key ``path``, which chooses the curve; the most specific comes first.
    points : tuple of (float, float)
        Corners (n, 2), y up, each once [unit of the file].
    closed : bool
        Whether the last point is joined to the first.
    group : Hashable
        Layer, block or group of the curve: curves inside one in the same group are holes.
    source : Hashable
        Path that the curve belongs to; parts of one path inside each other are holes.
    filled : bool
        Whether the area inside belongs to the object, whatever other paths draw there.
    aside : str
        Reason why the curve is the object only if ``path`` names it: ``white`` like the paper, ``dashed``; empty if it
        may be the object.
    width : float
        Width of the drawn line [unit of the file]; 0 for the thinnest.
    flaw : str
        Reason why the curve cannot be an outline; empty if it can.
    """

    label: str
    names: tuple[str, ...]
    points: tuple[PlanePoint, ...]
    closed: bool = True
    group: Hashable = None
    source: Hashable = None
    filled: bool = False
    aside: str = ""
    width: float = 0.0
    flaw: str = ""

    @cached_property
    def size(self) -> PlanePoint:
        """Width and height [unit of the points]."""
        x, y = zip(*self.points, strict=True)
        return max(x) - min(x), max(y) - min(y)

    @cached_property
    def solid(self) -> Any:
        """The area inside, valid also where the curve crosses itself; shapely's."""
        import shapely

        return shapely.make_valid(shapely.Polygon(self.points)) if len(self.points) > 2 else shapely.Polygon()

    @cached_property
    def drawn(self) -> Any:
        """Visible shape: the area inside, or the line; a shapely geometry."""
        import shapely

        return self.solid if self.closed else shapely.LineString(self.points)

    @property
    def text(self) -> str:
        """Label and size of the curve, where its points are in m."""
        return f"{self.label} ({sizes(self.size)})"

    def scaled(self, factor: float) -> DrawnCurve:
        """The curve with a unit of another length."""
        points = tuple((factor * x, factor * y) for x, y in self.points)
        return replace(self, points=points, width=factor * self.width)


def sizes(size: PlanePoint) -> str:
    """Width and height [m] in words."""
    return f"{1e3 * size[0]:.4g} x {1e3 * size[1]:.4g} mm"


def distinct(points: Iterable[PlanePoint]) -> tuple[PlanePoint, ...]:
    """Remove points that repeat the previous one, and the last point if it repeats the first."""
    chain = list(points)
    least = WRITTEN * max((math.dist(chain[0], point) for point in chain), default=0.0)
    once: list[PlanePoint] = []
    for point in chain:
        if not once or math.dist(point, once[-1]) > least:
            once.append(point)
    closed = len(once) > 1 and math.dist(once[0], once[-1]) <= least
    return tuple(once[:-1]) if closed else tuple(once)


def joined(curves: Sequence[DrawnCurve]) -> tuple[list[DrawnCurve], list[DrawnCurve]]:
    """Closed curves and the outermost loops of open ones that meet; and open ones that are not part of a loop."""
    rings = [curve for curve in curves if curve.closed and curve.solid.area > 0.0]
    strokes = [curve for curve in curves if not curve.closed]
    loops, rest = _loops(strokes) if strokes else ([], [])
    return rings + loops, rest


def _loops(strokes: list[DrawnCurve]) -> tuple[list[DrawnCurve], list[DrawnCurve]]:
    """Outermost loops of strokes, and strokes that are on none.

    Loops are the outer boundaries of faces between strokes that meet, so that lines between corners of an outline do
    not matter. The loops of ezdxf's ``edgeminer`` are all that there are, which takes a time beyond bounds for a grid.
    """
    import numpy as np
    import shapely
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.array([stroke.points[k] for stroke in strokes for k in (0, -1)])
    every = np.concatenate([stroke.points for stroke in strokes])
    at, other = _near(ends, _GAP * float(np.ptp(every, axis=0).max()))
    node = np.arange(len(ends))
    np.minimum.at(node, at, other)
    lines = [
        shapely.LineString([ends[node[2 * k]], *stroke.points[1:-1], ends[node[2 * k + 1]]])
        for k, stroke in enumerate(strokes)
    ]
    links = coo_array((np.ones(len(strokes)), (node[::2], node[1::2])), shape=(len(ends), len(ends)))
    network = connected_components(links, directed=False)[1][node[::2]]
    loops: list[DrawnCurve] = []
    rest: list[DrawnCurve] = []
    networks: dict[int, list[int]] = {}
    for k, number in enumerate(network):
        networks.setdefault(int(number), []).append(k)
    for members in networks.values():
        faces = shapely.polygonize(list({shapely.normalize(lines[k]).wkb: lines[k] for k in members}.values()))
        whole = shapely.union_all([shapely.Polygon(face.exterior) for face in faces.geoms])
        boundaries = [part.exterior for part in getattr(whole, "geoms", [whole]) if not part.is_empty]
        used: set[int] = set()
        for boundary in boundaries:
            shapely.prepare(boundary)
            pieces = [k for k in members if boundary.covers(lines[k])]
            used.update(pieces)
            loops.append(_loop([strokes[k] for k in pieces], boundary.coords[:-1]))
        rest += [strokes[k] for k in members if k not in used]
    return loops, rest


def _near(ends: Array, gap: float) -> Any:
    import shapely

    points = shapely.points(ends)
    return shapely.STRtree(points).query(points, predicate="dwithin", distance=gap)


def _loop(pieces: list[DrawnCurve], points: Any) -> DrawnCurve:
    first = pieces[0]
    label = first.label if len(pieces) == 1 else f"loop of {first.label} and {len(pieces) - 1} more"
    names = tuple(dict.fromkeys(name for piece in pieces for name in piece.names))
    groups = {piece.group for piece in pieces}
    group = first.group if len(groups) == 1 else frozenset(groups)
    width = max(piece.width for piece in pieces)
    return DrawnCurve(label, names, distinct((float(x), float(y)) for x, y in points), group=group, width=width)
