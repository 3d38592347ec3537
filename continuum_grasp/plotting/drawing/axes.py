"""Figures, axes, colors and labels that all pictures share, without matplotlib's global state."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base import prefixed, split_unit
from continuum_grasp.plotting.drawing.style import Color, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

Box = tuple[float, float, float, float]
"""Left, right, bottom, top [m]."""


def new_figure(width: float = 6.4, height: float = 4.2, *, layout: str | None = "constrained") -> Figure:
    """An empty figure [inch] that a notebook shows; its axes are laid out, or where they were put with no layout."""
    from continuum_grasp.plotting.drawing.shown import ShownFigure

    return ShownFigure(figsize=(width, height), dpi=150, layout=layout, facecolor="white")


def new_axes(ax: Axes | None, width: float = 6.4, height: float = 4.2) -> Axes:
    """The axes given, or quiet axes in a new figure."""
    return ax if ax is not None else quiet(new_figure(width, height).add_subplot())


def plane_axes(ax: Axes | None, box: Box, colorbar: bool = True) -> Axes:
    """World axes, one scale for both: those given, or new ones in a figure that fits."""
    # at most 5.4 x 4.4 inch for the drawing itself; the rest is for labels, title and color bar
    wide = (box[1] - box[0]) / (box[3] - box[2])
    height = min(4.4, 5.4 / wide)
    ax = new_axes(ax, wide * height + (1.9 if colorbar else 0.8), height + 1.1)
    unit = show_box(ax, box)
    label(ax, f"x [{unit}]", f"y [{unit}]")
    return ax


def show_box(ax: Axes, box: Box) -> str:
    """Show these limits [m] at one scale for both axes; returns the unit that they count, mm below a meter."""
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlim(box[0], box[1])
    ax.set_ylim(box[2], box[3])
    return length_unit(max(box[1] - box[0], box[3] - box[2]), ax.xaxis, ax.yaxis)


def length_unit(extent: float, *shown: Axis) -> str:
    """Unit of axes of lengths [m] that show an extent [m]: below a meter they count mm."""
    if extent >= 1.0:
        return "m"
    _count_parts(1e3, *shown)
    return "mm"


def shown_unit(unit: str, axis: Axis) -> str:
    """Unit that an axis counts of values in an SI unit: mm below a meter, and mN or µN of small forces."""
    low, high = axis.get_view_interval()
    if unit == "m":
        return length_unit(high - low, axis)
    factor, shown = prefixed(unit, max(abs(low), abs(high)))
    if factor != 1.0:
        _count_parts(factor, axis)
    return shown


def shown_label(text: str, axis: Axis) -> str:
    """A label ``name [unit]`` of an SI unit with the unit that its axis counts (`shown_unit`)."""
    name, unit = split_unit(text)
    return f"{name} [{shown_unit(unit, axis)}]" if unit else name


def _count_parts(factor: float, *shown: Axis) -> None:
    for axis in shown:
        axis.set_major_formatter(lambda value, _: f"{factor * value + 0.0:.5g}".replace("-", "\N{MINUS SIGN}"))


def label(ax: Axes, x: str, y: str, **style: Any) -> None:
    """Write what the axes count, with units."""
    ax.set_xlabel(x, color=Color.INK, **style)
    ax.set_ylabel(y, color=Color.INK, **style)


def whole_numbers(*shown: Axes) -> None:
    """Count in whole numbers on x axes, of which there may be one only."""
    for ax in shown:
        ax.locator_params(axis="x", integer=True, min_n_ticks=1)


def color_bar(ax: Axes, drawn: ScalarMappable, text: str = "time [s]") -> None:
    """A bar beside the axes for what is colored by a quantity."""
    bar = ax.figure.colorbar(drawn, ax=ax, pad=0.03)
    bar.set_label(shown_label(text, bar.ax.yaxis), color=Color.INK)
    bar.ax.tick_params(colors=Color.INK, labelsize=9)
    bar.outline.set_visible(False)


def draw_timed(
    ax: Axes, lines: Iterable[NDArray[Any]], at: NDArray[Any], t: NDArray[Any], width: float = 2.0
) -> LineCollection:
    """Draw n lines (points, 2) in the colors of their instants (n,) [s] within all instants t, with a color bar."""
    from matplotlib.collections import LineCollection

    drawn = LineCollection(list(lines), cmap=time_map(), linewidths=width, capstyle="round", zorder=Z.SHAPE)
    drawn.set_array(at)
    # a run of one instant has no range of its own
    drawn.set_clim(float(t[0]), float(t[-1]) if t[-1] > t[0] else float(t[0]) + 1.0)
    ax.add_collection(drawn)
    color_bar(ax, drawn)
    return drawn


def quiet(ax: Axes) -> Axes:
    """Leave out the frame's top and right side, and draw a light grid behind everything."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_color(Color.GRAY)
    ax.tick_params(colors=Color.INK, labelsize=9)
    ax.grid(True, color="#E4E4E4", linewidth=0.6)
    ax.set_axisbelow(True)
    return ax


