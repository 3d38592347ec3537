"""Grasps written down by hand: scenes, and the arrays that a grasp is stored in."""

from __future__ import annotations

import math

import numpy as np

from continuum_grasp.scene.finger import BasePose, Rod, Tendons
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import GraspContacts, GraspFinger, NoGravity
from continuum_grasp.scene.objects import Circle
from tests import certificate_cases as cases

LENGTH, STIFFNESS, OFFSET = 0.18, 6.11e-3, 0.005


def make_finger(base=(0.0, 0.0, 0.0), half_thickness=0.006, weight=0.0, **tendons):
    used = tendons.pop("tendons_used", "both")
    return GraspFinger(
        rod=Rod(length=LENGTH, linear_density=max(weight, 1e-9), bending_stiffness=STIFFNESS),
        half_thickness=half_thickness,
        tendons=Tendons(offset=OFFSET, **{"max_tension": 60.0, **tendons}),
        base=BasePose(position=base[:2], angle=base[2]),
        tendons_used=used,
    )


def make_scene(**changes):
    """A disc of radius 40 mm at the origin, out of reach of its one finger, weightless."""
    values = {
        "finger": make_finger((0.5, 0.5, 0.0)),
        "object": Circle(shape="circle", diameter=0.08, mass=0.3, position=(0.0, 0.0)),
        "contacts": GraspContacts(friction=0.5, normal_force_max=30.0, tip="on", middle="off"),
        "gravity": NoGravity(mode="none"),
        **changes,
    }
    if "fingers" in changes:
        del values["finger"]
    return GraspScene(**values)


def straight_finger(base, tensions=(0.0, 0.0), curvatures=(0.0, 0.0, 0.0), lengths=None):
    """Arrays of one finger with curvatures at its nodes."""
    curvatures = np.asarray(curvatures, dtype=float)
    lengths = np.full(curvatures.size - 1, LENGTH / (curvatures.size - 1)) if lengths is None else np.asarray(lengths)
    return {
        "family": "clothoid",
        "q": curvatures,
        "curvature_shapes": cases.shapes_of("clothoid", lengths),
        "lengths": lengths,
        "tip_curvature": curvatures[-1],
        "tensions": np.asarray(tensions, dtype=float),
        "base": np.asarray(base, dtype=float),
        "backbone": np.zeros((0, 4)),
    }


def arrays_of(contacts, pose=(0.0, 0.0, 0.0), fingers=None):
    """Stored arrays: contacts are (name, position, normal, forces, station)."""
    arrays = {"object.pose": np.asarray(pose, dtype=float)}
    arrays |= cases.contact_arrays([(*contact, 0) for contact in contacts])
    for name, finger in (fingers or {}).items():
        arrays |= {f"{name}.{key}": value for key, value in finger.items()}
    return arrays


def on_disc(angles, radius=0.04, forces=None, stations=None):
    """Contacts on a disc at the origin, seen from its center at these angles [rad]."""
    contacts = []
    for k, angle in enumerate(angles):
        normal = (math.cos(angle), math.sin(angle))
        force = (1.0, 0.0, 0.0) if forces is None else forces[k]
        station = math.nan if stations is None else stations[k]
        name = f"finger.middle_{k + 1}" if math.isnan(station) else "finger.tip"
        contacts.append((name, (radius * normal[0], radius * normal[1]), normal, force, station))
    return contacts
