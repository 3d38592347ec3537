"""Figures, axes, colors and labels that all pictures share, without matplotlib's global state."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.style import BLUE, GRAY, GREEN, INK, ORANGE, PURPLE, SKY, YELLOW

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

Box = tuple[float, float, float, float]

_SYMBOL = re.compile(r"(theta|kappa|tau|phi)_?(\d*)")


def new_figure(width: float = 6.4, height: float = 4.2) -> Figure:
    """An empty figure [inch] on an Agg canvas, unknown to pyplot."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def new_axes(ax: Axes | None, width: float = 6.4, height: float = 4.2) -> Axes:
    """The axes given, or quiet axes in a new figure."""
    return ax if ax is not None else quiet(new_figure(width, height).add_subplot())


def plane_axes(ax: Axes | None, box: Box, colorbar: bool = True) -> Axes:
    """World axes in meters, one scale for both: those given, or new ones in a figure that fits."""
    wide = (box[1] - box[0]) / (box[3] - box[2])
    height = min(4.4, 5.4 / wide)
    ax = new_axes(ax, wide * height + (1.9 if colorbar else 0.8), height + 1.1)
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlim(box[0], box[1])
    ax.set_ylim(box[2], box[3])
    ax.set_xlabel("x [m]", color=INK)
    ax.set_ylabel("y [m]", color=INK)
    return ax


def color_bar(ax: Axes, drawn: ScalarMappable, label: str = "time [s]") -> None:
    """A bar beside the axes for what is colored by a quantity."""
    bar = ax.figure.colorbar(drawn, ax=ax, pad=0.03)
    bar.set_label(label, color=INK)
    bar.ax.tick_params(colors=INK, labelsize=9)
    bar.outline.set_visible(False)


def quiet(ax: Axes) -> Axes:
    """Leave out the frame's top and right side, and draw a light grid behind everything."""
    ax.spines[["top", "right"]].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set_color(GRAY)
    ax.tick_params(colors=INK, labelsize=9)
    ax.grid(True, color="#E4E4E4", linewidth=0.6)
    ax.set_axisbelow(True)
    return ax


def head(ax: Axes, name: str | None, entries: int = 0, columns: int = 4) -> None:
    """Above the axes: the name, where there is no title yet, and under it a legend of so many entries."""
    if entries:
        legend = ax.legend(
            frameon=False,
            fontsize=9,
            ncols=columns,
            loc="lower left",
            bbox_to_anchor=(-0.015, 1.0),
            borderpad=0.2,
            handlelength=1.5,
            handletextpad=0.4,
            columnspacing=1.2,
        )
        legend.set_in_layout(False)  # the title keeps its place free
    if not ax.get_title() and not ax.get_title("left"):
        rows = -(-entries // columns)
        ax.set_title(name or " ", fontsize=10, color=INK, loc="left", pad=7.0 + 15.0 * rows)


def time_axes(ax: Axes, label: str, name: str | None, entries: int = 0, columns: int = 4) -> Axes:
    """Finish axes over time: what is drawn, with its unit, and what stands above."""
    ax.set_xlabel("time [s]", color=INK)
    ax.set_ylabel(label, color=INK)
    head(ax, name, entries, columns)
    return ax


def split_unit(name: str) -> tuple[str, str]:
    """Name and unit of ``"name [unit]"``; the unit is empty where there is none."""
    head, bracket, rest = name.partition("[")
    return head.strip(), rest.rpartition("]")[0].strip() if bracket else ""


def symbol(name: str) -> str:
    """A name as it is typeset in a legend: ``theta_1`` becomes the Greek letter with an index."""
    found = _SYMBOL.fullmatch(name)
    if not found:
        return name
    index = f"_{{{found[2]}}}" if found[2] else ""
    return rf"$\{found[1]}{index}$"


def colors(count: int) -> list[Any]:
    """Colors for so many curves: distinct ones for a few, an ordered scale for many."""
    few = [BLUE, ORANGE, GREEN, PURPLE, YELLOW, SKY]
    if count <= len(few):
        return few[:count]
    return list(time_map()(np.linspace(0.0, 1.0, count)))


def time_map() -> Colormap:
    """Dark to light for early to late, without the palest end, which is lost on white."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.93, 256)), name="time")


def bend_box(points: Sequence[NDArray[Any]], margin: float, slimmest: float = 0.5) -> Box:
    """Limits (left, right, bottom, top) [m] around world points (..., 2), with a margin on every side.

    Neither side is shorter than ``slimmest`` of the other.
    """
    flat = np.concatenate([np.reshape(p, (-1, 2)) for p in points])
    flat = flat[np.isfinite(flat).all(axis=1)]
    if not len(flat):
        flat = np.zeros((1, 2))
    low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
    sides = high - low
    more = np.maximum(0.0, slimmest * sides.max() - sides) / 2
    low, high = low - more, high + more
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


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
