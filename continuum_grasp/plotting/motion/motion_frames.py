"""Frames of a moving finger, with its object and the forces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import bend_box
from continuum_grasp.plotting.drawing.film import Film
from continuum_grasp.plotting.drawing.fingers import draw_body, draw_clamp, finger_outline, mass_positions, masses_of
from continuum_grasp.plotting.drawing.forces import draw_forces, explain, force_scale, sizes_of
from continuum_grasp.plotting.drawing.objects import draw_object, object_outlines
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, INK, Z
from continuum_grasp.plotting.drawing.surroundings import draw_supports

if TYPE_CHECKING:
    from continuum_grasp.planning.result import Plan
    from continuum_grasp.simulation.trajectory import Trajectory

__all__ = ["motion_frames"]


def motion_frames(trajectory: Trajectory | Plan, indices: NDArray[Any], width: int) -> Iterator[NDArray[Any]]:
    """Draw a motion frame by frame.

    Parameters
    ----------
    trajectory : Trajectory or Plan
        What moves.
    indices : ndarray of int (F,)
        Instants to draw.
    width : int
        Width of a frame [pixels], made even.

    Yields
    ------
    ndarray of uint8 (height, width, 3)
        Height and width are even, as video coders want them.
    """
    t, tip, length, scene = np.asarray(trajectory.t), np.asarray(trajectory.tip), trajectory.length, trajectory.scene
    unique, back = np.unique(indices, return_inverse=True)
    shapes = np.asarray(trajectory.backbone(unique, points=60))
    forces = [[one for one in trajectory.loads_at(int(k)) if np.hypot(*one[1]) > 0] for k in unique]
    everything = [one for some in forces for one in some]
    scale = force_scale(sizes_of(everything), 0.25 * length)
    ends = [np.asarray(p) + scale * np.asarray(f) for p, f, _ in everything]
    outlines, bodies = [], []
    if trajectory.object_pose is not None and scene.object is not None:
        outlines = [object_outlines(scene.object, pose) for pose in np.asarray(trajectory.object_pose)[unique, :3]]
        bodies = [finger_outline(shape, scene.finger.thickness_radius) for shape in shapes]
    film = Film(bend_box([shapes, tip, *ends, *(one for some in outlines for one in some)], 0.09 * length), width)
    ax = film.ax
    draw_supports(ax, scene.supports)
    patches = draw_object(ax, outlines[0], animated=True) if outlines else []
    if bodies:
        patches.append(draw_body(ax, bodies[0], animated=True))
    draw_clamp(ax, shapes[0], length)
    (trail,) = ax.plot([], [], color=GRAY, linewidth=0.9, zorder=Z.SUPPORT, animated=True)
    (finger,) = ax.plot([], [], color=BLUE, linewidth=2.6, solid_capstyle="round", zorder=Z.SHAPE, animated=True)
    masses = masses_of(scene.finger)
    (dots,) = ax.plot([], [], "o", color=INK, markersize=7, zorder=Z.MASS, animated=True)
    clock = film.corner_text()
    explain(ax, masses, everything, trajectory.name)

    def moving(k: int) -> tuple[list[Any], list[Any]]:
        trail.set_data(*tip[: unique[k] + 1].T)
        finger.set_data(*shapes[k].T)
        clock.set_text(f"{t[unique[k]]:.2f} s")
        if masses:
            dots.set_data(*mass_positions(shapes[k], masses, length).T)
        # edges, then fillings of the object's parts, then the finger
        moved = [*outlines[k], *outlines[k], bodies[k]] if outlines else []
        for patch, outline in zip(patches, moved, strict=True):
            patch.set_xy(outline)
        arrows = list(draw_forces(ax, forces[k], scale).values())
        return [*patches, trail, finger, clock, *([dots] if masses else [])], arrows

    return film.frames(back, moving)
