"""Announcement of the add-on."""

from continuum_grasp.base import Addon

ADDON = Addon(exports={"fmu": "continuum_grasp.addons.fmu.verbs:FmuTarget"})
