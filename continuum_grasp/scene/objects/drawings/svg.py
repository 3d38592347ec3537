"""Curves of SVG drawings: every shape is one path, with all transforms, in the unit of the document."""

from __future__ import annotations

import io
import math
import re
from collections import Counter
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.drawings.curves import Drawing, DrawnCurve, distinct
from continuum_grasp.scene.polygons import PlanePoint

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.outline import OutlineFile

_PIXEL = 0.0254 / 96.0
"""Length of a user unit of SVG [m]: 96 per inch, by CSS."""
_CHORDS = 128
"""Chords of a curved segment as long as its path is large; shorter ones have fewer, with the same distance from the
curve: they keep a half circle to 1e-4 of its radius, about (pi / 128)^2 / 8."""
_SHAPES = ("path", "rect", "circle", "ellipse", "line", "polyline", "polygon")
_GROUPS = ("g", "a", "switch", "svg")
_REFERENCES = ("href", "{http://www.w3.org/1999/xlink}href")
_PLACES = ("x", "y", "width", "height", "viewBox", "preserveAspectRatio", *_REFERENCES)
"""Attributes that say where an element is, which its children do not inherit."""
_ACROSS, _DOWN = ("x", "width", "cx", "rx", "x1", "x2"), ("y", "height", "cy", "ry", "y1", "y2")
_LIST = r"[-+.,eE\d\s]*"
_LENGTH = r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*(px|mm|cm|in|pt|pc|%)?\s*|auto"
_GRAMMAR = {
    "d": r"[MmZzLlHhVvCcSsQqTtAaeE\d+\-.,\s]*",
    "points": _LIST,
    "viewBox": _LIST,
    "transform-origin": r"0(px)?[\s,]+0(px)?",
    "transform": r"(\s*(matrix|translate|scale|rotate|skewX|skewY)\s*\([-+.,eE\d\s]*\d[-+.,eE\d\s]*\)[\s,]*)*",
    **dict.fromkeys((*_ACROSS, *_DOWN, "r"), _LENGTH),
}
"""Attributes that say where something is, and what may stand in them: svgelements passes over all else in silence."""
_SPACE = "{http://www.w3.org/2000/svg"
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_NUMBER = "number-of-shape"
"""Attribute that leads from a shape of svgelements to our knowledge of it."""
_MOST = 100_000
"""Greatest number of shapes, with every use of each: uses of uses multiply beyond any bound."""


def read_svg(given: OutlineFile) -> Drawing:
    """Read the shapes that are visible; `ValueError` names an element that cannot be read."""
    import svgelements

    plain = _Plain(ElementTree.parse(given.file).getroot())
    text = io.BytesIO(ElementTree.tostring(plain.root))
    drawing = Drawing(_PIXEL, ignored=plain.ignored)
    try:
        elements = list(svgelements.SVG.parse(text, reify=False, on_error="raise").elements())
    except (ArithmeticError, LookupError, TypeError, ValueError):
        raise ValueError(plain.culprit()) from None
    regions: list[list[DrawnCurve]] = [[] for _ in range(plain.clips)]
    for element in elements:
        if isinstance(element, svgelements.Text | svgelements.Image):
            drawing.ignored[type(element).__name__.lower()] += 1
        elif isinstance(element, svgelements.Shape):
            shape = plain.shapes[int(element.values[_NUMBER])]
            curves = list(_curves(element, shape))
            (drawing.curves if shape.clip is None else regions[shape.clip]).extend(curves)
            if not curves and shape.clip is None:
                drawing.ignored["shape that is not visible"] += 1
    clipped = {shape.source: shape.clipped for shape in plain.shapes}
    shown = []
    for curve in drawing.curves:
        within = [regions[k] for k in clipped[curve.source]]
        shown += [_on_page(part, elements[0].width, elements[0].height) for part in _clipped(curve, within)]
    drawing.curves = shown
    return drawing


@dataclass(frozen=True)
class _Shape:
    """A shape as the file has it: its name in messages, those that choose it, and the elements around it.

    ``clip`` is the number of the clip path that it belongs to, ``clipped`` has the clip paths that cut it.
    """

    label: str
    names: tuple[str, ...]
    group: tuple[int, ...]
    source: Hashable
    data: str
    clip: int | None
    clipped: tuple[int, ...]


