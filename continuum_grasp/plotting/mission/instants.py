"""A mission at one instant: finger, object, forces, and the instants that matter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import Box, bend_box
from continuum_grasp.plotting.drawing.fingers import draw_body, finger_outline
from continuum_grasp.plotting.drawing.forces import Force, draw_arrow
from continuum_grasp.plotting.drawing.objects import draw_object, object_outlines
from continuum_grasp.plotting.drawing.style import BLUE, EDGE, ORANGE, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.mission.result import MissionRun

__all__ = [
    "acting_forces",
    "box_of",
    "draw_grasp",
    "draw_moment",
    "instants",
    "pull_at",
    "pull_label",
]

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


def box_of(mission: MissionRun, shapes: Array, poses: Array, margin: float) -> Box:
    """Limits around finger and object in some of their poses."""
    outlines = [part for pose in poses for part in object_outlines(mission.body, pose)]
    return bend_box([shapes, *outlines], margin)


def draw_grasp(ax: Axes, mission: MissionRun, shape: Array, pose: Array, **style: Any) -> list[Any]:
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


def pull_at(mission: MissionRun, t: float) -> Array:
    """Wrench (3) that pulls at an instant, were it whole throughout its phase; zero in the others."""
    for span in mission.spans:
        if span.name in mission.pulls and span.start < t < span.end:
            return mission.pulls[span.name]
    return np.zeros(3)


def acting_forces(mission: MissionRun, index: int) -> list[Force]:
    """Forces of the contacts and of a pull at one instant: where (2,) [m], force (2,) [N], and of what kind.

    What is too small to be seen beside the greatest is left out.
    """
    run = mission.run
    pulled = pull_at(mission, float(run.t[index]))[:2]
    least = _SEEN * float(np.max(mission.contacts.normal_force, initial=0.0))
    found = [*mission.contacts.at(index), (mission.object_pose[index, :2], pulled, "load")]
    return [(np.asarray(at), np.asarray(force), kind) for at, force, kind in found if np.hypot(*force) > least]


def draw_moment(ax: Axes, pose: Array, moment: float, radius: float, **style: Any) -> list[Any]:
    """Draw a moment on an object as an arc with a head."""
    if not moment:
        return []
    turn = np.sign(moment) * np.linspace(-0.5 * np.pi, 0.9 * np.pi, 60)
    arc = pose[:2] + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    head = draw_arrow(ax, arc[-6], arc[-1], ORANGE, width=1.8, **{"zorder": Z.MOMENT, **style})
    return [*ax.plot(*arc[:-4].T, color=ORANGE, linewidth=1.8, zorder=Z.MOMENT, **style), head]
