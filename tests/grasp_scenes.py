"""The mug of the shipped scenes in numbers of the tests' own."""

from __future__ import annotations

import math
import re
from pathlib import Path

import yaml

from continuum_grasp.scene import (
    BasePose,
    Circle,
    Fidelity,
    GraspContacts,
    GraspFinger,
    GraspScene,
    Palm,
    PointMass,
    Rod,
    Tendons,
)

CONFIGS = Path(__file__).parents[1] / "configs" / "grasp"
PLANAR = (0.0, -9.81, 0.0)
INTO_PLANE = (0.0, 0.0, -9.81)
WEIGHTLESS = (0.0, 0.0, 0.0)
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


def make_scene(family="matched_clothoid", gravity=INTO_PLANE, base_y=-0.055, elements=2, **changes):
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


def repaired(scene, repair):
    """A scene with the repair of a reason typed into it, ``key = value together with key = value``."""
    for part in repair.split(" together with "):
        key, _, value = part.partition(" = ")
        number = re.sub(r"(?<=\d) (N m|N|kg|m)$", "", value)
        scene = scene.changed({key: yaml.safe_load(number)})
    return scene


def finger_to(tip, towards, length=0.2, half=0.006, stiffness=0.4, **more):
    """A straight finger of next to no weight: the center of its round tip is at a place [m], where it points at an
    angle [rad].
    """
    x, y = (float(at) - length * way for at, way in zip(tip, (math.cos(towards), math.sin(towards)), strict=True))
    return {
        "rod": {"length": length, "linear_density": 1e-9, "bending_stiffness": stiffness},
        "half_thickness": half,
        "tendons": {"offset": 0.005, "max_tension": 200.0},
        "base": {"position": (x, y), "angle": math.remainder(towards - 0.5 * math.pi, math.tau)},
        **more,
    }


def loose(finger, by):
    """A finger whose base may move by so much [m]."""
    x, y = finger["base"]["position"]
    return finger | {"base_free": {"x": (x - by, x + by), "y": (y - by, y + by)}}


def held_by_tips(fingers, gravity, body=None, contacts=None, **more):
    """Fingers, by their names or in order, that hold a disc of 80 mm about the origin with their tips alone."""
    return GraspScene.model_validate(
        {
            "fingers": fingers if isinstance(fingers, dict) else {f"finger_{k}": one for k, one in enumerate(fingers)},
            "object": {"mass": 0.3, "position": (0.0, 0.0), **(body or {"shape": "circle", "diameter": 0.08})},
            "contacts": {"friction": 0.5, "normal_force_max": 100.0, "middle": "off", "tip": "on", **(contacts or {})},
            "gravity": gravity,
            "fidelity": {"family": "matched_clothoid", "elements": 2},
            **more,
        }
    )


HEXAGON = {
    "finger": {
        "rod": {
            "length": 0.11932284160351045,
            "linear_density": 0.0031543944730146214,
            "bending_stiffness": 0.0023766751810183093,
        },
        "half_thickness": 0.004418572044625068,
        "tendons": {"offset": 0.004190820878198073, "max_tension": 104.38260150679578, "min_tension": 0.0},
        "tendons_used": "left",
        "base": {"position": [0.0045493821945984565, -0.023385844245115743], "angle": -1.219522387064357},
    },
    "object": {
        "shape": "polygon",
        "vertices": [
            [0.016655450579472084, -0.004052498029296169],
            [0.007072427331219942, 0.015614337831855035],
            [-0.00976008071797336, 0.014091401586120909],
            [-0.016722145957028717, -0.0037678387537837046],
            [-0.004636384595865063, -0.016502445641840828],
            [0.011885701859888114, -0.012351391240687765],
        ],
        "position": [0.01650510614061406, 0.0],
        "angle": -1.5702219090772405,
        "mass": 0.041669230108076896,
    },
    "supports": {"palm": {"type": "palm", "point": (0.0, 0.0), "normal_angle": 0.0}},
    "contacts": {"friction": 1.1265019631337605, "normal_force_max": 460.0180088633679, "middle": "on", "tip": "on"},
    "gravity": [4.243009249191035, -8.84494050354661, 0.0],
    "fidelity": {"family": "matched_clothoid", "elements": 4, "bending_range": 3.4},
    "stability": "ignore",
}
"""A short first segment: the tip sweeps over the object within a thousandth of its outline, so that all digits count,
and the finger bends less than the curves of the scan, which exceed the bending range.
"""
