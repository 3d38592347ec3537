"""A mission at the instants that matter, side by side, and frame by frame: finger, object and forces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import Box, bend_box, head, new_figure, quiet
from continuum_grasp.plotting.drawing.film import Film
from continuum_grasp.plotting.drawing.fingers import draw_body, draw_clamp, finger_outline
from continuum_grasp.plotting.drawing.forces import Force, draw_arrow, draw_forces, force_keys, force_scale, sizes_of
from continuum_grasp.plotting.drawing.objects import draw_object, draw_supports, object_outlines
from continuum_grasp.plotting.drawing.style import BLUE, EDGE, GREEN, INK, ORANGE, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from continuum_grasp.mission.result import MissionRun

Array = NDArray[Any]
_SEEN = 0.05
"""Share of the greatest force below which a force is not drawn: its arrow would be shorter than its head."""


def instants(mission: MissionRun) -> dict[int, str]:
    """Index and name of each instant that matters: begin and end of what happens, and the middle of every pull."""
    t = np.asarray(mission.run.t)
    wanted: list[tuple[float, str]] = [(t[0], "start")]
    for span in mission.spans:
        if span.name in mission.pulls:
            wanted.append((0.5 * (span.start + span.end), pull_label(mission.pulls[span.name])))
        named = {"approach": "about to touch", "squeeze": "squeezed", "hold": "lifted and held", "end": "released"}
        if span.name in named:
            wanted.append((span.end, named[span.name]))
    return {int(np.abs(t - at).argmin()): name for at, name in wanted if at <= t[-1] + 1e-9}


def pull_label(wrench: Array) -> str:
    """A wrench in a few words."""
    force, moment = wrench[:2], float(wrench[2])
    words = []
    for value, axis in zip(force, "xy", strict=True):
        if value:
            words.append(f"{value:+.1f} N in {axis}".replace("-", "\N{MINUS SIGN}"))
    if moment:
        words.append(f"{1e3 * moment:+.0f} mN m".replace("-", "\N{MINUS SIGN}"))
    return "pull " + (", ".join(words) or "of nothing")


def _box_of(mission: MissionRun, shapes: Array, poses: Array, margin: float) -> Box:
    """Limits around finger and object in some of their poses."""
    outlines = [part for pose in poses for part in object_outlines(mission.body, pose)]
    return bend_box([shapes, *outlines], margin)


def _draw_grasp(ax: Axes, mission: MissionRun, shape: Array, pose: Array, **style: Any) -> list[Any]:
    """Draw object and finger; a mark on the object, from its center along its x axis, shows how it turns."""
    outlines = object_outlines(mission.body, pose)
    reach = 0.5 * np.linalg.norm(np.concatenate(outlines) - pose[:2], axis=1).min()
    mark = np.array([pose[:2], pose[:2] + reach * np.array([np.cos(pose[2]), np.sin(pose[2])])])
    return [
        *draw_object(ax, outlines, **style),
        draw_body(ax, finger_outline(shape, mission.scene.finger.thickness_radius), **style),
        *ax.plot(*shape.T, color=BLUE, linewidth=1.8, solid_capstyle="round", zorder=Z.SHAPE, **style),
        *ax.plot(*mark.T, color=EDGE, linewidth=1.2, zorder=Z.MARK, **style),
    ]


def _pull_at(mission: MissionRun, t: float) -> Array:
    """Wrench (3) that pulls at an instant, were it whole throughout its phase; zero in the others."""
    for span in mission.spans:
        if span.name in mission.pulls and span.start < t < span.end:
            return mission.pulls[span.name]
    return np.zeros(3)


def _acting_forces(mission: MissionRun, index: int) -> list[Force]:
    """Forces of the contacts and of a pull at one instant: where (2,) [m], force (2,) [N], and of what kind.

    What is too small to be seen beside the greatest is left out.
    """
    run = mission.run
    pulled = _pull_at(mission, float(run.t[index]))[:2]
    least = _SEEN * float(np.max(mission.contacts.normal_force, initial=0.0))
    found = [*mission.contacts.at(index), (mission.object_pose[index, :2], pulled, "load")]
    return [(np.asarray(at), np.asarray(force), kind) for at, force, kind in found if np.hypot(*force) > least]


def _draw_moment(ax: Axes, pose: Array, moment: float, radius: float, **style: Any) -> list[Any]:
    """Draw a moment on an object as an arc with a head."""
    if not moment:
        return []
    turn = np.sign(moment) * np.linspace(-0.5 * np.pi, 0.9 * np.pi, 60)
    arc = pose[:2] + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    head = draw_arrow(ax, arc[-6], arc[-1], ORANGE, width=1.8, **{"zorder": Z.MOMENT, **style})
    return [*ax.plot(*arc[:-4].T, color=ORANGE, linewidth=1.8, zorder=Z.MOMENT, **style), head]


_COLUMNS = (4, 5, 6)
"""Numbers of snapshots in a row, of which that is taken that leaves the fewest places empty."""
_WIDE = 2.1
"""Width of one [inch]: six fit across a page in landscape."""
_WORDS = {"load": "pull", "contact": "contact, on the finger", "support": "support, on the object"}
"""What a legend calls a kind of force, where that is another word."""


def plot_mission_snapshots(mission: MissionRun) -> list[Axes]:
    """Draw finger, object, supports and forces at the instants that matter, side by side.

    Parameters
    ----------
    mission : MissionRun

    Returns
    -------
    list of matplotlib.axes.Axes
        One per instant, in one figure; forces of all are to one scale.
    """
    run, chosen = mission.run, instants(mission)
    at = np.array(list(chosen))
    shapes, poses = np.asarray(run.backbone(at, points=60)), mission.object_pose[at, :3]
    box = _box_of(mission, shapes, poses, 0.06 * run.length)
    forces = [force for k in at for force in _acting_forces(mission, int(k))]
    scale = force_scale(sizes_of(forces), 0.25 * run.length)
    columns = min(_COLUMNS, key=lambda count: -len(at) % count) if len(at) > max(_COLUMNS) else len(at)
    rows = -(-len(at) // columns)
    high = _WIDE * (box[3] - box[2]) / (box[1] - box[0])
    figure = new_figure(columns * (_WIDE + 0.12) + 0.55, rows * (high + 0.42) + 0.95)
    grid = figure.subplots(rows, columns, squeeze=False)
    for ax in grid.ravel()[len(at) :]:
        ax.set_axis_off()
    axes = list(grid.ravel()[: len(at)])
    for j, (ax, k, shape, pose) in enumerate(zip(axes, at, shapes, poses, strict=True)):
        quiet(ax).set_aspect("equal")
        ax.set_xlim(box[0], box[1])
        ax.set_ylim(box[2], box[3])
        ax.grid(False)
        ax.tick_params(labelleft=j % columns == 0, labelbottom=j + columns >= len(at), labelsize=8)
        draw_supports(ax, mission.scene.supports)
        draw_clamp(ax, shape, run.length)
        _draw_grasp(ax, mission, shape, pose)
        wrench = _pull_at(mission, float(run.t[k]))
        draw_forces(ax, _acting_forces(mission, int(k)), scale)
        _draw_moment(ax, pose, float(wrench[2]), 0.12 * run.length)
        ax.set_title(f"{chosen[int(k)]}\n{run.t[k]:.2f} s", fontsize=8.5, color=INK, loc="left")
    figure.supxlabel("x [m]", fontsize=9, color=INK)
    figure.supylabel("y [m]", fontsize=9, color=INK)
    _explain(figure, mission.name, forces)
    return axes


def _explain(figure: Figure, name: str | None, forces: Sequence[Force]) -> None:
    """Above all axes of a figure: the name, and what arrows mean, with the greatest force of each kind."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], **key) for key in force_keys(forces, _WORDS)]
    figure.suptitle(name or " ", fontsize=10, color=INK, x=0.01, ha="left")
    figure.legend(handles=handles, loc="outside upper right", ncols=max(len(handles), 1), frameon=False, fontsize=9)


