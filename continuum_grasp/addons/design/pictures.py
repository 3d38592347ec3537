"""A design: a grasp before and after, the cost of all designs tried, and what the cost depends on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.plotting import Color, StyledAxes, Z, plot_grasp

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.addons.design.result import DesignResult


def plot_design(result: DesignResult) -> list[Axes]:
    """Draw the grasp of the case that decides, the costs in the order of the designs, and sensitivities.

    The dashed gray line is the finger at the start. Sensitivities are changes of the cost where a variable grows by 1 %
    of its range, and where a tolerated number has 1 % of its greatest error.
    """
    figure = StyledAxes.figure(11.0, 5.4)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.0))
    grasp, costs, bars = (figure.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1]))
    _draw_grasp(grasp, result)
    _draw_costs(costs, result)
    _draw_influences(bars, result)
    return [grasp, costs, bars]


_PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
"""Behind names, which lie on the line of no change."""


def _draw_grasp(ax: Axes, result: DesignResult) -> None:
    decisive = "" if result.best is None else result.best.worst.case
    name = decisive if decisive in result.grasps else next(iter(result.grasps))
    plot_grasp(result.grasps[name], ax=ax, numbers=False)
    before = result.before.get(name)
    if before is not None and before.solved:
        for k, finger in enumerate(before.fingers.values()):
            line = finger.backbone[:, 1:3]
            text = "at the start" if k == 0 else None
            ax.plot(*line.T, color=Color.GRAY, linewidth=1.4, linestyle=(0, (4, 2)), zorder=Z.LABEL, label=text)
            (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
            margin = 0.03 * float(np.ptp(line, axis=0).max())
            low = line.min(axis=0) - margin
            high = line.max(axis=0) + margin
            ax.set_xlim(min(left, low[0]), max(right, high[0]))
            ax.set_ylim(min(bottom, low[1]), max(top, high[1]))
    ax.set_title("", loc="left")
    several = f", {name}" if len(result.grasps) > 1 else ""
    StyledAxes(ax).head(f"{result.name or 'design'}{several}")


def _draw_costs(ax: Axes, result: DesignResult) -> None:
    number = np.arange(1, result.costs.size + 1)
    costs = result.costs
    holds = np.isfinite(costs) & (result.violations <= 1e-6)
    trial = result.rounds == 0
    for chosen, color, text in ((trial, Color.GRAY, "full search"), (~trial, Color.BLUE, "by gradient")):
        good = chosen & holds
        bad = chosen & np.isfinite(costs) & ~holds
        if chosen.any():
            ax.plot(number[good], costs[good], "o", color=color, markersize=4.0, label=text)
            ax.plot(number[bad], costs[bad], "o", color=color, markersize=4.0, fillstyle="none")
    best = np.fmin.accumulate(np.where(holds, costs, np.nan)) if holds.any() else costs
    ax.plot(number, best, color=Color.BLUE, linewidth=1.0)
    lost = ~np.isfinite(costs)
    if lost.any():
        low = ax.get_ylim()[0]
        ax.plot(
            number[lost],
            np.full(lost.sum(), low),
            "x",
            color=Color.ORANGE,
            markersize=5.0,
            label="no grasp",
            clip_on=False,
        )
        ax.set_ylim(bottom=low)
    StyledAxes(ax).whole_numbers()
    StyledAxes(ax).label("design", "cost")
    StyledAxes(ax).head(f"Cost: {result.scene.minimize}")


def _draw_influences(ax: Axes, result: DesignResult) -> None:
    """Bars at the start and at the best design, in its order; at an optimum only those at a bound remain."""
    # 12: most bars, which are read at a glance
    influences = result.influences[:12]
    before = () if result.first is None else 0.01 * result.first.slope[: len(influences)]
    places = np.arange(len(influences))
    ax.barh(places[: len(before)] + 0.05, before, color=Color.GRAY, height=0.22, label="at the start")
    at_bound = np.array([bool(influence.at) for influence in influences])
    change = np.array([influence.per_percent for influence in influences])
    for chosen, color, text in (
        (~at_bound, Color.BLUE, "at the best design"),
        (at_bound, Color.ORANGE, "there, at a bound"),
    ):
        if chosen.any():
            ax.barh(places[chosen] + 0.3, change[chosen], color=color, height=0.22, label=text)
    ax.axvline(0.0, color=Color.GRAY, linewidth=0.8)
    for at, influence in zip(places, influences, strict=True):
        name = influence.key + (f" (at its {influence.at})" if influence.at else "")
        ax.text(
            0.01,
            at - 0.09,
            name,
            transform=ax.get_yaxis_transform(),
            fontsize=8,
            color=Color.INK,
            va="bottom",
            bbox=_PAPER,
        )
    ax.set_yticks([])
    ax.set_ylim(len(influences) - 0.45, -0.45)
    StyledAxes(ax).label("change of the cost per +1 % of the range", "")
    StyledAxes(ax).head("Sensitivities")
