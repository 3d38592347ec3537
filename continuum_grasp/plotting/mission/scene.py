"""What the pictures of a mission ask of it, and its finger, object and forces at one instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import BLUE, INK, ORANGE, Box, bend_box
from continuum_grasp.plotting.drawing.finger_shape import Force, kind_color
from continuum_grasp.plotting.drawing.objects import draw_body, draw_object, finger_outline, object_outlines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "DrawableMission",
    "acting_forces",
    "box_of",
    "draw_grasp",
    "draw_moment",
    "explain_forces",
    "instants",
    "pull_at",
    "pull_label",
]

Array = NDArray[Any]
_WORDS = {"load": "pull", "contact": "contact, on the finger", "support": "support, on the object"}
"""What a legend calls a kind of force, where that is another word."""

_SEEN = 0.05
"""Share of the greatest force below which a force is not drawn."""


class DrawableMission(Protocol):
    """A mission that was carried out; SI units, world frame."""

    @property
    def run(self) -> Any:
        """The closed loop, as ``DrawableControl``, with contacts and the pose of an object."""

    @property
    def scene(self) -> Any:
        """The plant's finger, object, walls and pegs."""

    @property
    def name(self) -> str | None:
        """Title of the pictures."""

    @property
    def spans(self) -> Sequence[Any]:
        """Phases with name, start and end [s]."""

    @property
    def pulls(self) -> Mapping[str, Array]:
        """Wrench (3) of each phase that pulls [N, N, N m]."""

    @property
    def held_contact(self) -> str:
        """Name of the contact whose force is held."""

    @property
    def force_estimate(self) -> Array:
        """Its estimated normal force (K,) [N]."""

    @property
    def friction_use(self) -> Array:
        """Share of the friction cone that each contact uses (K + 1, contacts) [1]."""


def instants(mission: DrawableMission) -> dict[int, str]:
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
    told = []
    for value, axis in zip(force, "xy", strict=True):
        if value:
            told.append(f"{value:+.1f} N in {axis}".replace("-", "\N{MINUS SIGN}"))
    if moment:
        told.append(f"{1e3 * moment:+.0f} mN m".replace("-", "\N{MINUS SIGN}"))
    return "pull " + (", ".join(told) or "of nothing")


def box_of(mission: DrawableMission, shapes: Array, poses: Array, margin: float) -> Box:
    """Limits around finger and object in some of their poses."""
    outlines = [part for pose in poses for part in object_outlines(mission.scene, pose)]
    return bend_box([shapes, *outlines], margin)


def draw_grasp(ax: Axes, mission: DrawableMission, shape: Array, pose: Array, **style: Any) -> list[Any]:
    """Draw object and finger; a mark on the object shows how it turns."""
    scene = mission.scene
    bodies: list[Any] = list(draw_object(ax, object_outlines(scene, pose), **style))
    bodies.append(draw_body(ax, finger_outline(scene, shape), **style))
    bodies += ax.plot(*shape.T, color=BLUE, linewidth=1.8, solid_capstyle="round", zorder=2, **style)
    bodies += ax.plot(*mark_of(mission, pose).T, color="#A58A55", linewidth=1.2, zorder=1.3, **style)
    return bodies


def mark_of(mission: DrawableMission, pose: Array) -> Array:
    """A line (2, 2) from the object's centre towards its own x axis [m]."""
    outline = np.concatenate(object_outlines(mission.scene, pose))
    reach = 0.5 * np.linalg.norm(outline - pose[:2], axis=1).min()
    return np.array([pose[:2], pose[:2] + reach * np.array([np.cos(pose[2]), np.sin(pose[2])])])


def pull_at(mission: DrawableMission, t: float) -> Array:
    """Wrench (3) that pulls at an instant, were it whole throughout its phase; zero in the others."""
    for span in mission.spans:
        if span.name in mission.pulls and span.start < t < span.end:
            return mission.pulls[span.name]
    return np.zeros(3)


def acting_forces(mission: DrawableMission, index: int) -> list[Force]:
    """Forces of the contacts and of a pull at one instant: where (2,) [m], force (2,) [N], and of what kind.

    What is too small to be seen beside the greatest is left out.
    """
    run = mission.run
    pulled = pull_at(mission, float(run.t[index]))[:2]
    least = _SEEN * float(np.max(run.contacts.normal_force, initial=0.0))
    found = [*run.contacts.at(index), (run.object_pose[index, :2], pulled, "load")]
    return [(np.asarray(at), np.asarray(force), kind) for at, force, kind in found if np.hypot(*force) > least]


def draw_moment(ax: Axes, pose: Array, moment: float, radius: float, **style: Any) -> list[Any]:
    """Draw a moment on an object as an arc with a head."""
    if not moment:
        return []
    turn = np.sign(moment) * np.linspace(-0.5 * np.pi, 0.9 * np.pi, 60)
    arc = pose[:2] + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    look: dict[str, Any] = {"color": ORANGE, "linewidth": 1.8, "zorder": 6, **style}
    ends = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "color": ORANGE, "linewidth": 1.8}
    head = ax.annotate("", xy=arc[-1], xytext=arc[-6], arrowprops=ends, zorder=6, **style)
    return [*ax.plot(*arc[:-4].T, **look), head]


def explain_forces(figure: Figure, name: str | None, loads: Sequence[Force]) -> None:
    """Above all axes of a figure: the name, and what arrows mean, with the greatest force of each kind."""
    from matplotlib.lines import Line2D

    handles = []
    for kind in dict.fromkeys(kind for _, _, kind in loads):
        greatest = max(float(np.hypot(*force)) for _, force, other in loads if other == kind)
        label = rf"{_WORDS.get(kind, kind)} $\leq$ {greatest:.3g} N"
        style: dict[str, Any] = {
            "color": kind_color(kind),
            "marker": r"$\rightarrow$",
            "markersize": 13,
            "linestyle": "",
        }
        handles.append(Line2D([], [], label=label, **style))
    figure.suptitle(name or " ", fontsize=10, color=INK, x=0.01, ha="left")
    figure.legend(handles=handles, loc="outside upper right", ncols=max(len(handles), 1), frameon=False, fontsize=9)
