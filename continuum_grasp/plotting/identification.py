"""Measurements against predictions, and the residuals between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.labels import name_of, unit_of
from continuum_grasp.plotting.drawing.axes import head, label, new_axes, new_figure, quiet
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.identification.excitation import ExcitationPlan
    from continuum_grasp.identification.fit import Fit


def plot_residuals(fit: Fit, *, ax: Axes | None = None) -> Axes:
    """Draw residuals in standard deviations, set by set; those that were not fitted as open rings."""
    ax = new_axes(ax, 7.2, 4.0)
    scaled = fit.residuals / fit.sigma
    # 95 % of normal residuals are within two deviations
    ax.axhspan(-2.0, 2.0, color=BLUE, alpha=0.08, linewidth=0)
    ax.axhline(0.0, color=GRAY, linewidth=0.8)
    _draw_points(ax, fit, np.ones(scaled.size, dtype=bool), np.arange(1, scaled.size + 1), scaled)
    for end in np.cumsum([count for _, count in fit.blocks[:-1]]):
        ax.axvline(end + 0.5, color=GRAY, linewidth=0.6, linestyle=":")
    reach = 1.15 * max(3.0, float(np.abs(scaled).max(initial=0.0)))
    ax.set_ylim(-reach, reach)
    ax.locator_params(axis="x", integer=True)
    label(ax, "number of the measurement (dotted: next set)", "residual [standard deviations]")
    head(ax, "Residuals: predicted less measured")
    return ax


def plot_predictions(fit: Fit, group: str, *, ax: Axes | None = None) -> Axes:
    """Draw predictions of one group of entries over measurements; on the line they agree.

    Raises
    ------
    InputError
        If there is no such group.
    """
    members = np.array([entry.group == group for entry in fit.entries], dtype=bool)
    if not members.any():
        known = ", ".join(dict.fromkeys(entry.group for entry in fit.entries))
        raise InputError(f"expected one of {known}, got {group!r}", key="group")
    unit = next(entry.unit for entry in fit.entries if entry.group == group)
    ax = new_axes(ax, 4.8, 4.6)
    numbers = np.concatenate([fit.measured[members], fit.predictions[members]])
    # Three deviations show how well a single point is met; its own range would be nothing.
    margin = max(0.05 * float(np.ptp(numbers)), 3.0 * float(fit.sigma[members].max()))
    ends = [float(numbers.min()) - margin, float(numbers.max()) + margin]
    ax.plot(ends, ends, color=GRAY, linewidth=0.9, zorder=1)
    _draw_points(ax, fit, members, fit.measured, fit.predictions, linewidth=0.8)
    ax.set_xlim(*ends)
    ax.set_ylim(*ends)
    ax.set_box_aspect(1.0)
    ax.locator_params(nbins=5)
    ax.ticklabel_format(useOffset=False)  # an offset at the axis would lie on the legend
    label(ax, f"measured [{unit}]", f"predicted [{unit}]")
    head(ax, group[:1].upper() + group[1:])
    return ax


def _draw_points(
    ax: Axes, fit: Fit, members: NDArray[np.bool_], x: NDArray[Any], y: NDArray[Any], **ring: float
) -> None:
    """Draw some of the entries: filled where they were fitted, as open rings where not."""
    size = 22.0 if members.sum() <= 200 else 7.0  # more would overlap
    inside, outside = members & fit.fitted, members & ~fit.fitted
    ax.scatter(x[inside], y[inside], s=size, color=BLUE, linewidth=0, label="fitted", zorder=3)
    if outside.any():
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": ORANGE, "label": "hold-out", "zorder": 3, **ring}
        ax.scatter(x[outside], y[outside], s=size, **look)


def plot_all_predictions(fit: Fit, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw predictions over measurements, one picture per group, of which a new figure holds six at most."""
    groups = list(dict.fromkeys(entry.group for entry in fit.entries))
    if ax is None:
        groups = groups[:6]  # two rows of three; more are not read at a glance
        columns = min(3, len(groups))
        rows = -(-len(groups) // columns)
        figure = new_figure(4.6 * columns, 5.3 * rows)
        ax = [quiet(figure.add_subplot(rows, columns, k + 1)) for k in range(len(groups))]
    return [plot_predictions(fit, group, ax=one) for group, one in zip(groups, ax, strict=False)]


def plot_excitation(plan: ExcitationPlan, *, ax: Axes | None = None) -> Axes:
    """Draw the commands over time, with the segments."""
    ax = new_axes(ax, 9.0, 3.8)
    looks = zip(plan.commands.T, plan.command_names, (BLUE, ORANGE, GRAY) * 6, strict=False)
    for values, name, color in looks:
        ax.plot(plan.t, values, color=color, linewidth=1.2, label=name_of(name))
    for k, one in enumerate(plan.segments):
        if k % 2:
            ax.axvspan(one.start, one.end, color=GRAY, alpha=0.12, linewidth=0)
        middle = 0.5 * (one.start + one.end)
        ax.annotate(
            one.name,
            (middle, 0.98),
            xycoords=("data", "axes fraction"),
            rotation=90,
            ha="center",
            va="top",
            fontsize=7,
            color="0.35",
        )
    low, high = float(plan.commands.min()), float(plan.commands.max())
    span = max(high - low, 1e-12)
    ax.set_ylim(low - 0.08 * span, high + 0.75 * span)
    ax.set_xlim(float(plan.t[0]), float(plan.t[-1]))
    ax.legend(loc="lower right", fontsize=8, frameon=False, ncols=4)
    label(ax, "time [s]", f"command [{unit_of(plan.command_names[0])}]")
    head(ax, "Commands that show the unknowns")
    return ax
