"""Announcement of the add-on."""

from continuum_grasp.base import Addon, ConfigurationKind

ADDON = Addon(
    kinds=(
        ConfigurationKind(
            *("mission", "continuum_grasp.addons.mission:MissionScene", "a mission", "grasp, controller", "mpc"),
            required=("controller", "grasp"),
            loop="continuum_grasp.addons.mission:exported_loop",
            results=("AssignedMission", "MissionRun"),
            prepare="continuum_grasp.addons.mission:prepared",
            preparing="optimizing the grasp",
        ),
    ),
)
