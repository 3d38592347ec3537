"""The object of a motion and what else holds it, in world axes in metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import BLUE, GREY, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Polygon

__all__ = ["draw_body", "draw_object", "draw_surroundings", "finger_outline", "object_outlines", "object_poses"]

Array = NDArray[Any]

_FILL, _EDGE = "#F3E9D6", "#A58A55"
_MATERIAL: dict[str, Any] = {"facecolor": "#E3E3E3", "edgecolor": "#9A9A9A", "hatch": "////", "linewidth": 0.0}


def object_poses(trajectory: Any, indices: Array) -> Array | None:
    """Poses (len(indices), 3) of the object of a motion: x, y [m] and angle [rad]; None without one."""
    poses = getattr(trajectory, "object_pose", None)
    return None if poses is None else np.asarray(poses)[indices, :3]


def object_outlines(scene: Any, pose: Array) -> list[Array]:
    """World outlines (points, 2) [m] of the parts of a scene's object in a pose (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[c, s], [-s, c]])
    return [pose[:2] + np.asarray(part.outline()) @ turn for part in scene.object.parts]


def draw_object(ax: Axes, outlines: Sequence[Array], *, faint: bool = False, **style: Any) -> list[Polygon]:
    """Draw an object by the outlines of its parts; a faint one has no filling."""
    from matplotlib.patches import Polygon

    drawn = []
    for outline in outlines:
        look: dict[str, Any] = {"facecolor": _FILL, "edgecolor": _EDGE, "linewidth": 1.2, "zorder": 1.2}
        if faint:
            look |= {"fill": False, "edgecolor": GREY, "linewidth": 0.7, "zorder": 1.1}
        patch = Polygon(outline, closed=True, **{**look, **style})
        ax.add_patch(patch)
        drawn.append(patch)
    return drawn


def finger_outline(scene: Any, backbone: Array) -> Array:
    """World outline (points, 2) [m] of the finger that touches, with its rounded end, round a backbone (points, 2)."""
    half = scene.finger.thickness_radius
    tangent = np.gradient(backbone, axis=0)
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-300)[:, None]
    across = half * np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    turn = np.linspace(0.0, math.pi, 17)[:, None]
    cap = backbone[-1] + np.cos(turn) * across[-1] + np.sin(turn) * half * tangent[-1]
    return np.concatenate([backbone + across, cap, (backbone - across)[::-1]])


def draw_body(ax: Axes, outline: Array, **style: Any) -> Polygon:
    """Draw the thickness of the finger."""
    from matplotlib.patches import Polygon

    body = Polygon(outline, closed=True, **{"facecolor": BLUE, "alpha": 0.2, "linewidth": 0.0, "zorder": 1.5, **style})
    ax.add_patch(body)
    return body


def draw_surroundings(ax: Axes, scene: Any) -> None:
    """Draw the supports of a scene within the limits of the axes."""
    from matplotlib.patches import Circle, Polygon

    if getattr(scene, "object", None) is None:
        return
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    far = 2.0 * math.hypot(right - left, high - low)
    depth = 0.035 * max(right - left, high - low)
    for wall in scene.walls:
        normal, half = np.array(wall.normal), min(wall.half_length, far)
        face = np.array(wall.point) + np.outer([-half, half], [-normal[1], normal[0]])
        block = np.concatenate([face, face[::-1] - depth * normal])
        ax.add_patch(Polygon(block, closed=True, zorder=0.9, **_MATERIAL))
        ax.plot(*face.T, color=INK, linewidth=1.2, zorder=1.0, scalex=False, scaley=False)
    for peg in scene.pegs:
        radius = max(peg.radius, 0.006 * (right - left))
        ax.add_patch(Circle(peg.position, radius, **{**_MATERIAL, "linewidth": 1.0, "edgecolor": INK}))
