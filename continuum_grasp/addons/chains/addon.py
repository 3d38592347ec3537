"""Announcement of the add-on."""

from continuum_grasp.base import Addon

ADDON = Addon(
    exports={"mjcf": "continuum_grasp.addons.chains.verbs:ChainTarget"},
    trials={"mujoco": "continuum_grasp.addons.chains.trial:try_in_mujoco"},
    plants={"guides": "continuum_grasp.addons.chains.guides.plant:ChainPlant"},
)
