"""Pictures of motions and modes."""

from __future__ import annotations

from continuum_grasp.plotting.motion.modes import plot_modes
from continuum_grasp.plotting.motion.over_time import plot_contact_forces, plot_coordinates, plot_energy
from continuum_grasp.plotting.motion.snapshots import plot_snapshots, plot_tip_path

__all__ = [
    "plot_contact_forces",
    "plot_coordinates",
    "plot_energy",
    "plot_modes",
    "plot_snapshots",
    "plot_tip_path",
]
