"""Pictures of results: what they share is in ``drawing``, the rest is by kind of result.

Every ``plot_x(result, *, ax=None)`` draws into the axes it is given, or into axes of a new figure, and returns the
axes; `continuum_grasp.results.save_picture` saves their figure. Nothing is shown, saved, or changed in matplotlib's
global style. matplotlib is imported when the first picture is drawn.

Further pictures are in ``plotting.control`` (closed loops and plans), ``plotting.mission`` and
``plotting.identification``.
"""

from __future__ import annotations

from continuum_grasp.plotting.accuracy import plot_accuracy
from continuum_grasp.plotting.grasp import plot_grasp, plot_resistance, plot_robustness
from continuum_grasp.plotting.motion import (
    plot_contact_forces,
    plot_coordinates,
    plot_energy,
    plot_modes,
    plot_shape,
    plot_snapshots,
    plot_tip_path,
)
from continuum_grasp.plotting.sweep import plot_front, plot_map

__all__ = [
    "plot_accuracy",
    "plot_contact_forces",
    "plot_coordinates",
    "plot_energy",
    "plot_front",
    "plot_grasp",
    "plot_map",
    "plot_modes",
    "plot_resistance",
    "plot_robustness",
    "plot_shape",
    "plot_snapshots",
    "plot_tip_path",
]
