"""Pictures of grasps."""

from __future__ import annotations

from continuum_grasp.plotting.grasp.closing import plot_closing
from continuum_grasp.plotting.grasp.picture import plot_grasp
from continuum_grasp.plotting.grasp.resistance import plot_resistance

__all__ = [
    "plot_closing",
    "plot_grasp",
    "plot_resistance",
]
