"""Measurements against predictions, and the residuals between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.numbers import SHOWN_IN
from continuum_grasp.base import prefixed, split_unit
from continuum_grasp.plotting import Color, StyledAxes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection

    from continuum_grasp.addons.identification.comparison import Predicted
    from continuum_grasp.addons.identification.experiment_plan import ExperimentPlan
    from continuum_grasp.addons.identification.fit import Fit
    from continuum_grasp.addons.identification.replayed import Replay

_PANELS = 6
"""Panels of a new figure [1]: two rows of three; more are not read at a glance."""
_DENSE = 200
"""Numbers from which on points are drawn small [1]: larger ones overlap."""


def plot_residuals(fit: Fit, *, ax: Axes | None = None) -> Axes:
    """Draw residuals in standard deviations, set by set; those that were not fitted as open rings."""
    styled = StyledAxes.on(ax, 7.2, 4.0)
    ax = styled.ax
    scaled = fit.residuals / fit.sigma
    # 95 % of normal residuals are within two deviations
    ax.axhspan(-2.0, 2.0, color=Color.BLUE, alpha=0.08, linewidth=0)
    ax.axhline(0.0, color=Color.GRAY, linewidth=0.8)
    number = np.arange(1, scaled.size + 1)
    inside = fit.fitted
    size = 22.0 if scaled.size <= _DENSE else 7.0
    ax.scatter(number[inside], scaled[inside], s=size, color=Color.BLUE, linewidth=0, label="fitted", zorder=3)
    if not inside.all():
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": Color.ORANGE, "label": "hold-out", "zorder": 3}
        ax.scatter(number[~inside], scaled[~inside], s=size, **look)
    for end in np.cumsum([count for _, count in fit.blocks[:-1]]):
        ax.axvline(end + 0.5, color=Color.GRAY, linewidth=0.6, linestyle=":")
    reach = 1.15 * max(3.0, float(np.abs(scaled).max(initial=0.0)))
    ax.set_ylim(-reach, reach)
    styled.whole_numbers()
    styled.label("number of the measurement (dotted: next set)", "residual [standard deviations]")
    styled.head("Residuals: predicted less measured")
    return ax


def plot_shapes(result: Predicted, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw predicted fingers, and measured points over them with lines to where they are predicted; a panel per set.

    From many rows or instants some are drawn, evenly spread; paths of points over time are drawn whole, the predicted
    ones as lines. What was not fitted is orange.
    """
    from continuum_grasp.plotting import draw_clamp

    finger = result.scene.finger
    sets = dict[str, list[tuple[float, int, int, int]]]()
    markers = list(dict.fromkeys(result.described[x].name for x, _ in result.points.values()))
    for (name, at, *_), (x, y) in result.points.items():
        sets.setdefault(name, []).append((at, markers.index(result.described[x].name), x, y))
    drawn = {of.name: (lines, of.moves) for of, lines in zip(result.sets, result.drawn, strict=True)}
    names = [name for name in sets if len(drawn[name][0].at)][:_PANELS]
    panels = _panels(len(names), ax, 5.6, 4.4)
    for axes, name in zip(panels, names, strict=False):
        rows = np.array(sets[name])
        lines, over_time = drawn[name]
        index = rows[:, 2:].astype(int)
        measured, predicted = result.measured[index], result.predictions[index]
        shown = np.isin(rows[:, 0], lines.at)
        StyledAxes(axes).show_around([lines.backbones, measured, predicted], 0.06 * finger.rod.length)
        for backbone in lines.backbones:
            axes.plot(*backbone.T, color=Color.BLUE, alpha=0.35 if over_time else 0.7, linewidth=1.6, zorder=2)
        draw_clamp(axes, lines.backbones[0], finger)
        for place in np.unique(rows[:, 1]) if over_time else ():
            here = rows[:, 1] == place
            axes.plot(*predicted[here].T, color=Color.INK, linewidth=0.9, zorder=3)
            axes.scatter(measured[here, 0], measured[here, 1], s=3, color=Color.GRAY, linewidth=0, zorder=3)
        axes.add_collection(_links(measured[shown], predicted[shown]))
        inside = result.fitted[index[:, 0]]
        for chosen, color, what in (
            (shown & inside, Color.INK, "measured"),
            (shown & ~inside, Color.ORANGE, "measured, hold-out"),
        ):
            if chosen.any():
                x, y = measured[chosen].T
                axes.scatter(x, y, s=20, color=color, linewidth=0, zorder=5, label=what)
        count = len(lines.at)
        every = len(np.unique(rows[:, 0]))
        some = f" ({count} of {every})" if count < every else ""
        axes.plot([], [], color=Color.BLUE, linewidth=1.6, label=f"simulated{some}")
        StyledAxes(axes).head(f"{name}{_off(result, name)}", 3)
    return panels


