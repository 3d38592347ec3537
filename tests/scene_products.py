"""What each consumer makes of a scene; from inside: the problems, before anything is compiled or solved.

What each consumer makes of a scene, by the shortest way: all its numbers and functions, none of them compiled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import casadi as ca
import numpy as np
from pydantic import BaseModel

from continuum_grasp.addons.chains import export_mjcf
from continuum_grasp.addons.chains.guides.system import ChainSystem
from continuum_grasp.addons.design import Design
from continuum_grasp.addons.design.space import design_space_of
from continuum_grasp.addons.fmu import plant as plants
from continuum_grasp.addons.fmu.variable import Variable
from continuum_grasp.addons.identification import IdentifyScene, Poses, Reading, TipPath, read_data
from continuum_grasp.addons.identification.blocks import PosesBlock
from continuum_grasp.addons.identification.fitting import under_laws
from continuum_grasp.addons.identification.path_block import PathBlock
from continuum_grasp.addons.identification.read import choices_of, plain_scene
from continuum_grasp.addons.identification.scene import Excitation, StaticPoses
from continuum_grasp.addons.identification.segments import CommandDesign as Excited
from continuum_grasp.addons.identification.segments import patterns_of
from continuum_grasp.addons.identification.unknowns import read_unknowns
from continuum_grasp.addons.learning.environments import sensing
from continuum_grasp.addons.learning.environments.plants import plants_of
from continuum_grasp.addons.learning.environments.sensing import observed_of, state_bounds
from continuum_grasp.addons.mission import MissionScene
from continuum_grasp.addons.mission import plant as mission_plant
from continuum_grasp.addons.mission.from_grasp import _Task
from continuum_grasp.addons.planning import PlanScene
from continuum_grasp.addons.planning.search import PlanSearch
from continuum_grasp.addons.sweeps import Sweep, SweepPlan
from continuum_grasp.addons.web.plant import plant_of_loop, plant_of_scene
from continuum_grasp.closed_loop import PlantModel, Sensors
from continuum_grasp.control import Prediction, Setpoints, stages_of
from continuum_grasp.core import CReal
from continuum_grasp.export import ModelFields, PackageOptions, title_of
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.package import subject_of
from continuum_grasp.export.source import source_of
from continuum_grasp.export.subject import Subject
from continuum_grasp.model import FingerModel, System
from continuum_grasp.rod.dimensionless import read_problem
from continuum_grasp.scene import (
    Actuation,
    ConfigurationData,
    ControlScene,
    Fidelity,
    Samples,
    Scene,
    Surroundings,
)
from continuum_grasp.simulation import Signals, initial_state, modes, resolve_fidelity
from continuum_grasp.simulation.accuracy.motion import timing_of_comparison
from continuum_grasp.simulation.accuracy.truth import load_cases
from tests.mission_cases import straight_grasp

CONFIGS = Path(__file__).parents[1] / "configs"
_AROUND = tuple(Surroundings.model_fields)
_INSTANTS = np.linspace(0.0, 2.0, 9)
"""At which setpoints are compared [s]."""


def parts(made: Any) -> Iterator[object]:
    """Numbers, texts and functions of what was made, so that they compare."""
    if isinstance(made, np.ndarray):
        yield made.shape
        yield made.tobytes() if made.dtype != object else repr(made.tolist())
    elif isinstance(made, ca.Function):
        yield made.serialize()
    elif isinstance(made, ca.SX | ca.MX):
        yield ca.Function("value", ca.symvar(made), [made]).serialize()
    elif isinstance(made, Variable):
        yield repr(made)
    elif isinstance(made, Setpoints):
        yield from parts(made.rows(_INSTANTS))
    elif isinstance(made, FingerModel | System):
        yield from parts((made.forward_dynamics, made.p_nominal, made.x_names, made.u_names, made.w_names))
    elif is_dataclass(made) and not isinstance(made, type):
        yield from parts([getattr(made, one.name) for one in fields(made)])
    elif isinstance(made, Mapping):
        yield from parts([*made.items()])
    elif isinstance(made, tuple | list | set | frozenset | Iterator):
        for one in sorted(made) if isinstance(made, set | frozenset) else made:
            yield from parts(one)
    elif made is None or isinstance(made, str | int | float | complex | bool | bytes | np.generic):
        yield repr(made)
    elif isinstance(made, BaseModel):
        yield made.model_dump_json()
    elif not callable(made):
        yield from parts([value for name, value in sorted(vars(made).items()) if not name.startswith("_")])


def chain_of_hinges(scene: Scene) -> Iterator[object]:
    """What export to mjcf makes."""
    made = export_mjcf(scene, hinges=3)
    yield made.text
    yield made.controls([0.0, 0.25, 0.85]).tolist()


def chain_of_guides(scene: Scene) -> Iterator[object]:
    """What a plant with guides makes of a finger and its surroundings."""
    chain = ChainSystem(scene, 3, 1e4)
    yield chain.numbers(np.array(chain.p_nominal)).tolist()
    start = chain.start(np.zeros(chain.finger_model.nx), np.zeros(chain.nu))
    yield from (repr(chain.tendons), repr(chain.winches), start.tolist())
    yield from (one.serialize() for one in (chain.drums, chain.around, chain.tensions, chain.touch))


def equilibrium_and_modes(scene: Scene) -> Iterator[object]:
    """What statics and modes find, without an object, at the last inputs, pulled where the finger has friction."""
    alone: dict[str, Any] = {name: getattr(Surroundings(), name) for name in _AROUND}
    initial = scene.initial
    if scene.finger.has_friction and initial.reached_by is None:
        initial = initial.replaced(reached_by="pulling")
    actuation = scene.actuation
    if actuation is not None:
        values = [one.values[-1] if isinstance(one, Samples) else one for one in actuation.values]
        actuation = Actuation.of(scene.finger.input_keys, values)
    found = modes(scene.replaced(**alone, initial=initial, actuation=actuation), points=5)
    yield from (found.equilibrium.q, found.equilibrium.u, found.equilibrium.w, found.backbone)
    yield from (found.frequencies_hz, found.damping_ratios, found.stuck_frequencies_hz, found.free_frequencies_hz)


def package(scene: Scene) -> Iterator[object]:
    """What export to c makes of a finger."""
    source = source_of(scene, CReal.KINDS["double"])
    yield source.title, source.finger, source.step, source.finger.range_use
    subject = Subject.of(source.finger, "finger", CReal.KINDS["double"], {}, source.surroundings)
    yield subject.parameters, subject.state, subject.input, subject.forces
    if subject.touching is not None:
        yield from (subject.touching.forward_dynamics, subject.touching.touch, subject.start)


def page(scene: Scene) -> Iterator[object]:
    """What a web page computes by."""
    plant = plant_of_scene(scene)
    yield from (plant.rate, plant.acting, plant.sensed, plant.start, plant.rest, plant.p, plant.x_names)
    yield from (plant.signals.u(at) for at in _INSTANTS)
    yield from (plant.signals.w(at) for at in _INSTANTS)
    yield ModelFields(plant.system.finger_model).inputs()


def lanes(scene: ControlScene) -> Iterator[object]:
    """What environments make of a closed loop."""
    with patch.object(sensing, "ControlPeriods", lambda *given: given):
        plants = plants_of((scene,))
        sensed = sensing.sensing_of(plants, None)
    yield from (plants.p, plants.start, plants.forces, plants.setpoints, plants.periods, plants.period)
    yield from (sensed, scene.input_limits, scene.controller.input.rate_max)
    observed = observed_of(plants, sensed, state_bounds(plants, 1.0))
    yield from (observed.names, observed.bounds, observed.setpoints)


def loop(scene: ControlScene) -> Iterator[object]:
    """What export to c makes of a closed loop."""
    yield from (title_of(scene), Loop.of(scene, CReal.KINDS["double"], ["mpc"]))


def moved(scene: ControlScene) -> Iterator[object]:
    """The plant of a closed loop, what its sensors show at rest, and what else a run of it has."""
    model = PlantModel(scene)
    sensors = Sensors(scene, model, Prediction(scene), None)
    if isinstance(model.system, ChainSystem):
        yield from (repr(model.system.tendons), model.system.p_nominal)
    else:
        yield model.forward_dynamics
    yield from (model.p, model.start, model.rest_input, model.forces(_INSTANTS))
    yield from (sensors.names, sensors.delay, sensors.std, sensors.value)
    yield from (scene.mounting, scene.plant.mounting, scene.log)
    yield sensors.read(model.start, model.rest_input, model.forces(0.0)[0])
    yield from (scene.duration, scene.controller.deadline, scene.controller.step)


def run(scene: ControlScene) -> Iterator[object]:
    """What mpc runs."""
    yield from loop(scene)
    yield from moved(scene)


def units_of_loop(scene: ControlScene) -> Iterator[object]:
    """What functional mock-up units of a closed loop have: the controller by its first setpoints, and the plant."""
    first = Loop.of(scene, CReal.KINDS["double"], ["mpc"])
    yield from (title_of(scene), replace(first, setpoints=first.setpoints.rows(_INSTANTS[:1]), duration=0.0))
    with patch.object(plants, "UnitContents", _given):
        yield {key: made for key, made in plants.loop_plant_unit(scene, "unit").items() if key != "manifest"}


def unit(scene: Scene) -> Iterator[object]:
    """What a functional mock-up unit of a finger has."""
    scene = resolve_fidelity(scene)[0]
    with (
        patch.object(plants, "Library", _Library),
        patch.object(plants, "UnitContents", _given),
        patch.object(plants, "variables_of", _variables),
    ):
        made = plants.finger_unit(scene, "unit", step=None, substeps=None, ranges=None)
    yield {key: value for key, value in made.items() if key != "manifest"}
    yield from package(scene)


def _given(**given: Any) -> dict[str, Any]:
    return given


def _variables(*given: Any, **_: Any) -> tuple[Any, ...]:
    return given


class _Library:
    """What a unit takes from a library whose C is not written."""

    @staticmethod
    def of(scene: Scene, *, if_possible: Sequence[str], **given: Any) -> SimpleNamespace:
        options, source = PackageOptions(**given), source_of(scene, CReal.KINDS["double"])
        known = {"nominal_parameters": {}, "steps": {"step": {"accurate_s": 1.0}}, "functions": {}}
        return SimpleNamespace(
            subject=subject_of(source, options.what, CReal.KINDS["double"], options),
            structs={"input": (), "state": (), "rate": ()},
            manifest={**known, "options": options},
            parts=if_possible,
            title=source.title,
            sources={},
            flags=list,
        )


def page_of_loop(scene: ControlScene) -> Iterator[object]:
    """What a web page of a closed loop computes by."""
    plant, sensors = plant_of_loop(scene, stages_of(scene, Prediction(scene)))
    yield from loop(scene)
    yield from (plant.rate, plant.acting, plant.sensed, plant.start, plant.rest, plant.p, plant.x_names)
    yield from (plant.signals.w(_INSTANTS), sensors.names, sensors.delay, sensors.std)


def search(scene: PlanScene) -> Iterator[object]:
    """The problem of a plan, and what its solver and its check are given."""
    made, options = PlanSearch(scene), scene.solver
    assembly = made.problem.assembly
    yield from (assembly.nlp.f, assembly.nlp.g, assembly.low, assembly.high, made.x0, made.first, made.problem.before)
    yield from ([(one.name, one.lower, one.upper, one.scale) for one in assembly.blocks], options.starts)
    yield from (made.budget.left, options.time_limit, options.method, options.tolerance, options.max_iterations)
    yield from ([vars(one) for one in made.problem.goal], scene.check, scene.name, made.motion.exact)
    yield from (made.motion.prediction.p_names, made.motion.prediction.p_nominal)
    yield made.motion.steps if scene.transcription == "single_shooting" else ()


def model(scene: Scene) -> Iterator[object]:
    """What operators and all else that takes the model of a finger know of a scene."""
    made = FingerModel(scene)
    yield from (made, made.tip, made.p_names)


def measured_choices(scene: Scene) -> Iterator[object]:
    """What accuracy measures against what: load cases of the exact rod, and models as they move, without an object."""
    known = scene.replaced(**{name: getattr(Surroundings(), name) for name in _AROUND})
    known.check_for_exact_rod()
    known = known.replaced(fidelity=Fidelity(bending_range=known.fidelity.bending_range, elements=3))
    for name, case in load_cases(known):
        yield from (name, read_problem(case), case.loads)
    one = FingerModel(known)
    signals = Signals(known, one)
    yield from (one, [signals.u(at) for at in _INSTANTS], [signals.w(at) for at in _INSTANTS])
    yield from (initial_state(known, one), known.name, known.time and timing_of_comparison(known))


class _AskedPlant(PlantModel):
    """What a plant is asked for, in place of the plant."""

    def __new__(cls, *plant: Any, **named: Any) -> Any:
        return (*plant[1:], named)


def carried_out(mission: MissionScene) -> Iterator[object]:
    """What a mission asks of controller and plant, once its grasp has been found: of one middle contact."""
    control = _Task(mission, straight_grasp(mission, 0.1), mission.grasp.setups[0].name).control
    one: Any = SimpleNamespace(mission=mission, control=control, pulls=[0])
    with patch.object(mission_plant, "PlantModel", _AskedPlant):
        yield from (control, mission_plant.mission_plant_model(one), mission_plant.Timetable(one).spans)
    asked = mission.controller
    yield from (asked.retained, asked.held, asked.deadline, mission.pull_share, mission.beyond_certificate)
    yield from (mission.phases.lift_share, mission.phases.squeeze_share, mission.phases.hold_until_release)
    yield from (mission.trials, mission.turn, mission.slip)


def fitted(scene: Scene) -> Iterator[object]:
    """What identify predicts at the scene's values: a shape at rest and a short motion, without an object."""
    known = scene.replaced(**{name: getattr(Surroundings(), name) for name in _AROUND})
    unknowns = read_unknowns(known, ["clamp_angle"])
    tip = [Reading(axis, [0.01, 0.02]) for axis in "xy"]
    for block in (
        PosesBlock(known, Poses(tip), unknowns),
        PathBlock(known, TipPath([0.01, 0.02], measured=tip), unknowns),
    ):
        yield from (block.predict(np.zeros(1)), block.measured)


