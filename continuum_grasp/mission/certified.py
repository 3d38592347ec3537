"""Contacts of a mission's plant beside those of the certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.mission.assignment import Assignment
from continuum_grasp.mission.plant import Variation
from continuum_grasp.scene.mission import MissionScene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CertifiedContact:
    """Certified numbers of one contact of the plant; several contacts of one support count together."""

    friction: float
    """Friction coefficient for which the grasp is certified [1]."""
    normal_force: float
    """Normal force of the grasp [N]."""
    shear: float
    """Friction force of the grasp, in and out of the plane [N]."""


def certified_contact(assignments: Sequence[Assignment], name: str) -> CertifiedContact | None:
    """The certificate's numbers for a contact of the plant by its name; None where the grasp has no such contact."""
    own, grasp = grasp_contact(assignments, name), assignments[0].grasp
    found = [c for c in grasp.contacts if own is not None and (c.name == own or c.name.startswith(f"{own}."))]
    if not found:
        return None
    shear = np.sum([[c.friction_force, c.lift] for c in found], axis=0)
    return CertifiedContact(
        friction=min(grasp.scene.friction(c.name) for c in found),
        normal_force=sum(c.normal_force for c in found),
        shear=float(np.hypot(*shear)),
    )


def grasp_contact(assignments: Sequence[Assignment], name: str) -> str | None:
    """Name in the grasp of a contact of the plant; None where the grasp does not know it (``more_contacts``)."""
    body, _, own = name.partition(".")
    finger = next((one for one in assignments if one.name == body), None)
    if finger is None:
        return body
    if own == "tip":
        return f"{finger.name}.tip"
    at = sorted({*finger.control.contacts, *finger.mission.more_contacts})[int(own) - 1]
    known = finger.control.contacts
    return finger.middles[known.index(at)] if at in known else None


def plant_friction(mission: MissionScene, variation: Variation, names: Sequence[str]) -> Array:
    """Friction coefficient (K,) of each contact on the plant, by its name there or in the grasp; NaN for the table."""
    own = {place.name: place.friction for place in mission.grasp.places}
    found = [own.get(name.partition(".")[0] if name not in own else name) for name in names]
    usual = mission.contact_law.friction
    mu = [np.nan if is_table(name) else usual if f is None else f for name, f in zip(names, found, strict=True)]
    return variation.friction * np.array(mu)


def plant_mass(mission: MissionScene, variation: Variation) -> float:
    """Mass of the object on the plant [kg]."""
    own = mission.grasp.object.mass if mission.object_mass is None else mission.object_mass
    return own * variation.mass


def is_table(name: str) -> bool:
    """Whether a contact of the plant is one with the table, of which a polygon has several in the plane."""
    return name.partition(".")[0] == "table"


def object_height(mission: MissionScene, pose: Array) -> Array:
    """Height (K,) of an object with poses (K, 3 or 4): out of the plane, or in it against gravity [m]."""
    up = -np.array(mission.plane_gravity)
    size = float(np.hypot(*up))
    return np.asarray(pose[:, 3] if size == 0.0 else pose[:, :2] @ up / size)
