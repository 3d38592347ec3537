"""Announcement of the add-on."""

from continuum_grasp.base import Addon, ConfigurationKind

_VERBS = ("compare", "identify", "commission", "replay")
ADDON = Addon(
    kinds=(
        ConfigurationKind(
            "identify",
            "continuum_grasp.addons.identification:IdentifyScene",
            "an identification",
            "finger, estimate",
            "identify",
            marks=("estimate", "data"),
        ),
    ),
    verbs={verb: f"continuum_grasp.addons.identification.verbs:{verb}" for verb in _VERBS},
)
