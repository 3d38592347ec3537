"""What the add-on announces."""

from continuum_grasp.base import Addon, ExportTarget

ADDON = Addon(
    exports={
        "web": ExportTarget(
            write="continuum_grasp.addons.web:export_web",
            report="continuum_grasp.addons.web.verbs:report",
            suffix=".html",
        )
    }
)
