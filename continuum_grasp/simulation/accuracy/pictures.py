"""Error of models against their cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

from continuum_grasp.plotting import Color, StyledAxes
from continuum_grasp.scene import FAMILIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.simulation.accuracy.report import AccuracyReport

_LOOKS = ((Color.BLUE, "o"), (Color.GREEN, "s"), (Color.ORANGE, "D"), (Color.INK, "^"))
"""Color and marker of the families, in the order of their table."""
_WORDS = {
    "evaluation [ns]": "forward dynamics [ns]",
    "real-time factor": "times faster than real time",
    "tip / L": "static tip error / L",
    "frequency 1": "error of the first frequency",
    "motion / L": "r.m.s. tip error in motion / L",
}
"""Labels of axes, by the column that they show."""


def plot_accuracy(report: AccuracyReport, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw errors of the choices against their cost, and the front that no choice beats.

    Axes that are given are for static error, first frequency and motion; a report has the first, the first two
    or all.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    columns = report.choices.columns
    rows = report.choices.rows
    fronts = report.fronts
    if ax is None:
        count = max(len(fronts), 1)
        ax = list(StyledAxes.figure(4.6 * count, 4.2).subplots(1, count, squeeze=False)[0])
    for axes, ((cost, error), front) in zip(ax, fronts.items(), strict=False):
        i, j = columns.index(cost), columns.index(error)
        axes.plot(
            [row[i] for row in front], [row[j] for row in front], color=Color.GRAY, linewidth=5.0, alpha=0.35, zorder=1
        )
        for family, (color, marker) in zip(FAMILIES, cycle(_LOOKS), strict=False):
            points = [row for row in rows if row[0].split(",")[0] == family and _drawn(row[i]) and _drawn(row[j])]
            look: dict[str, Any] = {"color": color, "markersize": 4.5, "linewidth": 0.0}
            look["label"] = family.replace("_", " ")
            axes.plot([row[i] for row in points], [row[j] for row in points], marker=marker, **look)
            for row in points:
                beside: dict[str, Any] = {"xytext": (4, 3), "textcoords": "offset points"}
                axes.annotate(str(row[1]), (row[i], row[j]), fontsize=7, color=color, **beside)
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
        StyledAxes(axes).label(_WORDS[cost], _WORDS[error])
    ax[0].legend(frameon=False, fontsize=8, title="number of elements beside", title_fontsize=8)
    return list(ax)


def _drawn(value: Any) -> bool:
    """Whether logarithmic axes can show it."""
    return isinstance(value, int | float) and math.isfinite(value) and value > 0
