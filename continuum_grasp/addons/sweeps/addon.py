"""Announcement of the add-on."""

from continuum_grasp.base import Addon, ConfigurationKind

ADDON = Addon(
    kinds=(
        ConfigurationKind(
            *("sweep", "continuum_grasp.addons.sweeps:Sweep", "a sweep", "scene, vary", "sweep"),
            marks=("scene", "vary", "sample"),
            without=("variables", "minimize"),
            names_files=False,
            reader="continuum_grasp.addons.sweeps:read_sweep",
        ),
    ),
    verbs={"sweep": "continuum_grasp.addons.sweeps.verbs:sweep"},
)
