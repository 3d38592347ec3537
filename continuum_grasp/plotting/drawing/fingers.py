"""Parts of a finger: body, clamped base, point masses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.plotting.drawing.style import BLUE, CLAMP, INK, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Polygon

    from continuum_grasp.scene.finger import Finger

Array = NDArray[Any]

_CLAMP_WIDTH, _CLAMP_DEPTH = 0.12, 0.035
"""As parts of the finger's length: wider than any finger is thick."""


def finger_outline(backbone: Array, half: float, angle: ArrayLike | None = None) -> Array:
    """Outline (points, 2) of a finger with a rounded end, half as thick as ``half``, round a backbone (points, 2).

    ``angle`` (points,) [rad] is that of the sections' X axes; by differences of the backbone where not given.
    """
    if angle is None:
        tangent = np.gradient(backbone, axis=0)
        angle = np.arctan2(-tangent[:, 0], tangent[:, 1])
    angle = np.asarray(angle)
    across = half * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    cap = angle[-1] + np.linspace(0.0, math.pi, 25)
    end = backbone[-1] + half * np.stack([np.cos(cap), np.sin(cap)], axis=1)
    return np.concatenate([backbone + across, end, (backbone - across)[::-1]])


def draw_body(ax: Axes, outline: Array, **style: Any) -> Polygon:
    """Draw the thickness of a finger."""
    from matplotlib.patches import Polygon

    look: dict[str, Any] = {"facecolor": BLUE, "alpha": 0.2, "linewidth": 0.0, "zorder": Z.BODY, **style}
    body = Polygon(outline, **look)
    ax.add_patch(body)
    return body


def draw_clamp(ax: Axes, backbone: Array, length: float) -> Polygon:
    """Draw a hatched block that holds the base, across a finger of this length."""
    from matplotlib.patches import Polygon

    along = _base_direction(backbone)
    across = np.array([-along[1], along[0]])
    half, depth = 0.5 * _CLAMP_WIDTH * length, _CLAMP_DEPTH * length
    face = [backbone[0] - half * across, backbone[0] + half * across]
    corners = np.array([*face, face[1] - depth * along, face[0] - depth * along])
    ax.plot(*np.transpose(face), color=INK, linewidth=1.5, solid_capstyle="butt", zorder=Z.CLAMP_FACE)
    block = Polygon(corners, zorder=Z.CLAMP, **CLAMP)
    ax.add_patch(block)
    return block


def _base_direction(backbone: Array) -> Array:
    """Unit tangent (2,) at the base, by a one-sided difference of second order: a chord would tilt the clamp."""
    p = backbone
    tangent = -3 * p[0] + 4 * p[1] - p[2] if len(p) > 2 else p[1] - p[0]
    size = float(np.hypot(*tangent))
    return np.asarray(tangent / size) if size > 0 else np.array([0.0, 1.0])


def masses_of(finger: Finger) -> list[tuple[float, float]]:
    """Positions along a finger [m] and masses [kg] of its point masses."""
    return [(float(m.at), float(m.mass)) for m in finger.masses if m.mass > 0]


def mass_positions(backbone: Array, masses: Sequence[tuple[float, float]], length: float) -> Array:
    """World positions (len(masses), 2) on a backbone whose points are evenly spaced from base to tip."""
    s = np.linspace(0.0, length, len(backbone))
    at = [min(at, length) for at, _ in masses]
    return np.column_stack([np.interp(at, s, backbone[:, k]) for k in (0, 1)])
