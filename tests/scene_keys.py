"""Every key of every kind of scene, in scenes that together have all of them, with other values that it can have."""

from __future__ import annotations

import fnmatch
import inspect
import typing
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel
from pydantic.fields import FieldInfo

import continuum_grasp as cg
from continuum_grasp.addons.design import Design
from continuum_grasp.addons.identification import IdentifyScene
from continuum_grasp.addons.mission import MissionScene
from continuum_grasp.addons.planning import PlanScene
from continuum_grasp.addons.sweeps import Sweep
from continuum_grasp.scene import ControlScene, GraspScene, KeyPath, Scene

CONFIGS = Path(__file__).parents[1] / "configs"
_CORNERS = [[0.02, -0.01], [0.02, 0.03], [-0.02, 0.02]]
_SHAPES: dict[str, dict[str, Any]] = {
    "circle": {"diameter": 0.04},
    "ellipse": {"width": 0.04, "height": 0.03},
    "superellipse": {"width": 0.04, "height": 0.03, "exponent": 3.0},
    "box": {"width": 0.04, "height": 0.03, "corner_radius": 0.002},
    "polygon": {"vertices": _CORNERS, "corner_radius": 0.002},
    "stadium": {"length": 0.03, "radius": 0.01},
}
_PLACE = {"mass": 0.3, "position": [0.12, 0.1], "angle": 0.1, "center_of_mass": [0.001, 0.002]}
_SUPPORTS = {
    "line": {"type": "line", "start": [0.0, -0.5], "end": [0.5, -0.5]},
    "point": {"type": "point", "position": [0.3, -0.3], "radius": 0.01},
    "groove": {"type": "v_groove", "apex": [0.0, -0.4], "opening_angle": 1.5, "axis_angle": 1.57},
}
_SPREAD = {
    "at": [0.0, 0.05, 0.1],
    "bending_stiffness": [0.02, 0.015, 0.01],
    "linear_density": [0.2, 0.15, 0.1],
    "rotary_inertia": [1e-6, 1e-6, 1e-6],
    "rest_curvature": [0.1, 0.2, 0.1],
    "thickness": [0.01, 0.009, 0.008],
}
_BENT = {"to": 0.05, "bending_stiffness": 0.02, "linear_density": 0.2, "rotary_inertia": 1e-6, "thickness": 0.01}
_CUT = {"to": 0.1, "youngs_modulus": 1e9, "density": 1e3, "width": 0.01, "thickness": 0.005}
_OWN_ROD: dict[str, Any] = {
    "contacts": [],
    "finger.masses": [],
    "finger.tendons.offset": 0.002,
    "finger.half_thickness": None,
    "finger.strain_limit": None,
}
_FORCE = {"kind": "force", "at": 0.06, "force": {"times": [0.0, 1.0], "values": [[0.0, 0.1], [0.2, 0.3]]}}
_MOMENT = {"kind": "moment", "at": 0.05, "moment": 0.01}
_DRY = {"dry_friction": [{"stiffness": 0.01, "moment": 0.01}], "friction_cells": 3}
_RELAXING = {"finger.damping": {"relaxation": [{"share": 0.2, "time": 3.0}]}}
_CHAMBER = {"area": 6e-5, "offset": -0.004, "max_pressure": 8e4, "time_constant": 0.05}
_CHAMBERS = {
    "finger.tendons": None,
    "finger.pressure": [_CHAMBER, {**_CHAMBER, "offset": 0.004, "start": 0.01, "to": 0.08, "stiffness_share": 0.1}],
}
_SHIPPED: dict[type[BaseModel], dict[str, dict[str, Any]]] = {
    Scene: {
        name: {"fidelity": {"family": "arc", "elements": 3}, "initial": {"pose": "straight"}}
        for name in ("close_on_mug", "three_tendons", "winch_loop", "motor_pulley", "spirob")
    },
    ControlScene: {
        name: {"plant.fidelity": {"family": "arc", "elements": 2}}
        for name in (
            *("steady_tip", "turn_bar", "unknown_payload", "wrap_post", "winches", "motor_servo", "tip_circle"),
            *("keep_out", "three_tendons", "nitinol_moment", "saturation", "tip_steps"),
        )
    },
    PlanScene: {
        "tip_to_point": {"intervals": 4},
        "past_a_post": {"intervals": 4},
        "release": {"intervals": 4},
        "close_on_mug": {"intervals": 4, "grasp": None, "goal.contact_force": [0.0, 1.0], "contacts": [0.1]},
    },
    MissionScene: {"mug": {}, "turn_block": {}, "mug_hard": {}, "cup_lying": {}, "mug_servo": {}},
    IdentifyScene: {"own_finger": {}, "winch_finger": {}},
    Sweep: {"finger_design": {}, "mug_uncertain": {}},
    Design: {"tolerances": {}, "ten_objects": {}},
}
"""Shipped scenes by kind, and what is changed in all of them."""
_FOLDERS = {
    Scene: "simulate",
    ControlScene: "mpc",
    PlanScene: "plan",
    MissionScene: "mission",
    IdentifyScene: "identify",
    Sweep: "sweep",
    Design: "design",
}
_CHANGES: dict[str, tuple[str, dict[str, Any]]] = {
    "pulled": (
        "close_on_mug",
        {
            "object_load": {"force": [0.1, 0.2], "moment": 0.01},
            "table_height": -0.01,
            "supports.peg": {"type": "point", "position": [0.09, 0.01], "radius": 0.009},
            "support_motion": {
                "peg": {
                    "shift": {"times": [0.0, 0.1], "values": [[0.0, 0.0], [0.0, 0.004]]},
                    "turn": {"times": [0.0, 0.1], "values": [0.0, 1.0]},
                }
            },
        },
    ),
    "samples": ("close_on_mug", {"finger.rod": {"length": 0.1, "samples": _SPREAD}, **_OWN_ROD}),
    "loads": ("three_tendons", {"loads": [_MOMENT, _FORCE], "actuation": {"tensions": [3.0, 4.0, 5.0]}}),
    "shape": (
        "close_on_mug",
        {
            "finger.rest_curvature": {"breaks": [0.05], "values": [1.0, 2.0]},
            "finger.tip_body": {"mass": 0.01, "rotary_inertia": 1e-6, "center_of_mass": [0.0, 0.01]},
            "finger.masses": [{"at": 0.1, "mass": 0.01}, {"at": 0.15, "mass": 0.02}],
        },
    ),
    "parameters": ("close_on_mug", {"parameters": ["bending_stiffness"]}),
    "conduit": ("close_on_mug", {"finger.tendons.friction": 0.1, "finger.tendons.conduit_bend": 1.0}),
    "fixed object": (
        "close_on_mug",
        {
            "object_moves": False,
            "table": None,
            "out_of_plane_gravity": 0.0,
            "supports": {},
            "object.position": [0.1, 0.1],
        },
    ),
    **{
        f"object: {shape}": ("close_on_mug", {"object": {"shape": shape, **_PLACE, **own}})
        for shape, own in _SHAPES.items()
    },
    **{
        f"member: {shape}": (
            "close_on_mug",
            {"object": {"shape": "union", **_PLACE, "members": [{"shape": shape, **own}, {"shape": shape, **own}]}},
        )
        for shape, own in _SHAPES.items()
    },
    "supports": ("close_on_mug", {"supports": _SUPPORTS}),
    "table in the plane": (
        "close_on_mug",
        {"out_of_plane_gravity": 0.0, "table": {"friction": 0.3, "point": [0.0, -0.5], "normal_angle": 1.57}},
    ),
    "sections": ("close_on_mug", {"finger.rod": {"length": 0.1, "sections": [_BENT, _CUT]}, **_OWN_ROD}),
    "section": (
        "close_on_mug",
        {
            "finger.rod": {
                "length": 0.1,
                "sections": [{"to": 0.1, "diameter": 0.01, "rest_curvature": 0.1}],
                "youngs_modulus": 1e9,
                "density": 1e3,
            },
            **_OWN_ROD,
        },
    ),
    "tip moment": ("close_on_mug", {"finger.tendons": None, "actuation": {"tip_moment": 0.01}}),
    "chambers": ("close_on_mug", {**_CHAMBERS, "actuation": {"pressures": [2e4, 1e4]}}),
    "muscle beside tendons": (
        "three_tendons",
        {
            "finger.pressure": {**_CHAMBER, "contracts": True},
            "actuation": {"tensions": [3.0, 4.0, 5.0], "pressures": [{"times": [0.0, 1.0], "values": [0.0, 2e4]}]},
        },
    ),
    "dry friction": ("close_on_mug", {"finger.damping": _DRY}),
    "dry friction, bent": (
        "close_on_mug",
        {
            "finger.damping": {**_DRY, "friction_cells": 5},
            "fidelity": {"family": "clothoid", "elements": 2},
            "contacts": [],
            "initial": {"q": [0.1, 0.2, 0.3], "qd": [0.1, 0.2, 0.3], "reached_by": "pulling"},
        },
    ),
    "stops": ("close_on_mug", {"finger.stops": {"curvature": 20.0, "stiffness_ratio": 30.0}}),
    "relaxation": ("close_on_mug", _RELAXING),
    "softening": ("close_on_mug", {"finger.softening": {"curvature": 5.0, "stiffness_ratio": 0.5}}),
    "tendons that shorten": ("close_on_mug", {"finger.tendons.time_constant": None, "finger.gyration_radius": 3e-4}),
    "slip speed": ("close_on_mug", {"contact_law.presliding": None, "contact_law.slip_speed": 0.01}),
    "film": ("close_on_mug", {"contact_law.viscous": 0.5}),
    "winches": ("winch_loop", {"finger.tendons.friction": 0.0, "actuation": {"lengths": [1e-3, 2e-3]}}),
    "slack winches": (
        "winch_loop",
        {
            "finger.tendons.friction": 0.0,
            "finger.tendons.drive.pretension": 0.0,
            "finger.tendons.drive.slack": 0.001,
        },
    ),
    "motor with a gear": (
        "motor_pulley",
        {
            "finger.tendons.drive.backlash": 0.01,
            "finger.tendons.drive.gear_stiffness": 20.0,
            "actuation": {"angles": [0.1]},
        },
    ),
    "motor, torques": (
        "motor_pulley",
        {
            "finger.tendons.drive.position_gain": None,
            "finger.tendons.drive.rate_gain": 0.0,
            "actuation": {"torques": [0.01]},
        },
    ),
}
_MOUNTING = {
    "camera": {"position": (0.008, -0.005), "angle": 0.1, "scale": 1.05, "mirrored": True},
    "drives": [{"of": 2, "zero": 0.3}, {"of": 1, "sign": -1}],
    "tensions": [{"of": 2, "zero": 1.0}, {"of": 1}],
}
_LOOPS: dict[str, tuple[str, dict[str, Any]]] = {
    "mounting": (
        "steady_tip",
        {"mounting": _MOUNTING, "plant.mounting": _MOUNTING, "log": {"columns": {"tip_x": "x"}}},
    ),
    "scenarios": (
        "steady_tip",
        {"controller.scenarios": [{"stiffness": 0.8, "damping": 0.9, "tip_mass": 0.001, "time_constant": 0.02}, {}]},
    ),
    "scenarios of winches": (
        "winches",
        {
            "controller.scenarios": [
                {"tendon_friction": 0.1, "presliding": 1e-5, "axial_stiffness": 9e3, "series_stiffness": 3e4},
                {},
            ]
        },
    ),
    "state given": (
        "wrap_post",
        {"estimator": None, "controller.bounds.curvature": 10.0, "controller.horizon.substeps": 4},
    ),
    "motor": ("motor_servo", {"loads": []}),
    "chambers": (
        "steady_tip",
        {
            **_CHAMBERS,
            "fidelity.family": "clothoid",
            "controller.cost": {"tip": {"running": 2e4}, "effort": 1e-10, "input_rate": 1e-10},
            "controller.input.rate_max": 1e6,
            "estimator.measured": {"tip": 0.0003},
        },
    ),
    "torques": ("motor_servo", {"estimator.measured.torque": 0.001}),
    "guides": ("winches", {"plant": {"guides": 20}}),
    "all tracked": (
        "turn_bar",
        {
            "estimator.object_acceleration_std": 0.2,
            "controller.cost": {
                "shape": {"at": [0.09], "running": 1.0},
                **{key: {"running": 1.0} for key in ("tip", "bending", "tip_angle", "object_position", "object_angle")},
                "contact_force": {"running": 1.0, "of": ["finger.tip"]},
                "effort": 1e-3,
            },
            "reference": {
                "tip": [0.0, 0.15],
                "shape": [0.0, 0.08],
                "bending": [0.1, 0.1],
                "tip_angle": [0.1],
                "object_position": [0.035, 0.2],
                "object_angle": [0.1],
                "contact_force": [1.0],
                "input": [2.0, 2.0],
            },
        },
    ),
    "touching": (
        "wrap_post",
        {
            "estimator.disturbances": {"object_position": 0.004, "contact_friction": 0.5},
            "estimator.spread.object_position": 0.003,
        },
    ),
    "motor, torques": (
        "motor_servo",
        {
            "finger.tendons.drive.position_gain": None,
            "finger.tendons.drive.rate_gain": 0.0,
            "controller.input.torques": [-0.2, 0.2],
            "loads": [],
            "controller.input.angles": None,
            "estimator.measured.torque": 0.001,
        },
    ),
}
_TRACKED = {"tip": [0.0, 0.15]}
_MOTOR = {
    "kind": "motor",
    "pretension": 2.0,
    "winch_radius": 0.008,
    "inertia": 4e-5,
    "viscous_friction": 2e-4,
    "torque_max": 0.4,
}
_PLANS: dict[str, tuple[str, dict[str, Any]]] = {
    "tracking": (
        "past_a_post",
        {
            "objective": "tracking",
            "cost": {"tip": {"running": 1e4}, "effort": 1e-3},
            "reference": _TRACKED,
            "bounds.keep_out": {
                "floor": {"type": "half_plane", "point": [0.0, -0.1], "normal_angle": 1.57, "penalty": {}},
                "post": {"type": "disc", "center": [-0.05, 0.175], "radius": 0.008},
            },
            "goal": {"shape": {"at": [0.09], "value": [[0.0, 0.08]], "weight": 1e4, "tolerance": 0.01}},
        },
    ),
    "shooting": (
        "past_a_post",
        {
            "loads": [{"kind": "force", "at": 0.18, "force": [0.0, 0.01]}],
            "goal": {"end": "moving", "bending": {"value": [0.1, 0.1], "weight": 10.0}, "input": [3.0, 2.0]},
            "bounds.speed": 20.0,
            "method": "single_shooting",
            "solver": {"substeps": 40, "starts": 2},
        },
    ),
    "soft bounds": (
        "past_a_post",
        {
            "parameters": ["bending_stiffness"],
            "bounds": {"curvature": 20.0, "speed": 20.0, "penalty": {"linear": 2.0, "quadratic": 20.0}},
            "solver": {"method": "sqp", "hessian": "gauss_newton"},
        },
    ),
    "chambers": ("tip_to_point", {**_CHAMBERS, "fidelity.family": "clothoid", "input.rate_max": 1e6}),
    "tip moment": ("tip_to_point", {"finger.tendons": None, "input": {"moment_max": 0.2, "time_constant": 0.02}}),
    **{
        f"motor, {key}": (
            "release",
            {
                "finger.tendons.drive": {**_MOTOR, **own},
                "input": {key: [-0.2, 0.2], "form": "linear"},
                "goal": {"tip": {"value": [-0.0362, 0.1749], "weight": 1e6}},
            },
        )
        for key, own in (
            ("angles", {"position_gain": 2.0, "rate_gain": 0.02}),
            ("torques", {}),
        )
    },
}
_WEIGHED = {"kind": "static", "file": "own_finger_weights.csv"}
_SHOWN = {"quantity": "bend", "column": "weight_g", "unit": "rad", "since": 0.01, "at": 0.1, "minus": "weight_g"}
_RANG = {"quantity": "frequency", "column": "weight_g", "zero": -1.0, "of": 2}
_MILLI = {"name": "load_1_y", "column": "weight_g", "unit": "mN"}
_RUNG = {"kind": "ring_down", "file": "own_finger_ring_down.csv", "window": [0.2, 2.0], "mode": 2}
_SET = {"name": "one", "where": [{"column": "weight_g", "equals": ["0", "5", "10"]}], "set": ["gravity=[0.0, -9.8]"]}
_FITS: dict[str, tuple[str, dict[str, Any]]] = {
    "static": (
        "own_finger",
        {
            "estimate": [{"name": "bending_stiffness", "start": 6e-3, "sigma": 1e-3}],
            "data": [{**_WEIGHED, **_SET, "measured": [{**_SHOWN, "scale": 1e-3, "zero": 0.1, "sigma": 1e-3}]}],
        },
    ),
    "per set": (
        "own_finger",
        {
            "estimate": [{"name": "clamp_angle", "per": "set", "min": -0.5, "max": 0.5}],
            "data": [{**_WEIGHED, **_SET, "sequence": True, "holdout_rows": [1], "measured": [_SHOWN]}],
        },
    ),
    "laws": (
        "own_finger",
        {
            "laws": [
                {"name": "plain", "set": ["gravity=[0.0, -9.8]"]},
                {"name": "turned", "estimate": [{"name": "base_x", "start": 0.01}]},
            ]
        },
    ),
    "other laws": ("own_finger", {"laws": [{"name": "first"}, {"name": "second"}]}),
    "rung": (
        "own_finger",
        {"data": [{**_RUNG, "t": {"column": "t [s]", "scale": 2.0}, "signals": ["y [px]", "y [px]"]}]},
    ),
    "frequencies": ("own_finger", {"data": [{**_WEIGHED, "measured": [_RANG], "conditions": [_MILLI]}]}),
    "started": (
        "winch_finger",
        {
            "data[0].start": "estimated",
            "data[0].t": {"column": "t", "scale": 2.0},
            "data[0].measured": [{"quantity": "x", "column": "tip_y", "unit": "mm", "at": 0.17}],
            "data[0].start_prior": {"bend": 0.1, "rate": 1.0},
            "data[0].window": [0.1, 1.0],
        },
    ),
}
_DRAWN = {
    "contacts.friction": {"choice": [0.4, 0.5]},
    "object.mass": {"uniform": [0.2, 0.3]},
    "object.diameter": {"log_uniform": [0.07, 0.08]},
    "finger.tendons.offset": {"normal": [0.005, 1e-4]},
}
_FOLLOWS = {
    "object.position[0]": {"key": "object.diameter", "times": 0.5, "plus": 1e-3},
    "finger.rod.linear_density": {"key": "object.mass", "times": 0.2},
}
CHANGES: dict[type[BaseModel], dict[str, tuple[str, dict[str, Any]]]] = {
    Scene: _CHANGES,
    ControlScene: _LOOPS,
    PlanScene: _PLANS,
    MissionScene: {
        "more contacts": ("mug", {"more_contacts": [0.05], "estimator.delay": 0.0}),
        "slip": ("mug", {"slip": {"height": 1e-4}, "trials": {"count": 2, "friction_fall": 0.3}}),
    },
    IdentifyScene: _FITS,
    Sweep: {
        "drawn": (
            "mug_uncertain",
            {
                "scene": "../grasp/mug_arcs.yaml",
                "set": {"solver.effort": "normal"},
                "sample": {"count": 5, "seed": 1, "keys": _DRAWN},
                "follow": _FOLLOWS,
                "record": ["quality.epsilon_l1"],
                "pareto": [{"x": "object.mass", "y": "tension_max"}],
            },
        ),
    },
    Design: {
        "limited": (
            "tolerances",
            {
                "scene": "../grasp/mug.yaml",
                "set": {"solver.effort": "quick"},
                "cases": {"light": {"object.mass": 0.2}},
                "follow": {
                    "object.diameter": {"key": "finger.tendons.offset", "times": 16.0, "plus": 1e-3},
                    "finger.rod.linear_density": {"key": "finger.rod.bending_stiffness", "times": 5.0},
                },
                "limits": {"tension": {"min": 1.0, "max": 50.0}},
                "variables": {
                    "finger.tendons.offset": {"min": 0.003, "max": 0.006, "start": 0.004, "name": "e"},
                    "finger.rod.bending_stiffness": {"min": 0.004, "max": 0.009, "spacing": "log"},
                },
                "tolerances": {"contacts.friction": {"share": 0.05}, "object.mass": {"amount": 0.01}},
            },
        ),
    },
}
"""Scenes beside the shipped ones, by kind: name of one of these, and changes."""
NOT_ALONE = {
    "schema_version": "there is one",
    "contact_law.law": "an add-on announces it: see tests/addons",
    "contact_law.law_numbers": "they are of contact_law.law",
    "object.free": "scenes of simulation refuse it",
    "fidelity.tolerance": "it excludes other keys",
    "initial.motor_angles": "it needs an equilibrium",
    "initial.friction_states": "initial.reached_by must be state",
    "finger.tendons.drive.arrangement": "it changes the number of inputs",
    "data.axes": "its two entries belong together",
    "data.file": "another file has other columns",
    "data.pose": "every row of the shipped tables is a pose",
    "data.where.column": "another column has other texts",
    "mounting.drives.of": "each drive has a tendon of its own",
}
"""Keys of which no other value is tried, and why."""
_MOST_PLACES = 12
"""Places of a key that are tried, those with a value first, each once before any again."""
_NUMBERS: tuple[float, ...] = (1e-6, 1e-4, 1e-3, 0.01, 0.1, 1.0, 10.0, 1e3, 1e5)
"""Values of what is none, or zero."""


