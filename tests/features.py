"""Features of scenes and the verbs that take them; from inside: problems are posed, and not solved.

Features of scenes and the verbs that take them or do not: small scenes with one feature each, and what declarations
refuse of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import continuum_grasp as cg
from continuum_grasp.addons.identification import IdentifyScene, Poses, Reading
from continuum_grasp.addons.identification.path_block import block_of
from continuum_grasp.addons.identification.unknowns import read_unknowns
from continuum_grasp.addons.mission import MissionScene
from continuum_grasp.addons.planning import PlanScene
from continuum_grasp.addons.planning.search import PlanSearch
from continuum_grasp.base import InputError
from continuum_grasp.grasp.finger_map import places_of
from continuum_grasp.grasp.rods.contact_sets import contact_sets
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.search import Case, RodSearch
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import Consumer, ControlScene, GraspScene, Scene, Value
from continuum_grasp.simulation import resolve_fidelity
from tests import scene_products as products

CONFIGS = Path(__file__).parents[1] / "configs"
_TENDONS = {"offset": 0.005, "max_tension": 60.0, "time_constant": 0.02}
_FINGER = {
    "rod": {"length": 0.18, "linear_density": 0.034, "bending_stiffness": 6.11e-3},
    "damping": {"material": 3e-5},
    "half_thickness": 0.006,
    "tendons": _TENDONS,
}
_CHAMBER = {"area": 6e-5, "offset": 0.005, "max_pressure": 8e4, "time_constant": 0.02}
_DRIVEN = {"offset": 0.005, "max_tension": 60.0, "axial_stiffness": 1e4, "series_stiffness": 3e4}
_MOTOR = {
    "kind": "motor",
    "winch_radius": 0.008,
    "inertia": 2e-6,
    "viscous_friction": 2e-4,
    "torque_max": 0.25,
    "position_gain": 2.0,
    "rate_gain": 0.01,
    "pretension": 6.0,
}
_GEAR = {**_MOTOR, "pretension": 0.0, "arrangement": "one_pulley", "backlash": 0.01, "gear_stiffness": 20.0}
_OBJECT = {"shape": "circle", "diameter": 0.04, "mass": 0.3, "position": [0.1, 0.1]}
_LAW = {"stiffness": 2e3, "friction": 0.5, "slip_speed": 0.01}
_FIXED = {"object": _OBJECT, "contact_law": _LAW}
_MOVING = {**_FIXED, "object_moves": True}
_SAMPLES = {"at": [0.0, 0.18], "bending_stiffness": [8e-3, 5e-3], "linear_density": [0.04, 0.03]}
_STEP = {"bending_stiffness": 8e-3, "linear_density": 0.04, "to": 0.09}
_FORCE = {"kind": "force", "at": 0.18, "force": [0.01, 0.0]}


@dataclass(frozen=True)
class Feature:
    """Something that a scene may have: its name, and changes of a plain scene by which it has that."""

    name: str
    changes: Mapping[str, Any]


def _driven(drive: Mapping[str, Any]) -> dict[str, Any]:
    return {"finger.tendons": {**_DRIVEN, "drive": drive}}


FEATURES = (
    Feature("tendon friction", {"finger.tendons.friction": 0.1}),
    Feature(
        "friction in a conduit",
        {"finger.tendons.friction": 0.1, "finger.tendons.conduit_bend": 1.0},
    ),
    Feature("winches", _driven({"kind": "length", "time_constant": 0.02})),
    Feature(
        "slack cables",
        _driven({"kind": "length", "time_constant": 0.02, "slack": 1e-3}),
    ),
    Feature("motors", _driven(_MOTOR)),
    Feature("a gear with play", _driven(_GEAR)),
    Feature(
        "tendons at several places",
        {"finger.tendons": [{**_TENDONS, "offset": 0.005, "to": 0.09}, _TENDONS, {**_TENDONS, "offset": -0.005}]},
    ),
    Feature("no tendons", {"finger.tendons": None}),
    Feature(
        "pressure chambers", {"finger.tendons": None, "finger.pressure": [_CHAMBER, {**_CHAMBER, "offset": -0.005}]}
    ),
    Feature("a muscle beside tendons", {"finger.pressure": {**_CHAMBER, "contracts": True, "to": 0.09}}),
    Feature("dry friction in bending", {"finger.damping.dry_friction": [{"stiffness": 0.01, "moment": 0.01}]}),
    Feature("relaxation", {"finger.damping.relaxation": [{"share": 0.2, "time": 3.0}]}),
    Feature("quadratic damping", {"finger.damping.quadratic": 1e-5}),
    Feature("damping per arc", {"finger.damping.per_arc": 1e-4}),
    Feature("stops", {"finger.stops": {"curvature": 30.0, "stiffness_ratio": 30.0}}),
    Feature("softening", {"finger.softening": {"curvature": 5.0, "stiffness_ratio": 0.5}}),
    Feature("tendons that shorten the rod", {"finger.tendons.time_constant": None, "finger.gyration_radius": 1.5e-3}),
    Feature("a tapered rod", {"finger.rod": {"length": 0.18, "samples": _SAMPLES}}),
    Feature(
        "a stepped rod",
        {"finger.rod": {"length": 0.18, "sections": [_STEP, {**_STEP, "bending_stiffness": 5e-3, "to": 0.18}]}},
    ),
    Feature("curvature at rest", {"finger.rest_curvature": 2.0}),
    Feature("point masses", {"finger.masses": [{"at": 0.1, "mass": 0.01}]}),
    Feature("a body at the tip", {"finger.tip_body": {"mass": 0.01, "rotary_inertia": 1e-6}}),
    Feature("a body aside of the tip", {"finger.tip_body": {"mass": 0.01, "center_of_mass": [0.005, 0.0]}}),
    Feature("loads", {"loads": [_FORCE]}),
    Feature("following loads", {"loads": [{**_FORCE, "follows": True}]}),
    Feature(
        "loads over time", {"loads": [{**_FORCE, "force": {"times": [0.0, 1.0], "values": [[0.0, 0.0], [0.01, 0.0]]}}]}
    ),
    Feature("couples", {"loads": [{"kind": "moment", "at": 0.09, "moment": 0.01}]}),
    Feature("a fixed object", _FIXED),
    Feature("an object that moves", _MOVING),
    Feature(
        "a table under the object",
        {**_MOVING, "table": {"friction": 0.3}, "out_of_plane_gravity": 9.81},
    ),
    Feature(
        "a table in the plane",
        {**_MOVING, "table": {"friction": 0.3, "point": [0.0, -0.5], "normal_angle": 1.57}},
    ),
    Feature(
        "supports",
        {**_MOVING, "supports": {"peg": {"type": "point", "position": [0.3, -0.3], "radius": 0.01}}},
    ),
    Feature(
        "sticking friction of contacts",
        {**_FIXED, "contact_law": {"stiffness": 2e3, "friction": 0.5, "presliding": 1e-4}},
    ),
    Feature("known contacts", {"contacts": [0.09]}),
    Feature("run-time parameters", {"parameters": ["bending_stiffness"]}),
    Feature(
        "motors that stand",
        {**_driven(_MOTOR), "initial.pose": "equilibrium", "initial.motor_angles": [0.1, 0.0]},
    ),
    Feature("a tolerance for a model", {"fidelity.tolerance": 0.02}),
)
"""All that are tried; one more is one line."""


def _commands(changes: Mapping[str, Any]) -> str:
    """What the finger of a scene takes."""
    tendons = changes.get("finger.tendons", _TENDONS)
    drive = tendons.get("drive") if isinstance(tendons, dict) else None
    kinds = {"length": "lengths", "motor": "angles"}
    if tendons is None:
        return "pressures" if "finger.pressure" in changes else "tip_moment"
    return kinds[drive["kind"]] if drive else "tensions"


def _limits(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Limits of the input."""
    key = _commands(changes)
    moment = {"moment_max": 0.1, "time_constant": 0.02}
    return moment if key == "tip_moment" else {} if key in ("tensions", "pressures") else {key: [-0.01, 0.01]}


