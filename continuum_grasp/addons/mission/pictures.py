"""A mission: at the instants that matter, frame by frame, and over time phase by phase; many trials of one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array, amount_text
from continuum_grasp.plotting import Color, HeldObject, StyledAxes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.addons.mission.outcomes import Outcome
    from continuum_grasp.addons.mission.result import MissionRun


_COLUMNS = (4, 5, 6)
"""Numbers of snapshots in a row to choose from: the choice leaves the fewest places empty."""
_WIDE = 2.1
"""Width of one [inch]: six fit across a page in landscape."""
_NAMED = {"approach": "about to touch", "squeeze": "squeezed", "hold": "lifted and held", "end": "released"}
"""State reached at the end of a phase, in words."""
_WORDS = {"load": "pull", "contact": "contact, on the finger", "support": "support, on the object"}
"""Words of a legend for a kind of force, where they differ from its name."""
_BANDS = {
    **dict.fromkeys(("approach", "release", "touch", "leave"), "#EAF2FA"),
    "turn": "#EFE6F5",
    **dict.fromkeys(("lift", "lower"), "#FBEFD5"),
    **dict.fromkeys(("hold", "rest"), "#E3F3EA"),
    **dict.fromkeys(("squeeze", "confirm"), "#D3E5F5"),
    "pull": "#F8DDD2",
}
"""Pale, since curves are drawn on them; phases that undo each other share one."""


def plot_mission_snapshots(mission: MissionRun) -> list[Axes]:
    """Draw finger, object, supports and forces at the instants that matter, side by side in one figure.

    Forces of all instants are to one scale.
    """
    from matplotlib.lines import Line2D

    chosen = _instants(mission)
    at = np.array(list(chosen))
    shapes = _backbones(mission, at)
    poses = mission.object_pose[at, :3]
    held = _held_object(mission)
    arrows = held.arrows(_forces_at(mission, at), _least_force(mission))
    box = held.box(shapes, poses, 0.09 * mission.length, arrows.ends)
    columns = min(_COLUMNS, key=lambda count: -len(at) % count) if len(at) > max(_COLUMNS) else len(at)
    rows = -(-len(at) // columns)
    high = _WIDE * (box[3] - box[2]) / (box[1] - box[0])
    figure = StyledAxes.figure(columns * (_WIDE + 0.12) + 0.55, rows * (high + 0.42) + 0.95)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax in grid.ravel()[len(at) :]:
        ax.set_axis_off()
    axes = list(grid.ravel()[: len(at)])
    for j, (ax, k, shape, pose) in enumerate(zip(axes, at, shapes, poses, strict=True)):
        unit = StyledAxes(ax).show_box(box)
        ax.grid(False)
        ax.tick_params(labelleft=j % columns == 0, labelbottom=j + columns >= len(at), labelsize=8)
        held.draw_fixed(ax, shape)
        held.draw(ax, shape, pose, _pull_at(mission, float(mission.t[k]))[2])
        arrows.draw(ax, j)
        ax.set_title(f"{chosen[int(k)]}\n{mission.t[k]:.2f} s", fontsize=8.5, color=Color.INK, loc="left")
    figure.supxlabel(f"x [{unit}]", fontsize=9, color=Color.INK)
    figure.supylabel(f"y [{unit}]", fontsize=9, color=Color.INK)
    figure.head(mission.name or " ")
    handles = [Line2D([], [], **key) for key in arrows.keys(_WORDS)]
    figure.legend(handles=handles, loc="outside upper right", ncols=max(len(handles), 1), frameon=False, fontsize=9)
    return axes


def mission_frames(mission: MissionRun, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a mission frame by frame; as `motion_frames`."""
    unique, back = np.unique(indices, return_inverse=True)
    shapes = _backbones(mission, unique)
    poses = mission.object_pose[unique, :3]
    held = _held_object(mission)
    arrows = held.arrows(_forces_at(mission, unique), _least_force(mission))
    film = held.film(shapes, poses, 0.09 * mission.length, width)
    ax = film.ax
    labels = ["predicted tip"] + [""] * (len(mission.runs) - 1)
    ahead = [film.prediction(label) for label in labels]
    clock = film.clock()
    StyledAxes(ax).head(mission.name)

    def moving(k: int) -> tuple[list[Any], list[Any]]:
        at = int(unique[k])
        t = float(mission.t[at])
        for line, run in zip(ahead, mission.runs, strict=True):
            line.set_data(*run.plan_tip[min(at, len(run.plan_tip) - 1)].T)
        span = next((span for span in mission.spans if span.start <= t < span.end), mission.spans[-1])
        phase = _pull_words(mission.pulls[span.name]) if span.name in mission.pulls else str(span.name)
        clock.set_text(f"{phase}\n{t:.2f} s")
        passing = held.draw(ax, shapes[k], poses[k], _pull_at(mission, t)[2], animated=True)
        return [*ahead, clock], passing + arrows.draw(ax, k)

    return film.frames(back, moving)


