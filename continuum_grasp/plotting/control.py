"""Closed loops: path, inputs (of plans too), tracking, bounds, estimates and times; frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import amount_text, split_unit
from continuum_grasp.plotting.drawing import bodies
from continuum_grasp.plotting.drawing.film import Film
from continuum_grasp.plotting.drawing.style import FORBIDDEN, Color, Z, quiet
from continuum_grasp.plotting.drawing.styled_axes import StyledAxes, bend_box, over_time
from continuum_grasp.plotting.motion import motion_frames

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from continuum_grasp.closed_loop import ControlRun

_SHAPES = 9
"""Shapes drawn of a run [1]: about two per second of a few seconds, which stay apart."""


def plot_control_path(run: ControlRun, *, ax: Axes | None = None) -> Axes:
    """Draw the path of the tip in the plane with its setpoints, some shapes of the finger and what must be avoided."""
    tip = np.asarray(run.tip)
    wanted = run.tip_reference
    shapes = run.backbone(np.unique(np.linspace(0, len(tip) - 1, _SHAPES).astype(int)), points=60)
    outlines = bodies.outlines_at(run, [0, -1])
    points = [shapes, tip, *([] if wanted is None else [wanted]), *bodies.zone_points(run.scene), *chain(*outlines)]
    styled = StyledAxes.plane(ax, bend_box(points, 0.07 * run.length), colorbar=False)
    ax = styled.ax
    bodies.draw_surroundings(ax, run, shapes[0], outlines)
    for shape in shapes:
        ax.plot(*shape.T, color=Color.GRAY, linewidth=0.8, alpha=0.7, zorder=1)
    if bodies.shows_thickness(run.scene.finger):
        bodies.draw_thickness(ax, shapes[-1], run.scene.finger)
    if wanted is not None:
        jumps = _jumps(wanted)
        ax.plot(*_parted(wanted, jumps).T, color=Color.ORANGE, linewidth=1.0, linestyle="--", zorder=5)
        ends = wanted[np.unique([0, *jumps, *(jumps + 1), len(wanted) - 1])]
        ax.plot(*ends.T, "o", color=Color.ORANGE, markersize=4, label="setpoint", zorder=5)
    ax.plot(*tip.T, color=Color.BLUE, linewidth=1.6, label="tip", zorder=4)
    styled.head(run.name)
    return ax


def _jumps(wanted: NDArray[Any]) -> NDArray[np.intp]:
    """Indices of setpoints (K, 2) after which there is a jump: 20 times the usual step is none of a path."""
    steps = np.linalg.norm(np.diff(wanted, axis=0), axis=1)
    return np.flatnonzero(steps > max(20.0 * float(np.median(steps)), 1e-6))


def _parted(wanted: NDArray[Any], jumps: NDArray[np.intp]) -> NDArray[Any]:
    """Setpoints with a row of NaN where they jump, so that no line joins them: of steps alone nothing is drawn."""
    return np.insert(wanted, jumps + 1, np.nan, axis=0)


@over_time()
def plot_inputs(ax: Axes, run: Any) -> str:
    """Draw the commands over time, with their limits."""
    linear = getattr(run, "linear_inputs", False)
    for column, name, color in zip(np.asarray(run.u).T, run.u_names, Color.distinct(len(run.u_names)), strict=True):
        look: dict[str, Any] = {"color": color, "linewidth": 1.4, "label": split_unit(name).words}
        if linear:
            ax.plot(run.t, column, **look)
        else:
            ax.stairs(column[: len(run.t) - 1], run.t, baseline=None, **look)
    for limit in np.unique(run.scene.input_limits):
        ax.axhline(limit, color=Color.GRAY, linewidth=0.9, linestyle="--", zorder=1)
    return f"input [{split_unit(run.u_names[0]).unit}]"


@over_time()
def plot_tracking(ax: Axes, run: ControlRun) -> str:
    """Draw tracked quantities and setpoints over time; of several units, the first on the left, the second on the
    right.
    """
    groups = run.tracked_groups
    units = list(dict.fromkeys(group.unit for group in groups))[:2]
    columns = [(k, group.unit) for group in groups for k in group.columns if group.unit in units]
    right = ax.twinx() if len(units) > 1 else ax
    for (k, unit), color in zip(columns, Color.distinct(len(columns)), strict=True):
        axis = ax if unit == units[0] else right
        axis.plot(run.t, run.r[:, k], color=color, linewidth=1.0, linestyle="--")
        axis.plot(run.t, run.tracked[:, k], color=color, linewidth=1.4, label=split_unit(run.r_names[k]).words)
        if axis is not ax:  # the legend is of the left axes
            ax.plot([], [], color=color, linewidth=1.4, label=split_unit(run.r_names[k]).words)
    ax.plot([], [], color=Color.GRAY, linewidth=1.0, linestyle="--", label="setpoint")
    if right is not ax:
        quiet(right).grid(False)
        right.spines["right"].set(visible=True, color=Color.GRAY)
        right.margins(x=0.0)
        right.set_ylabel(StyledAxes(right).shown_label(f"tracked [{units[1]}]", "y"), color=Color.INK)
    return f"tracked [{units[0]}]"


@over_time()
def plot_tracking_error(ax: Axes, run: ControlRun) -> str:
    """Draw the distance of the tip from its setpoint over time, or else the greatest error of the first tracked
    quantity.
    """
    if run.tip_reference is not None:
        size = np.linalg.norm(run.tip - run.tip_reference, axis=1)
        name = "tip"
        unit = "m"
    else:
        name, unit = split_unit(run.r_names[0])
        name = name.rstrip("0123456789_")  # entries of one quantity differ in their number
        columns = [k for k, entry in enumerate(run.r_names) if entry.startswith(name)]
        size = np.abs(run.tracked[:, columns] - run.r[:, columns]).max(axis=1)
    ax.plot(run.t, size, color=Color.BLUE, linewidth=1.4)
    ax.set_ylim(bottom=0.0)
    return f"error of the {name.replace('_', ' ')} [{unit}]"


@over_time(columns=2)
def plot_bounds(ax: Axes, run: ControlRun) -> str:
    """Draw how far each bound is away over time, in percent of what the legend says; above zero it is exceeded."""
    shares = [100.0 * bound.excess / bound.scale for bound in run.bounds]
    names = [
        f"{split_unit(bound.name).words} (100 %: {amount_text(bound.scale, bound.unit, '.4g')})" for bound in run.bounds
    ]
    StyledAxes(ax).curves(run.t, shares, names)
    top = max(2.0, 1.1 * max(float(np.max(share)) for share in shares))
    bottom = min(-30.0, ax.get_ylim()[0])
    ax.axhspan(0.0, top, color=FORBIDDEN["facecolor"], alpha=0.75, zorder=Z.ZONE)
    ax.set_ylim(max(bottom, -105.0), top)  # what is farther away than its scale does not matter
    return "beyond the limit, which is 0 [%]"


@over_time(columns=2)
def plot_disturbances(ax: Axes, run: ControlRun) -> str:
    """Draw the estimated disturbances of one unit, with two standard deviations either way.

    The unit is the first one's; the error of a camera comes after all others.
    """
    names = run.disturbance_names
    of_finger = [name for name in names if not name.startswith("tip_offset")]
    unit = next((split_unit(name).unit for name in (*of_finger, *names)), "")
    chosen = [k for k, name in enumerate(names) if split_unit(name).unit == unit]
    for k, color in zip(chosen, Color.distinct(len(chosen)), strict=True):
        value = run.disturbance[:, k]
        spread = 2.0 * run.disturbance_std[:, k]
        ax.fill_between(run.t[:-1], value - spread, value + spread, color=color, alpha=0.15, linewidth=0.0)
        ax.plot(run.t[:-1], value, color=color, linewidth=1.4, label=split_unit(names[k]).words)
    return f"estimated disturbance [{unit}]"


def plot_controller_times(run: ControlRun, *, ax: Axes | None = None) -> Axes:
    """Draw a histogram of the time that each phase of the controller took."""
    styled = StyledAxes.on(ax)
    ax = styled.ax
    times = 1e6 * np.asarray(run.phase_times)
    positive = times[times > 0.0]
    if positive.size:
        # times are skewed, a long tail of preemptions: bins of equal ratios
        edges = np.geomspace(positive.min() / 1.05, positive.max() * 1.05, 60).tolist()
        for column, name, color in zip(times.T, run.phase_names, Color.distinct(len(run.phase_names)), strict=True):
            ax.hist(column, bins=edges, histtype="stepfilled", color=color, alpha=0.35)
            median, most = (
                f"{time:.3g}" if time < 1e3 else f"{time:,.0f}" for time in np.quantile(column, (0.5, 0.99))
            )
            text = f"{name}: median {median}, 99 % {most}"
            ax.hist(column, bins=edges, histtype="step", color=color, linewidth=1.3, label=text)
        ax.set_xscale("log")
    styled.label(r"time of a step [$\mathrm{\mu}$s]", "steps [1]")
    styled.head(run.name, columns=2)
    return ax


def control_frames(run: ControlRun, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a closed loop frame by frame, with its setpoint and the predicted path of the tip; as `motion_frames`."""
    wanted = run.tip_reference

    def ahead(film: Film, at: NDArray[Any]) -> Callable[[int], list[Artist]]:
        cross: dict[str, Any] = {"color": Color.ORANGE, "markeredgewidth": 1.8}
        if wanted is not None:
            film.ax.plot(
                *_parted(wanted, _jumps(wanted)).T, color=Color.ORANGE, linewidth=0.8, alpha=0.6, zorder=Z.SUPPORT
            )
            film.ax.plot([], [], "+", markersize=9, label="setpoint", **cross)
        path = film.prediction("predicted")
        target = film.line("+", markersize=11, zorder=Z.FORCE, **cross)

        def move(k: int) -> list[Artist]:
            path.set_data(*run.plan_tip[min(at[k], len(run.plan_tip) - 1)].T)  # nothing is planned at the last instant
            if wanted is not None:
                target.set_data(*wanted[at[k] : at[k] + 1].T)
            return [path, target]

        return move

    return motion_frames(run, indices, width, ahead, [] if wanted is None else [wanted])