@cache
def _plain(kind: type[Value]) -> Value:
    """A scene without any of the features."""
    own: dict[str, Any] = {"finger": _FINGER, "gravity": [0.0, 0.0]}
    if kind is Scene:
        return Scene.model_validate(
            {**own, "initial": {"pose": "straight"}, "time": {"duration": 0.004, "step": 0.002}}
        )
    coarse = {"family": "clothoid", "elements": 2}
    if kind is ControlScene:
        loop = {"fidelity": coarse, "plant": {"fidelity": coarse}, "estimator": None, "duration": 0.1}
        return cg.load(CONFIGS / "mpc" / "steady_tip.yaml").changed({**own, **loop, "controller.input": {}})
    if kind is PlanScene:
        plan = {
            "fidelity": coarse,
            "intervals": 4,
            "check": {},
            "input": {},
            "objective": "least_effort",
            "duration": 0.3,
        }
        return cg.load(CONFIGS / "plan" / "tip_to_point.yaml").changed({**own, **plan})
    placed = {**_FINGER, "base": {"position": [0.0, -0.055], "angle": -1.57}}
    if kind is GraspScene:
        return cg.load(CONFIGS / "grasp" / "mug.yaml").changed({"finger": placed, "fidelity": {"elements": 4}})
    found = cg.load(CONFIGS / "mission" / "mug.yaml")
    return found.changed({"grasp.finger": placed, "grasp.fidelity": {"elements": 4}, "grasp.robust": None})


_LIMITS = {ControlScene: "controller.input", PlanScene: "input", MissionScene: "controller.input"}


