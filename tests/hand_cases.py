"""Grasps of hands made by hand: straight fingers in closed form, and one that an independent program found."""

from __future__ import annotations

import cmath
import math

import numpy as np

from continuum_grasp.scene import HandScene
from tests import certificate_cases as planar

LENGTH, STIFFNESS, HALF, OFFSET = 0.12, 0.006, 0.006, 0.006
STRIP = {"shape": "ellipse", "thickness": 1e-3, "width": 4e-3}
LATERAL = 16 * STIFFNESS
EXTENTS = np.array([0.04, 0.05, 0.06])
AWAY = {"shape": "sphere", "diameter": 0.01, "mass": 0.0, "position": (0.07, 0.07, 0.0)}
"""An object that nothing touches."""


def make_scene(bases, body, contacts=None, section=None, gravity=(0.0, 0.0, 0.0), half=HALF, **more):
    """A scene of fingers without weight: of a hand of names to (position, direction, bends toward)."""
    finger = {
        "rod": {"length": LENGTH, "bending_stiffness": STIFFNESS, "linear_density": more.pop("density", 1e-12)},
        "half_thickness": half,
        "section": STRIP if section is None else section,
        "tendons": {"offset": min(OFFSET, half), "max_tension": 60.0},
    }
    names = ("position", "direction", "bends_toward")
    plain = {name: dict(zip(names, (tuple(map(float, v)) for v in base), strict=True)) for name, base in bases.items()}
    contacts = {"friction": 0.5, "normal_force_max": 50.0, "middle": "off", "tip": "on", **(contacts or {})}
    more = {"fidelity": {"family": "matched_clothoid", "elements": 2}, **more}
    hand = {"finger": finger, "bases": plain, "palm": more.pop("palm", None)}
    return HandScene(schema_version=1, hand=hand, object=body, contacts=contacts, gravity=gravity, **more)


def stored(scene, contacts, **fingers):
    """All stored arrays: contacts (name, position, normal, force, station, deflection); fingers as in a plane."""
    arrays = {}
    for setup in scene.setups:
        arrays |= planar.finger_arrays(scene, setup.name, base=(0.0, 0.0, 0.0), **fingers.get(setup.name, {}))
    arrays["contact_names"] = np.array([contact[0] for contact in contacts], dtype=str)
    for k, (key, shape) in enumerate(
        {"positions": 3, "normals": 3, "forces": 3, "stations": 0, "deflections": 0}.items()
    ):
        values = np.array([contact[k + 1] for contact in contacts], dtype=float)
        arrays[f"contact_{key}"] = values.reshape((-1, shape) if shape else -1)
    return arrays | {f"{setup.name}.base_moment": base_moment(scene, arrays, setup.name) for setup in scene.setups}


def base_moment(scene, arrays, name):
    """Moment (3,) in the base of a finger without weight that bears its contacts, by statics alone."""
    base = np.array(scene.hand.named_bases[name].position)
    own = [k for k, contact in enumerate(arrays["contact_names"]) if str(contact).startswith(f"{name}.")]
    arms = arrays["contact_positions"][own] - base
    return np.cross(arms, arrays["contact_forces"][own]).sum(axis=0) if own else np.zeros(3)


def sag(force, press=0.0):
    """Displacement of a straight finger's end by a force to the side that acts a half thickness ahead of it, while one
    along the finger presses it: E I w'' = force (L - s + h) + press (w(L) - w).
    """
    x = LENGTH * cmath.sqrt(press / LATERAL)
    tangent, secant = x * x / 3.0 + 2.0 * x**4 / 15.0, x * x / 2.0 + 5.0 * x**4 / 24.0  # tan x / x - 1, 1 / cos x - 1
    if abs(x) > 1e-3:
        tangent, secant = cmath.tan(x) / x - 1.0, 1.0 / cmath.cos(x) - 1.0
    if not press:
        return force * (LENGTH**3 / 3.0 + HALF * LENGTH**2 / 2.0) / LATERAL
    return force * (LENGTH * tangent + HALF * secant).real / press


def squeezed_box(press=2.0, mass=0.05, body=None, density=1e-12, **contacts):
    """Two straight fingers press a box between their ends, and bear its weight by their stiffness to the side."""
    a, force = 0.5 * EXTENTS[0], 0.5 * 9.81 * mass
    w, reach = sag(force, press), 0.5 * EXTENTS[0] + HALF + LENGTH
    bases = {
        "left": ((-reach, 0, w), (1, 0, 0), (0, 1, 0)),
        "right": ((reach, 0, w), (-1, 0, 0), (0, 1, 0)),
    }
    box = {"shape": "box", "extents": tuple(EXTENTS), "edge_radius": 0.004, "mass": mass, "position": (0.0, 0.0, 0.0)}
    scene = make_scene(bases, {**box, **(body or {})}, contacts, gravity=(0.0, 0.0, -9.81), density=density)
    # The plane's normal is along z on the left and against it on the right.
    touches = [
        ("left.tip", (-a, 0, 0), (-1, 0, 0), (-press, 0, -force), LENGTH, -w),
        ("right.tip", (a, 0, 0), (1, 0, 0), (press, 0, -force), LENGTH, w),
    ]
    return scene, stored(scene, touches)