class _Plain:
    """The document without references and inner viewports, which svgelements places wrongly or draws where they stand.

    Attributes
    ----------
    root : Element
        Groups and shapes alone; symbols, nested drawings and uses have become groups.
    shapes : list of _Shape
        By the number that each shape carries.
    ignored : Counter of str
    clips : int
        Number of times that clip paths are used.
    """

    def __init__(self, root: Element) -> None:
        self.targets = {element.get("id"): element for element in root.iter() if element.get("id")}
        self.shapes: list[_Shape] = []
        self.ignored: Counter[str] = Counter()
        self.clips = 0
        self._kinds: Counter[str] = Counter()
        self._clip: int | None = None
        self._cutting: dict[Element, int] = {}
        if _tag(root) != "svg":
            raise ValueError(f"expected an svg element, got {str(root.tag)[:60]!r}")
        _check(root, _named(root))
        own = {key: value for key, value in root.attrib.items() if key not in ("x", "y")}
        self.root = Element(root.tag, own)
        # Styles first: svgelements applies them to what follows.
        self.root.extend([element for element in root.iter() if _tag(element) == "style"])
        self._fill(self.root, root, (root,), _viewport(root, (100.0, 100.0)))

    def culprit(self) -> str:
        """The first shape whose data cannot be read."""
        import svgelements

        for shape in self.shapes:
            try:
                svgelements.Path(shape.data)
            except ValueError:
                return f"{shape.label}: d = {shape.data[:60]!r} is not read"
        return "svgelements cannot place its content"

    def _fill(self, into: Element, source: Element, within: tuple[Element, ...], viewport: PlanePoint) -> None:
        """Append what the children of an element draw to a group of the plain document."""
        for child in source:
            self._add(into, child, within, viewport)

    def _add(self, into: Element, element: Element, within: tuple[Element, ...], viewport: PlanePoint) -> None:
        tag = _tag(element)
        if tag in (*_SHAPES, *_GROUPS, "use"):
            self._cut(into, element, within, viewport)
        if tag in _SHAPES:
            into.append(self._shape(element, tag, within, viewport))
        elif tag in ("text", "image"):
            into.append(Element(element.tag, element.attrib))
        elif tag == "use":
            self._use(into, element, within, viewport)
        elif tag in _GROUPS:
            self._group(into, element, element, within, viewport)

    def _cut(self, into: Element, element: Element, within: tuple[Element, ...], viewport: PlanePoint) -> None:
        """Append the clip path of an element, where the element stands."""
        if element.get("mask", "none") != "none" or "mask:" in element.get("style", ""):
            self.ignored[f"mask of {_named(element)}, which is not applied"] += 1
        words = f"clip-path:{element.get('clip-path', '')};{element.get('style', '')}"
        used = re.findall(r"clip-path\s*:\s*url\([\"']?#([^)\"']*)", words)
        target = self.targets.get(used[-1]) if used else None
        if target is None or self._clip is not None:
            return
        if target.get("clipPathUnits") == "objectBoundingBox":
            self.ignored[f"clip path {used[-1]!r}, which is not applied"] += 1
            return
        self._clip = self._cutting[element] = self.clips
        self.clips += 1
        place = ElementTree.SubElement(into, f"{_SPACE}}}g", {"transform": element.get("transform", "")})
        self._group(place, target, target, within, viewport)
        self._clip = None

    def _group(
        self, into: Element, element: Element, sized: Element, within: tuple[Element, ...], viewport: PlanePoint
    ) -> None:
        """Append a group; ``sized`` has the size of a viewport, which a use may state for its target."""
        _check(element, _named(element))
        group = ElementTree.SubElement(into, f"{_SPACE}}}g", _without_place(element))
        if _tag(element) in ("svg", "symbol"):
            group.set("transform", f"{element.get('transform', '')} {_placed(element, sized, viewport)}")
            viewport = _viewport(element, viewport)
        self._fill(group, element, (*within, element), viewport)

    def _use(self, into: Element, element: Element, within: tuple[Element, ...], viewport: PlanePoint) -> None:
        reference = next((element.attrib[key] for key in _REFERENCES if key in element.attrib), "")
        target = self.targets.get(reference.removeprefix("#"))
        if target is None or target in within:
            self.ignored[f"use of {reference!r}, which is not in the file"] += 1
            return
        group = ElementTree.SubElement(into, f"{_SPACE}}}g", _without_place(element))
        _check(element, _named(element))
        x, y = (_length(element.get(key, "0"), whole) for key, whole in zip("xy", viewport, strict=True))
        group.set("transform", f"{element.get('transform', '')} translate({x!r}, {y!r})")
        if _tag(target) in ("svg", "symbol"):
            self._group(group, target, element, (*within, element), viewport)
        else:
            self._add(group, target, (*within, element), viewport)

    def _shape(self, element: Element, tag: str, within: tuple[Element, ...], viewport: PlanePoint) -> Element:
        if len(self.shapes) >= _MOST:
            raise ValueError(f"more than {_MOST} shapes")
        self._kinds[tag] += self._clip is None
        ordinal = f"{tag} {self._kinds[tag]}"
        names = [*_names(element), ordinal, *(name for outer in reversed(within[1:]) for name in _names(outer))]
        label = _named(element) if names[0] != ordinal else ordinal
        _check(element, label)
        data = element.get("d", "")
        clipped = tuple(self._cutting[outer] for outer in (*within, element) if outer in self._cutting)
        count = len(self.shapes)
        group = tuple(map(id, within))
        self.shapes.append(_Shape(label, tuple(dict.fromkeys(names)), group, count, data, self._clip, clipped))
        number = {_NUMBER: str(count), "d": data}
        return Element(element.tag, {**element.attrib, **_without_percent(element, viewport), **number})


