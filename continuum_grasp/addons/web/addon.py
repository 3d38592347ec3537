"""Announcement of the add-on."""

from continuum_grasp.base import Addon, ExportTarget

ADDON = Addon(
    exports={
        "web": ExportTarget(
            write="continuum_grasp.addons.web:export_web",
            report="continuum_grasp.addons.web.verbs:report",
            suffix=".html",
            defaults="continuum_grasp.addons.web.verbs:defaults",
        )
    },
    pages={
        "motion": "continuum_grasp.addons.web.page:page_of_motion",
        "loop": "continuum_grasp.addons.web.page:page_of_loop",
    },
)
