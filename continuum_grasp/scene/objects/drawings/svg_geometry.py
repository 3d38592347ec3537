"""Geometry of SVG elements: lengths, transforms and viewports, and the points of their shapes."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.drawings.curves import distinct
from continuum_grasp.scene.objects.drawings.svg_shape import Piece
from continuum_grasp.scene.polygons import PlanePoint
from continuum_grasp.scene.value import WRITTEN

SHAPES = ("path", "rect", "circle", "ellipse", "line", "polyline", "polygon")
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_CHORDS = 128
"""Chords of a curved segment as long as its path is large; shorter ones have fewer, with the same distance from the
curve: they keep a half circle to 1e-4 of its radius, about (pi / 128)^2 / 8."""
_ACROSS, _DOWN = ("x", "width", "cx", "rx", "x1", "x2"), ("y", "height", "cy", "ry", "y1", "y2")
_LIST = r"[-+.,eE\d\s]*"
_NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"
_LENGTH = rf"\s*{_NUMBER}\s*(px|mm|cm|in|pt|pc|%)?\s*"
_ARGUMENT = rf"\s*{_NUMBER}(px|deg|rad|turn|grad)?\s*"
_TURN = r"(matrix|(translate|scale)[XY]?|rotate|skew[XY])"
_SIDE = rf"({_LENGTH}|left|right|top|bottom|center)"
_GRAMMAR = {
    "d": r"[MmZzLlHhVvCcSsQqTtAaeE\d+\-.,\s]*",
    "points": _LIST,
    "viewBox": _LIST,
    "transform-origin": rf"\s*{_SIDE}([\s,]+{_SIDE})?({_LENGTH})?\s*",
    "transform": rf"none|(\s*{_TURN}\s*\({_ARGUMENT}([\s,]?{_ARGUMENT})*\)[\s,]*)*",
    "stroke-width": _LENGTH,
    **dict.fromkeys((*_ACROSS, *_DOWN, "r"), rf"{_LENGTH}|auto"),
}
"""Properties of position and size, with their syntax: svgelements silently ignores everything else."""


def names(element: Any) -> list[str]:
    """Return the names of an element: its id, and the label that Inkscape shows for layers."""
    return [name for name in (element.get("id"), element.get(_LABEL)) if name]


def named(element: Any) -> str:
    """An element in a message."""
    return " ".join([element.tag, *map(repr, names(element)[:1])])


def check(style: Mapping[str, str], label: str) -> None:
    """Refuse what svgelements would silently ignore, by `ValueError`."""
    for key, pattern in _GRAMMAR.items():
        text = style.get(key)
        if text is not None and not re.fullmatch(pattern, text):
            raise ValueError(f"{label}: {key} = {text[:60]!r} is not read")


def length(text: str, whole: float) -> float:
    """A length in user units; ``whole`` is 100 %."""
    import svgelements

    return float(svgelements.Length(text).value(ppi=96.0, relative_length=whole))


def transform(style: Mapping[str, str], viewport: PlanePoint) -> Any:
    """The transform of an element around its origin."""
    import svgelements

    text = style.get("transform", "none")
    if text == "none":
        return svgelements.Matrix()
    x, y = _origin(style.get("transform-origin", "0 0"), viewport)
    return svgelements.Matrix(f"translate({x!r}, {y!r}) {text} translate({-x!r}, {-y!r})")


def _origin(text: str, viewport: PlanePoint) -> PlanePoint:
    """Point about which a transform turns."""
    words = {"left": "0%", "right": "100%", "top": "0%", "bottom": "100%", "center": "50%"}
    sides = [*text.replace(",", " ").split(), "center"][:2]
    if sides[0] in ("top", "bottom") or sides[1] in ("left", "right"):
        sides.reverse()
    x, y = (length(words.get(side, side), whole) for side, whole in zip(sides, viewport, strict=True))
    return x, y


def box(style: Mapping[str, str], outer: PlanePoint, sized: Mapping[str, str]) -> tuple[float, float, float, float]:
    """Return left, top, width and height of a viewport; ``sized`` may state another size."""
    wholes = {"x": outer[0], "y": outer[1], "width": outer[0], "height": outer[1]}
    sides = {"x": style.get("x", "0"), "y": style.get("y", "0")}
    for key in ("width", "height"):
        given = [text for text in (sized.get(key), style.get(key)) if text not in (None, "auto")]
        sides[key] = given[0] if given else "100%"
    x, y, width, height = (length(sides[key], whole) for key, whole in wholes.items())
    return x, y, width, height


def fitted(element: Any, label: str, place: tuple[float, float, float, float]) -> tuple[Any, PlanePoint]:
    """Return the transform from user units inside a viewport to units outside, and its size in units inside."""
    import svgelements

    x, y, width, height = place
    text = element.get("viewBox")
    if text is None:
        return svgelements.Matrix(f"translate({x!r}, {y!r})"), (width, height)
    check({"viewBox": text}, label)
    view = svgelements.Viewbox(text)
    if not (view.width and view.height):
        raise ValueError(f"{label}: viewBox = {text!r} has no size")
    inner = view.x, view.y, view.width, view.height
    aspect = element.get("preserveAspectRatio")
    fit = svgelements.Viewbox.viewbox_transform(x, y, width, height, *inner, aspect)
    return svgelements.Matrix(fit), (view.width, view.height)


def rectangle(matrix: Any, x: float, y: float, width: float, height: float) -> Any:
    """A rectangle of user units, on the page; shapely's."""
    import numpy as np
    import shapely

    corners = np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])
    return shapely.Polygon(moved(corners, matrix))


