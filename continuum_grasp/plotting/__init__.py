"""Pictures of results: one file per thing drawn.

Every ``plot_x(result, *, ax=None)`` draws into the axes it is given, or into axes of a new figure, and
returns the axes; their ``figure`` can be saved. Nothing is shown and no global style or current figure is
touched. matplotlib is imported when the first picture is drawn.
"""

from __future__ import annotations

from continuum_grasp.plotting.accuracy import plot_accuracy
from continuum_grasp.plotting.control.control import (
    plot_bounds,
    plot_control_path,
    plot_controller_times,
    plot_disturbances,
    plot_inputs,
    plot_tracking,
    plot_tracking_error,
    save_control_pictures,
)
from continuum_grasp.plotting.control.frames import animate_control
from continuum_grasp.plotting.drawing.pictures import save_picture, save_simulation_pictures
from continuum_grasp.plotting.motion.animation import animate
from continuum_grasp.plotting.motion.contact import plot_contact_forces
from continuum_grasp.plotting.motion.coordinates import plot_coordinates
from continuum_grasp.plotting.motion.energy import plot_energy
from continuum_grasp.plotting.motion.modes import plot_modes
from continuum_grasp.plotting.motion.snapshots import plot_snapshots
from continuum_grasp.plotting.motion.tip_path import plot_tip_path

__all__ = [
    "animate",
    "animate_control",
    "plot_accuracy",
    "plot_bounds",
    "plot_contact_forces",
    "plot_control_path",
    "plot_controller_times",
    "plot_coordinates",
    "plot_disturbances",
    "plot_energy",
    "plot_inputs",
    "plot_modes",
    "plot_snapshots",
    "plot_tip_path",
    "plot_tracking",
    "plot_tracking_error",
    "save_control_pictures",
    "save_picture",
    "save_simulation_pictures",
]