def read_and_sought(scene: IdentifyScene) -> Iterator[object]:
    """What identify reads of the shipped files and seeks, and the commands that it begins to design."""
    yield read_unknowns(scene, scene.estimate)
    yield [{**vars(one), "scene": None, "own": one.scene} for one in read_data(scene, [CONFIGS / "identify"])]
    yield [(law.name, own.estimate, own.gravity) for law, own in zip(scene.laws, under_laws(scene), strict=True)]
    for k, one in enumerate(scene.data):
        if isinstance(one, StaticPoses) and one.propose:
            headings, cells, poses = choices_of(one, plain_scene(scene), f"data[{k}]")
            yield from (one.propose, headings, cells, [*poses.conditions.items()])
    if scene.finger.tendons is not None:
        yield from (excited(plain_scene(scene), scene.excitation), scene.excitation.sample)


@cache
def excited(scene: Scene, options: Excitation) -> Scene:
    """A finger under the commands that the design of an excitation begins with."""
    design = Excited(scene, patterns_of(scene), options)
    return design.scene(1.0)


def of_sweep(sweep: Sweep) -> Iterator[object]:
    """Which scenes a sweep consists of, what its table holds, and its pictures."""
    plan = SweepPlan.of(sweep)
    yield from (plan.variation.base, len(plan), [plan.point(k) for k in range(min(len(plan), 9))])
    yield from (plan.keys, plan.columns, plan.units, plan.pictures)


