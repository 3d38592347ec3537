"""Frames of a closed loop: the finger, where its tip was, and where the controller predicts it to go."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.control.closed_loop import draw_surroundings, shown_points
from continuum_grasp.plotting.drawing.axes import bend_box, head
from continuum_grasp.plotting.drawing.film import Film
from continuum_grasp.plotting.drawing.fingers import draw_clamp, mass_positions, masses_of
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, GREEN, INK, ORANGE, Z

if TYPE_CHECKING:
    from continuum_grasp.closed_loop.result import ControlRun

__all__ = ["control_frames"]


def control_frames(run: ControlRun, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a closed loop frame by frame; as `motion_frames`."""
    t, tip, wanted = np.asarray(run.t), np.asarray(run.tip), run.tip_reference
    unique, back = np.unique(indices, return_inverse=True)
    shapes = np.asarray(run.backbone(unique, points=60))
    film = Film(bend_box(shown_points(run, shapes), 0.09 * run.length), width)
    ax = film.ax
    draw_surroundings(ax, run)
    draw_clamp(ax, shapes[0], run.length)
    if wanted is not None:
        ax.plot(*wanted.T, color=ORANGE, linewidth=0.8, alpha=0.6, zorder=Z.SUPPORT)
    style: dict[str, Any] = {"animated": True}
    (trail,) = ax.plot([], [], color=GRAY, linewidth=0.9, zorder=Z.SUPPORT, **style)
    (finger,) = ax.plot([], [], color=BLUE, linewidth=2.6, solid_capstyle="round", zorder=Z.SHAPE, **style)
    (ahead,) = ax.plot([], [], color=GREEN, linewidth=1.4, zorder=Z.CLAMP_FACE, **style)
    (target,) = ax.plot([], [], "+", color=ORANGE, markersize=11, markeredgewidth=1.8, zorder=Z.FORCE, **style)
    (dots,) = ax.plot([], [], "o", color=INK, markersize=6, zorder=Z.MASS, **style)
    ax.plot([], [], color=GREEN, linewidth=1.4, label="predicted")
    ax.plot([], [], "+", color=ORANGE, markersize=9, markeredgewidth=1.8, label="setpoint")
    clock = film.corner_text()
    head(ax, run.name, entries=2)
    masses = masses_of(run.scene.finger)

    def moving(k: int) -> tuple[list[Any], list[Any]]:
        at = unique[k]
        trail.set_data(*tip[: at + 1].T)
        finger.set_data(*shapes[k].T)
        ahead.set_data(*run.plan_tip[min(at, len(run.plan_tip) - 1)].T)
        clock.set_text(f"{t[at]:.2f} s")
        if masses:
            dots.set_data(*mass_positions(shapes[k], masses, run.length).T)
        if wanted is not None:
            target.set_data(*wanted[at : at + 1].T)
        return [trail, finger, ahead, clock, *([dots] if masses else []), *([target] if wanted is not None else [])], []

    return film.frames(back, moving)
