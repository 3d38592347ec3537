"""What the add-on announces."""

from continuum_grasp.base import Addon

ADDON = Addon(exports={"web": "continuum_grasp.addons.web:export_web"})
