"""Curves of SVG drawings: every shape is one path, with all transforms, in the unit of the document."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from continuum_grasp.scene.objects.drawings.curves import Curve, Drawing, distinct
from continuum_grasp.scene.parts import Point

_PIXEL = 0.0254 / 96.0
"""Length of a user unit of SVG [m]: 96 per inch, by CSS."""
_CHORDS = 128
"""Chords of a curved segment: they keep a half circle to 8e-5 of its radius, (pi / 128)^2 / 8."""
_SHAPES = ("path", "rect", "circle", "ellipse", "line", "polyline", "polygon")
_GROUPS = ("g", "a", "switch", "svg")
_PLACES = ("x", "y", "width", "height", "viewBox", "preserveAspectRatio", "href", "{http://www.w3.org/1999/xlink}href")
"""Attributes that say where an element is, which its children do not inherit."""
_LIST = r"[-+.,eE\d\s]*"
_LENGTH = r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*(px|mm|cm|in|pt|pc|%)?\s*|auto"
_GRAMMAR = {
    "d": r"[MmZzLlHhVvCcSsQqTtAaeE\d+\-.,\s]*",
    "points": _LIST,
    "viewBox": _LIST,
    "transform": r"(\s*(matrix|translate|scale|rotate|skewX|skewY)\s*\([-+.,eE\d\s]*\d[-+.,eE\d\s]*\)[\s,]*)*",
    **dict.fromkeys("x y width height cx cy r rx ry x1 y1 x2 y2".split(), _LENGTH),
}
"""Attributes that say where something is, and what may stand in them: svgelements passes over all else in silence."""
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_NUMBER = "number-of-shape"
"""Attribute that leads from a shape of svgelements to what is known of it here."""


def read_svg(file: str) -> Drawing:
    """Read the shapes that are visible; `ValueError` names an element that cannot be read."""
    import svgelements

    plain = _Plain(ElementTree.parse(file).getroot())
    text = io.BytesIO(ElementTree.tostring(plain.root))
    drawing = Drawing(_PIXEL, ignored=plain.ignored)
    try:
        elements = list(svgelements.SVG.parse(text, reify=False, on_error="raise").elements())
    except ValueError:
        raise ValueError(plain.culprit()) from None
    for element in elements:
        if isinstance(element, svgelements.Text | svgelements.Image):
            drawing.ignored[type(element).__name__.lower()] += 1
        elif isinstance(element, svgelements.Shape):
            shape = plain.shapes[int(element.values[_NUMBER])]
            curves = list(_curves(element, shape))
            drawing.curves += curves
            if not curves:
                drawing.ignored["shape that is not visible"] += 1
    return drawing


@dataclass(frozen=True)
class _Shape:
    """A shape as the file has it: its name in messages, those that choose it, and the elements around it."""

    label: str
    names: tuple[str, ...]
    group: tuple[int, ...]
    data: str


class _Plain:
    """The document without references and inner viewports, which svgelements places wrongly or draws where they stand.

    Attributes
    ----------
    root : Element
        Groups and shapes alone; symbols, nested drawings and uses have become groups.
    shapes : list of _Shape
        By the number that each shape carries.
    ignored : Counter of str
    """

    def __init__(self, root: Element) -> None:
        self.targets = {element.get("id"): element for element in root.iter() if element.get("id")}
        self.shapes: list[_Shape] = []
        self.ignored: Counter[str] = Counter()
        self._kinds: Counter[str] = Counter()
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
        return "not a drawing"

    def _fill(self, into: Element, source: Element, within: tuple[Element, ...], viewport: Point) -> None:
        """Append what the children of an element draw to a group of the plain document."""
        for child in source:
            self._add(into, child, within, viewport)

    def _add(self, into: Element, element: Element, within: tuple[Element, ...], viewport: Point) -> None:
        tag = _tag(element)
        if tag in _SHAPES:
            into.append(self._shape(element, tag, within))
        elif tag in ("text", "image"):
            into.append(Element(element.tag, element.attrib))
        elif tag == "use":
            self._use(into, element, within, viewport)
        elif tag in _GROUPS:
            self._group(into, element, element, within, viewport)

    def _group(
        self, into: Element, element: Element, sized: Element, within: tuple[Element, ...], viewport: Point
    ) -> None:
        """Append a group; ``sized`` has the size of a viewport, which a use may state for its target."""
        _check(element, _named(element))
        group = ElementTree.SubElement(into, _svg("g"), _without_place(element))
        if _tag(element) in ("svg", "symbol"):
            group.set("transform", f"{element.get('transform', '')} {_placed(element, sized, viewport)}")
            viewport = _viewport(element, viewport)
        self._fill(group, element, (*within, element), viewport)

    def _use(self, into: Element, element: Element, within: tuple[Element, ...], viewport: Point) -> None:
        reference = next((element.get(key) for key in _PLACES[-2:] if element.get(key)), "")
        target = self.targets.get((reference or "").removeprefix("#"))
        if target is None or target in within:
            self.ignored[f"use of {reference!r}, which is not in the file"] += 1
            return
        group = ElementTree.SubElement(into, _svg("g"), _without_place(element))
        _check(element, _named(element))
        x, y = (_length(element.get(key, "0"), whole) for key, whole in zip("xy", viewport, strict=True))
        group.set("transform", f"{element.get('transform', '')} translate({x!r}, {y!r})")
        if _tag(target) in ("svg", "symbol"):
            self._group(group, target, element, (*within, element), viewport)
        else:
            self._add(group, target, (*within, element), viewport)

    def _shape(self, element: Element, tag: str, within: tuple[Element, ...]) -> Element:
        self._kinds[tag] += 1
        ordinal = f"{tag} {self._kinds[tag]}"
        names = [*_names(element), ordinal, *(name for outer in reversed(within[1:]) for name in _names(outer))]
        label = _named(element) if names[0] != ordinal else ordinal
        _check(element, label)
        data = element.get("d", "")
        self.shapes.append(_Shape(label, tuple(dict.fromkeys(names)), tuple(map(id, within)), data))
        number = {_NUMBER: str(len(self.shapes) - 1), "d": data}
        return Element(element.tag, {**element.attrib, **number})


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


def _curves(element: Any, shape: _Shape) -> Iterator[Curve]:
    """Each subpath of a visible shape."""
    import svgelements

    values = element.values
    if values.get("visibility", "visible") in ("hidden", "collapse") or values.get("opacity") in ("0", "0%"):
        return
    fill, stroke = _paint(element.fill), _paint(element.stroke)
    if not fill and not stroke:
        return
    ground = "dark" not in (fill, stroke)
    path = svgelements.Path(element)
    pieces = [piece for piece in _pieces(path) if len(piece[0]) > 1]
    for k, (points, closed) in enumerate(pieces, 1):
        named = len(pieces) > 1
        yield Curve(
            f"{shape.label} [{k}]" if named else shape.label,
            (*((f"{shape.names[0]}[{k}]",) if named else ()), *shape.names),
            distinct(points),
            closed or (bool(fill) and len(points) > 2),
            shape.group,
            fill == "dark",
            ground,
        )


def _pieces(path: Any) -> list[tuple[list[Point], bool]]:
    """Points of each subpath, y up, and whether it is closed."""
    import numpy as np
    from svgelements import Close, Line, Move

    matrix = path.transform
    pieces: list[tuple[list[Any], bool]] = []
    for segment in path:
        if isinstance(segment, Move):
            pieces.append(([segment.end], False))
            continue
        if not pieces or pieces[-1][1]:  # what follows a close starts where the subpath started
            pieces.append(([segment.start], False))
        points, _ = pieces[-1]
        if isinstance(segment, Close):
            pieces[-1] = points, True
        elif isinstance(segment, Line):
            points.append(segment.end)
        else:
            points += [segment.point(t) for t in np.linspace(0.0, 1.0, _CHORDS + 1)[1:]]
    placed = [([matrix.point_in_matrix_space(point) for point in points], closed) for points, closed in pieces]
    return [([(float(p.x), -float(p.y)) for p in points], closed) for points, closed in placed]


def _paint(color: Any) -> str:
    """``dark``, ``white`` as the paper, or empty where nothing is painted."""
    if color is None or color.value is None or color.alpha == 0:
        return ""
    return "white" if color.red == color.green == color.blue == 255 else "dark"


def _tag(element: Element) -> str:
    """Name of an element of SVG; empty for those of editors, comments and instructions."""
    if not isinstance(element.tag, str):
        return ""
    space, _, name = element.tag.rpartition("}")
    return name if space in ("", "{http://www.w3.org/2000/svg") else ""


def _svg(name: str) -> str:
    return f"{{http://www.w3.org/2000/svg}}{name}"


def _without_place(element: Element) -> dict[str, str]:
    return {key: value for key, value in element.attrib.items() if key not in _PLACES}


def _length(text: str, whole: float) -> float:
    """A length in user units; ``whole`` is 100 %."""
    import svgelements

    return float(svgelements.Length(text).value(ppi=96.0, relative_length=whole))


def _viewport(element: Element, outer: Point) -> Point:
    """Width and height of the user units inside a drawing or symbol."""
    box = element.get("viewBox", "").replace(",", " ").split()
    if len(box) == 4:
        return float(box[2]), float(box[3])
    width, height = (
        _length(element.get(key, "100%"), all_) for key, all_ in zip(("width", "height"), outer, strict=True)
    )
    return width, height


def _placed(element: Element, sized: Element, outer: Point) -> str:
    """The transform of an inner viewport."""
    import svgelements

    at = (
        [0.0, 0.0]
        if sized is not element
        else [_length(element.get(key, "0"), w) for key, w in zip("xy", outer, strict=True)]
    )
    size = [
        _length(sized.get(key) or element.get(key) or "100%", whole)
        for key, whole in zip(("width", "height"), outer, strict=True)
    ]
    box = element.get("viewBox")
    if box is None:
        return f"translate({at[0]!r}, {at[1]!r})"
    view = svgelements.Viewbox(box)
    aspect = element.get("preserveAspectRatio")
    return str(svgelements.Viewbox.viewbox_transform(*at, *size, view.x, view.y, view.width, view.height, aspect))
