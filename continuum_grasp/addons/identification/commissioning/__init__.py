"""Commissioning: how a bench is mounted and connected, from a log of its commands and readings."""

from continuum_grasp.addons.identification.commissioning.log import commission
from continuum_grasp.addons.identification.commissioning.plan import design_commissioning
from continuum_grasp.addons.identification.commissioning.result import Commissioning

__all__ = ["Commissioning", "commission", "design_commissioning"]
