"""Pictures of missions."""

from __future__ import annotations

from continuum_grasp.plotting.mission.instants import plot_mission_snapshots
from continuum_grasp.plotting.mission.timeline import plot_mission_timeline, plot_trials

__all__ = [
    "plot_mission_snapshots",
    "plot_mission_timeline",
    "plot_trials",
]