_SCENES = (Scene, ControlScene, GraspScene)
_BEFORE = {ControlScene: (Scene,), IdentifyScene: (Scene,), **dict.fromkeys((PlanScene, MissionScene), _SCENES)}
"""Kinds of scenes of which the classes are left out."""


@dataclass(frozen=True)
class Place:
    """A key in one scene."""

    base: str
    path: KeyPath
    key: str  # without indices and names of entries
    field: FieldInfo
    value: Any

    def changed(self, scene: Any, value: Any) -> Any:
        """The scene with another value; entries with dots in their names are replaced with all beside them."""
        if not any("." in str(part) for part in self.path):
            words = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in self.path)
            return scene.changed({"".join(words).removeprefix("."): value})
        first, *inner, last = self.path
        whole = scene.model_dump(exclude_unset=True, by_alias=True)[first]
        within = whole
        for part in inner:
            within = within[part]
        within[last] = value
        return scene.changed({str(first): whole})


@cache
def bases(root: type[BaseModel]) -> dict[str, Any]:
    """Scenes of a kind by name."""
    folder = CONFIGS / _FOLDERS[root]
    shipped = {name: cg.load(folder / f"{name}.yaml").changed(own) for name, own in _SHIPPED[root].items()}
    return {name: shipped[base].changed(own) for name, (base, own) in CHANGES[root].items()} | shipped


