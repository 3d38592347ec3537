"""A mission over time: tensions, contact forces, friction and motion of the object, phase by phase; many trials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.plotting.drawing.axes import colors, head, new_figure, quiet
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, INK, ORANGE
from continuum_grasp.plotting.mission.instants import pull_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.mission.result import MissionRun
    from continuum_grasp.mission.trials import Outcome

_BANDS = {
    "approach": "#EAF2FA",
    "squeeze": "#D3E5F5",
    "lift": "#FBEFD5",
    "hold": "#E3F3EA",
    "rest": "#E3F3EA",
    "pull": "#F8DDD2",
    "lower": "#FBEFD5",
    "release": "#EAF2FA",
}
"""Pale, since curves are drawn on them; phases that undo each other share one."""
_LEAST_INCH = 0.14
"""Width of a phase below which its name is left out: a line of 7.5 points, upright."""


def plot_mission_timeline(mission: MissionRun, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw tensions, contact forces, use of friction and motion of the object over the phases.

    Parameters
    ----------
    mission : MissionRun
    ax : sequence of 5 matplotlib.axes.Axes, optional
        Where to draw; a new figure where not given.

    Returns
    -------
    list of matplotlib.axes.Axes
        Of phases, tensions, normal forces, friction, and motion, in one figure.
    """
    if ax is None:
        ax = new_figure(8.6, 9.4).subplots(5, 1, sharex=True, height_ratios=(0.66, 1.0, 1.35, 1.0, 1.0))
    axes = list(ax)
    strip, tension, force, friction, motion = axes
    end = float(mission.run.t[-1])
    for one in axes[1:]:
        quiet(one)
        for span in mission.spans:
            one.axvspan(span.start, span.end, color=_band(span.name), linewidth=0.0, zorder=0)
    _draw_tensions(tension, mission)
    _draw_forces(force, mission)
    _draw_friction(friction, mission)
    _draw_motion(motion, mission)
    motion.set_xlabel("time [s]", color=INK)
    motion.set_xlim(0.0, max(end, 1e-3))
    _draw_phases(strip, mission, end)
    return axes


def _band(name: str) -> str:
    return _BANDS.get(name.partition(" ")[0], "white")


def _draw_phases(ax: Axes, mission: MissionRun, end: float) -> None:
    """Names of the phases, upright, and with what each pull pulls."""
    ax.set_axis_off()
    ax.set_ylim(0.0, 1.0)
    per_second = 7.4 / max(end, 1e-3)
    for span in mission.spans:
        if span.start >= end:
            break
        ax.axvspan(span.start, span.end, color=_band(span.name), linewidth=0.0)
        wide = per_second * (min(span.end, end) - span.start)
        if wide < _LEAST_INCH or span.name in ("rest", "end"):
            continue
        wrench = mission.pulls.get(span.name)
        text = span.name if wrench is None else pull_label(wrench).replace("pull ", "")
        rotation = 0.0 if wide > 0.07 * len(text) else 90.0
        middle = 0.5 * (span.start + min(span.end, end))
        ax.text(middle, 0.5, text, rotation=rotation, ha="center", va="center", fontsize=7.5, color=INK)
    ax.set_title(mission.name or " ", fontsize=10, color=INK, loc="left")


def _draw_tensions(ax: Axes, mission: MissionRun) -> None:
    run = mission.run
    for k, color in zip(range(run.u.shape[1]), colors(run.u.shape[1]), strict=True):
        name = run.u_names[k]
        ax.stairs(
            run.u[:, k],
            run.t,
            color=color,
            linewidth=1.3,
            baseline=None,
            label=name.partition(" ")[0].replace("_", " "),
        )
        if name in run.r_names:
            ax.plot(run.t, run.r[:, run.r_names.index(name)], color=color, linewidth=0.9, linestyle="--")
    ax.plot([], [], color=GRAY, linewidth=0.9, linestyle="--", label="setpoint")
    for limit in np.unique([*run.u_min, *run.u_max]):
        ax.axhline(limit, color=GRAY, linewidth=0.9, linestyle=":", zorder=1)
    ax.plot([], [], color=GRAY, linewidth=0.9, linestyle=":", label="limit")
    ax.set_ylabel("tension [N]", color=INK)
    _legend(ax, run.u.shape[1] + 2)


def _draw_forces(ax: Axes, mission: MissionRun) -> None:
    run = mission.run
    contacts = mission.contacts
    shown = [k for k, name in enumerate(contacts.names) if np.any(contacts.normal_force[:, k] > 0.0)]
    for k, color in zip(shown, colors(len(shown)), strict=True):
        ax.plot(run.t, contacts.normal_force[:, k], color=color, linewidth=1.3, label=contacts.names[k])
    wanted = run.r[:, run.r_names.index(f"contact_force_{mission.held_contact} [N]")]
    ax.plot(run.t, wanted, color=INK, linewidth=1.0, linestyle="--", label=f"setpoint of {mission.held_contact}")
    ax.plot(run.t[:-1], mission.force_estimate, color=GRAY, linewidth=0.9, label="its estimate", zorder=1.9)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("normal force [N]", color=INK)
    _legend(ax, len(shown) + 2)


def _draw_friction(ax: Axes, mission: MissionRun) -> None:
    run = mission.run
    names = mission.contacts.names
    shown = [k for k, name in enumerate(names) if np.any(np.isfinite(mission.friction_use[:, k]))]
    everything = [k for k, name in enumerate(names) if np.any(mission.contacts.normal_force[:, k] > 0.0)]
    shade = dict(zip(everything, colors(len(everything)), strict=True))
    for k in shown:
        ax.plot(run.t, mission.friction_use[:, k], color=shade.get(k, GRAY), linewidth=1.3, label=names[k])
    ax.axhline(1.0, color=GRAY, linewidth=0.9, linestyle=":", zorder=1, label="whole friction cone")
    ax.set_ylim(0.0, 1.08)
    ax.set_ylabel("friction used [1]", color=INK)
    _legend(ax, len(shown) + 1)


def _draw_motion(ax: Axes, mission: MissionRun) -> None:
    """Motion since the lift began; before that, the object is slid along the table by the finger."""
    run = mission.run
    start = next((span.start for span in mission.spans if span.name == "lift"), 0.0)
    begin = min(int(np.searchsorted(run.t, start - 1e-9)), len(run.t) - 1)
    moved = 1e3 * (mission.object_pose - mission.object_pose[begin])
    labels = ("x since the lift", "y", "height")
    for values, label, color in zip((moved[:, 0], moved[:, 1], moved[:, 3]), labels, colors(3), strict=True):
        ax.plot(run.t, values, color=color, linewidth=1.3, label=label)
    ax.set_ylabel("object moved [mm]", color=INK)
    _legend(ax, 3)


def _legend(ax: Axes, entries: int) -> None:
    head(ax, None, entries=entries, columns=max(entries, 1))


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
