"""The look of all pictures in one place: colors, widths [points], and what covers what."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap


class Color(StrEnum):
    """Colors of all pictures; curves have Okabe and Ito's palette, which color-blind readers tell apart."""

    BLUE = "#0072B2"
    ORANGE = "#D55E00"
    GREEN = "#009E73"
    PURPLE = "#CC79A7"
    SKY = "#56B4E9"
    YELLOW = "#E69F00"
    INK = "#222222"
    """Text and outlines."""
    GRAY = "#8A8A8A"
    """Helps to read: limits, axes, scales."""
    SLATE = "#6B6B6B"
    """Text of less weight, and parts that are not real."""
    OBJECT = "#F3E9D6"
    """Filling of the object: pale, since forces and fingers are drawn on it, and none of the curves' colors."""
    EDGE = "#A58A55"
    """Edge of the object."""

    @classmethod
    def distinct(cls, count: int) -> list[Any]:
        """Colors for so many curves: distinct ones for a few, an ordered scale for many."""
        few = [cls.BLUE, cls.ORANGE, cls.GREEN, cls.PURPLE, cls.YELLOW, cls.SKY]
        if count <= len(few):
            return few[:count]
        shades = cls.early_to_late()
        return [shades(k / (count - 1)) for k in range(count)]

    @classmethod
    def early_to_late(cls) -> Colormap:
        """Dark to light, without the palest end, which is lost on white."""
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap

        scale = colormaps["viridis"]
        # 0.93: end of the scale, 256: its steps
        return ListedColormap([scale(0.93 * k / 255) for k in range(256)], name="time")


def plain(text: str) -> str:
    """A text of users as matplotlib shows it letter by letter: between two dollar signs it would read a formula."""
    return text.replace("$", r"\$")


def quiet(ax: Axes) -> Axes:
    """Leave out the frame's top and right side, and draw a light grid behind everything."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_color(Color.GRAY)
    ax.tick_params(colors=Color.INK, labelsize=9)
    ax.grid(True, color="#E4E4E4", linewidth=0.6)
    ax.set_axisbelow(True)
    return ax


FAINT: dict[str, Any] = {"fill": False, "edgecolor": Color.GRAY, "linewidth": 0.7}
"""The object where it was before."""
MATERIAL: dict[str, Any] = {"facecolor": "#E3E3E3", "edgecolor": "#9A9A9A", "hatch": "////", "linewidth": 0.0}
CLAMP: dict[str, Any] = {"facecolor": "#DDDDDD", "edgecolor": "#777777", "hatch": "////", "linewidth": 0.0}
"""Style of fixed bodies, which are hatched, as in drawings of mechanics; the clamp a little darker than supports that
it may lie on."""
FORBIDDEN: dict[str, Any] = {"facecolor": "#F3D3C7", "edgecolor": "#C25B36", "linewidth": 0.9}
"""Zones that must not be entered."""


class Font:
    """Sizes of letters [points]."""

    TEXT = 9.0
    SMALL = 8.0
    PER_INCH = 15.5
    """Small letters per inch: most sentences take a little less."""


class Inch:
    """Sizes on a page [inch]."""

    PIXELS = 100
    """Pixels of a screen: letters of 9 points are 12 pixels high, as the text of a notebook."""
    DRAWING = (4.8, 5.4)
    """Greatest width and height of a drawing: on a small screen, where a page shows it alone, labels are read."""
    LEFT = 0.65
    BELOW = 0.55
    """Margins for the axes' ticks and labels."""
    ABOVE = 0.22
    """Margin above a title."""
    LINE = 0.2
    """A line of a title."""
    BETWEEN = 0.3
    """Distance of a drawing to the numbers beside it."""
    PANEL = 2.9
    """Width of numbers in four columns."""
    ROW = 0.17
    """Height of a row of them: 12 points."""
    DISCS = 0.9
    """Height of a row of discs of friction."""
    POLYGON = 2.05
    """Side of the forces that are resisted."""
    SPACE = 4.6
    """Side of a view in space."""
    PLANE = 2.7
    """Side of a view of a plane beside it."""


class Z:
    """Order of layers, from the ground up."""

    ZONE = 0.0
    SUPPORT = 1.0
    FACE = 1.05
    CLAMP = 1.08
    FAINT_OBJECT = 1.1
    OBJECT = 1.2
    OBJECT_FILL = 1.25
    MARK = 1.3
    CONE = 1.4
    BODY = 1.5
    TENDON = 1.6
    CENTERLINE = 1.7
    JOINT = 1.8
    SHAPE = 2.0
    CLAMP_FACE = 3.0
    MASS = 4.0
    FORCE = 5.0
    LEADER = 5.5
    CONTACT = 6.0
    MOMENT = 6.0
    SCALE = 7.0
    LABEL = 8.0
