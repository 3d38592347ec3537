"""The object, in any pose, and what surrounds it: walls, edges, grooves, pegs, and zones that must not be entered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.style import EDGE, FAINT, FORBIDDEN, INK, MATERIAL, OBJECT, Z
from continuum_grasp.scene.supports import VGroove

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Polygon

    from continuum_grasp.scene.objects import GraspObject
    from continuum_grasp.scene.supports import Support

Array = NDArray[Any]

_EDGE_WIDTH = 3.0
"""[points]; half of it lies under the filling."""


def object_outlines(body: GraspObject, pose: Array) -> list[Array]:
    """World outlines (points, 2) [m] of the parts of an object in a pose (3,): x, y [m] and angle [rad]."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[c, s], [-s, c]])
    return [pose[:2] + np.asarray(part.outline()) @ turn for part in body.parts]


def draw_object(ax: Axes, outlines: Sequence[Array], *, faint: bool = False, **style: Any) -> list[Polygon]:
    """Draw an object by the outlines of its parts: as one body, or faintly as its outlines alone.

    Returns the patches: once over all parts for a faint one, else first the edges of all parts, then their fillings.
    """
    from matplotlib.patches import Polygon

    if faint:
        layers = [{**FAINT, "zorder": Z.FAINT_OBJECT}]
    else:  # all fillings lie on all edges, so that no edge shows where parts overlap
        edge = {"facecolor": EDGE, "edgecolor": EDGE, "linewidth": _EDGE_WIDTH, "joinstyle": "round"}
        layers = [{**edge, "zorder": Z.OBJECT}, {"facecolor": OBJECT, "linewidth": 0.0, "zorder": Z.OBJECT_FILL}]
    drawn = [Polygon(outline, **{**layer, **style}) for layer in layers for outline in outlines]
    for patch in drawn:
        ax.add_patch(patch)
    return drawn


_DEPTH = 0.035
"""Thickness of the hatched material, as a part of the picture: two strokes of the hatching."""
_LEAST_RADIUS = 0.012
"""Of a peg, as a part of the diagonal: a point peg is still seen."""


def draw_supports(ax: Axes, supports: Mapping[str, Support], unit: float = 1.0) -> list[Array]:
    """Draw supports within the limits of the axes, in which a meter is ``unit`` long; returns their outlines."""
    from matplotlib.patches import Circle, Polygon

    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    diagonal = math.hypot(right - left, high - low)
    far, depth = 2.0 * diagonal, _DEPTH * max(right - left, high - low)
    drawn: list[Array] = []
    for name, support in supports.items():
        for block, face in _blocks(support, name, unit, far, depth):
            ax.add_patch(Polygon(block, zorder=Z.SUPPORT, **MATERIAL))
            ax.plot(*face.T, color=INK, linewidth=1.4, zorder=Z.FACE, scalex=False, scaley=False)
            drawn.append(block)
        for peg in support.pegs(name):
            center, radius = unit * np.array(peg.position), max(unit * peg.radius, _LEAST_RADIUS * diagonal)
            style = {**MATERIAL, "linewidth": 1.2, "edgecolor": INK, "zorder": Z.SUPPORT}
            ax.add_patch(Circle((center[0], center[1]), radius, **style))
            turns = np.linspace(0.0, math.tau, 25)
            drawn.append(center + radius * np.stack([np.cos(turns), np.sin(turns)], axis=1))
    return drawn


def _blocks(support: Support, name: str, unit: float, far: float, depth: float) -> list[tuple[Array, Array]]:
    """Outline of the material and its face, of each straight part; a groove is one, so that its corner is filled."""
    if isinstance(support, VGroove):
        return [_groove(support, unit, far, depth)]
    found = []
    for wall in support.walls(name):
        normal, reach = np.array(wall.normal), min(unit * wall.half_length, far)
        face = unit * np.array(wall.point) + np.outer([-reach, reach], [-normal[1], normal[0]])
        found.append((np.concatenate([face, face[::-1] - depth * normal]), face))
    return found


def _groove(groove: VGroove, unit: float, far: float, depth: float) -> tuple[Array, Array]:
    apex, half = unit * np.array(groove.apex), 0.5 * groove.opening_angle
    axis, left, right = (_direction(groove.axis_angle + turn) for turn in (0.0, half, -half))
    face = np.array([apex + far * left, apex, apex + far * right])
    outside = [_direction(groove.axis_angle + turn) for turn in (half + 0.5 * math.pi, -half - 0.5 * math.pi)]
    corner = apex - depth / math.sin(half) * axis
    back = np.array([face[2] + depth * outside[1], corner, face[0] + depth * outside[0]])
    return np.concatenate([face, back]), face


def _direction(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])


def zone_points(zones: Mapping[str, Any]) -> list[Array]:
    """World points (n, 2) that a picture should show: the edges of round zones, one point of straight ones."""
    found = []
    for zone in zones.values():
        if zone.type == "disc":
            found.append(np.array(zone.center) + zone.radius * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]))
        else:
            found.append(np.array([zone.point]))
    return found


def draw_zones(ax: Axes, zones: Mapping[str, Any]) -> None:
    """Draw zones as large as the axes, whose limits are set already."""
    from matplotlib.patches import Circle, Polygon

    for zone in zones.values():
        if zone.type == "disc":
            ax.add_patch(Circle(zone.center, zone.radius, zorder=Z.ZONE, **FORBIDDEN))
            continue
        normal = np.array([np.cos(zone.normal_angle), np.sin(zone.normal_angle)])
        along = np.array([-normal[1], normal[0]])
        far = 10.0 * (np.ptp(ax.get_xlim()) + np.ptp(ax.get_ylim()))
        edge = [np.array(zone.point) + far * along, np.array(zone.point) - far * along]
        ax.add_patch(Polygon([*edge, edge[1] - far * normal, edge[0] - far * normal], zorder=Z.ZONE, **FORBIDDEN))
