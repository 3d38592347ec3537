"""Pictures as a part of a web page."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["inline_svg"]

_HEAD = re.compile(r"\A.*?(?=<svg)", re.DOTALL)
_METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)
_NAMES = re.compile(r'( id="|href="#|url\(#)')


def inline_svg(ax: Axes, name: str, label: str) -> str:
    """The figure of some axes as an SVG element that refers to nothing outside itself.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    name : str
        What the names inside it begin with, so that several such elements fit on one page: letters and digits.
    label : str
        What it shows, for those who cannot see it; escaped already.

    Returns
    -------
    str
        Without width and height: it is as wide as the page lets it be. The same text for the same drawing.
    """
    from matplotlib import rc_context

    buffer = io.StringIO()
    with rc_context({"svg.hashsalt": name}):
        ax.figure.savefig(buffer, format="svg", metadata={"Date": None})  # type: ignore[union-attr]
    text = _METADATA.sub("", _HEAD.sub("", buffer.getvalue()))
    opening, rest = text.split(">", 1)
    opening = re.sub(r' (width|height|version|xmlns(:\w+)?)="[^"]*"', "", opening)
    rest = rest.replace("xlink:href", "href")
    return f'{opening} role="img" aria-label="{label}">' + _NAMES.sub(rf"\g<1>{name}-", rest)
