"""Announcement of the add-on."""

from continuum_grasp.base import Addon, ConfigurationKind

ADDON = Addon(
    kinds=(
        ConfigurationKind(
            *("plan", "continuum_grasp.addons.planning:PlanScene", "a plan", "finger, goal", "plan"),
            required=("goal",),
        ),
    ),
    verbs={"plan": "continuum_grasp.addons.planning.verbs:plan"},
)