def of_design(design: Design) -> Iterator[object]:
    """What a design chooses, and the scenes, costs and options of its search."""
    space = design_space_of(ConfigurationData.given(design, Design))
    yield from (space.coordinates, space.keys.ties, space.tolerated, space.start)
    yield [space.scene(case, space.start) for case in space.cases]
    yield from (design.expressions, [*design.limits.values()], design.over, design.solver)


@dataclass(frozen=True)
class Walk:
    """A consumer of which all keys of a kind of scene are tried, by what it makes of them."""

    consumer: str
    root: type[BaseModel]
    make: Callable[[Any], Iterator[object]]
    but: tuple[str, ...] = ()
    """Keys of the scene that are those of others."""

    def __str__(self) -> str:
        return f"{self.consumer}: {self.make.__name__}"


_OF_TOUCH = ("finger.half_thickness", "finger.rod.samples.thickness", "finger.tendons.max_tension")
"""Keys of contacts and commands, which a model without them has not."""
WALKS = (
    Walk("export to mjcf", Scene, chain_of_hinges),
    Walk(
        "plant.guides",
        Scene,
        chain_of_guides,
        ("actuation", "initial", "loads", "time", "parameters", "fidelity", "name"),
    ),
    Walk("statics, modes", Scene, equilibrium_and_modes, _AROUND),
    Walk("export to c, operators", Scene, package),
    Walk("export to web", Scene, page),
    Walk("export to fmu", Scene, unit),
    # Ranges are those of the package; the model takes every pressure.
    Walk(
        "export to c, operators", Scene, model, ("time", "name", "finger.pressure.max_pressure", *_AROUND, *_OF_TOUCH)
    ),
    Walk("accuracy by the exact rod", Scene, measured_choices, _AROUND),
    Walk("identify", Scene, fitted, _AROUND),
    Walk("environments", ControlScene, lanes),
    Walk("export to c of closed loops", ControlScene, loop),
    Walk("mpc", ControlScene, run),
    Walk("export to fmu", ControlScene, units_of_loop),
    Walk("export to web", ControlScene, page_of_loop),
    # Plans touch fixed objects alone, and a fixed object has neither.
    Walk("plan", PlanScene, search, ("moment_of_inertia", "out_of_plane_gravity")),
    Walk("missions", MissionScene, carried_out),
    Walk("identify", IdentifyScene, read_and_sought),
    Walk("sweep", Sweep, of_sweep, ("name",)),
    Walk("design", Design, of_design, ("name",)),
)
"""All that are tried; one more is one line, and where it has keys that it does not take, a ``Consumer``."""