def _instants(mission: MissionRun) -> dict[int, str]:
    """Index and name of each instant that matters: begin and end of what happens, and the middle of every pull."""
    t = np.asarray(mission.t)
    wanted: list[tuple[float, str]] = [(t[0], "start")]
    for span in mission.spans:
        if span.name in mission.pulls:
            wanted.append((0.5 * (span.start + span.end), _pull_words(mission.pulls[span.name])))
        if span.name in _NAMED:
            wanted.append((span.end, _NAMED[span.name]))
        if span.name.startswith("turn "):
            wanted += [(span.start, f"touched, {span.name}"), (span.end, f"{span.name} done")]
    # a mission that was stopped has no later instants
    return {int(np.abs(t - at).argmin()): name for at, name in wanted if at <= t[-1] + 1e-9}


def _pull_words(wrench: Array) -> str:
    """A wrench (3) [N, N m] in a few words."""
    parts = [f"{amount_text(v, 'N', '+.1f')} in {axis}" for v, axis in zip(wrench[:2], "xy", strict=True) if v]
    if wrench[2]:
        parts.append(amount_text(wrench[2], "N m", "+.2g"))
    return "pull " + (", ".join(parts) or "of nothing").replace("-", "\N{MINUS SIGN}")


def _held_object(mission: MissionRun) -> HeldObject:
    return HeldObject(mission.scene.body, [scene.finger for scene in mission.scenes], mission.scene.supports)


def _backbones(mission: MissionRun, at: Array) -> Array:
    """Backbones (len(at), fingers, points, 2) at some of the instants [m]."""
    return np.stack([run.backbone(at, points=60) for run in mission.runs], axis=1)


def _pull_at(mission: MissionRun, t: float) -> Array:
    """Wrench (3) that pulls at an instant, were it whole throughout its phase; zero in the others."""
    for span in mission.spans:
        if span.name in mission.pulls and span.start < t < span.end:
            return mission.pulls[span.name]
    return np.zeros(3)


def _forces_at(mission: MissionRun, indices: NDArray[Any]) -> Iterator[list[tuple[Array, Array, str]]]:
    """Forces of contacts and pulls at some instants: place, force and kind."""
    for index in map(int, indices):
        pulled = _pull_at(mission, float(mission.t[index]))[:2]
        yield [*mission.contacts.at(index), (mission.object_pose[index, :2], pulled, "load")]


def _least_force(mission: MissionRun) -> float:
    """Force below which none is drawn [N]: beside the greatest one its arrow would be shorter than its head."""
    # 0.05: share of the greatest force
    return 0.05 * float(np.max(mission.contacts.normal_force, initial=0.0))