def moved(points: Array, matrix: Any) -> Array:
    """Points (n, 2) of user units, on the page."""
    import numpy as np

    turn = np.array([[matrix.a, matrix.b], [matrix.c, matrix.d]])
    on_page: Array = points @ turn + np.array([matrix.e, matrix.f])
    return on_page


def pieces(tag: str, style: Mapping[str, str], label: str, viewport: PlanePoint, matrix: Any) -> tuple[Piece, ...]:
    """Subpaths of a shape that are longer than a point, on the page."""
    import numpy as np
    import svgelements

    data = _data(tag, style, viewport)
    try:
        parts = _flattened(svgelements.Path(data))
    except (ArithmeticError, LookupError, TypeError, ValueError):
        raise ValueError(f"{label}: d = {data[:60]!r} is not read") from None
    every = []
    for points, closed in parts:
        ends_meet = math.dist(points[0], points[-1]) <= WRITTEN * float(np.ptp(points, axis=0).max())
        every.append((distinct(map(tuple, moved(points, matrix).tolist())), closed or ends_meet))
    return tuple(piece for piece in every if len(piece[0]) > 1)  # not those of a move alone


def _data(tag: str, style: Mapping[str, str], viewport: PlanePoint) -> str:
    """The path of a shape, as the data of a path of SVG."""
    if tag == "path":
        return style.get("d", "")
    if tag in ("polyline", "polygon"):
        points = style.get("points", "").strip()
        return f"M{points}{'z' if tag == 'polygon' else ''}" if points else ""
    wholes = {**dict.fromkeys(_ACROSS, viewport[0]), **dict.fromkeys(_DOWN, viewport[1])}
    wholes["r"] = math.hypot(*viewport) / math.sqrt(2.0)
    given = {key: text for key, text in style.items() if key in wholes and text != "auto"}
    sides = {key: length(given.get(key, "0"), whole) for key, whole in wholes.items()}
    rx, ry = sides["rx"], sides["ry"]
    rx, ry = (rx if "rx" in given else ry), (ry if "ry" in given else rx)
    if tag == "line":
        return f"M{sides['x1']!r},{sides['y1']!r}L{sides['x2']!r},{sides['y2']!r}"
    if tag == "rect":
        return _rounded(sides["x"], sides["y"], sides["width"], sides["height"], rx, ry)
    rx, ry = (sides["r"], sides["r"]) if tag == "circle" else (rx, ry)
    if not (rx > 0.0 and ry > 0.0):
        return ""
    half = f"a{rx!r},{ry!r} 0 1 1"
    return f"M{sides['cx'] - rx!r},{sides['cy']!r}{half} {2 * rx!r},0{half} {-2 * rx!r},0z"


def _rounded(x: float, y: float, width: float, height: float, rx: float, ry: float) -> str:
    """Data of the path of a rectangle with round corners."""
    if not (width > 0.0 and height > 0.0):
        return ""
    rx, ry = min(rx, 0.5 * width), min(ry, 0.5 * height)
    if not (rx > 0.0 and ry > 0.0):
        return f"M{x!r},{y!r}h{width!r}v{height!r}h{-width!r}z"
    across, down = width - 2 * rx, height - 2 * ry
    corners = [f"a{rx!r},{ry!r} 0 0 1 {dx!r},{dy!r}" for dx, dy in ((rx, ry), (-rx, ry), (-rx, -ry), (rx, -ry))]
    start = f"M{x + rx!r},{y!r}h{across!r}"
    return f"{start}{corners[0]}v{down!r}{corners[1]}h{-across!r}{corners[2]}v{-down!r}{corners[3]}z"


def _flattened(path: Any) -> list[tuple[Array, bool]]:
    """Points (n, 2) of each subpath, and whether it is closed."""
    import numpy as np
    from svgelements import Close, Line, Move

    parts: list[tuple[list[Any], bool]] = []
    ends = np.array([(segment.end.x, segment.end.y) for segment in path if segment.end is not None])
    size = float(np.ptp(ends, axis=0).max()) if len(ends) else 0.0
    for segment in path:
        if isinstance(segment, Move):
            parts.append(([[segment.end]], False))
            continue
        if not parts or parts[-1][1]:  # after a close the next segment starts at the start of the subpath
            parts.append(([[segment.start]], False))
        points, _ = parts[-1]
        if isinstance(segment, Close):
            parts[-1] = points, True
        else:
            points.append([segment.end] if isinstance(segment, Line) else _curved(segment, size))
    return [(np.concatenate([np.asarray(p, dtype=float) for p in points]), closed) for points, closed in parts]


def _curved(segment: Any, size: float) -> Array:
    """Return points of a curved segment after its start; chords deviate like the chords of a segment of a given
    size.
    """
    import numpy as np

    rough = segment.npoint(np.linspace(0.0, 1.0, 9))
    way = float(np.hypot(*np.diff(rough, axis=0).T).sum())
    count = max(2, math.ceil(_CHORDS * math.sqrt(min(1.0, way / size if size else 1.0))))
    points: Array = segment.npoint(np.linspace(0.0, 1.0, count + 1))[1:]
    return points
