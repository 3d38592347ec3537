"""Announcement of the add-on."""

from continuum_grasp.base import Addon

ADDON = Addon(
    exports={"mjcf": "continuum_grasp.addons.chains.verbs:ChainTarget"},
    plants={"guides": "continuum_grasp.addons.chains.guides.plant:ChainPlant"},
)
