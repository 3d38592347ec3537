"""Announcement of the add-on."""

from continuum_grasp.base import Addon

ADDON = Addon(exports={"web": "continuum_grasp.addons.web.verbs:PageTarget"})
