"""Force budget of a mission: what each contact is certified for and has on a plant, and what that bears.

All that is said about it reads it here: numbers beyond the certificate before the run, forces before the lift, and the
explanation of a drop after the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from continuum_grasp.addons.mission.assignment import Assignment
from continuum_grasp.addons.mission.plant import PlantVariation
from continuum_grasp.addons.mission.scene import MissionScene
from continuum_grasp.base import Array
from continuum_grasp.grasp import GraspResult, Resistance

ROUNDING = 1e-6
"""Excess, as a part of a number, that is none: the certificate itself holds to this."""


# -- contacts ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CertifiedContact:
    """Certified numbers of one contact of the plant; several contacts of one support count together."""

    friction: float  # coefficient for which the grasp is certified [1]
    normal_force: float  # of the grasp [N]
    shear: float  # friction force of the grasp, in and out of the plane [N]


def certified_contact(assignments: Sequence[Assignment], name: str) -> CertifiedContact | None:
    """The certificate's numbers for a contact of the plant by its name; None where the grasp has no such contact."""
    grasp_name = grasp_contact(assignments, name)
    grasp = assignments[0].grasp
    contacts = [
        c
        for c in grasp.contacts
        if grasp_name is not None and (c.name == grasp_name or c.name.startswith(f"{grasp_name}."))
    ]
    if not contacts:
        return None
    shear = np.sum([[c.friction_force, c.lift] for c in contacts], axis=0)
    return CertifiedContact(
        friction=min(grasp.scene.friction(c.name) for c in contacts),
        normal_force=sum(c.normal_force for c in contacts),
        shear=float(np.hypot(*shear)),
    )


def grasp_contact(assignments: Sequence[Assignment], name: str) -> str | None:
    """Name in the grasp of a contact of the plant; None where the grasp does not know it (``more_contacts``)."""
    body, _, part = name.partition(".")
    finger = next((assignment for assignment in assignments if assignment.name == body), None)
    if finger is None:
        return body
    if part == "tip":
        return f"{finger.name}.tip"
    at = sorted({*finger.control.contacts, *finger.mission.more_contacts})[int(part) - 1]
    known = finger.control.contacts
    return finger.middles[known.index(at)] if at in known else None


def bodies(names: Sequence[str], fingers: Sequence[str]) -> dict[str, list[int]]:
    """Contacts by the body that holds there: each of a finger's for itself, a support's together; not the table."""
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        if not is_table(name):
            body = name.partition(".")[0]
            groups.setdefault(name if body in fingers else body, []).append(k)
    return groups


def is_table(name: str) -> bool:
    """Whether a contact of the plant touches the table; a polygon has several such contacts in the plane."""
    return name.partition(".")[0] == "table"


# -- the plant --------------------------------------------------------------------------------------------------------


def plant_friction(
    mission: MissionScene, variation: PlantVariation, names: Sequence[str], fallen: float | Array = 0.0
) -> Array:
    """Friction coefficient (K,) of each contact on the plant, by its name there or in the grasp; NaN for the table.

    (T, K) where ``fallen`` is the share (T,) by which it has fallen by some instants.
    """
    frictions = {place.name: place.friction for place in mission.grasp.places}
    usual = mission.contact_law.friction

    def coefficient(name: str) -> float:
        if is_table(name):
            return np.nan
        place = name if name in frictions else name.partition(".")[0]
        of_place = frictions.get(place)
        return usual if of_place is None else of_place

    mu = np.array([coefficient(name) for name in names])
    now: Array = np.asarray(1.0 - fallen)[..., None] * variation.friction * mu
    return now


def plant_mass(mission: MissionScene, variation: PlantVariation) -> float:
    """Mass of the object on the plant [kg]."""
    mass = mission.grasp.object.mass if mission.object_mass is None else mission.object_mass
    return mass * variation.mass


# -- pulls ------------------------------------------------------------------------------------------------------------


