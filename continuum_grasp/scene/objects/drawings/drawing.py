"""A drawing: its curves, and the curve that is the outline of an object."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from continuum_grasp.scene.curved_parts import SHARE
from continuum_grasp.scene.objects.drawings.curves import DrawnCurve, joined
from continuum_grasp.scene.objects.measured import Sampling
from continuum_grasp.scene.polygons import PlanePoint, check_simple
from continuum_grasp.scene.value import WRITTEN

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.measured.fit import FittedCurve

_PEN = 0.05
"""A line wider than this share of the outline's size is an area [1]: ISO 128 has lines of up to 2 mm, 0.05 of an object
of 40 mm."""


@dataclass(frozen=True)
class DrawnOutline:
    """Outline in a drawing, the parts left out in words, and for measured points the lines and arcs of the outline."""

    curve: DrawnCurve
    left_out: tuple[str, ...]
    fit: FittedCurve | None = None

    @property
    def error(self) -> float:
        """Distance of the outline from the true one that the noise of its points explains [m]."""
        return 0.0 if self.fit is None else self.fit.error

    def level(self, normals: Iterable[PlanePoint]) -> DrawnOutline:
        """Return the outline with sides that are flat, within its error, across its outermost points along each
        normal.
        """
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
        Length of a unit [m]; None if the file does not state it.
    curves : list of DrawnCurve
    ignored : Counter of str
        Other contents that are not read, in words, with counts.
    advice : str
        How to choose one of several curves.
    page : (float, float, float, float) or None
        Left, lower, right and upper edge of the visible part [unit of the curves]; None if everything is visible.
    sampling : Sampling or None
        Sampling of measured points, in their unit; None for drawn curves.
    """

    unit: float | None
    curves: list[DrawnCurve] = field(default_factory=list)
    ignored: Counter[str] = field(default_factory=Counter)
    advice: str = "choose one by path"
    page: tuple[float, float, float, float] | None = None
    sampling: Sampling | None = None

    def scaled(self, factor: float) -> Drawing:
        """Return the drawing with a unit of another length."""
        left, lower, right, upper = (factor * edge for edge in self.page or (0.0, 0.0, 0.0, 0.0))
        page = (left, lower, right, upper) if self.page else None
        sampling = None if self.sampling is None else self.sampling.scaled(factor)
        return replace(self, curves=[curve.scaled(factor) for curve in self.curves], page=page, sampling=sampling)

    def outline(self, file: str, path: str | None) -> DrawnOutline:
        """Return the only outer curve, or the outer curve with one name, with points in m; `ValueError` otherwise."""
        chosen = [curve for curve in self.curves if path in curve.names or (path is None and not curve.aside)]
        aside = [curve for curve in self.curves if curve.aside and path is None]
        paper = [curve for curve in aside if curve.aside == "white" and curve.closed]
        if flawed := next((curve for curve in [*chosen, *paper] if curve.flaw), None):
            raise ValueError(f"file: {flawed.label} of {file} {flawed.flaw}")
        rings, strokes = joined(chosen)
        if not rings and path is not None:  # the name of one piece of a loop
            rings = [ring for ring in joined(self.curves)[0] if path in ring.names]
        others = [f"{stroke.text}: open" for stroke in strokes]
        others += [f"{curve.text}: {curve.aside}" for curve in aside if curve not in paper]
        others += [f"{what} ({count})" if count > 1 else what for what, count in self.ignored.items()]
        if not rings:
            raise ValueError(_nothing(self, file, path, [*(f"{curve.text}: white" for curve in paper), *others]))
        outer, inner = _nested(_once_each(rings))
        if len(outer) > 1:
            raise ValueError(f"file: {file} has {len(outer)} outer curves, expected one: {_choice(outer, self)}")
        fit = None if self.sampling is None else self._fitted(outer[0], self.sampling)
        whole = outer[0] if fit is None else replace(outer[0], points=fit.points)
        check_simple(whole.points, f"file: {whole.label} of {file}")
        _check_holes(outer[0], inner, self, file)
        inside = [f"{curve.text}: {'a hole' if curve.group == outer[0].group else 'inside'}" for curve in inner]
        edge = self._edge(outer[0], file)
        left_out = (*edge, *_outliers(fit), *inside, *_paper(outer[0], paper, file), *others)
        return DrawnOutline(whole, left_out, fit)

    def _fitted(self, ring: DrawnCurve, sampling: Sampling) -> FittedCurve | None:
        from continuum_grasp.scene.objects.measured.fit import fitted

        return fitted(ring.points, sampling)

    def _edge(self, outer: DrawnCurve, file: str) -> list[str]:
        """Describe the line that draws an outline; `ValueError` if the visible shape differs from the outline."""
        import shapely

        size = max(outer.size)
        wide = f"{1e3 * outer.width:.4g} mm wide"
        if outer.width > _PEN * size:
            raise ValueError(
                f"file: {outer.text} of {file} is drawn by a line {wide}, an area of its own: convert the line to a "
                f"path, or make it thinner than {100.0 * _PEN:g} % of the size"
            )
        if self.page and not shapely.box(*self.page).buffer(SHARE * size).covers(outer.solid):
            raise ValueError(f"file: {outer.text} of {file} reaches beyond the page: enlarge the page, or cut it out")
        return [f"half of its line, which is {wide}"] if outer.width > 2.0 * SHARE * size else []