def _off(result: Predicted, name: str) -> str:
    """Distances of the points of a set from where they are predicted, at the worst place, as the table has them."""
    distances = [of for of in result.channels if of.name.startswith(f"{name}: distance at ")]
    worst = max(distances, key=lambda of: of.rms)
    place = worst.name.removeprefix(f"{name}: distance") if len(distances) > 1 else ""
    held_out = " (hold-out)" if not worst.fitted and len(distances) > 1 else ""
    _, rms, largest, *_ = worst.texts
    return f": {rms} mm r.m.s.{place}{held_out}, {largest} mm at most"


def plot_series(result: Predicted, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw measured and predicted numbers over rows or time, and below each the prediction less the measurement.

    Hold-outs are orange. A new figure has six quantities at most: of more those that are missed by most, per the widest
    range of their unit, in the order of the tables.
    """
    every = result.series
    ranges = dict[str, float]()
    for column, _, rows in every.values():
        span = max(float(np.ptp(result.measured[rows])), 1e-12)
        ranges[column.unit] = max(ranges.get(column.unit, 0.0), span)

    def missed(unit: str, rows: NDArray[np.intp]) -> float:
        return float(np.sqrt(np.mean(result.residuals[rows] ** 2))) / ranges[unit]

    most = _PANELS if ax is None else len(ax) // 2
    by_miss = sorted(every, key=lambda key: -missed(every[key][0].unit, every[key][-1]))
    series = [(key, of) for key, of in every.items() if key in by_miss[:most]]
    panels = _panels(len(series), ax, 4.6, 4.4, ratios=(2.0, 1.0))
    for ((name, what), (column, moves, rows)), above, below in zip(series, panels[0::2], panels[1::2], strict=False):
        factor, unit = _shown_in(column.unit, result.measured[rows])
        at, inside = result.at[rows], result.fitted[rows]
        measured = factor * result.measured[rows]
        predicted = factor * result.predictions[rows]
        dense = len(rows) > _DENSE
        # rows of their own are no points of a curve
        look: dict[str, Any] = {"linewidth": 1.2} if moves else {"linestyle": "none", "marker": "_", "markersize": 14}
        above.plot(at, predicted, color=Color.BLUE, label=result.predicted, zorder=2, **look)
        for chosen, color, text in ((inside, Color.INK, "measured"), (~inside, Color.ORANGE, "measured, hold-out")):
            if chosen.any():
                above.scatter(at[chosen], measured[chosen], s=4 if dense else 18, color=color, linewidth=0, label=text)
                below.vlines(at[chosen], 0.0, (predicted - measured)[chosen], color=color, linewidth=1.0)
        below.axhline(0.0, color=Color.GRAY, linewidth=0.8)
        _scale(above, below, measured, predicted)
        if not moves:
            below.set_xlim(at.min() - 0.5, at.max() + 0.5)
            above.set_xlim(below.get_xlim())
            StyledAxes(above).whole_numbers()
            StyledAxes(below).whole_numbers()
        StyledAxes(above).label("", f"{what} [{unit}]")
        StyledAxes(below).label("time [s]" if moves else "row", f"error [{unit}]")
        StyledAxes(above).head(name, 3)
    return panels


def _shown_in(unit: str, values: NDArray[Any]) -> tuple[float, str]:
    """Factor and unit in which values of an SI unit are drawn."""
    finite = np.abs(values[np.isfinite(values)])
    return SHOWN_IN.get(unit) or prefixed(unit, float(finite.max(initial=0.0)))


def _scale(above: Axes, below: Axes, measured: NDArray[Any], predicted: NDArray[Any]) -> None:
    """Show errors beside the size of the measurements: errors by rounding are not to fill their axes."""
    above.ticklabel_format(axis="y", useOffset=False)
    size = float(np.ptp(measured))
    if not size:  # one number, or one again and again
        size = float(np.abs(measured).max()) or 1.0
        middle = float(measured[0])
        reach = max(1.2 * float(np.abs(predicted - measured).max()), 0.2 * size)
        above.set_ylim(middle - reach, middle + reach)
    # 0.01: part of the range that was measured which the axis of errors shows at least
    reach = 1.1 * max(float(np.abs(predicted - measured).max()), 0.01 * size)
    below.set_ylim(-reach, reach)


def plot_ring_downs(result: Predicted, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw records of vibrations, and the damped sines of the predicted frequency and decay rate nearest to them.

    A new figure has six records at most, the first ones.
    """
    records = result.ring_downs
    panels = _panels(min(len(records), _PANELS), ax, 4.6, 3.0)
    for (name, signal, frequency, decay_rate, nearest), axes in zip(records, panels, strict=False):
        axes.scatter(signal.t, signal.values, s=4, color=Color.INK, linewidth=0, label="measured", zorder=3)
        axes.plot(signal.t, nearest, color=Color.BLUE, linewidth=1.2, label=result.predicted, zorder=2)
        StyledAxes(axes).label("time [s]", signal.name)
        StyledAxes(axes).head(f"{name}: {frequency:.4g} Hz, {decay_rate:.3g} 1/s", 2)
    return panels


def plot_innovations(replay: Replay, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw what was measured less what was expected, with three standard deviations, and commands of log and replay."""
    names = [*replay.compared_names, *replay.u_names]
    panels = _panels(len(names), ax, 4.6, 3.0)
    for k, (axes, name) in enumerate(zip(panels, names, strict=False)):
        j = k - len(replay.compared_names)
        values = replay.innovation[:, k] if j < 0 else replay.logged[:, j]
        factor, unit = _shown_in(split_unit(name).unit, values)
        if k < len(replay.compared_names):
            band = 3.0 * factor * replay.innovation_std[:, k]
            axes.fill_between(
                replay.t, -band, band, color=Color.BLUE, alpha=0.2, linewidth=0, label="3 standard deviations"
            )
            innovation = factor * replay.innovation[:, k]
            axes.scatter(replay.t, innovation, s=4, color=Color.INK, linewidth=0, label="innovation")
            # 0.9: share of the instants whose band is shown whole: the first ones, before the estimator settles, have
            # one of many times its width
            reach = 1.1 * max(float(np.nanquantile(band, 0.9)), float(np.nanmax(np.abs(innovation), initial=0.0)))
            if reach > 0.0:
                axes.set_ylim(-reach, reach)
        else:
            axes.step(replay.t, factor * replay.logged[:, j], where="post", color=Color.INK, linewidth=1.6, label="log")
            axes.step(
                replay.t, factor * replay.u[:, j], where="post", color=Color.ORANGE, linewidth=1.0, label="replay"
            )
        StyledAxes(axes).label("time [s]", f"{split_unit(name).name} [{unit}]")
        StyledAxes(axes).head("", 2)
    return panels


def _links(a: NDArray[Any], b: NDArray[Any]) -> LineCollection:
    """Lines from points (P, 2) to others."""
    from matplotlib.collections import LineCollection

    return LineCollection(list(np.stack([a, b], axis=1)), colors=Color.INK, linewidths=0.8, zorder=4)


def _panels(
    count: int, ax: Sequence[Axes] | None, width: float, height: float, ratios: tuple[float, ...] = (1.0,)
) -> list[Axes]:
    """Given axes, or the axes of a new figure in rows of three at most; each as several, one below the other."""
    if ax is not None:
        return list(ax)
    rows = max(-(-count // 3), 1)
    columns = max(-(-count // rows), 1)  # of four, two in each row
    figure = StyledAxes.figure(width * columns, height * rows)
    grid = figure.add_gridspec(rows, columns)
    panels = []
    for k in range(count):
        inner = grid[k // columns, k % columns].subgridspec(len(ratios), 1, height_ratios=ratios)
        panels += [figure.add_subplot(inner[i]) for i in range(len(ratios))]
    return panels


def plot_excitation(plan: ExperimentPlan, *, ax: Axes | None = None) -> Axes:
    """Draw the commands over time, with the segments."""
    styled = StyledAxes.on(ax, 9.0, 3.8)
    ax = styled.ax
    styled.curves(plan.t, plan.commands.T, [split_unit(name).name for name in plan.command_names], linewidth=1.2)
    for k, segment in enumerate(plan.segments):
        if k % 2:
            ax.axvspan(segment.start, segment.end, color=Color.GRAY, alpha=0.12, linewidth=0)
        middle = 0.5 * (segment.start + segment.end)
        look: dict[str, Any] = {"rotation": 90, "ha": "center", "va": "top", "fontsize": 7, "color": "0.35"}
        ax.text(middle, 0.98, segment.name, transform=ax.get_xaxis_transform(), **look)
    low = float(plan.commands.min())
    high = float(plan.commands.max())
    span = max(high - low, 1e-12)
    ax.set_ylim(low - 0.08 * span, high + 0.75 * span)
    ax.set_xlim(float(plan.t[0]), float(plan.t[-1]))
    unit = split_unit(plan.command_names[0]).unit
    styled.label("time [s]", styled.shown_label(f"command [{unit}]", "y"))
    styled.head("Commands that show the unknowns")
    return ax
