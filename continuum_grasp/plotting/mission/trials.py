"""One mission on many plants, in a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.plotting.drawing.axes import new_figure, quiet
from continuum_grasp.plotting.drawing.style import BLUE, INK, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.mission.trials import Outcome

__all__ = ["plot_trials"]


def plot_trials(outcomes: Sequence[Outcome]) -> list[Axes]:
    """Draw error of the held force and least slip margin of many plants over what differs between them.

    Parameters
    ----------
    outcomes : sequence of Outcome

    Returns
    -------
    list of matplotlib.axes.Axes
        Two rows: force errors, then slip margins; plants that failed are crosses.
    """
    judged = [outcome for outcome in outcomes if outcome.verdict is not None]
    verdicts = [outcome.verdict for outcome in outcomes if outcome.verdict is not None]
    good = np.array([outcome.succeeded for outcome in judged], dtype=bool)
    given = {
        "stiffness [1]": [o.variation.stiffness for o in judged],
        "damping [1]": [o.variation.damping for o in judged],
        "mass [1]": [o.variation.mass for o in judged],
        "friction [1]": [o.variation.friction for o in judged],
        "shift x [mm]": [1e3 * o.variation.shift[0] for o in judged],
        "shift y [mm]": [1e3 * o.variation.shift[1] for o in judged],
    }
    found = {
        "force error [%]": np.array([100.0 * verdict.force_error for verdict in verdicts], dtype=float),
        "least slip margin [1]": np.array([verdict.slip_margin for verdict in verdicts], dtype=float),
    }
    figure = new_figure(10.2, 4.4)
    grid = figure.subplots(2, len(given), sharex="col", sharey="row", squeeze=False)
    for ax, name in zip(grid[-1], given, strict=True):
        ax.set_xlabel(name, color=INK, fontsize=9)
    for row, (what, values) in zip(grid, found.items(), strict=True):
        for ax, against in zip(row, given.values(), strict=True):
            x = np.array(against, dtype=float)
            quiet(ax)
            ax.plot(x[good], values[good], "o", color=BLUE, markersize=3.5, alpha=0.8, markeredgewidth=0.0)
            ax.plot(x[~good], values[~good], "x", color=ORANGE, markersize=6, markeredgewidth=1.6)
        row[0].set_ylabel(what, color=INK, fontsize=9)
        row[0].set_ylim(bottom=min(0.0, 1.1 * float(np.nanmin(values, initial=0.0))))
    held = f"{int(good.sum())} of {len(outcomes)} plants held and released"
    figure.suptitle(held + ("" if good.all() else "; crosses: not"), fontsize=10, color=INK, x=0.01, ha="left")
    return list(grid.ravel())
