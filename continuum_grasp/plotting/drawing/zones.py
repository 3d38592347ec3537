"""Zones that a finger must not enter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.style import FORBIDDEN, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_zones", "zone_points"]


def zone_points(zones: Mapping[str, Any]) -> list[NDArray[Any]]:
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
