"""Curves of SVG drawings: every shape as one sees it, in the unit of the document.

What changes the shape that one sees is either applied here, or named: left out, or a flaw of the shapes around it.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from continuum_grasp.scene.objects.drawings.curves import Drawing, DrawnCurve
from continuum_grasp.scene.objects.drawings.svg_geometry import (
    SHAPES,
    box,
    check,
    fitted,
    length,
    moved,
    pieces,
    rectangle,
    transform,
)
from continuum_grasp.scene.objects.drawings.svg_paint import REFERENCES, Paint, Paints, fraction
from continuum_grasp.scene.objects.drawings.svg_shape import DrawnShape, masked
from continuum_grasp.scene.objects.drawings.svg_style import Styles
from continuum_grasp.scene.polygons import PlanePoint

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.outline import OutlineFile

_PIXEL = 0.0254 / 96.0
"""Length of a user unit of SVG [m]: 96 per inch, by CSS."""
_GROUPS = ("g", "a", "switch", "svg", "symbol")
_VIEWPORTS = ("svg", "symbol")
_NOT_DRAWN = (
    "clipPath", "defs", "desc", "filter", "linearGradient", "marker", "mask", "metadata", "pattern", "radialGradient",
    "style", "symbol", "title", "view",
)  # fmt: skip
"""Elements that are not drawn where they stand."""
_MOVING = ("animate", "animateColor", "animateMotion", "animateTransform", "set")
_EFFECTS = {
    **dict.fromkeys(("filter", "animation", "animation-name", "mask-image", "offset-path", "perspective"), ("none",)),
    **dict.fromkeys(("rotate", "scale", "translate", "refX", "refY"), ("none", "0")),
    "clip": ("auto",),
    "mix-blend-mode": ("normal", "multiply", "darken"),
    "transform-box": ("view-box",),
    "zoom": ("1", "normal"),
}
"""Properties that change the shape that one sees and that this reader does not apply, with their harmless values."""
_SPACE = "{http://www.w3.org/2000/svg}"
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_BOX = "objectBoundingBox"
_Edges = tuple[float, float, float, float]
_MOST = 100_000
"""Greatest number of shapes, with every use of each: uses of uses multiply beyond any bound."""


def read_svg(given: OutlineFile) -> Drawing:
    """Read the shapes that are visible; `ValueError` names an element that cannot be read."""
    from lxml import etree

    root = etree.parse(given.file, etree.XMLParser(no_network=True)).getroot()
    for element in root.iter(etree.Element):
        element.tag = element.tag.removeprefix(_SPACE)
    if root.tag != "svg":
        raise ValueError(f"expected an svg element, got {etree.QName(root).localname[:60]!r}")
    try:
        return _Document(root).drawing()
    except RecursionError:
        raise ValueError("elements inside elements are too many") from None


@dataclass(frozen=True)
class _Place:
    """Where an element is drawn.

    Attributes
    ----------
    matrix : svgelements.Matrix
        From user units to the page.
    viewport : (float, float)
        Lengths that are 100 % [user units].
    style : dict
        Properties of the element around it.
    within : tuple of Element
        Elements around it, with those that use it.
    opacity : float
        Opacity of the elements around it.
    clips : bool
        Whether it is a part of a clip path, which has areas without paint.
    """

    matrix: Any
    viewport: PlanePoint
    style: dict[str, str]
    within: tuple[Any, ...] = ()
    opacity: float = 1.0
    clips: bool = False


class _Document:
    def __init__(self, root: Any) -> None:
        self.root = root
        self.targets = {element.get("id"): element for element in root.iter() if element.get("id")}
        self.styles = Styles(root)
        self.paints = Paints(self.target, self.styles.in_place)
        self.ignored: Counter[str] = Counter()
        self._kinds: Counter[str] = Counter()
        self._count = 0
        self._boxed = any(element.tag == "mask" or _BOX in element.attrib.values() for element in root.iter())

    def drawing(self) -> Drawing:
        """Everything that the document shows."""
        style = self.styles.of(self.root, {})
        matrix, viewport, page = self._page(style)
        place = _Place(matrix, viewport, style, (self.root,), fraction(style.get("opacity", "1")))
        if style.get("transform", "none") != "none":
            raise ValueError(f"{_named(self.root)}: transform is not read: put it into a group")
        shapes = [shape for child in self.root for shape in self._drawn(child, place)]
        drawing = Drawing(_PIXEL, ignored=self.ignored)
        for shape in self._seen(self.root, place, shapes):
            curves = list(shape.curves())
            drawing.curves += curves if page is None else [_on_page(curve, page) for curve in curves]
            if not curves:
                self.ignored["shape that is not visible"] += 1
        return replace(drawing, page=page)

    def target(self, reference: str) -> Any:
        """The element that a reference means; None where the file does not have it."""
        return self.targets.get(reference.strip().removeprefix("#")) if reference.strip().startswith("#") else None

    def _page(self, style: dict[str, str]) -> tuple[Any, PlanePoint, _Edges | None]:
        """Transform and lengths of the outermost viewport, and the page, y up; None where the file has none."""
        check({"viewBox": self.root.get("viewBox", "")}, _named(self.root))
        view = self.root.get("viewBox", "").replace(",", " ").split()
        inner = (float(view[2]), float(view[3])) if len(view) == 4 else (0.0, 0.0)
        width, height = (self._side(style, key) for key in ("width", "height"))
        if all(inner):  # a side that the file does not state follows from the other
            width, height = width or height * inner[0] / inner[1], height or width * inner[1] / inner[0]
        width, height = width or inner[0], height or inner[1]
        page = (0.0, -height, width, 0.0) if width and height else None
        matrix, viewport = fitted(self.root, _named(self.root), (0.0, 0.0, width or 100.0, height or 100.0))
        return matrix, viewport, page

    def _side(self, style: dict[str, str], key: str) -> float:
        """Width or height of the page [px]; 0 where it is left to the viewer."""
        for text in (style.get(key), self.root.get(key)):
            check({} if text is None else {key: text}, _named(self.root))
            if text is not None and text != "auto" and not text.endswith("%"):
                return length(text, 0.0)
        return 0.0

    def _drawn(self, element: Any, place: _Place) -> list[DrawnShape]:
        """Everything that an element shows."""
        if not isinstance(element.tag, str) or "}" in element.tag or not _wanted(element):
            return []
        inside = self._inside(element, place)
        if element.tag in SHAPES:
            inside = self._turned(element, inside)
            shapes = [self._shape(element, inside)]
        elif element.tag == "use":
            inside = self._turned(element, inside)
            shapes = self._used(element, inside)
        elif element.tag in _GROUPS and element.tag != "symbol":
            inside = self._turned(element, inside)
            shapes = self._group(element, inside, inside.style)
        else:
            if element.tag not in (*_NOT_DRAWN, *_MOVING) and inside.style.get("display") != "none":
                self.ignored[element.tag] += 1
            return []
        return self._seen(element, inside, shapes)

    def _inside(self, element: Any, place: _Place) -> _Place:
        """The place with the properties of an element, which is not displayed inside of one that is not."""
        style = self.styles.of(element, place.style)
        if place.style.get("display") == "none":
            style["display"] = "none"
        return replace(place, style=style, opacity=place.opacity * fraction(style.get("opacity", "1")))

    def _turned(self, element: Any, place: _Place) -> _Place:
        """The place of an element with its own transform, of which x and y of a use are a part."""
        check(place.style, _named(element))
        matrix = transform(place.style, place.viewport) * place.matrix
        if element.tag == "use":
            x, y, _, _ = box(place.style, place.viewport, {})
            matrix = fitted({}, "", (x, y, 0.0, 0.0))[0] * matrix
        return replace(place, matrix=matrix)

    def _group(self, element: Any, place: _Place, sized: dict[str, str]) -> list[DrawnShape]:
        """The children of a group; ``sized`` has the size of a viewport, which a use may state."""
        place = replace(place, within=(*place.within, element))
        edge = None
        if element.tag in _VIEWPORTS:
            sides = box(place.style, place.viewport, sized)
            if not (sides[2] > 0.0 and sides[3] > 0.0):
                return []
            if place.style.get("overflow", "hidden") not in ("visible", "auto"):
                edge = rectangle(place.matrix, *sides)
            fit, viewport = fitted(element, _named(element), sides)
            place = replace(place, matrix=fit * place.matrix, viewport=viewport)
        children = list(element)
        if element.tag == "switch":
            children = [child for child in children if isinstance(child.tag, str) and "}" not in child.tag]
            children = [child for child in children if child.tag != "foreignObject" and _wanted(child)][:1]
        shapes = [shape for child in children for shape in self._drawn(child, place)]
        return shapes if edge is None else [shape.cut(edge) for shape in shapes]

    def _used(self, element: Any, place: _Place) -> list[DrawnShape]:
        reference = next((element.get(key) for key in REFERENCES if element.get(key)), "")
        target = self.target(reference)
        if target is None or target in place.within:
            self.ignored[f"use of {reference!r}, which is not in the file"] += 1
            return []
        place = replace(place, within=(*place.within, element))
        if target.tag not in _VIEWPORTS:
            return self._drawn(target, place)
        inside = self._turned(target, self._inside(target, place))
        return self._seen(target, inside, self._group(target, inside, self.styles.of(element, {})))

    def _shape(self, element: Any, place: _Place) -> DrawnShape:
        if self._count >= _MOST:
            raise ValueError(f"more than {_MOST} shapes")
        import numpy as np

        self._count += 1
        self._kinds[element.tag] += not place.clips
        ordinal = f"{element.tag} {self._kinds[element.tag]}"
        names = [*_names(element), ordinal, *(name for outer in reversed(place.within[1:]) for name in _names(outer))]
        label = _named(element) if names[0] != ordinal else ordinal
        style = place.style
        parts = pieces(element.tag, style, label, place.viewport, place.matrix)
        shape = DrawnShape(
            label,
            tuple(dict.fromkeys(names)),
            group=tuple(map(id, place.within)),
            source=self._count,
            pieces=parts,
            whole=np.array([point for points, _ in parts for point in points]).reshape(-1, 2),
            rule=style.get("clip-rule" if place.clips else "fill-rule", "nonzero"),
        )
        if style.get("display") == "none":
            return replace(shape, whole=shape.whole[:0])
        if style.get("visibility", "visible") in ("hidden", "collapse"):
            return shape
        if place.clips:
            return replace(shape, fill=Paint(0.0, 1.0))
        fill = self.paints.of(style, "fill", place.opacity)
        stroke = self.paints.of(style, "stroke", place.opacity)
        width = self._width(style, place) if stroke else 0.0
        shape = replace(shape, fill=fill, stroke=stroke if width else None, width=width)
        return self._marked(element, style, shape)

    def _width(self, style: dict[str, str], place: _Place) -> float:
        """Width of a stroke on the page [px]."""
        width = length(style.get("stroke-width", "1"), math.hypot(*place.viewport) / math.sqrt(2.0))
        fixed = style.get("vector-effect") == "non-scaling-stroke"
        return width * (1.0 if fixed else math.sqrt(abs(place.matrix.determinant)))

    def _marked(self, element: Any, style: dict[str, str], shape: DrawnShape) -> DrawnShape:
        """A shape with what its stroke has: gaps, and markers, which are left out or a flaw."""
        marks = {style.get(key, "none") for key in ("marker-start", "marker-mid", "marker-end")} - {"none"}
        if marks and element.tag in ("path", "line", "polyline", "polygon"):
            if any(closed or (shape.fill and len(points) > 2) for points, closed in shape.pieces):
                return replace(shape, flaw="has markers, which are not read: remove them, or convert them to paths")
            self.ignored[f"marker of {shape.label}"] += 1
        dashes = style.get("stroke-dasharray", "none").replace(",", " ").split()
        return replace(shape, dashed=dashes != ["none"] and any(fraction(dash) for dash in dashes))

    def _seen(self, element: Any, place: _Place, shapes: list[DrawnShape]) -> list[DrawnShape]:
        """The shapes of an element as its clip path, its mask and its effects leave them."""
        style = place.style
        if self._boxed:
            shapes = _boxed(shapes, place.matrix)
        flaws = [
            f"{key} of {_named(element)}"
            for key, harmless in _EFFECTS.items()
            if style.get(key, harmless[0]) not in harmless
        ]
        flaws += [f"{child.tag} in {_named(element)}" for child in element if child.tag in _MOVING]
        for key in ("clip-path", "mask"):
            text = style.get(key, "none")
            if text != "none":
                try:
                    region = self._region(key, text, place, shapes)
                    shapes = [shape.cut(region) for shape in shapes]
                except ValueError as error:
                    flaws.append(f"{key} of {_named(element)}: {error}")
        if not flaws:
            return shapes
        flaw = f"is changed by {flaws[0]}, which is not read: apply or remove it in the program that drew it"
        return [replace(shape, flaw=shape.flaw or flaw) for shape in shapes]

    def _region(self, key: str, text: str, place: _Place, shapes: list[DrawnShape]) -> Any:
        """The region that a clip path or a mask leaves visible."""
        match = re.fullmatch(r"url\(\s*[\"']?([^)\"']*)[\"']?\s*\)", text)
        target = self.target(match[1]) if match else None
        if target is None or target.tag != {"clip-path": "clipPath", "mask": "mask"}[key]:
            raise ValueError(f"{text[:60]!r} is no {key} of this file")
        if target in place.within:
            raise ValueError(f"{text[:60]!r} refers to itself")
        style = self.styles.in_place(target)
        check(style, _named(target))
        inner = replace(place, style=style, within=(*place.within, target), opacity=1.0, clips=key == "clip-path")
        whole = _box(shapes, place.matrix)
        if target.get("clipPathUnits" if inner.clips else "maskContentUnits") == _BOX:
            inner = replace(inner, matrix=whole * place.matrix, viewport=(1.0, 1.0))
        region = self._clip(target, inner) if inner.clips else self._mask(target, inner, whole, place)
        for other in ("clip-path", "mask"):  # of the clip path or mask itself, which refer to the same shapes
            if style.get(other, "none") != "none":
                around = replace(place, within=inner.within)
                region = region.intersection(self._region(other, style[other], around, shapes))
        return region

    def _clip(self, target: Any, place: _Place) -> Any:
        """The region of a clip path, which has shapes and uses of shapes alone."""
        import shapely

        inner = self._turned(target, place)
        children = [child for child in target if child.tag in (*SHAPES, "use", "text")]
        shapes = self._clean(children, inner)
        if flawed := next((shape for shape in shapes if shape.flaw), None):
            raise ValueError(f"{flawed.label} {flawed.flaw}")
        return shapely.union_all([shape.area for shape in shapes if shape.fill])

    def _mask(self, target: Any, inner: _Place, whole: Any, outer: _Place) -> Any:
        """The region of a mask, within the rectangle that it states."""
        shapes = self._clean(list(target), inner)
        in_box = target.get("maskUnits", _BOX) == _BOX
        default = {"x": "-10%", "y": "-10%", "width": "120%", "height": "120%"}
        sides = box(default | dict(target.attrib), (1.0, 1.0) if in_box else outer.viewport, {})
        by_alpha = inner.style.get("mask-type") == "alpha"
        frame = rectangle(whole * outer.matrix if in_box else outer.matrix, *sides)
        return masked(shapes, by_alpha).intersection(frame)

    def _clean(self, children: list[Any], place: _Place) -> list[DrawnShape]:
        """Shapes of a clip path or a mask, which may have nothing else. They do not count in names of other shapes."""
        before, kinds = self.ignored, self._kinds
        self.ignored, self._kinds = Counter(), Counter()
        shapes = [shape for child in children for shape in self._drawn(child, place)]
        other = next(iter(self.ignored), None)
        self.ignored, self._kinds = before, kinds
        if other is not None:
            raise ValueError(f"it has {other}")
        return shapes


def _boxed(shapes: list[DrawnShape], matrix: Any) -> list[DrawnShape]:
    """Shapes with the box around all of them, along the axes of the element that they are."""
    import numpy as np

    whole = rectangle(_box(shapes, matrix) * matrix, 0.0, 0.0, 1.0, 1.0)
    corners = np.array(whole.exterior.coords)
    return [replace(shape, whole=corners) if len(shape.whole) else shape for shape in shapes]


def _box(shapes: list[DrawnShape], matrix: Any) -> Any:
    """The transform from the unit square to the box around shapes in user units."""
    import numpy as np
    import svgelements

    every = [moved(shape.whole, ~matrix) for shape in shapes if len(shape.whole)] if matrix.determinant else []
    if not every:
        return svgelements.Matrix()
    (left, top), (right, bottom) = (f(np.concatenate(every), axis=0).tolist() for f in (np.min, np.max))
    return svgelements.Matrix(right - left, 0.0, 0.0, bottom - top, left, top)


def _wanted(element: Any) -> bool:
    """Whether the conditions of an element hold: a viewer in English without extensions."""
    languages = element.get("systemLanguage")
    english = languages is None or any(one.strip().lower().startswith("en") for one in languages.split(","))
    return english and element.get("requiredExtensions") is None


def _names(element: Any) -> list[str]:
    """Names of an element in the file: its own, and what Inkscape shows, which calls layers so."""
    return [name for name in (element.get("id"), element.get(_LABEL)) if name]


def _named(element: Any) -> str:
    """An element in a message."""
    return " ".join([element.tag, *map(repr, _names(element)[:1])])


def _on_page(curve: DrawnCurve, edges: _Edges) -> DrawnCurve:
    """The curve; where it is a rectangle as large as the page, a curve inside it may be the object."""
    import shapely

    page = shapely.box(*edges)
    if not page.intersects(curve.drawn):
        return replace(curve, aside="outside of the page")
    if not curve.filled or curve.solid.symmetric_difference(page).area > 1e-3 * page.area:
        return curve
    return replace(curve, filled=False, group="page")
