"""Measurements against predictions, and the residuals between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing.axes import head, new_axes, new_figure, quiet
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, INK, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.identification.fit import Fit


def plot_residuals(fit: Fit, *, ax: Axes | None = None) -> Axes:
    """Draw residuals in standard deviations, set by set; those that were not fitted as open rings.

    Parameters
    ----------
    fit : Fit
        What an identification found.
    ax : matplotlib.axes.Axes, optional
        Where to draw; axes of a new figure where not given.

    Returns
    -------
    matplotlib.axes.Axes
    """
    ax = new_axes(ax, 7.2, 4.0)
    scaled = fit.residuals / fit.sigma
    number = np.arange(1, scaled.size + 1)
    size = 22.0 if scaled.size <= 200 else 7.0
    inside, outside = np.asarray(fit.fitted), ~np.asarray(fit.fitted)
    ax.axhspan(-2.0, 2.0, color=BLUE, alpha=0.08, linewidth=0)
    ax.axhline(0.0, color=GRAY, linewidth=0.8)
    ax.scatter(number[inside], scaled[inside], s=size, color=BLUE, linewidth=0, label="fitted", zorder=3)
    if outside.any():
        ax.scatter(
            number[outside], scaled[outside], s=size, facecolor="none", edgecolor=ORANGE, label="hold-out", zorder=3
        )
    end = 0
    for _, count in fit.blocks[:-1]:
        end += count
        ax.axvline(end + 0.5, color=GRAY, linewidth=0.6, linestyle=":")
    reach = 1.15 * max(3.0, float(np.abs(scaled).max(initial=0.0)))
    ax.set_ylim(-reach, reach)
    ax.locator_params(axis="x", integer=True)
    ax.set_xlabel("number of the measurement (dotted: next set)", color=INK)
    ax.set_ylabel("residual [standard deviations]", color=INK)
    head(ax, "Residuals: predicted less measured", 1 + int(outside.any()))
    return ax


def plot_predictions(fit: Fit, group: str, *, ax: Axes | None = None) -> Axes:
    """Draw predictions of one group over measurements; on the line they agree.

    Parameters
    ----------
    fit : Fit
        What an identification found.
    group : str
        Which numbers: ``entry.group`` of some.
    ax : matplotlib.axes.Axes, optional
        Where to draw; axes of a new figure where not given.

    Returns
    -------
    matplotlib.axes.Axes

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
    inside, outside = members & np.asarray(fit.fitted), members & ~np.asarray(fit.fitted)
    numbers = np.concatenate([fit.measured[members], fit.predictions[members]])
    size = 22.0 if members.sum() <= 200 else 7.0
    margin = 0.05 * max(float(np.ptp(numbers)), 1e-12)
    ends = [float(numbers.min()) - margin, float(numbers.max()) + margin]
    ax.plot(ends, ends, color=GRAY, linewidth=0.9, zorder=1)
    ax.scatter(fit.measured[inside], fit.predictions[inside], s=size, color=BLUE, linewidth=0, label="fitted", zorder=3)
    if outside.any():
        ax.scatter(
            fit.measured[outside],
            fit.predictions[outside],
            s=size,
            linewidth=0.8,
            facecolor="none",
            edgecolor=ORANGE,
            label="hold-out",
            zorder=3,
        )
    ax.set_xlim(*ends)
    ax.set_ylim(*ends)
    ax.set_box_aspect(1.0)
    ax.locator_params(nbins=5)
    ax.set_xlabel(f"measured [{unit}]", color=INK)
    ax.set_ylabel(f"predicted [{unit}]", color=INK)
    head(ax, group[:1].upper() + group[1:], int(inside.any()) + int(outside.any()))
    return ax


def plot_all_predictions(fit: Fit, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw predictions over measurements, one picture per group.

    Parameters
    ----------
    fit : Fit
        What an identification found.
    ax : sequence of matplotlib.axes.Axes, optional
        Where to draw, one per group; a new figure with at most six where not given.

    Returns
    -------
    list of matplotlib.axes.Axes
    """
    groups = list(dict.fromkeys(entry.group for entry in fit.entries))
    if ax is None:
        groups = groups[:6]  # two rows of three; more are not read at a glance
        columns = min(3, len(groups))
        rows = -(-len(groups) // columns)
        figure = new_figure(4.6 * columns, 5.3 * rows)
        ax = [quiet(figure.add_subplot(rows, columns, k + 1)) for k in range(len(groups))]
    return [plot_predictions(fit, group, ax=one) for group, one in zip(groups, ax, strict=False)]
