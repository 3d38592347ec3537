"""Apply clip paths, masks and other effects of SVG to the shapes of an element."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from continuum_grasp.scene.objects.drawings.svg_geometry import SHAPES, box, check, moved, named, rectangle, transform
from continuum_grasp.scene.objects.drawings.svg_shape import DrawnShape, masked
from continuum_grasp.scene.objects.drawings.svg_style import Styles
from continuum_grasp.scene.polygons import PlanePoint

MOVING = ("animate", "animateColor", "animateMotion", "animateTransform", "set")
_EFFECTS = {
    **dict.fromkeys(("filter", "animation", "animation-name", "mask-image", "offset-path", "perspective"), ("none",)),
    **dict.fromkeys(("rotate", "scale", "translate", "refX", "refY"), ("none", "0")),
    "clip": ("auto",),
    "mix-blend-mode": ("normal", "multiply", "darken"),
    "transform-box": ("view-box",),
    "zoom": ("1", "normal"),
}
"""Unsupported properties that change the visible shape, with their harmless values."""
_BOX = "objectBoundingBox"


@dataclass(frozen=True)
class ElementPlace:
    """Place where an element is drawn.

    Attributes
    ----------
    matrix : svgelements.Matrix
        From user units to the page.
    viewport : (float, float)
        Lengths of 100 % [user units].
    style : dict
        Properties of the element around it.
    within : tuple of Element
        Elements around it, including the elements that use it.
    opacity : float
        Opacity of the elements around it.
    clips : bool
        Whether it is part of a clip path, which has areas without paint.
    """

    matrix: Any
    viewport: PlanePoint
    style: dict[str, str]
    within: tuple[Any, ...] = ()
    opacity: float = 1.0
    clips: bool = False

    def turned(self, label: str) -> ElementPlace:
        """Return the place with the transform of the element."""
        check(self.style, label)
        return replace(self, matrix=transform(self.style, self.viewport) * self.matrix)


class Effects:
    """Effects in a document.

    Attributes
    ----------
    target : callable
        Function from a reference to its element, or None.
    styles : Styles
    draw : callable
        Function from the children of a clip path or a mask, and their place, to their shapes; `ValueError` for other
        contents.
    """

    def __init__(
        self,
        root: Any,
        target: Callable[[str], Any],
        styles: Styles,
        draw: Callable[[list[Any], ElementPlace], list[DrawnShape]],
    ) -> None:
        self.target = target
        self.styles = styles
        self.draw = draw
        self._boxed = any(element.tag == "mask" or _BOX in element.attrib.values() for element in root.iter())

    def seen(self, element: Any, place: ElementPlace, shapes: list[DrawnShape]) -> list[DrawnShape]:
        """Return the shapes of an element after its clip path, mask and effects."""
        style = place.style
        if self._boxed:
            shapes = _boxed(shapes, place.matrix)
        flaws = [
            f"{key} of {named(element)}"
            for key, harmless in _EFFECTS.items()
            if style.get(key, harmless[0]).lower() not in harmless
        ]
        flaws += [f"{child.tag} in {named(element)}" for child in element if child.tag in MOVING]
        for key in ("clip-path", "mask"):
            text = style.get(key, "none")
            if text != "none":
                try:
                    region = self._region(key, text, place, shapes)
                    shapes = [shape.cut(region) for shape in shapes]
                except ValueError as error:
                    flaws.append(f"{key} of {named(element)}: {error}")
        if not flaws:
            return shapes
        flaw = f"is changed by {flaws[0]}, which is not read: apply or remove it in the program that drew it"
        return [replace(shape, flaw=shape.flaw or flaw) for shape in shapes]

    def _region(self, key: str, text: str, place: ElementPlace, shapes: list[DrawnShape]) -> Any:
        """Return the region that a clip path or a mask leaves visible."""
        match = re.fullmatch(r"url\(\s*[\"']?([^)\"']*)[\"']?\s*\)", text)
        target = self.target(match[1]) if match else None
        if target is None or target.tag != {"clip-path": "clipPath", "mask": "mask"}[key]:
            raise ValueError(f"{text[:60]!r} is no {key} of this file")
        if target in place.within:
            raise ValueError(f"{text[:60]!r} refers to itself")
        style = self.styles.in_place(target)
        check(style, named(target))
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

    def _clip(self, target: Any, place: ElementPlace) -> Any:
        """Return the region of a clip path, which contains only shapes and uses of shapes."""
        import shapely

        inner = place.turned(named(target))
        children = [child for child in target if child.tag in (*SHAPES, "use", "text")]
        shapes = self.draw(children, inner)
        if flawed := next((shape for shape in shapes if shape.flaw), None):
            raise ValueError(f"{flawed.label} {flawed.flaw}")
        return shapely.union_all([shape.area for shape in shapes if shape.fill])

    def _mask(self, target: Any, inner: ElementPlace, whole: Any, outer: ElementPlace) -> Any:
        """Return the region of a mask, within its rectangle."""
        shapes = self.draw(list(target), inner)
        in_box = target.get("maskUnits", _BOX) == _BOX
        default = {"x": "-10%", "y": "-10%", "width": "120%", "height": "120%"}
        sides = box(default | dict(target.attrib), (1.0, 1.0) if in_box else outer.viewport, {})
        by_alpha = inner.style.get("mask-type") == "alpha"
        frame = rectangle(whole * outer.matrix if in_box else outer.matrix, *sides)
        return masked(shapes, by_alpha).intersection(frame)


def _boxed(shapes: list[DrawnShape], matrix: Any) -> list[DrawnShape]:
    """Return shapes with the box around all of them, along the element's axes."""
    import numpy as np

    whole = rectangle(_box(shapes, matrix) * matrix, 0.0, 0.0, 1.0, 1.0)
    corners = np.array(whole.exterior.coords)
    return [replace(shape, whole=corners) if len(shape.whole) else shape for shape in shapes]


def _box(shapes: list[DrawnShape], matrix: Any) -> Any:
    """Return the transform from the unit square to the box around shapes in user units."""
    import numpy as np
    import svgelements

    every = [moved(shape.whole, ~matrix) for shape in shapes if len(shape.whole)] if matrix.determinant else []
    if not every:
        return svgelements.Matrix()
    (left, top), (right, bottom) = (f(np.concatenate(every), axis=0).tolist() for f in (np.min, np.max))
    return svgelements.Matrix(right - left, 0.0, 0.0, bottom - top, left, top)
