"""Pictures of results: the package ``drawing`` has what they share.

Every ``plot_x(result, *, ax=None)`` draws into the axes it is given, or into axes of a new figure, and returns the
axes; `continuum_grasp.results.save_picture` saves their figure. Nothing is shown, saved, or changed in matplotlib's
global style. matplotlib is imported when the first picture is drawn.

Examples
--------
>>> import continuum_grasp as cg
>>> from continuum_grasp import plotting
>>> found = cg.modes("configs/simulate/standing.yaml")
>>> [ax.get_xlabel() for ax in plotting.plot_modes(found, count=1)]
['x [m]']
"""

from __future__ import annotations

from continuum_grasp.plotting.accuracy import plot_accuracy
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
from continuum_grasp.plotting.grasp.picture import plot_grasp
from continuum_grasp.plotting.grasp.resistance import plot_resistance
from continuum_grasp.plotting.identification import plot_all_predictions, plot_predictions, plot_residuals
from continuum_grasp.plotting.mission.mission_snapshots import plot_mission_snapshots
from continuum_grasp.plotting.mission.timeline import plot_mission_timeline
from continuum_grasp.plotting.mission.trials import plot_trials
from continuum_grasp.plotting.motion.modes import plot_modes
from continuum_grasp.plotting.motion.over_time import plot_contact_forces, plot_coordinates, plot_energy
from continuum_grasp.plotting.motion.snapshots import plot_snapshots
from continuum_grasp.plotting.motion.tip_path import plot_tip_path
from continuum_grasp.plotting.sweep import plot_front, plot_map

__all__ = [
    "plot_accuracy",
    "plot_all_predictions",
    "plot_bounds",
    "plot_contact_forces",
    "plot_control_path",
    "plot_controller_times",
    "plot_coordinates",
    "plot_disturbances",
    "plot_energy",
    "plot_front",
    "plot_grasp",
    "plot_inputs",
    "plot_map",
    "plot_mission_snapshots",
    "plot_mission_timeline",
    "plot_modes",
    "plot_plan_inputs",
    "plot_plan_path",
    "plot_predictions",
    "plot_residuals",
    "plot_resistance",
    "plot_snapshots",
    "plot_tip_path",
    "plot_tracking",
    "plot_tracking_error",
    "plot_trials",
]
