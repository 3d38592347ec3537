"""Loads of contacts on a finger, which act at its skin: half a thickness from the center line to the object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.held import HeldContact
from continuum_grasp.grasp.judge.space_rod import RodLoad
from continuum_grasp.scene import FingerSetup

Normal = Callable[[Array], Array]
"""Outward normal (3,) of the object by a place (3,) [m]."""


@dataclass(frozen=True, eq=False)
class SkinCouple:
    """Couple of a contact about the center line of a finger, by the place of the center line."""

    normal: Normal
    contact: HeldContact
    half: float
    """Half the thickness of the finger [m]."""

    def __call__(self, center: Array) -> Array:
        """The couple (3,) at a place (3,) [m]."""
        normal = self.normal(center)
        return np.asarray(self.contact.moment * normal - self.half * np.cross(normal, self.contact.force))


def skin_load(setup: FingerSetup, contact: HeldContact, normal: Normal) -> RodLoad:
    """The load of a contact on a finger."""
    half = float(setup.finger.profile.half_thickness(contact.place))
    return RodLoad(contact.place, contact.force, SkinCouple(normal, contact, half))
