"""Colors of SVG: lightness, opacity, and whether they show the filled area."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

REFERENCES = ("href", "{http://www.w3.org/1999/xlink}href")
_LINK = re.compile(r"url\(\s*[\"']?([^)\"']*)[\"']?\s*\)\s*(.*)", re.DOTALL)


@dataclass(frozen=True)
class Paint:
    """Visible color of an area or a stroke.

    Attributes
    ----------
    light : float
        Luminance from 0, black, to 1, white.
    alpha : float
        Opacity, above 0.
    flaw : str
        Reason why the paint does not show the filled area; empty if it does.
    even : bool
        Whether the color is uniform.
    """

    light: float
    alpha: float
    flaw: str = ""
    even: bool = True


class Paints:
    """Paints of a document: ``find`` gives the element with an id, ``style`` the properties of an element."""

    def __init__(self, find: Callable[[str], Any], style: Callable[[Any], Mapping[str, str]]) -> None:
        self._find = find
        self._style = style

    def of(self, style: Mapping[str, str], key: str, opacity: float) -> Paint | None:
        """Return ``fill`` or ``stroke`` of an element; None if it paints nothing."""
        text = style.get(key, "black" if key == "fill" else "none")
        share = opacity * fraction(style.get(f"{key}-opacity", "1"))
        paint = self._paint(text, style.get("color", "black"))
        return replace(paint, alpha=share * paint.alpha) if paint and share > 0.0 else None

    def _paint(self, text: str, current: str) -> Paint | None:
        link = _LINK.fullmatch(text)
        if link is None:
            return color(text, current)
        server = self._find(link[1])
        tag = "" if server is None else server.tag
        if tag in ("linearGradient", "radialGradient"):
            return self._gradient(server, link[1])
        if tag == "pattern":
            return Paint(0.0, 1.0, f"has a pattern, {link[1]!r}, whose gaps are not read: give it a color")
        if server is not None or not link[1].startswith("#"):
            return Paint(0.0, 1.0, f"has a paint, {link[1]!r}, which is not read: give it a color")
        return color(link[2] or "none", current)

    def _gradient(self, server: Any, name: str) -> Paint | None:
        """Return the darkest and least transparent stop of a gradient, which may take its stops from another one."""
        stops = [paint for stop in self._stops(server) if (paint := self._stop(stop))]
        if not stops:
            return None
        clear = any(paint.alpha == 0.0 for paint in stops)
        flaw = f"fades out in the gradient {name!r}, which is not read: give it a color" if clear else ""
        even = all(paint == stops[0] for paint in stops)
        return Paint(min(paint.light for paint in stops), max(paint.alpha for paint in stops), flaw, even)

    def _stops(self, server: Any) -> Iterator[Any]:
        seen: list[Any] = []
        while server is not None and server not in seen:
            stops = server.findall("stop")
            if stops:
                yield from stops
                return
            seen.append(server)
            server = self._find(next((server.get(key) for key in REFERENCES if server.get(key)), ""))

    def _stop(self, stop: Any) -> Paint:
        style = self._style(stop)
        paint = color(style.get("stop-color", "black"), style.get("color", "black"))
        alpha = paint.alpha * fraction(style.get("stop-opacity", "1")) if paint else 0.0
        return Paint(paint.light if paint else 0.0, alpha)


def color(text: str, current: str) -> Paint | None:
    """Return a color of CSS; None for ``none`` or a transparent one."""
    from tinycss2.color4 import parse_color

    if text == "none":
        return None
    try:
        value = parse_color(current if text.lower() == "currentcolor" else text).to("srgb")
    except (AttributeError, NotImplementedError):
        return Paint(0.0, 1.0, f"has the color {text[:60]!r}, which is not read")
    red, green, blue = value.coordinates
    light = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return Paint(round(light, 6), value.alpha) if value.alpha > 0.0 else None


def fraction(text: str) -> float:
    """A number from 0 to 1, or a percentage."""
    try:
        value = float(text.strip().removesuffix("%")) / (100.0 if text.strip().endswith("%") else 1.0)
    except ValueError:
        raise ValueError(f"the opacity {text[:60]!r} is not read") from None
    return min(max(value, 0.0), 1.0)