def head(ax: Axes, name: str | None, columns: int = 4) -> None:
    """Above the axes: the name, where there is no title yet, and under it a legend of what has a label."""
    entries = len(ax.get_legend_handles_labels()[1])
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
        legend.set_in_layout(False)  # the title's padding keeps its place free already
    if not ax.get_title() and not ax.get_title("left"):
        rows = -(-entries // columns)
        # 15 points per row of 9-point text; an empty title takes the same place, so that axes of all pictures align
        ax.set_title(
            wrapped(plain(name or " "), ax.get_position().width * ax.figure.bbox.width / ax.figure.dpi),
            fontsize=10,
            color=Color.INK,
            loc="left",
            pad=7.0 + 15.0 * rows,
        )


def over_time(columns: int = 4) -> Callable[[Callable[[Axes, Any], str]], Callable[..., Axes]]:
    """Make a picture of what draws curves of a result over time into axes, and returns what they are, with the unit."""

    def decorate(draw: Callable[[Axes, Any], str]) -> Callable[..., Axes]:
        def plot(result: Any, *, ax: Axes | None = None) -> Axes:
            ax = new_axes(ax)
            ax.margins(x=0.0)
            label(ax, "time [s]", shown_label(draw(ax, result), ax.yaxis))
            head(ax, result.name, columns)
            return ax

        plot.__doc__ = draw.__doc__
        return plot

    return decorate


def curves(ax: Axes, t: ArrayLike, rows: Iterable[ArrayLike], names: Sequence[str | None], **style: Any) -> None:
    """Draw rows (T,) over instants t (T,), each in a color of its own."""
    for values, name, color in zip(rows, names, colors(len(names)), strict=True):
        ax.plot(t, values, **{"color": color, "linewidth": 1.4, "label": name, **style})


def plain(text: str) -> str:
    """A text of users as matplotlib shows it letter by letter: between two dollar signs it would read a formula."""
    return text.replace("$", r"\$")


def wrapped(text: str, width: float) -> str:
    """A text of 10 points in lines no wider [inch]: what sticks out is cut off, or takes the place of the axes."""
    # 11.5: letters of 10 points per inch
    return "\n".join(textwrap.wrap(text, max(int(11.5 * width), 24), max_lines=5, placeholder=" ...")) or text


def words(name: str) -> str:
    """``"tip_moment [N m]"`` as it is written in a legend: without unit and underscores."""
    return split_unit(name).name.replace("_", " ")


def symbol(name: str) -> str:
    """A name as it is typeset in a legend: ``theta_1`` becomes the Greek letter with an index."""
    match = re.fullmatch(r"(theta|kappa|tau|phi)_?(\d*)", name)
    if not match:
        return name
    index = f"_{{{match[2]}}}" if match[2] else ""
    return rf"$\{match[1]}{index}$"


def colors(count: int) -> list[Any]:
    """Colors for so many curves: distinct ones for a few, an ordered scale for many."""
    few = [Color.BLUE, Color.ORANGE, Color.GREEN, Color.PURPLE, Color.YELLOW, Color.SKY]
    return few[:count] if count <= len(few) else list(time_map()(np.linspace(0.0, 1.0, count)))


def time_map() -> Colormap:
    """Dark to light for early to late, without the palest end, which is lost on white."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.93, 256)), name="time")


def bend_box(points: Sequence[NDArray[Any]], margin: float, slimmest: float = 0.5) -> Box:
    """Limits around world points (..., 2), with a margin on every side [m]; those that are not finite are left out.

    Neither side is shorter than ``slimmest`` of the other: a straight finger would leave a strip without ticks.
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


def inline_svg(ax: Axes, name: str, described: str) -> str:
    """Some axes without their title as an SVG element that refers to nothing outside itself, as wide as it may be.

    Ids begin with ``name``, letters and digits, so that several elements fit on one page; ``described`` is for those
    who cannot see it, escaped already. The same drawing gives the same text.
    """
    from matplotlib import rc_context
    from matplotlib.text import Text

    buffer, figure = io.StringIO(), cast("Figure", ax.get_figure(root=True))
    titles = {ax.get_title(loc=where) for where in ("left", "center", "right")} - {""}
    heads = [artist for artist in ax.get_children() if isinstance(artist, Text) and artist.get_text() in titles]
    hidden = [
        artist for artist in (*(other for other in figure.axes if other is not ax), *heads) if artist.get_visible()
    ]
    for artist in hidden:
        artist.set_visible(False)
    try:
        box = cast("Bbox", ax.get_tightbbox()).padded(2.0).transformed(figure.dpi_scale_trans.inverted())
        # without a salt matplotlib draws ids at random; date and metadata would differ from run to run
        with rc_context({"svg.hashsalt": name}):
            figure.savefig(buffer, format="svg", metadata={"Date": None}, bbox_inches=box)
    finally:
        for artist in hidden:
            artist.set_visible(True)
    text = re.sub(r"\A.*?(?=<svg)|<metadata>.*?</metadata>", "", buffer.getvalue(), flags=re.DOTALL)
    opening, rest = text.split(">", 1)
    opening = re.sub(r' (width|height|version|xmlns(:\w+)?)="[^"]*"', "", opening)
    rest = rest.replace("xlink:href", "href")  # HTML has no name spaces
    return f'{opening} role="img" aria-label="{described}">' + re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{name}-", rest)