def mission_frames(mission: MissionRun, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a mission frame by frame; as `motion_frames`."""
    run = mission.run
    unique, back = np.unique(indices, return_inverse=True)
    shapes, poses = np.asarray(run.backbone(unique, points=60)), mission.object_pose[unique, :3]
    forces = [_acting_forces(mission, int(k)) for k in unique]
    scale = force_scale(sizes_of(one for some in forces for one in some), 0.25 * run.length)
    film = Film(_box_of(mission, shapes, poses[[0, -1]], 0.09 * run.length), width)
    ax = film.ax
    draw_supports(ax, mission.scene.supports)
    draw_clamp(ax, shapes[0], run.length)
    (ahead,) = ax.plot([], [], color=GREEN, linewidth=1.6, zorder=Z.MASS, animated=True)
    ax.plot([], [], color=GREEN, linewidth=1.6, label="predicted tip")
    words = film.corner_text()
    head(ax, mission.name, entries=1)

    def moving(k: int) -> tuple[list[Any], list[Any]]:
        at = int(unique[k])
        t = float(run.t[at])
        ahead.set_data(*run.plan_tip[min(at, len(run.plan_tip) - 1)].T)
        words.set_text(f"{_phase(mission, t)}\n{t:.2f} s")
        passing = _draw_grasp(ax, mission, shapes[k], poses[k], animated=True)
        passing += _draw_moment(ax, poses[k], float(_pull_at(mission, t)[2]), 0.12 * run.length, animated=True)
        passing += draw_forces(ax, forces[k], scale).values()
        return [ahead, words], passing

    return film.frames(back, moving)


def _phase(mission: MissionRun, t: float) -> str:
    """The phase at an instant; of a pull, what is pulled with."""
    span = next((span for span in mission.spans if span.start <= t < span.end), mission.spans[-1])
    return pull_label(mission.pulls[span.name]) if span.name in mission.pulls else str(span.name)
