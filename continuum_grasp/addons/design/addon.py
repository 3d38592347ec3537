"""Announcement of the add-on."""

from continuum_grasp.base import Addon, ConfigurationKind

ADDON = Addon(
    kinds=(
        ConfigurationKind(
            "design",
            "continuum_grasp.addons.design:Design",
            "a design",
            "scene, variables, minimize",
            "design",
            marks=("variables", "minimize"),
            reader="continuum_grasp.addons.design:read_design",
        ),
    ),
    verbs={"design": "continuum_grasp.addons.design.verbs:design"},
)
