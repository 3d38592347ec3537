"""What the add-on announces."""

from continuum_grasp.base import Addon

ADDON = Addon(exports={"fmu": "continuum_grasp.addons.fmu:export_fmu"})
