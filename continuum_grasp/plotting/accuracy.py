"""Error of models against their cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

from continuum_grasp.plotting.drawing.axes import label, new_figure, quiet
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, GREEN, INK, ORANGE
from continuum_grasp.scene.methods import FAMILIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.accuracy.report import AccuracyReport

_LOOKS = ((BLUE, "o"), (GREEN, "s"), (ORANGE, "D"), (INK, "^"))
"""Color and marker of the families, in the order of their table."""
_PANELS = (
    ("evaluation [ns]", "tip / L", "static tip error / L"),
    ("evaluation [ns]", "frequency 1", "error of the first frequency"),
    ("real-time factor", "motion / L", "r.m.s. tip error in motion / L"),
)
_COSTS = {"evaluation [ns]": "forward dynamics [ns]", "real-time factor": "times faster than real time"}


def plot_accuracy(report: AccuracyReport, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw errors of the choices against their cost, and the front that no choice beats.

    Axes that are given are for static error, first frequency and motion, of which a report has the first, the first two
    or all.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    columns, rows = report.choices.columns, report.choices.rows
    panels = [panel for panel in _PANELS if len(report.front(panel[0], panel[1])) > 1]
    if ax is None:
        figure = new_figure(4.6 * max(len(panels), 1), 4.2)
        ax = [quiet(panel) for panel in figure.subplots(1, max(len(panels), 1), squeeze=False)[0]]
    for axes, (cost, error, text) in zip(ax, panels, strict=False):
        i, j = columns.index(cost), columns.index(error)
        front = report.front(cost, error)
        axes.plot([row[i] for row in front], [row[j] for row in front], color=GRAY, linewidth=5.0, alpha=0.35, zorder=1)
        for family, (color, marker) in zip(FAMILIES, cycle(_LOOKS), strict=False):
            points = [row for row in rows if row[0].split(",")[0] == family and _drawn(row[i]) and _drawn(row[j])]
            look: dict[str, Any] = {
                "color": color,
                "markersize": 4.5,
                "linewidth": 0.0,
                "label": family.replace("_", " "),
            }
            axes.plot([row[i] for row in points], [row[j] for row in points], marker=marker, **look)
            for row in points:
                axes.annotate(
                    str(row[1]), (row[i], row[j]), (4, 3), textcoords="offset points", fontsize=7, color=color
                )
        axes.set_xscale("log")
        axes.set_yscale("log")
        costs = [row[i] for row in rows if _drawn(row[i])]
        # decades alone would leave a narrow range with one tick or none
        subs = (1.0,) if max(costs) > 50.0 * min(costs) else (1.0, 2.0, 5.0)
        axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=9))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        if cost == "real-time factor":  # greater is better: turned, so that the best is at the lower left as elsewhere
            axes.invert_xaxis()
        label(axes, _COSTS[cost], text)
    ax[0].legend(frameon=False, fontsize=8, title="number of elements beside", title_fontsize=8)
    return list(ax)


def _drawn(value: Any) -> bool:
    """Whether logarithmic axes can show it."""
    return isinstance(value, int | float) and math.isfinite(value) and value > 0
