"""Maps and Pareto pictures of sweeps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import color_bar, head, label, new_axes, time_map
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable

    from continuum_grasp.sweeps import Front, Map

_HATCHES = ("////", "....", "xxxx", "\\\\\\\\", "oooo", "++++", "----")
_MARKERS = ("x", "+", "v", "s", "^", "d", "1")
_SHADES = ("#BFBFBF", "#D9D9D9", "#CFC4B8", "#C3CBD3", "#D8C8D0", "#C9D3C3", "#E0DCC8")
"""Distinguish reasons why there is no grasp, in print too: none is a color of the quantity's scale."""


def plot_map(drawn: Map, *, ax: Axes | None = None) -> Axes:
    """Draw a quantity over two columns in color; places without a grasp are hatched, or crossed, by reason."""
    ax = new_axes(ax, 6.6, 4.9)
    ax.grid(False)
    kinds = [str(kind) for kind in dict.fromkeys(drawn.kind[drawn.kind != ""].tolist())]
    draw = _draw_grid if drawn.color.ndim == 2 else _draw_points
    shown = draw(ax, drawn, kinds)
    if np.isfinite(drawn.color).any():
        color_bar(ax, shown, drawn.labels[2])
    label(ax, drawn.labels[0], drawn.labels[1])
    head(ax, None if kinds else drawn.labels[2], columns=2)
    return ax


def plot_front(drawn: Front, *, ax: Axes | None = None) -> Axes:
    """Draw two quantities against each other, and the front of what no other beats in both."""
    ax = new_axes(ax, 6.6, 4.9)
    size = _size(drawn.x, 18.0, 5.0)
    if drawn.color is None:
        ax.scatter(drawn.x, drawn.y, s=size, color=BLUE, alpha=0.45, linewidths=0.0, label="grasps")
    else:
        shown = ax.scatter(drawn.x, drawn.y, s=size, c=drawn.color, cmap=time_map(), linewidths=0.0, label="grasps")
        color_bar(ax, shown, drawn.labels[2])
    front = drawn.x[drawn.best], drawn.y[drawn.best]
    ax.plot(*front, color=ORANGE, linewidth=1.2, alpha=0.8, zorder=3)
    text = f"front: {len(drawn.best)} of {len(drawn.x)}; {drawn.best_words}"
    ring: dict[str, Any] = {
        "markersize": 7.5,
        "markerfacecolor": "none",
        "markeredgecolor": ORANGE,
        "markeredgewidth": 1.6,
    }
    ax.plot(*front, "o", zorder=4, label=text, **ring)
    label(ax, drawn.labels[0], drawn.labels[1])
    head(ax, None, columns=2)
    return ax


def _size(points: NDArray[Any], few: float, many: float) -> float:
    """Area of a dot [points^2]: thousands of large ones would hide each other."""
    return few if len(points) < 2000 else many


def _draw_grid(ax: Axes, drawn: Map, kinds: list[str]) -> ScalarMappable:
    from matplotlib.colors import ListedColormap

    x, y = _edges(drawn.x), _edges(drawn.y)
    shown = ax.pcolormesh(x, y, np.ma.masked_invalid(drawn.color), cmap=time_map())
    for k, kind in enumerate(kinds):
        here = drawn.kind == kind
        shade = _SHADES[k % len(_SHADES)]
        look: dict[str, Any] = {"hatch": _HATCHES[k % len(_HATCHES)], "edgecolor": GRAY, "linewidth": 0.0}
        # pcolormesh cannot hatch
        ax.pcolor(x, y, np.ma.masked_where(~here, np.ones(here.shape)), cmap=ListedColormap([shade]), **look)
        ax.fill([], [], facecolor=shade, label=f"no grasp, {kind}: {int(here.sum())}", **look)
    for name, values in (("x", drawn.x), ("y", drawn.y)):
        if values.dtype.kind not in "iuf":
            ax.set(**{f"{name}ticks": range(len(values)), f"{name}ticklabels": [str(value) for value in values]})
        elif _is_log(values):
            ax.set(**{f"{name}scale": "log"})
    return shown


def _draw_points(ax: Axes, drawn: Map, kinds: list[str]) -> ScalarMappable:
    size = _size(drawn.x, 26.0, 6.0)
    for k, kind in enumerate(kinds):
        here = drawn.kind == kind
        look: dict[str, Any] = {"marker": _MARKERS[k % len(_MARKERS)], "label": f"no grasp, {kind}: {int(here.sum())}"}
        ax.scatter(drawn.x[here], drawn.y[here], s=0.7 * size, color=GRAY, linewidths=1.0, **look)
    there = np.isfinite(drawn.color)
    return ax.scatter(drawn.x[there], drawn.y[there], s=size, c=drawn.color[there], cmap=time_map(), linewidths=0.0)


def _edges(values: NDArray[Any]) -> NDArray[Any]:
    """Borders of cells around the values; words lie at 0, 1, 2, ..."""
    if values.dtype.kind not in "iuf":
        return np.arange(len(values) + 1) - 0.5
    middle = np.log(values) if _is_log(values) else values.astype(float)
    if len(middle) == 1:  # there is no neighbor to share a border with
        wide = 0.05 * abs(float(middle[0])) or 0.5
        return np.array([middle[0] - wide, middle[0] + wide])
    between = 0.5 * (middle[1:] + middle[:-1])
    edges = np.concatenate([[2 * middle[0] - between[0]], between, [2 * middle[-1] - between[-1]]])
    return np.asarray(np.exp(edges) if _is_log(values) else edges)


def _is_log(values: NDArray[Any]) -> bool:
    """Whether numbers are spaced by ratios rather than by differences."""
    if len(values) < 3 or values[0] <= 0:
        return False
    steps, ratios = np.diff(values), np.diff(np.log(values))
    # ratios ten times as even; a row that is neither stays on the plain axis
    return bool(np.ptp(ratios) / ratios.mean() < 0.1 * np.ptp(steps) / steps.mean())