def _outliers(fit: FittedCurve | None) -> list[str]:
    """Describe the measured points that are not on the curve through the others."""
    if fit is None or not fit.outliers:
        return []
    points = "1 point that is" if fit.outliers == 1 else f"{fit.outliers} points that are"
    return [f"{points} not on the curve through the others"]


def _paper(outer: DrawnCurve, paper: list[DrawnCurve], file: str) -> list[str]:
    """Describe areas in the color of the paper near an outline; `ValueError` if one covers a part of it."""
    texts = []
    for curve in paper:
        if outer.solid.covers(curve.solid):
            texts.append(f"{curve.text}: a hole, white")
        elif curve.solid.covers(outer.solid) or not curve.solid.intersects(outer.solid):
            texts.append(f"{curve.text}: white")
        else:
            raise ValueError(f"file: {curve.text} of {file} is white and covers a part of {outer.label}: cut it out")
    return texts


def _once_each(rings: list[DrawnCurve]) -> list[DrawnCurve]:
    """Return the rings without duplicates, each with its widest line."""
    unique: list[DrawnCurve] = []
    for ring in rings:
        least = WRITTEN * ring.solid.area
        alike = [k for k, other in enumerate(unique) if abs(other.solid.area - ring.solid.area) <= least]
        same = next((k for k in alike if ring.solid.symmetric_difference(unique[k].solid).area <= least), None)
        if same is None:
            unique.append(ring)
        elif ring.width > unique[same].width:
            unique[same] = replace(unique[same], width=ring.width)
    return unique


def _nested(rings: list[DrawnCurve]) -> tuple[list[DrawnCurve], list[DrawnCurve]]:
    """Return the outer rings and the inner ones, each the largest first."""
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
    """List curves with their sizes, and the name that chooses each."""
    counts = Counter(name for curve in curves for name in set(curve.names))
    texts = []
    for curve in curves[:8]:
        name = next((name for name in curve.names if counts[name] == 1), None)
        texts.append(curve.text if name is None else f"{curve.text}, path: {_quoted(name)}")
    more = [f"{len(curves) - 8} more"] if len(curves) > 8 else []
    return f"{'; '.join([*texts, *more])}; {drawing.advice}"


def _quoted(name: str) -> str:
    """Write a name for YAML: in quotes if it would otherwise be a number or the like."""
    import yaml

    try:
        plain = yaml.safe_load(f"path: {name}") == {"path": name}
    except yaml.YAMLError:
        plain = False
    return name if plain else json.dumps(name, ensure_ascii=False)


def _nothing(drawing: Drawing, file: str, path: str | None, left_out: list[str]) -> str:
    """Say why there is no outline."""
    if path is not None and not any(path in curve.names for curve in drawing.curves):
        known = list(dict.fromkeys(name for curve in drawing.curves for name in curve.names))
        return f"path: no curve {path!r} in {file}, which has {', '.join(known[:20]) or 'none'}"
    rest = f"; it has {'; '.join(left_out[:8])}" if left_out else ""
    return f"file: no closed curve in {file}: expected one that ends where it begins{rest}"
