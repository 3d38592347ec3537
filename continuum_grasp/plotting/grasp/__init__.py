"""Pictures of grasps."""

from __future__ import annotations

from continuum_grasp.plotting.grasp.picture import plot_grasp
from continuum_grasp.plotting.grasp.resistance import plot_resistance
from continuum_grasp.plotting.grasp.robustness import plot_robustness

__all__ = [
    "plot_grasp",
    "plot_resistance",
    "plot_robustness",
]