def promised(grasp: GraspResult) -> Resistance:
    """Multiples of the scene's disturbances that a mission may count on, whose drives hold.

    With locked tendons in the certificate, these are its multiples. Where it lets tensions be chosen anew for a
    disturbance, which a mission does not do, they are multiples with locked tendons and the weight shared out evenly:
    the least tension puts a contact on its cone, at which nothing could be resisted.
    """
    certified = grasp.quality.resistance
    if certified.tendons == "locked":
        return certified
    friction = np.array([grasp.scene.friction(contact.name) for contact in grasp.contacts])
    return held_resistance(grasp, friction, grasp.scene.object.mass, evenly=True)


def held_resistance(
    grasp: GraspResult,
    friction: Array,
    mass: float,
    *,
    max_tension: float | None = None,
    evenly: bool = False,
    wrenches: Sequence[Sequence[float]] | None = None,
) -> Resistance:
    """Multiples of the disturbances resisted with locked tendons, other friction (C,) [1] and mass [kg].

    The weight is shared out as in the certificate, in proportion; ``evenly``, or where that is beyond a cone, each
    contact bears an equal part of what it has left beside its friction in the plane. ``max_tension`` [N] is by default
    the grasp's, ``wrenches`` its scene's.
    """
    scene = grasp.scene
    if max_tension is not None:
        fingers = {name: finger.with_tendons(max_tension=max_tension) for name, finger in scene.named_fingers.items()}
        scene = scene.with_fingers(fingers)
    forces = np.array(grasp.arrays["contact_forces"], dtype=float)
    normal, across, lift = forces.T
    lift = lift * mass / scene.object.mass
    cone = friction * normal
    if evenly or (np.hypot(across, lift) > cone * (1.0 + ROUNDING)).any():
        spare = np.sqrt(np.maximum(cone**2 - across**2, 0.0))
        lift = spare * lift.sum() / max(float(spare.sum()), 1e-300)
    forces[:, 2] = lift
    response = grasp.quality.response.changed(scene=scene, contact_forces=forces)
    response.contacts.friction = friction
    # Weight in the plane beyond that of the grasp is one more wrench, to which all contacts respond.
    more = (mass - scene.object.mass) * np.array([*scene.gravity[:2], 0.0])
    response.contacts.forces[:, :2] += response.to_wrenches("locked").forces @ more
    return Resistance.of(response, tendons="locked", wrenches=wrenches)


# -- sinking -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Lowered:
    """Distance by which a pull lowers an object that weighs in the plane, though no contact slips."""

    pull: int  # number of the pull, from 1
    distance: float  # with the mission's drives and pads [m]
    certified: float  # with drives that keep their position, as the certificate has them [m]
    keeps: Literal["tension", "position"]  # what the mission's drives keep

    @property
    def text(self) -> str:
        """Distances by which a pull lowers the object, in words."""
        return (
            f"pull {self.pull} lowers it by {1e3 * self.distance:.3g} mm at least, with drives that keep their "
            f"{self.keeps} and contacts that give; the certificate has {1e3 * self.certified:.3g} mm, with drives that "
            "keep their position"
        )


def lowered_by_pulls(assignments: Sequence[Assignment], variation: PlantVariation) -> tuple[Lowered, ...]:
    """Distances by which pulls lower an object that weighs in the plane, once it rests; empty where it weighs out of
    it.

    For small motions. Controllers that follow a force give way further than drives that keep their tension.
    """
    of = assignments[0]
    fingers = [assignment.control.finger for assignment in assignments]
    grasp = of.grasp
    down = np.array(of.mission.grasp.gravity[:2])
    if of.mission.gravity:
        return ()
    more = (plant_mass(of.mission, variation) - grasp.scene.object.mass) * np.array([*down, 0.0])
    laws = [finger.drive_law for finger in fingers]
    keeps = all(finger.drives_keep_position for finger in fingers)
    springs = [np.inf if law is None else sum(law.springs(2 * [1.0 / (law.series + law.axial)])) for law in laws]
    response = grasp.quality.response
    there = response.changed(springs=springs, compliance=1.0 / of.mission.contact_law.stiffness)
    changes = (
        there.to_wrenches("locked" if keeps else "retensioned"),
        response.to_wrenches("locked"),
    )
    distances = np.stack([down / np.hypot(*down) @ change.pose[:2] @ (of.pulls + more).T for change in changes])
    return tuple(
        Lowered(k + 1, distance, firm, "position" if keeps else "tension")
        for k, (distance, firm) in enumerate(distances.T.tolist())
    )
