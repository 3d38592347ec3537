"""Curves of a drawing, loops of those that meet, and the one of them that is an outline."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.measured import Sampling
from continuum_grasp.scene.polygons import PlanePoint, check_simple
from continuum_grasp.scene.value import WRITTEN

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.measured.fit import FittedCurve

_GAP = 1e-4
"""Gap between ends that meet, as a part of what all open curves measure: files round to 0.01 px or 1e-4 inch, which is
5e-5 of an object that is 200 px or 2 inches large."""


@dataclass(frozen=True)
class DrawnCurve:
    """A curve of a drawing, as a chain of chords.

    Attributes
    ----------
    label : str
        What a message calls it: kind, name, layer.
    names : tuple of str
        By which the key ``path`` chooses it, the most particular first.
    points : tuple of (float, float)
        Corners (n, 2), y up, each once [unit of the file].
    closed : bool
        Whether the last point is joined to the first.
    group : Hashable
        Layer, block or group in which it stands: curves inside one of the same group are its holes.
    source : Hashable
        Path that it belongs to; parts of one path inside each other are holes.
    filled : bool
        Whether the area inside belongs to the object, whatever is drawn there by other paths.
    ground : bool
        Whether it is an area in the color of the paper.
    flaw : str
        Why it cannot be an outline, in words; empty where it can.
    """

    label: str
    names: tuple[str, ...]
    points: tuple[PlanePoint, ...]
    closed: bool = True
    group: Hashable = None
    source: Hashable = None
    filled: bool = False
    ground: bool = False
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

    @property
    def text(self) -> str:
        """Label and size of the curve, where its points are in m."""
        return f"{self.label} ({sizes(self.size)})"

    def scaled(self, factor: float) -> DrawnCurve:
        """The curve with a unit of another length."""
        return replace(self, points=tuple((factor * x, factor * y) for x, y in self.points))


@dataclass(frozen=True)
class DrawnOutline:
    """The outline in a drawing, in words what of the drawing is not part of it, and the lines and arcs of the outline
    where its points were measured.
    """

    curve: DrawnCurve
    left_out: tuple[str, ...]
    fit: FittedCurve | None = None

    @property
    def error(self) -> float:
        """Distance of the outline from the true one that the noise of its points explains [m]."""
        return 0.0 if self.fit is None else self.fit.error

    def level(self, normals: Iterable[PlanePoint]) -> DrawnOutline:
        """The outline with flat sides, within its error, across its outermost points along each normal."""
        if self.fit is None:
            return self
        fit = self.fit.level(normals)
        return replace(self, curve=replace(self.curve, points=fit.points), fit=fit)


@dataclass
class Drawing:
    """Contents of a file.

    Attributes
    ----------
    unit : float or None
        Length of a unit [m]; None where the file does not say it.
    curves : list of Curve
    ignored : Counter of str
        What else it has and is not read, in words, and how often.
    advice : str
        How one of several curves is chosen.
    sampling : Sampling or None
        What is known of the points where they were measured, in the unit of the points; None of drawn curves.
    """

    unit: float | None
    curves: list[DrawnCurve] = field(default_factory=list)
    ignored: Counter[str] = field(default_factory=Counter)
    advice: str = "choose one by path"
    sampling: Sampling | None = None

    def scaled(self, factor: float) -> Drawing:
        """The drawing with a unit of another length."""
        sampling = None if self.sampling is None else self.sampling.scaled(factor)
        return replace(self, curves=[curve.scaled(factor) for curve in self.curves], sampling=sampling)

    def outline(self, file: str, path: str | None) -> DrawnOutline:
        """The only outer curve, or the outer curve with one name, whose points are in m; `ValueError` otherwise."""
        chosen = [curve for curve in self.curves if path in curve.names or (path is None and not curve.ground)]
        if flawed := next((curve for curve in chosen if curve.flaw), None):
            raise ValueError(f"file: {flawed.label} of {file} {flawed.flaw}")
        rings, strokes = joined(chosen)
        if not rings and path is not None:  # the name of one piece of a loop
            rings = [ring for ring in joined(self.curves)[0] if path in ring.names]
        others = [f"{stroke.text}: open" for stroke in strokes]
        others += [f"{what} ({count})" if count > 1 else what for what, count in self.ignored.items()]
        ground = [curve for curve in self.curves if curve.ground and path is None and curve.closed]
        if not rings:
            raise ValueError(_nothing(self, file, path, [*(f"{curve.text}: white" for curve in ground), *others]))
        outer, inner = _nested(_once_each(rings))
        if len(outer) > 1:
            raise ValueError(f"file: {file} has {len(outer)} outer curves, expected one: {_choice(outer, self)}")
        fit = None if self.sampling is None else self._fitted(outer[0], self.sampling)
        whole = outer[0] if fit is None else replace(outer[0], points=fit.points)
        check_simple(whole.points, f"file: {whole.label} of {file}")
        _check_holes(outer[0], inner, self, file)
        inside = [f"{curve.text}: {'a hole' if curve.group == outer[0].group else 'inside'}" for curve in inner]
        return DrawnOutline(whole, (*inside, *_paper(outer[0], ground, file), *others), fit)

    def _fitted(self, ring: DrawnCurve, sampling: Sampling) -> FittedCurve | None:
        from continuum_grasp.scene.objects.measured.fit import fitted

        return fitted(ring.points, sampling)


def sizes(size: PlanePoint) -> str:
    """Width and height [m] in words."""
    return f"{1e3 * size[0]:.4g} x {1e3 * size[1]:.4g} mm"


def distinct(points: Iterable[PlanePoint]) -> tuple[PlanePoint, ...]:
    """Points without those that repeat the one before, and without the last where it is the first."""
    chain = list(points)
    least = WRITTEN * max((math.dist(chain[0], point) for point in chain), default=0.0)
    once: list[PlanePoint] = []
    for point in chain:
        if not once or math.dist(point, once[-1]) > least:
            once.append(point)
    closed = len(once) > 1 and math.dist(once[0], once[-1]) <= least
    return tuple(once[:-1]) if closed else tuple(once)


def _paper(outer: DrawnCurve, ground: list[DrawnCurve], file: str) -> list[str]:
    """Describe areas in the color of the paper beside an outline; `ValueError` where one covers a part."""
    texts = []
    for curve in ground:
        if outer.solid.covers(curve.solid):
            texts.append(f"{curve.text}: a hole, white")
        elif curve.solid.covers(outer.solid) or not curve.solid.intersects(outer.solid):
            texts.append(f"{curve.text}: white")
        else:
            raise ValueError(f"file: {curve.text} of {file} is white and covers a part of {outer.label}: cut it out")
    return texts


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
    return DrawnCurve(label, names, distinct((float(x), float(y)) for x, y in points), group=group)


def _once_each(rings: list[DrawnCurve]) -> list[DrawnCurve]:
    """Rings without those that are drawn twice."""
    unique: list[DrawnCurve] = []
    for ring in rings:
        least = WRITTEN * ring.solid.area
        alike = [other for other in unique if abs(other.solid.area - ring.solid.area) <= least]
        if not any(ring.solid.symmetric_difference(other.solid).area <= least for other in alike):
            unique.append(ring)
    return unique


def _nested(rings: list[DrawnCurve]) -> tuple[list[DrawnCurve], list[DrawnCurve]]:
    """Rings that are in no other, and those that are, the largest first."""
    ordered = sorted(rings, key=lambda ring: -ring.solid.area)
    outer: list[DrawnCurve] = []
    inner: list[DrawnCurve] = []
    for ring in ordered:
        (inner if any(other.solid.covers(ring.solid) for other in outer) else outer).append(ring)
    return outer, inner


def _check_holes(outer: DrawnCurve, inner: list[DrawnCurve], drawing: Drawing, file: str) -> None:
    """Refuse an outer curve that may be a frame around the object: a curve in a hole is another body."""
    own = [curve for curve in inner if curve.source is not None and curve.source == outer.source]
    holes = own if outer.filled else inner
    islands = [curve for curve in inner if any(hole is not curve and hole.solid.covers(curve.solid) for hole in holes)]
    foreign = [curve for curve in inner if curve.group != outer.group and curve not in own and not outer.filled]
    if foreign or islands:
        why = "is inside, on another layer or in another group" if foreign else "is inside a hole"
        raise ValueError(
            f"file: {file}: a frame around the object, or an object with holes? {(foreign or islands)[0].label} {why}: "
            f"{_choice([outer, *inner], drawing)}"
        )


def _choice(curves: list[DrawnCurve], drawing: Drawing) -> str:
    """Curves with their sizes, and the name that chooses each."""
    counts = Counter(name for curve in curves for name in set(curve.names))
    texts = []
    for curve in curves[:8]:
        name = next((name for name in curve.names if counts[name] == 1), None)
        texts.append(curve.text if name is None else f"{curve.text}, path: {name}")
    more = [f"{len(curves) - 8} more"] if len(curves) > 8 else []
    return f"{'; '.join([*texts, *more])}; {drawing.advice}"


def _nothing(drawing: Drawing, file: str, path: str | None, left_out: list[str]) -> str:
    """Why there is no outline."""
    if path is not None and not any(path in curve.names for curve in drawing.curves):
        known = list(dict.fromkeys(name for curve in drawing.curves for name in curve.names))
        return f"path: no curve {path!r} in {file}, which has {', '.join(known[:20]) or 'none'}"
    rest = f"; it has {'; '.join(left_out[:8])}" if left_out else ""
    return f"file: no closed curve in {file}: expected one that ends where it begins{rest}"
