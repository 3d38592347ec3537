"""An object among fingers, in a pose at an instant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.plotting.drawing.bodies import (
    draw_body,
    draw_clamp,
    draw_object,
    draw_supports,
    finger_outline,
    object_outlines,
)
from continuum_grasp.plotting.drawing.film import Film
from continuum_grasp.plotting.drawing.forces import Force, ForceArrows, draw_moment
from continuum_grasp.plotting.drawing.style import Color, Z
from continuum_grasp.plotting.drawing.styled_axes import Box, bend_box

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.scene import Finger, GraspObject, Support


@dataclass(frozen=True)
class HeldObject:
    """An object, the fingers around it, and what supports it, as they are drawn at instants."""

    object: GraspObject
    fingers: Sequence[Finger]
    supports: Mapping[str, Support]

    def box(self, backbones: Array, poses: Iterable[Array], margin: float, seen: Sequence[Array] = ()) -> Box:
        """Limits around fingers and object in some poses (3,), and further points that are seen, with a margin [m]."""
        return bend_box([backbones, *seen, *chain(*(object_outlines(self.object, pose) for pose in poses))], margin)

    def arrows(self, frames: Iterable[Iterable[Force]], least: float) -> ForceArrows:
        """Arrows of the forces that are greater than ``least`` [N], by instant, as long as suits the first finger."""
        return ForceArrows.above(frames, self.fingers[0].rod.length, least)

    def film(self, backbones: Array, poses: Array, margin: float, width: int) -> Film:
        """Frames of a width [pixels] in which fingers with backbones (frames, fingers, points, 2) take the object from
        its first to its last pose; what does not move is drawn.
        """
        film = Film(self.box(backbones, poses[[0, -1]], margin), width)
        self.draw_fixed(film.ax, backbones[0])
        return film

    def draw_fixed(self, ax: Axes, backbones: Array) -> None:
        """Draw supports, and the clamps of all fingers."""
        draw_supports(ax, self.supports)
        for backbone, finger in zip(backbones, self.fingers, strict=True):
            draw_clamp(ax, backbone, finger)

    def draw(self, ax: Axes, backbones: Array, pose: Array, moment: float, **style: Any) -> list[Any]:
        """Draw object and fingers, with backbones (fingers, points, 2), and a moment that pulls at the object [N m].

        A mark on the object, from its center along its x axis, shows how it turns.
        """
        outlines = object_outlines(self.object, pose)
        reach = 0.5 * np.linalg.norm(np.concatenate(outlines) - pose[:2], axis=1).min()
        mark = np.array([pose[:2], pose[:2] + reach * np.array([np.cos(pose[2]), np.sin(pose[2])])])
        drawn: list[Any] = [*draw_object(ax, outlines, **style)]
        for backbone, finger in zip(backbones, self.fingers, strict=True):
            drawn.append(draw_body(ax, finger_outline(backbone, finger), **style))
            drawn += ax.plot(
                *backbone.T, color=Color.BLUE, linewidth=1.8, solid_capstyle="round", zorder=Z.SHAPE, **style
            )
        drawn += ax.plot(*mark.T, color=Color.EDGE, linewidth=1.2, zorder=Z.MARK, **style)
        return [*drawn, *draw_moment(ax, pose[:2], moment, **style)]
