"""The axes of a picture, with what all pictures share: units that people read, colors, name and legend."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base import prefixed, split_unit
from continuum_grasp.plotting.drawing.style import Color, Z, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

    from continuum_grasp.plotting.drawing.shown import ShownFigure

Box = tuple[float, float, float, float]
"""Left, right, bottom, top [m]."""


@dataclass(frozen=True)
class StyledAxes:
    """Axes of matplotlib, into which curves are drawn, and what all pictures write on theirs.

    Units are those that people read: below a meter axes count mm, small forces mN. A picture ends with `label`, what
    the axes count, and `head`, name and legend above them.
    """

    ax: Axes

    @staticmethod
    def figure(width: float = 6.4, height: float = 4.2, *, layout: str | None = "constrained") -> ShownFigure:
        """An empty figure [inch] that a notebook shows; axes are laid out, or where they were put with no layout."""
        from continuum_grasp.plotting.drawing.shown import ShownFigure

        return ShownFigure(figsize=(width, height), dpi=150, layout=layout, facecolor="white")

    @classmethod
    def on(cls, ax: Axes | None, width: float = 6.4, height: float = 4.2) -> StyledAxes:
        """The axes given, or the axes of a new figure [inch]."""
        return cls(cls.figure(width, height).add_subplot() if ax is None else ax)

    @classmethod
    def plane(cls, ax: Axes | None, box: Box, colorbar: bool = True) -> StyledAxes:
        """World axes, one scale for both: those given, or new ones in a figure that fits."""
        # at most 5.4 x 4.4 inch for the drawing itself; the rest is for labels, title and color bar
        wide = (box[1] - box[0]) / (box[3] - box[2])
        height = min(4.4, 5.4 / wide)
        styled = cls.on(ax, wide * height + (1.9 if colorbar else 0.8), height + 1.1)
        unit = styled.show_box(box)
        styled.label(f"x [{unit}]", f"y [{unit}]")
        return styled

    def show_box(self, box: Box) -> str:
        """Show these limits [m] at one scale for both axes; returns the unit that they count, mm below a meter."""
        self.ax.set_aspect("equal", adjustable="box")
        self.ax.set_xlim(box[0], box[1])
        self.ax.set_ylim(box[2], box[3])
        if max(box[1] - box[0], box[3] - box[2]) >= 1.0:
            return "m"
        self._count_parts(1e3, "x")
        self._count_parts(1e3, "y")
        return "mm"

    def show_around(self, points: Sequence[NDArray[Any]], margin: float) -> None:
        """Show world points (..., 2) with a margin on every side [m], and write what the axes count."""
        unit = self.show_box(bend_box(points, margin))
        self.label(f"x [{unit}]", f"y [{unit}]")

    def shown_label(self, text: str, axis: Literal["x", "y"]) -> str:
        """A label ``name [unit]`` of an SI unit with the unit that an axis counts of what it shows.

        mm below a meter, and mN or µN of small forces.
        """
        name, unit = split_unit(text)
        if not unit:
            return name
        low, high = self._axis(axis).get_view_interval()
        factor, shown = prefixed(unit, max(abs(low), abs(high)))
        if unit == "m" and high - low < 1.0:
            factor = 1e3
            shown = "mm"
        if factor != 1.0:
            self._count_parts(factor, axis)
        return f"{name} [{shown}]"

    def _axis(self, axis: Literal["x", "y"]) -> Any:
        return self.ax.xaxis if axis == "x" else self.ax.yaxis

    def _count_parts(self, factor: float, axis: Literal["x", "y"]) -> None:
        def text(value: float, _: int) -> str:
            return f"{factor * value + 0.0:.5g}".replace("-", "\N{MINUS SIGN}")

        self._axis(axis).set_major_formatter(text)

    def label(self, x: str, y: str, **style: Any) -> None:
        """Write what the axes count, with units."""
        self.ax.set_xlabel(x, color=Color.INK, **style)
        self.ax.set_ylabel(y, color=Color.INK, **style)

    def whole_numbers(self) -> None:
        """Count in whole numbers on the x axis, even with only one of them."""
        self.ax.locator_params(axis="x", integer=True, min_n_ticks=1)

    def name_ticks(self, axis: Literal["x", "y"], names: Iterable[str]) -> None:
        """Write names at 0, 1, 2, ... of an axis."""
        texts = [plain(name) for name in names]
        self.ax.set(**{f"{axis}ticks": range(len(texts)), f"{axis}ticklabels": texts})

    def color_bar(self, drawn: ScalarMappable, text: str = "time [s]") -> None:
        """A bar beside the axes for drawings colored by a quantity."""
        bar = self.ax.figure.colorbar(drawn, ax=self.ax, pad=0.03)
        bar.set_label(StyledAxes(bar.ax).shown_label(text, "y"), color=Color.INK)
        bar.ax.tick_params(colors=Color.INK, labelsize=9)
        bar.outline.set_visible(False)

    def draw_timed(
        self, lines: Iterable[NDArray[Any]], at: NDArray[Any], t: NDArray[Any], width: float = 2.0
    ) -> LineCollection:
        """Draw n lines (points, 2) in the colors of their instants (n,) [s] within all instants t, with a color bar."""
        from matplotlib.collections import LineCollection

        look: dict[str, Any] = {"cmap": Color.early_to_late(), "capstyle": "round", "zorder": Z.SHAPE}
        drawn = LineCollection(list(lines), linewidths=width, **look)
        drawn.set_array(at)
        # a run of one instant has no range of its own
        end = float(t[-1]) if t[-1] > t[0] else float(t[0]) + 1.0
        drawn.set_clim(float(t[0]), end)
        self.ax.add_collection(drawn)
        self.color_bar(drawn)
        return drawn

    def head(self, name: str | None, columns: int = 4) -> None:
        """Above the axes: the name, where there is no title yet, and under it a legend of what has a label."""
        entries = len(self.ax.get_legend_handles_labels()[1])
        if entries:
            legend = self.ax.legend(
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
        if not self.ax.get_title() and not self.ax.get_title("left"):
            rows = -(-entries // columns)
            # 15 points per row of 9-point text; an empty title takes the same place, so that axes of all pictures align
            width = self.ax.get_position().width * self.ax.figure.bbox.width / self.ax.figure.dpi
            self.ax.set_title(
                wrapped(plain(name or " "), width),
                fontsize=10,
                color=Color.INK,
                loc="left",
                pad=7.0 + 15.0 * rows,
            )

    def curves(self, t: ArrayLike, rows: Iterable[ArrayLike], names: Sequence[str | None], **style: Any) -> None:
        """Draw rows (T,) over instants t (T,), each in a color of its own."""
        for values, name, color in zip(rows, names, Color.distinct(len(names)), strict=True):
            self.ax.plot(t, values, **{"color": color, "linewidth": 1.4, "label": name, **style})

    def svg(self, name: str, described: str) -> str:
        """The axes without their title as an SVG element that refers to nothing outside itself, as wide as it may be.

        Ids begin with ``name``, letters and digits, so that several elements fit on one page; ``described`` is for
        those who cannot see it, escaped already. The same drawing gives the same text.
        """
        from matplotlib import rc_context
        from matplotlib.text import Text

        ax = self.ax
        buffer = io.StringIO()
        figure = cast("Figure", ax.get_figure(root=True))
        titles = {ax.get_title(loc=where) for where in ("left", "center", "right")} - {""}
        heads = [artist for artist in ax.get_children() if isinstance(artist, Text) and artist.get_text() in titles]
        beside = [other for other in figure.axes if other is not ax]
        hidden = [artist for artist in (*beside, *heads) if artist.get_visible()]
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
        own = re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{name}-", rest)
        return f'{opening} role="img" aria-label="{described}">{own}'


def over_time(columns: int = 4) -> Callable[[Callable[[Axes, Any], str]], Callable[..., Axes]]:
    """Make a picture of what draws curves of a result over time into axes, and returns what they are, with the unit."""

    def decorate(draw: Callable[[Axes, Any], str]) -> Callable[..., Axes]:
        def plot(result: Any, *, ax: Axes | None = None) -> Axes:
            styled = StyledAxes.on(ax)
            styled.ax.margins(x=0.0)
            styled.label("time [s]", styled.shown_label(draw(styled.ax, result), "y"))
            styled.head(result.name, columns)
            return styled.ax

        plot.__doc__ = draw.__doc__
        return plot

    return decorate


def wrapped(text: str, width: float) -> str:
    """A text of 10 points in lines no wider [inch]: what sticks out is cut off, or takes the place of the axes."""
    # 11.5: letters of 10 points per inch
    return "\n".join(textwrap.wrap(text, max(int(11.5 * width), 24), max_lines=5, placeholder=" ...")) or text


def symbol(name: str) -> str:
    """A name as it is typeset in a legend: ``theta_1`` becomes the Greek letter with an index."""
    match = re.fullmatch(r"(theta|kappa|tau|phi)_?(\d*)", name)
    if not match:
        return name
    index = f"_{{{match[2]}}}" if match[2] else ""
    return rf"$\{match[1]}{index}$"


def bend_box(points: Sequence[NDArray[Any]], margin: float, slimmest: float = 0.5) -> Box:
    """Limits around world points (..., 2), with a margin on every side [m]; those that are not finite are left out.

    Neither side is shorter than ``slimmest`` of the other: a straight finger would leave a strip without ticks.
    """
    flat = np.concatenate([np.reshape(p, (-1, 2)) for p in points])
    flat = flat[np.isfinite(flat).all(axis=1)]
    if not len(flat):
        flat = np.zeros((1, 2))
    low = flat.min(axis=0) - margin
    high = flat.max(axis=0) + margin
    sides = high - low
    more = np.maximum(0.0, slimmest * sides.max() - sides) / 2
    low = low - more
    high = high + more
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