def twisted_box(offset=1e-3, press=2.0, mass=0.05, torsional_friction=1e-3, **contacts):
    """`squeezed_box` whose center of mass is beside the line through the ends, along y: both ends bear half the moment
    about it.
    """
    body = {"center_of_mass": (0.0, offset, 0.0)}
    scene, arrays = squeezed_box(press, mass, body, torsional_friction=torsional_friction, **contacts)
    moment = 0.5 * offset * 9.81 * mass
    arrays["contact_moments"] = np.array([moment, -moment])
    for name, normal, turn in zip(("left", "right"), arrays["contact_normals"], (moment, -moment), strict=True):
        arrays[f"{name}.base_moment"] = arrays[f"{name}.base_moment"] + turn * normal
    return scene, arrays


def one_finger(load, normal, curvature=0.0, section=None, station=LENGTH, **more):
    """A finger along the hand's y axis, in whose plane z is that of the hand, under one force; it touches nothing."""
    bases = {"finger": ((0, 0, 0), (0, 1, 0), (-1, 0, 0))}
    family = {"family": "clothoid", "elements": 2}
    switches = {"middle": "auto", "tip": "auto"}
    scene = make_scene(bases, AWAY, switches, section, fidelity=family, **more)
    name = "finger.tip" if station == LENGTH else "finger.middle"
    lengths = [station, LENGTH - station] if station < LENGTH else [0.5 * LENGTH] * 2
    touches = [(name, (0, 0, 0), normal, load, station, 0.0)]
    return scene, stored(scene, touches, finger={"q": [curvature] * 3, "lengths": lengths})


def three_straight(press, radius=0.03, half=1e-5, section=None, others=None, **more):
    """Three straight fingers downward beside a ball, whose ends press on its equator, and others that touch nothing."""
    bases, touches = {}, []
    for k in range(3):
        out = np.array([math.cos(math.tau * k / 3), math.sin(math.tau * k / 3), 0.0])
        bases[f"finger_{k + 1}"] = ((radius + half) * out, (0, 0, -1), -out)
        touches.append((f"finger_{k + 1}.tip", radius * out + (0, 0, -LENGTH), out, press * out, LENGTH, 0.0))
    ball = {"shape": "sphere", "diameter": 2 * radius, "mass": 0.0, "position": (0.0, 0.0, -LENGTH)}
    switch = {"tip": "auto"}
    scene = make_scene(bases | (others or {}), ball, switch, section, half=half, **more)
    return scene, stored(scene, touches)


def resting(body, points, mass=0.1, extra=(), base=((0.1, 0.0, 0.05), (0, 0, 1), (1, 0, 0)), **more):
    """A body on a table at z = 0 that alone carries its weight, in equal shares at some points; one finger."""
    solid = {**body, "mass": mass, "against": "table"}
    more = {"table": {"point": (0.0, 0.0, 0.0)}, "gravity": (0.0, 0.0, -9.81), **more}
    contacts = {"tip": "auto", **more.pop("contacts", {})}
    scene = make_scene({"finger": base}, solid, contacts, **more)
    share = -9.81 * mass / max(len(points), 1)
    touches = [(f"table_{k + 1}", point, (0, 0, -1), (0, 0, share), 0.0, 0.0) for k, point in enumerate(points)]
    return scene, stored(scene, [*touches, *extra])


def of_plane(scene, found, height):
    """The hand of a planar scene whose fingers hold a disc alone, which is a cylinder of some height, and its grasp."""
    bases, arrays = {}, {}
    for setup in scene.setups:
        name, (x, y, angle) = setup.name, (float(value) for value in found[f"{setup.name}.base"])
        c, s = math.cos(angle), math.sin(angle)
        own = {key: value for key, value in setup.finger.stated().items() if key not in ("base", "fidelity")}
        own["fidelity"] = {"family": setup.family, "elements": setup.elements}
        bases[name] = {"position": (x, y, 0.0), "direction": (-s, c, 0.0), "bends_toward": (-c, -s, 0.0), "finger": own}
        keys = "family", "q", "lengths", "curvature_shapes", "tip_curvature", "tensions"
        arrays |= {f"{name}.{key}": found[f"{name}.{key}"] for key in keys}
        line = np.array(found[f"{name}.backbone"])
        line[:, 1:3] = (line[:, 1:3] - [x, y]) @ [[c, -s], [s, c]]
        line[:, 3] -= angle
        arrays |= {f"{name}.base": np.zeros(3), f"{name}.backbone": line}
        arrays[f"{name}.base_moment"] = found[f"{name}.base_moment"]
    normals, (n, f, lift) = found["contact_normals"], found["contact_forces"].T
    loads = n[:, None] * normals + f[:, None] * np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    none = np.zeros(len(n))
    arrays |= {
        "contact_names": found["contact_names"],
        "contact_positions": np.column_stack([found["contact_positions"], none]),
        "contact_normals": np.column_stack([normals, none]),
        "contact_forces": np.column_stack([loads, -lift]),
        "contact_stations": found["contact_stations"],
        "contact_deflections": none,
    }
    disc = scene.object
    tube = {"shape": "cylinder", "diameter": disc.diameter, "height": height, "edge_radius": 0.02 * height}
    hand = HandScene.model_validate({
        "schema_version": 1,
        "hand": {"finger": next(iter(bases.values()))["finger"], "bases": bases},
        "object": {**tube, "mass": disc.mass, "position": (*(float(v) for v in found["object.pose"][:2]), 0.0)},
        "contacts": {key: getattr(scene.contacts, key) for key in ("friction", "normal_force_max", "reserve")},
        "gravity": scene.gravity,
        "stability": "ignore",
    })  # fmt: skip
    return hand, arrays
