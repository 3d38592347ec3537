"""Fingers of a grasp, with thickness, tendons, joints of the elements and clamped base."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.fingers import draw_body, draw_clamp
from continuum_grasp.plotting.drawing.style import Z
from continuum_grasp.plotting.grasp.view import MM, GraspView, lighter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_fingers"]

Array = NDArray[Any]


def draw_fingers(ax: Axes, view: GraspView, tendons: bool = True) -> list[Array]:
    """Draw all fingers; returns their outlines and those of their clamps [mm]."""
    drawn: list[Array] = []
    for name, finger in view.fingers.items():
        backbone, body, color = view.backbones[name], view.body(name), view.color(name)
        line, angle = backbone[:, 1:3], backbone[:, 3]
        across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        clamp = draw_clamp(ax, line, MM * finger.rod.length)
        drawn += [body, np.asarray(clamp.get_xy())]
        edge, style = lighter(color, 0.25), "solid" if view.found else "dashed"
        look = {"facecolor": lighter(color, 0.78), "edgecolor": edge, "linewidth": 1.1, "linestyle": style}
        draw_body(ax, body, alpha=1.0 if view.found else 0.6, joinstyle="round", **look)
        if tendons and finger.tendons is not None and finger.tendons.offset < finger.thickness_radius:
            sides = {"both": (-1.0, 1.0), "left": (-1.0,), "right": (1.0,)}[finger.tendons_used]
            for side in sides:
                path = line + side * MM * finger.tendons.offset * across
                ax.plot(*path.T, color=edge, linewidth=0.7, linestyle=(0, (4, 2)), zorder=Z.TENDON)
        ax.plot(*line.T, color=edge, linewidth=1.5, zorder=Z.CENTERLINE)
        for at in _joints(view, name):
            ax.plot(*at, "o", markersize=3.6, color="white", markeredgecolor=edge, zorder=Z.JOINT)
    return drawn


def _joints(view: GraspView, name: str) -> Array:
    """Where elements meet, (joints, 2) [mm]."""
    if not view.found:
        return np.zeros((0, 2))
    backbone = view.backbones[name]
    stations = MM * np.cumsum(view.result.fingers[name].lengths)[:-1]
    return np.stack([np.interp(stations, backbone[:, 0], backbone[:, k]) for k in (1, 2)], axis=1)