@cache
def classes(root: type[BaseModel]) -> set[type[BaseModel]]:
    """Classes of all values that a scene can have."""
    found: set[type[BaseModel]] = set()

    def walk(one: Any) -> None:
        if isinstance(one, type) and issubclass(one, BaseModel) and one not in found:
            found.add(one)
            for field in one.model_fields.values():
                walk(field.annotation)
        for part in typing.get_args(one):
            walk(part)

    walk(root)
    return found


def owner(kind: type[BaseModel], name: str) -> type[BaseModel]:
    """The class that declares a field."""
    return [one for one in kind.__mro__ if name in inspect.get_annotations(one)][-1]


@cache
def keys(root: type[BaseModel]) -> dict[str, set[str]]:
    """Fields by declaring class, without words that choose the class; of loops those that no simulated scene has."""
    found: dict[str, set[str]] = defaultdict(set)
    for kind in classes(root) - {one for of in _BEFORE.get(root, ()) for one in classes(of)}:
        for name, field in kind.model_fields.items():
            inherited = any(issubclass(root, of) and name in of.model_fields for of in _BEFORE.get(root, ()))
            if not is_tag(field) and not (kind is root and inherited):
                found[owner(kind, name).__name__].add(name)
    return found


@cache
def places(root: type[BaseModel]) -> dict[str, dict[str, list[Place]]]:
    """By declaring class and field, where it is in the scenes; without words that choose the class."""
    found: dict[str, dict[str, list[Place]]] = defaultdict(lambda: defaultdict(list))

    def walk(base: str, value: Any, path: KeyPath, key: str) -> None:
        if isinstance(value, BaseModel):
            for name, field in type(value).model_fields.items():
                one = getattr(value, name)
                inner = (*path, field.alias or name), f"{key}.{name}".removeprefix(".")
                if not is_tag(field):
                    found[owner(type(value), name).__name__][name].append(Place(base, *inner, field, one))
                walk(base, one, *inner)
        elif isinstance(value, tuple):
            for k, one in enumerate(value):
                walk(base, one, (*path, k), key)
        elif isinstance(value, dict):
            for name, one in value.items():
                walk(base, one, (*path, name), key)

    for base, scene in bases(root).items():
        walk(base, scene, (), "")
    for fields in found.values():
        for name, own in fields.items():
            values = [one.value for one in own]
            ranks = [(value in (None, (), {}), value in values[:k], k) for k, value in enumerate(values)]
            fields[name] = [own[k] for *_, k in sorted(ranks)][:_MOST_PLACES]
    return found


