"""Announcement of the add-on."""

from continuum_grasp.base import Addon, ExportTarget

ADDON = Addon(
    exports={
        "mjcf": ExportTarget(
            write="continuum_grasp.addons.chains:export_mjcf",
            report="continuum_grasp.addons.chains.verbs:report",
            suffix=".xml",
            loops=False,
        )
    }
)
