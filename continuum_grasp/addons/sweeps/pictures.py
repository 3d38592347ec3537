"""Maps and Pareto pictures of sweeps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.plotting import Color, StyledAxes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable

    from continuum_grasp.addons.sweeps.table import SweepTable

_HATCHES = ("////", "....", "xxxx", "\\\\\\\\", "oooo", "++++", "----")
_MARKERS = ("x", "+", "v", "s", "^", "d", "1")
_SHADES = ("#BFBFBF", "#D9D9D9", "#CFC4B8", "#C3CBD3", "#D8C8D0", "#C9D3C3", "#E0DCC8")
"""Distinguish reasons why there is no grasp, in print too: none is a color of the quantity's scale."""


def plot_map(table: SweepTable, *, x: str, y: str, color: str, reduce: str = "median", ax: Axes | None = None) -> Axes:
    """Draw a quantity over two columns in color; places without a grasp are hatched, or crossed, by reason."""
    across, upwards, colors, reasons = table.map(x, y, color, reduce)  # type: ignore[arg-type]
    styled = StyledAxes.on(ax, 6.6, 4.9)
    ax = styled.ax
    ax.grid(False)
    kinds = [str(kind) for kind in dict.fromkeys(reasons[reasons != ""].tolist())]
    draw = _draw_grid if colors.ndim == 2 else _draw_points
    shown = draw(ax, across, upwards, colors, {kind: reasons == kind for kind in kinds})
    if np.isfinite(colors).any():
        styled.color_bar(shown, table.label(color))
    styled.label(styled.shown_label(table.label(x), "x"), styled.shown_label(table.label(y), "y"))
    styled.head(None if kinds else table.label(color), columns=2)
    return ax


def plot_front(
    table: SweepTable,
    *,
    x: str,
    y: str,
    x_best: str = "least",
    y_best: str = "least",
    color: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw two quantities against each other, and the front of what no other beats in both."""
    best = table.front(x, y, x_best, y_best)  # type: ignore[arg-type]
    across, upwards = table.of_grasps(x), table.of_grasps(y)
    good = np.isfinite(across) & np.isfinite(upwards)
    styled = StyledAxes.on(ax, 6.6, 4.9)
    ax = styled.ax
    look: dict[str, Any] = {"s": _size(across[good], 18.0, 5.0), "linewidths": 0.0, "label": "grasps"}
    if color is None:
        ax.scatter(across[good], upwards[good], color=Color.BLUE, alpha=0.45, **look)
    else:
        look |= {"c": table.of_grasps(color)[good], "cmap": Color.early_to_late()}
        shown = ax.scatter(across[good], upwards[good], **look)
        styled.color_bar(shown, table.label(color))
    front = across[best], upwards[best]
    ax.plot(*front, color=Color.ORANGE, linewidth=1.2, alpha=0.8, zorder=3)
    text = f"front: {len(best)} of {good.sum()}; {x_best} x and {y_best} y are best"
    ring: dict[str, Any] = {
        "markersize": 7.5,
        "markerfacecolor": "none",
        "markeredgecolor": Color.ORANGE,
        "markeredgewidth": 1.6,
    }
    ax.plot(*front, "o", zorder=4, label=text, **ring)
    styled.label(styled.shown_label(table.label(x), "x"), styled.shown_label(table.label(y), "y"))
    styled.head(None, columns=2)
    return ax


def _size(points: NDArray[Any], few: float, many: float) -> float:
    """Area of a dot [points^2]: thousands of large ones would hide each other."""
    return few if len(points) < 2000 else many


def _draw_grid(
    ax: Axes, across: NDArray[Any], upwards: NDArray[Any], colors: Array, kinds: Mapping[str, NDArray[np.bool_]]
) -> ScalarMappable:
    from matplotlib.colors import ListedColormap

    x, y = _edges(across), _edges(upwards)
    shown = ax.pcolormesh(x, y, np.ma.masked_invalid(colors), cmap=Color.early_to_late())
    for k, (kind, here) in enumerate(kinds.items()):
        shade = _SHADES[k % len(_SHADES)]
        look: dict[str, Any] = {"hatch": _HATCHES[k % len(_HATCHES)], "edgecolor": Color.GRAY, "linewidth": 0.0}
        # pcolormesh cannot hatch
        ax.pcolor(x, y, np.ma.masked_where(~here, np.ones(here.shape)), cmap=ListedColormap([shade]), **look)
        ax.fill([], [], facecolor=shade, label=f"no grasp, {kind}: {int(here.sum())}", **look)
    axes: tuple[tuple[Literal["x", "y"], NDArray[Any]], ...] = (("x", across), ("y", upwards))
    for name, values in axes:
        if values.dtype.kind not in "iuf":
            StyledAxes(ax).name_ticks(name, map(str, values))
        elif _is_log(values):
            ax.set(**{f"{name}scale": "log"})
    return shown


def _draw_points(
    ax: Axes, across: NDArray[Any], upwards: NDArray[Any], colors: Array, kinds: Mapping[str, NDArray[np.bool_]]
) -> ScalarMappable:
    size = _size(across, 26.0, 6.0)
    for k, (kind, here) in enumerate(kinds.items()):
        look: dict[str, Any] = {"marker": _MARKERS[k % len(_MARKERS)], "label": f"no grasp, {kind}: {int(here.sum())}"}
        ax.scatter(across[here], upwards[here], s=0.7 * size, color=Color.GRAY, linewidths=1.0, **look)
    there = np.isfinite(colors)
    look = {"c": colors[there], "cmap": Color.early_to_late(), "linewidths": 0.0}
    return ax.scatter(across[there], upwards[there], s=size, **look)


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
    steps = np.diff(values)
    ratios = np.diff(np.log(values))
    # ratios ten times as even; a row that is neither stays on the plain axis
    return bool(np.ptp(ratios) / ratios.mean() < 0.1 * np.ptp(steps) / steps.mean())
