"""The mug of the shipped scenes in numbers of the tests' own."""

from __future__ import annotations

import math
from pathlib import Path

from continuum_grasp.scene.finger import BasePose, PointMass, Rod, Tendons
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import GraspContacts, GraspFinger, NoGravity, OutOfPlaneGravity, PlanarGravity
from continuum_grasp.scene.objects import Circle
from continuum_grasp.scene.simulate import Fidelity
from continuum_grasp.scene.supports import Palm

CONFIGS = Path(__file__).parents[1] / "configs" / "grasp"
PLANAR = PlanarGravity(mode="planar", vector=(0.0, -9.81))
UPRIGHT = OutOfPlaneGravity(mode="out_of_plane", magnitude=9.81)
WEIGHTLESS = NoGravity(mode="none")
SHAPES = {
    "circle": {"shape": "circle", "diameter": 0.08},
    "ellipse": {"shape": "ellipse", "width": 0.09, "height": 0.06},
    "superellipse": {"shape": "superellipse", "width": 0.08, "height": 0.06, "exponent": 3.5},
    "box": {"shape": "box", "width": 0.08, "height": 0.06},
    "rounded box": {"shape": "box", "width": 0.08, "height": 0.06, "corner_radius": 0.012},
    "polygon": {"shape": "polygon", "vertices": [(-0.04, -0.03), (0.045, -0.02), (0.03, 0.04), (-0.02, 0.045)]},
    "stadium": {"shape": "stadium", "length": 0.04, "radius": 0.03},
    "union": {
        "shape": "union",
        "center_of_mass": (0.0, 0.0),
        "members": [
            {"shape": "circle", "diameter": 0.07},
            {"shape": "box", "width": 0.02, "height": 0.03, "corner_radius": 0.004, "position": (0.04, 0.0)},
        ],
    },
}
"""Objects of every kind of outline."""
PALM = {"palm": Palm(point=(0.0, 0.0), normal_angle=0.0)}


def make_scene(family="matched_clothoid", gravity=UPRIGHT, base_y=-0.055, elements=2, **changes):
    """The mug of the shipped scene, in numbers of this test's own."""
    finger = GraspFinger(
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
        "finger": finger,
        "object": Circle(shape="circle", diameter=0.08, mass=changes.pop("mass", 0.3), position=(0.04, 0.0)),
        "supports": PALM,
        "contacts": GraspContacts(friction=changes.pop("friction", 0.5), normal_force_max=30.0),
        "gravity": gravity,
        "fidelity": Fidelity(family=family, elements=elements),
        **changes,
    }
    return GraspScene(**values)