def _without_percent(element: Element, viewport: PlanePoint) -> dict[str, str]:
    """Lengths of an element that are shares of the viewport around it, in user units."""
    wholes = {**dict.fromkeys(_ACROSS, viewport[0]), **dict.fromkeys(_DOWN, viewport[1])}
    wholes["r"] = math.hypot(*viewport) / math.sqrt(2.0)
    shares = {key: whole for key, whole in wholes.items() if "%" in element.get(key, "")}
    return {key: repr(_length(element.attrib[key], whole)) for key, whole in shares.items()}


def _names(element: Element) -> list[str]:
    """Names of an element in the file: its own, and what Inkscape shows, which calls layers so."""
    return [name for name in (element.get("id"), element.get(_LABEL)) if name]


def _named(element: Element) -> str:
    """An element in a message."""
    return " ".join([_tag(element), *map(repr, _names(element)[:1])])


def _check(element: Element, label: str) -> None:
    """Refuse what svgelements would pass over in silence, by `ValueError`."""
    for key, pattern in _GRAMMAR.items():
        text = element.get(key)
        if text is not None and not re.fullmatch(pattern, text):
            raise ValueError(f"{label}: {key} = {text[:60]!r} is not read")


def _curves(element: Any, shape: _Shape) -> Iterator[DrawnCurve]:
    """Each subpath of a visible shape."""
    import svgelements

    values = element.values
    clear = re.fullmatch(r"0*\.?0*%?", values.get("opacity", "1"))
    if clear or values.get("visibility", "visible") in ("hidden", "collapse"):
        return
    fill, stroke = (_paint(element.fill), _paint(element.stroke)) if shape.clip is None else ("dark", "")
    if not fill and not stroke:
        return
    pieces = [(distinct(map(tuple, points.tolist())), closed) for points, closed in _pieces(svgelements.Path(element))]
    pieces = [piece for piece in pieces if len(piece[0]) > 1]  # not those of a move alone
    for k, (points, closed) in enumerate(pieces, 1):
        part = f"[{k}]" if len(pieces) > 1 else ""
        names = (shape.names[0] + part, *shape.names) if part else shape.names
        yield DrawnCurve(
            f"{shape.label} {part}".strip(),
            names,
            points,
            closed=len(points) > 2 and (closed or bool(fill)),
            group=shape.group,
            source=shape.source,
            filled=fill == "dark",
            ground="dark" not in (fill, stroke),
        )


def _clipped(curve: DrawnCurve, clips: list[list[DrawnCurve]]) -> list[DrawnCurve]:
    """The curve as clip paths leave it: whole, none, or with a flaw."""
    import shapely

    drawn = curve.solid if curve.closed else shapely.LineString(curve.points)
    for clip in clips:
        region = shapely.union_all([part.solid for part in clip])
        if not region.intersects(drawn):
            return []
        if not region.buffer(1e-6 * max(curve.size)).covers(drawn):
            return [replace(curve, flaw="is cut by a clip path, which is not read: cut it, or release the clip")]
    return [curve]


