"""Pictures of plans."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.plotting import Color, draw_snapshots

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.addons.planning.result import MotionPlan


def plot_plan_path(plan: MotionPlan, *, ax: Axes | None = None) -> Axes:
    """Draw snapshots of a plan, the path of its tip, and the goal."""
    tip = np.asarray(plan.tip_path)
    goal = plan.scene.goal
    goals = [*([] if goal.tip is None else [goal.tip.value]), *([] if goal.shape is None else goal.shape.value)]

    def path(ax: Axes) -> None:
        ax.plot(*tip.T, color=Color.BLUE, linewidth=1.2, zorder=3, label="tip")
        if goals:
            ax.plot(
                *np.array(goals).T, "x", color=Color.ORANGE, markersize=8, markeredgewidth=2.0, zorder=4, label="goal"
            )

    return draw_snapshots(plan, ax=ax, beside=path, seen=[tip])