def scene_of(kind: type[Value], feature: Feature, more: Mapping[str, Any]) -> Value | None:
    """A scene of a kind with a feature, and further changes; None where such scenes do not have the key.

    Raises
    ------
    InputError
        If such a scene refuses the feature.
    """
    changes = dict(feature.changes)
    if kind is not Scene and any(load["kind"] == "moment" for load in changes.get("loads", ())):
        return None
    if kind in (GraspScene, MissionScene):
        if changes.get("finger.tendons", ()) is None or any(
            not key.startswith(("finger", "fidelity")) for key in changes
        ):
            return None
        if kind is MissionScene:
            changes = {f"grasp.{key}": value for key, value in changes.items()}
    if "finger.tendons" in feature.changes and kind in _LIMITS:
        changes |= {f"{_LIMITS[kind]}.{key}": value for key, value in _limits(feature.changes).items()}
    if "initial.motor_angles" in changes and kind is Scene:
        changes["actuation"] = {"angles": [0.0, 0.0]}
    return _plain(kind).changed({**changes, **more})


def _problem(scene: GraspScene) -> Iterator[object]:
    """The problem of a grasp with all contacts."""
    on, *_ = contact_sets(scene)
    case = Case(RodSearch(scene, Budget.of(scene.solver)), on, places_of(scene, on)[0])
    lengths = (setup.finger.rod.length for setup in scene.setups)
    pairs = zip(scene.setups, lengths, strict=True)
    yield GraspRods(case.numbers, joints=[tuple(at / length for at in s.middle_places) for s, length in pairs]).nlp.f


def _fit(scene: Scene) -> Iterator[object]:
    """What identification predicts of poses."""
    whole = IdentifyScene(**{**dict(scene), "estimate": [{"name": "bending_stiffness"}]})
    given = {one.name: np.full(2, 1e-3) for one in scene.finger.inputs}
    poses = Poses([Reading("bend", [0.3, 0.6])], given)
    yield block_of(whole, poses, read_unknowns(whole, whole.estimate)).predict(np.ones(1))


def _at_rest(scene: Scene) -> Iterator[object]:
    """Equilibrium and modes, of a finger with friction as it is pulled."""
    friction = {"reached_by": "pulling"} if scene.finger.has_friction else {}
    yield cg.modes(scene.replaced(initial=scene.initial.replaced(**friction))).equilibrium.q


def _compared(scene: Scene) -> Iterator[object]:
    """What accuracy measures, of the scene as it is."""
    Consumer.DECLARED["accuracy by the exact rod"].check(scene)
    yield from products.measured_choices(scene)


def _motion(scene: Scene) -> Iterator[object]:
    yield cg.simulate(scene).x


def _sought(scene: PlanScene) -> Iterator[object]:
    """What a plan begins from; of one with an object by collocation, since few intervals refuse its sub-steps."""
    yield PlanSearch(scene if scene.object is None else scene.changed({"method": "collocation"})).x0


def _resolved(make: Callable[[Any], Iterator[object]]) -> Callable[[Any], Iterator[object]]:
    """The same of the model that is chosen where a tolerance is given."""
    return lambda scene: make(resolve_fidelity(scene)[0])


@dataclass(frozen=True)
class Verb:
    """What takes scenes: its name, their kind, declarations beside those of the kind, and what it makes of them."""

    name: str
    kind: type[Value]
    consumers: tuple[str, ...]
    make: Callable[[Any], Iterator[object]]
    more: Mapping[str, Any]


def _verb(name: str, kind: type[Value], make: Callable[[Any], Iterator[object]], *consumers: str, **more: Any) -> Verb:
    return Verb(name, kind, consumers, _resolved(make) if kind is Scene else make, more)


VERBS = (
    _verb("simulate", Scene, _motion),
    _verb("equilibrium, modes", Scene, _at_rest, "statics, modes"),
    _verb("accuracy", Scene, _compared, "accuracy by the exact rod", "accuracy of motors"),
    _verb("identify", Scene, _fit, "identify"),
    _verb("export to c", Scene, products.package),
    _verb("export to fmu", Scene, products.unit),
    _verb("export to web", Scene, products.page),
    _verb("export to mjcf", Scene, products.chain_of_hinges, "export to mjcf"),
    _verb("operators", Scene, products.model),
    _verb("mpc, export to c of it", ControlScene, products.run),
    Verb(
        "mpc on guides",
        ControlScene,
        ("plant.guides", "plant.guides under a body aside"),
        products.moved,
        {"plant": {"guides": 12, "axial_stiffness": 1e4}},
    ),
    _verb("environments", ControlScene, products.lanes, "environments"),
    _verb("plan", PlanScene, _sought),
    _verb("grasp, sweep, design", GraspScene, _problem),
    _verb("mission", MissionScene, products.carried_out),
)
"""All that are tried; one more is one line."""


def declared(feature: Feature, verb: Verb) -> str | None:
    """Why declarations refuse a feature; empty where they do not, None where such scenes do not have the key.

    Raises
    ------
    AssertionError
        If a scene is refused for another reason.
    """
    reasons = {why for one in Consumer.DECLARED.values() for why in one.refused.values()}
    try:
        scene = scene_of(verb.kind, feature, verb.more)
        for name in () if scene is None else verb.consumers:
            Consumer.DECLARED[name].check(scene)
    except InputError as error:
        if not (found := [why for why in reasons if why in error.message]):
            raise AssertionError(f"{feature.name}, {verb.name}: refused, and not declared: {error}") from None
        return max(found, key=len)
    return None if scene is None else ""