def keys_below(schema: dict[str, Any], path: Iterable[str]) -> set[str]:
    """Keys that a configuration may have below a key, by its JSON Schema; names of the path may be patterns."""
    nodes, found = [schema], {}
    for name in (*path, "*"):
        found = defaultdict(list)
        while nodes:
            node = nodes.pop()
            if "$ref" in node:
                nodes.append(schema["$defs"][node["$ref"].rpartition("/")[2]])
            nodes += [one for word in ("anyOf", "oneOf", "allOf") for one in node.get(word, ())]
            nodes += [node[word] for word in ("items", "additionalProperties") if isinstance(node.get(word), dict)]
            for key in fnmatch.filter(node.get("properties", {}), name):
                found[key].append(node["properties"][key])
        nodes = [one for own in found.values() for one in own]
    return set(found)


def is_tag(field: FieldInfo) -> bool:
    """Whether a field has one word alone, which chooses the class."""
    return typing.get_origin(field.annotation) is Literal and len(options(field.annotation)) == 1


def options(annotation: Any) -> list[Any]:
    """The words of an annotation."""
    if typing.get_origin(annotation) is Literal:
        return list(typing.get_args(annotation))
    return [word for part in typing.get_args(annotation) for word in options(part)]


def others(place: Place, like: list[Place]) -> Iterator[Any]:
    """Other values that a key may have."""
    value = place.value
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield from (value + 1, value - 1)
    elif isinstance(value, float):
        yield from (1.01 * value + 1e-4, 0.99 * value, value + 1.0)
    elif isinstance(value, tuple) and value and all(isinstance(one, float | tuple) for one in value):
        yield [larger(one) for one in value]
        yield from ([*value[:k], larger(value[k]), *value[k + 1 :]] for k in range(len(value)))
    elif value is None:
        yield from (place.field.examples or ())
    if isinstance(value, tuple):
        yield value[:-1]
    yield from (word for word in options(place.field.annotation) if word != value)
    yield from (one.value for one in like if one.value not in (value, None, ()))
    if value is None or value == 0.0:
        yield from (*_NUMBERS, "word")


def larger(value: Any) -> Any:
    """A number, or numbers, a little larger."""
    return [larger(one) for one in value] if isinstance(value, tuple) else 1.01 * value + 1e-4


def is_part(field: FieldInfo) -> bool:
    """Whether a field has values of classes alone, whose own keys are tried."""

    def kinds(one: Any) -> Iterator[bool]:
        parts = [part for part in typing.get_args(one) if part not in (type(None), Ellipsis)]
        if isinstance(one, type) or not parts:
            yield isinstance(one, type) and issubclass(one, BaseModel)
        elif typing.get_origin(one) is Annotated:
            yield from kinds(parts[0])
        else:
            for part in parts[1:] if typing.get_origin(one) is dict else parts:
                yield from kinds(part)

    return all(kinds(field.annotation))