def _on_page(curve: DrawnCurve, width: float, height: float) -> DrawnCurve:
    """The curve; where it is a rectangle as large as the page, a curve inside it may be the object."""
    import shapely

    page = shapely.box(0.0, -height, width, 0.0)
    if not curve.filled or curve.solid.symmetric_difference(page).area > 1e-3 * page.area:
        return curve
    return replace(curve, filled=False, group="page")


def _pieces(path: Any) -> list[tuple[Array, bool]]:
    """Points (n, 2) of each subpath, y up, and whether it is closed."""
    import numpy as np
    from svgelements import Close, Line, Move

    pieces: list[tuple[list[Any], bool]] = []
    ends = np.array([(segment.end.x, segment.end.y) for segment in path if segment.end is not None])
    size = float(np.ptp(ends, axis=0).max()) if len(ends) else 0.0
    for segment in path:
        if isinstance(segment, Move):
            pieces.append(([[segment.end]], False))
            continue
        if not pieces or pieces[-1][1]:  # what follows a close starts where the subpath started
            pieces.append(([[segment.start]], False))
        points, _ = pieces[-1]
        if isinstance(segment, Close):
            pieces[-1] = points, True
        else:
            points.append([segment.end] if isinstance(segment, Line) else _curved(segment, size))
    m = path.transform
    turn = np.array([[m.a, -m.b], [m.c, -m.d]])
    shift = np.array([m.e, -m.f])
    return [
        (np.concatenate([np.asarray(p, dtype=float) for p in parts]) @ turn + shift, closed) for parts, closed in pieces
    ]


def _curved(segment: Any, size: float) -> Array:
    """Points of a curved segment behind its start, whose chords are as near to it as chords of one of a given size."""
    import numpy as np

    rough = segment.npoint(np.linspace(0.0, 1.0, 9))
    length = float(np.hypot(*np.diff(rough, axis=0).T).sum())
    count = max(2, math.ceil(_CHORDS * math.sqrt(min(1.0, length / size if size else 1.0))))
    points: Array = segment.npoint(np.linspace(0.0, 1.0, count + 1))[1:]
    return points


def _paint(color: Any) -> str:
    """``dark``, ``white`` as the paper, or empty where nothing is painted."""
    if color is None or color.value is None or color.alpha == 0:
        return ""
    return "white" if color.red == color.green == color.blue == 255 else "dark"


def _tag(element: Element) -> str:
    """Name of an element of SVG; empty for elements of editors, comments and instructions."""
    if not isinstance(element.tag, str):
        return ""
    space, _, name = element.tag.rpartition("}")
    return name if space in ("", _SPACE) else ""


def _without_place(element: Element) -> dict[str, str]:
    return {key: value for key, value in element.attrib.items() if key not in _PLACES}


def _length(text: str, whole: float) -> float:
    """A length in user units; ``whole`` is 100 %."""
    import svgelements

    return float(svgelements.Length(text).value(ppi=96.0, relative_length=whole))


def _viewport(element: Element, outer: PlanePoint) -> PlanePoint:
    """Width and height of the user units inside a drawing or symbol."""
    box = element.get("viewBox", "").replace(",", " ").split()
    if len(box) == 4:
        return float(box[2]), float(box[3])
    width, height = (
        _length(element.get(key, "100%"), all_) for key, all_ in zip(("width", "height"), outer, strict=True)
    )
    return width, height


def _placed(element: Element, sized: Element, outer: PlanePoint) -> str:
    """The transform of an inner viewport; ``sized`` may have another size for it."""
    import svgelements

    x, y = (_length(element.get(key, "0"), whole) for key, whole in zip("xy", outer, strict=True))
    width, height = (
        _length(sized.get(key) or element.get(key) or "100%", whole)
        for key, whole in zip(("width", "height"), outer, strict=True)
    )
    box = element.get("viewBox")
    if box is None:
        return f"translate({x!r}, {y!r})"
    view = svgelements.Viewbox(box)
    aspect = element.get("preserveAspectRatio")
    inner = view.x, view.y, view.width, view.height
    if not (view.width and view.height):
        raise ValueError(f"{_named(element)}: viewBox = {box!r} has no size")
    return str(svgelements.Viewbox.viewbox_transform(x, y, width, height, *inner, aspect))
