"""Announcement of the add-on."""

from continuum_grasp.base import Addon, ExportTarget

ADDON = Addon(
    exports={
        "fmu": ExportTarget(
            write="continuum_grasp.addons.fmu:export_fmu",
            report="continuum_grasp.addons.fmu.verbs:report",
            defaults="continuum_grasp.addons.fmu.verbs:defaults",
        )
    }
)