def plot_mission_timeline(mission: MissionRun, *, ax: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw inputs, contact forces, use of friction and motion of the object over the phases.

    The five axes, in one figure where none are given, are of phases, inputs, normal forces, friction, and motion; a
    sixth one is of the object's angle where it is turned before its grasp.
    """
    curves = (*_CURVES, *[(_draw_angle, "object's angle [deg]")] * (mission.mission.turn is not None))
    if ax is None:
        heights = (0.66, 1.0, 1.35, 1.0, 1.0, 1.0)[: len(curves) + 1]
        ax = StyledAxes.figure(8.6, 1.88 * len(heights)).subplots(len(heights), 1, sharex=True, height_ratios=heights)
    strip, *rest = ax
    first = mission.assignments[0].control.finger.inputs[0]
    taken = f"{first.word} [{first.unit}]"
    end = max(float(mission.t[-1]), 1e-3)
    for axes, (draw, text) in zip(rest, curves, strict=True):
        for span in mission.spans:
            axes.axvspan(span.start, span.end, color=_band(span.name), linewidth=0.0, zorder=0)
        draw(axes, mission)
        axes.set_ylabel(StyledAxes(axes).shown_label(text.format(input=taken), "y"), color=Color.INK)
        # Of three fingers the tensions, their setpoints and limits take two rows.
        entries = len(axes.get_legend_handles_labels()[1])
        StyledAxes(axes).head(None, entries if 0 < entries < 8 else 4)
    rest[-1].set_xlabel("time [s]", color=Color.INK)
    rest[-1].set_xlim(0.0, end)
    _draw_phases(strip, mission, end)
    return list(ax)


def _band(name: str) -> str:
    return _BANDS.get(name.partition(" ")[0], "white")


def _draw_phases(ax: Axes, mission: MissionRun, end: float) -> None:
    """Names of the phases, upright where they are narrow, and with what each pull pulls."""
    ax.set_axis_off()
    ax.set_ylim(0.0, 1.0)
    for span in mission.spans:
        if span.start >= mission.t[-1]:
            break
        ax.axvspan(span.start, span.end, color=_band(span.name), linewidth=0.0)
        stop = min(span.end, float(mission.t[-1]))
        wide = 7.4 / end * (stop - span.start)  # the axes are 7.4 inch wide
        # 0.14: width of a phase below which its name is left out: a line of 7.5 points, upright
        if wide < 0.14 or span.name in ("rest", "end"):
            continue
        wrench = mission.pulls.get(span.name)
        text = span.name if wrench is None else _pull_words(wrench).replace("pull ", "")
        rotation = 0.0 if wide > 0.07 * len(text) else 90.0  # 0.07 inch per letter of 7.5 points
        middle = 0.5 * (span.start + stop)
        ax.text(middle, 0.5, text, rotation=rotation, ha="center", va="center", fontsize=7.5, color=Color.INK)
    StyledAxes(ax).head(mission.name)


def _draw_inputs(ax: Axes, mission: MissionRun) -> None:
    curves = []
    for finger, run in mission.fingers.items():
        curves += [(finger, run, k) for k in range(len(run.u_names))]
    for (finger, run, k), color in zip(curves, Color.distinct(len(curves)), strict=True):
        name = run.u_names[k]
        what = run.scene.finger.inputs[k].name.replace("_", " ")
        whose = what if mission.run is not None else f"{finger}: {what}"
        ax.stairs(run.u[:, k], run.t, color=color, linewidth=1.3, baseline=None, label=whose)
        if name in run.r_names:
            ax.plot(run.t, run.r[:, run.r_names.index(name)], color=color, linewidth=0.9, linestyle="--")
    ax.plot([], [], color=Color.GRAY, linewidth=0.9, linestyle="--", label="setpoint")
    limits = [(*run.u_min, *run.u_max) for run in mission.runs]
    for limit in np.unique(np.concatenate(limits)):
        ax.axhline(limit, color=Color.GRAY, linewidth=0.9, linestyle=":", zorder=1)
    ax.plot([], [], color=Color.GRAY, linewidth=0.9, linestyle=":", label="limit")


def _touching(mission: MissionRun) -> dict[int, Any]:
    """Colors of the contacts that touch at any time, by their column."""
    touching = np.flatnonzero(np.any(mission.contacts.normal_force > 0.0, axis=0))
    return dict(zip(touching.tolist(), Color.distinct(len(touching)), strict=True))


def _draw_normal_forces(ax: Axes, mission: MissionRun) -> None:
    t, contacts = mission.t, mission.contacts
    for k, color in _touching(mission).items():
        ax.plot(t, contacts.normal_force[:, k], color=color, linewidth=1.3, label=contacts.names[k])
    held = mission.held_forces
    # All look alike, and names of several would not fit.
    labels: tuple[str | None, str | None] = "setpoints", "estimates, ± 1 std"
    if len(held) == 1:
        labels = f"setpoint of {next(iter(held))}", "its estimate, ± 1 std"
    for wanted, believed, std in held.values():
        ax.plot(t, wanted, color=Color.INK, linewidth=1.0, linestyle="--", label=labels[0])
        ax.plot(t[:-1], believed, color=Color.GRAY, linewidth=0.9, label=labels[1], zorder=1.9)
        ax.fill_between(t[:-1], believed - std, believed + std, color=Color.GRAY, alpha=0.2, linewidth=0.0, zorder=1.8)
        labels = None, None
    ax.set_ylim(bottom=0.0)


def _draw_friction(ax: Axes, mission: MissionRun) -> None:
    shade = _touching(mission)
    for k, name in enumerate(mission.contacts.names):
        use = mission.friction_use[:, k]
        if np.isfinite(use).any():
            ax.plot(mission.t, use, color=shade.get(k, Color.GRAY), linewidth=1.3, label=name)
    ax.axhline(1.0, color=Color.GRAY, linewidth=0.9, linestyle=":", zorder=1, label="whole friction cone")
    ax.set_ylim(0.0, 1.08)


def _draw_moved(ax: Axes, mission: MissionRun) -> None:
    """Motion since the lift began; before that, the object is slid along the table by the finger."""
    t = mission.t
    start = next((span.start for span in mission.spans if span.name == "lift"), 0.0)
    begin = min(int(np.searchsorted(t, start - 1e-9)), len(t) - 1)
    moved = 1e3 * (mission.object_pose - mission.object_pose[begin])
    rows = ((0, "x since the lift"), (1, "y"), (3, "height"))[: moved.shape[1] - 1]  # in the plane there is none
    for (k, name), color in zip(rows, Color.distinct(len(rows)), strict=True):
        ax.plot(t, moved[:, k], color=color, linewidth=1.3, label=name)


def _draw_angle(ax: Axes, mission: MissionRun) -> None:
    """The object's angle, and its setpoint as long as it is followed."""
    run = mission.runs[0]
    turning = [span for span in mission.spans if span.name.partition(" ")[0] == "turn"]
    name = "object_angle [rad]"
    ax.plot(mission.t, np.degrees(mission.object_pose[:, 2]), color=Color.BLUE, linewidth=1.3, label="of the plant")
    followed = np.any([(mission.t >= span.start) & (mission.t <= span.end) for span in turning], axis=0)
    wanted = np.where(followed, np.degrees(run.r[:, run.r_names.index(name)]), np.nan)
    ax.plot(mission.t, wanted, color=Color.INK, linewidth=1.0, linestyle="--", label="setpoint")
    # Behind the plant's: a camera's noise is a hair's breadth at this scale.
    believed = np.degrees(run.estimate[:, run.estimated_names.index(name)])
    ax.plot(mission.t[:-1], believed, color=Color.GRAY, linewidth=0.9, label="its estimate", zorder=1.9)


_CURVES = (
    (_draw_inputs, "{input}"),
    (_draw_normal_forces, "normal force [N]"),
    (_draw_friction, "friction used [1]"),
    (_draw_moved, "object moved [mm]"),
)
"""Curves drawn over time, from top to bottom."""


def plot_trials(outcomes: Sequence[Outcome]) -> list[Axes]:
    """Draw error of the held force and least slip margin of many plants over what differs between them.

    Two rows of axes: force errors, then slip margins; plants that failed are crosses.
    """
    judged = [(outcome, outcome.verdict) for outcome in outcomes if outcome.verdict is not None]
    good = np.array([outcome.succeeded for outcome, _ in judged], dtype=bool)
    varied = [outcome.variation for outcome, _ in judged]
    scales = ("stiffness", "damping", "mass", "friction")
    abscissas = {}
    for name in scales:
        abscissas[f"{name} [1]"] = [getattr(variation, name) for variation in varied]
    abscissas["shift x [mm]"] = [1e3 * variation.shift[0] for variation in varied]
    abscissas["shift y [mm]"] = [1e3 * variation.shift[1] for variation in varied]
    ordinates = {
        "force error [%]": np.array([100.0 * verdict.force_error for _, verdict in judged], dtype=float),
        "least slip margin [1]": np.array([verdict.slip_margin for _, verdict in judged], dtype=float),
    }
    figure = StyledAxes.figure(10.2, 4.4)
    grid = figure.subplots(2, len(abscissas), sharex="col", sharey="row", squeeze=False)
    for ax, name in zip(grid[-1], abscissas, strict=True):
        ax.set_xlabel(name, color=Color.INK, fontsize=9)
    for row, (what, values) in zip(grid, ordinates.items(), strict=True):
        for ax, against in zip(row, abscissas.values(), strict=True):
            x = np.array(against, dtype=float)
            ax.plot(x[good], values[good], "o", color=Color.BLUE, markersize=3.5, alpha=0.8, markeredgewidth=0.0)
            ax.plot(x[~good], values[~good], "x", color=Color.ORANGE, markersize=6, markeredgewidth=1.6)
        row[0].set_ylabel(what, color=Color.INK, fontsize=9)
        low = 1.1 * float(np.nanmin(values, initial=0.0))
        high = float(np.nanmax(values, initial=0.0))
        row[0].set_ylim(low, high + 0.06 * (high - low) or 1.0)  # 0.06: a margin in which dots are whole
    held = f"{int(good.sum())} of {len(outcomes)} plants held and released"
    figure.head(held + ("" if good.all() else "; crosses: not"))
    return list(grid.ravel())
