"""What stands around a finger under control: zones that it must not enter, and an object."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_surroundings", "zone_points"]

_COLOR, _EDGE = "#F3D3C7", "#C25B36"


def zone_points(scene: Any) -> list[NDArray[Any]]:
    """World points (n, 2) that a picture should show: the edges of round zones, one point of straight ones."""
    found = []
    for zone in scene.controller.bounds.keep_out.values():
        if zone.type == "disc":
            found.append(np.array(zone.center) + zone.radius * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]))
        else:
            found.append(np.array([zone.point]))
    return found


def draw_surroundings(ax: Axes, scene: Any) -> None:
    """Zones of a scene, as large as the axes, whose limits are set already; and its object."""
    from matplotlib.patches import Circle, Polygon

    for zone in scene.controller.bounds.keep_out.values():
        style: dict[str, Any] = {"facecolor": _COLOR, "edgecolor": _EDGE, "linewidth": 0.9, "zorder": 0}
        if zone.type == "disc":
            ax.add_patch(Circle(zone.center, zone.radius, **style))
            continue
        normal = np.array([np.cos(zone.normal_angle), np.sin(zone.normal_angle)])
        along = np.array([-normal[1], normal[0]])
        far = 10.0 * (np.ptp(ax.get_xlim()) + np.ptp(ax.get_ylim()))
        edge = [np.array(zone.point) + far * along, np.array(zone.point) - far * along]
        ax.add_patch(Polygon([*edge, edge[1] - far * normal, edge[0] - far * normal], **style))
    thing = getattr(scene, "object", None)
    for part in () if thing is None else thing.parts:
        ax.add_patch(Polygon(part.outline(180), facecolor="#EEEEEE", edgecolor=GREY, linewidth=0.9, zorder=0))
