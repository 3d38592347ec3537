"""What the add-on announces."""

from continuum_grasp.base import Addon

ADDON = Addon(exports={"mjcf": "continuum_grasp.addons.chains:export_mjcf"})
