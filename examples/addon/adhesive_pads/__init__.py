"""Adhesive pads: an add-on of continuum_grasp with a contact law, a plant and a verb."""

from continuum_grasp.base import Addon

ADDON = Addon(
    verbs={"pull-off": "adhesive_pads.verb:pull_off"},
    contact_laws={"adhesive": "adhesive_pads.law:AdhesiveLaw"},
)
