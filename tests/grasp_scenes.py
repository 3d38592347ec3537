"""The mug of the shipped scenes in numbers of the tests' own."""

from __future__ import annotations

import math
from pathlib import Path

from grasp_oracle import Plant

from continuum_grasp.scene.finger import BasePose, Finger, PointMass, Rod, Tendons
from continuum_grasp.scene.grasp import (
    Circle,
    GraspContacts,
    GraspScene,
    NoGravity,
    OutOfPlaneGravity,
    Palm,
    PlanarGravity,
)
from continuum_grasp.scene.simulate import Fidelity

CONFIGS = Path(__file__).parents[1] / "configs" / "grasp"
PLANAR = PlanarGravity(mode="planar", vector=(0.0, -9.81))
UPRIGHT = OutOfPlaneGravity(mode="out_of_plane", magnitude=9.81)
WEIGHTLESS = NoGravity(mode="none")


def make_scene(family="matched_clothoid", gravity=UPRIGHT, base_y=-0.055, elements=2, **changes):
    """The mug of the shipped scene, in numbers of this test's own."""
    finger = Finger(
        rod=Rod(length=0.18, linear_density=0.034, bending_stiffness=6.11e-3),
        half_thickness=0.006,
        masses=(PointMass(at=0.18, mass=0.002),),
        tendons=Tendons(
            offset=0.005,
            min_tension=1.0,
            max_tension=changes.pop("max_tension", 60.0),
            friction=changes.pop("tendon_friction", 0.0),
        ),
        base=BasePose(position=(0.0, base_y), angle=-math.pi / 2),
    )
    finger = finger.model_copy(update=changes.pop("finger", {}))
    values = {
        "schema_version": 1,
        "finger": finger,
        "object": Circle(shape="circle", diameter=0.08, mass=changes.pop("mass", 0.3), position=(0.04, 0.0)),
        "palm": Palm(point=(0.0, 0.0), normal_angle=0.0),
        "contacts": GraspContacts(friction=changes.pop("friction", 0.5), normal_force_max=30.0),
        "gravity": gravity,
        "fidelity": Fidelity(family=family, elements=elements),
        **changes,
    }
    return GraspScene(**values)


def plant_of(scene, **changes):
    """The same numbers for the independent solution."""
    finger, gravity = scene.finger, scene.gravity
    values = {
        "length": finger.rod.length,
        "stiffness": finger.rod.stiffness,
        "offset": finger.tendons.offset,
        "tension_max": finger.tendons.max_tension - finger.tendons.min_tension,
        "half_thickness": finger.thickness_radius,
        "base": finger.base.position,
        "angle": finger.base.angle,
        "centre": scene.object.position,
        "radius": scene.object.radius,
        "mass": scene.object.mass,
        "friction": scene.contacts.friction,
        "normal_max": scene.contacts.normal_force_max,
        "palm_angle": scene.palm.normal_angle,
        "gravity": gravity.vector if gravity.mode == "planar" else (0.0, 0.0),
        "lift": gravity.magnitude if gravity.mode == "out_of_plane" else 0.0,
        "weight_per_length": finger.rod.mass_per_length if gravity.mode == "planar" else 0.0,
        "tip_mass": finger.masses[0].mass if gravity.mode == "planar" else 0.0,
    }
    return Plant(**{**values, **changes})
