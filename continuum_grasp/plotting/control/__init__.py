"""Pictures of plans and closed loops."""

from __future__ import annotations

from continuum_grasp.plotting.control.closed_loop import (
    plot_bounds,
    plot_control_path,
    plot_controller_times,
    plot_disturbances,
    plot_inputs,
    plot_tracking,
    plot_tracking_error,
)
from continuum_grasp.plotting.control.plan_motion import plot_plan_inputs, plot_plan_path

__all__ = [
    "plot_bounds",
    "plot_control_path",
    "plot_controller_times",
    "plot_disturbances",
    "plot_inputs",
    "plot_plan_inputs",
    "plot_plan_path",
    "plot_tracking",
    "plot_tracking_error",
]
