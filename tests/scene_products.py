"""What each consumer makes of a scene, by the shortest way: all its numbers and functions, none of them compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any
from unittest.mock import patch

import casadi as ca
import numpy as np
from pydantic import BaseModel

from continuum_grasp.closed_loop.chain_system import ChainSystem
from continuum_grasp.control.ocp.setpoints import Setpoints
from continuum_grasp.environments import sensing
from continuum_grasp.environments.plants import plants_of
from continuum_grasp.environments.spaces import observed_of
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import REALS
from continuum_grasp.export.mjcf.write import export_mjcf
from continuum_grasp.export.ranges import input_fields
from continuum_grasp.export.source import names_of, source_of
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.web.plant import plant_of_scene
from continuum_grasp.model import FingerModel, System
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.loads import Actuation, Samples
from continuum_grasp.scene.simulate import Initial, Scene
from continuum_grasp.scene.surroundings import Surroundings
from continuum_grasp.simulation.modes import modes

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
    elif isinstance(made, ca.SX):
        yield ca.Function("value", ca.symvar(made), [made]).serialize()
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
    elif made is None or isinstance(made, str | int | float | bool | bytes | BaseModel | np.generic):
        yield repr(made)
    elif not callable(made):
        yield from parts([value for name, value in sorted(vars(made).items()) if not name.startswith("_")])


def chain_of_hinges(scene: Scene) -> Iterator[object]:
    """What export-mjcf makes."""
    made = export_mjcf(scene, hinges=3)
    yield made.text
    yield made.controls([0.0, 0.25, 0.85]).tolist()


def chain_of_guides(scene: Scene) -> Iterator[object]:
    """What a plant with guides makes of a finger and its surroundings."""
    chain = ChainSystem(scene, 3, 1e4)
    yield chain.numbers(np.array(chain.p_nominal)).tolist()
    states = sum(one.states for one in chain.winches)
    start = chain.start(*np.zeros((2, 3)), np.zeros(states), np.zeros(chain.nu), Initial(pose="straight"))
    yield from (repr(chain.chain.tendons), repr(chain.winches), start.tolist())
    yield from (one.serialize() for one in (chain.drums, chain.around, chain.tensions, chain.touch))


def equilibrium_and_modes(scene: Scene) -> Iterator[object]:
    """What statics and modes find, without an object, at the last inputs, pulled where the finger has friction."""
    alone: dict[str, Any] = {name: getattr(Surroundings(), name) for name in _AROUND}
    initial = scene.initial
    if scene.finger.has_friction and initial.reached_by is None:
        initial = initial.replaced(reached_by="pulling")
    actuation = scene.actuation
    if actuation is not None:
        key, given = actuation.given
        actuation = Actuation.of(key, [one.values[-1] if isinstance(one, Samples) else one for one in given])
    found = modes(scene.replaced(**alone, initial=initial, actuation=actuation), points=5)
    yield from (found.equilibrium.q, found.equilibrium.u, found.equilibrium.w, found.backbone)
    yield from (found.frequencies_hz, found.damping_ratios, found.stuck_frequencies_hz, found.free_frequencies_hz)


def package(scene: Scene) -> Iterator[object]:
    """What export-c makes of a finger."""
    source = source_of(scene, REALS["double"])
    yield source.title, source.finger, source.step, source.finger.range_use
    subject = Subject.of(source.finger, "finger", REALS["double"], {}, None, 1)
    yield subject.parameters, subject.state, subject.input, subject.forces
    if scene.object is not None:
        yield System(source.finger.structure.asked[0], surroundings=source.surroundings).touch


def page(scene: Scene) -> Iterator[object]:
    """What a web page computes by."""
    plant = plant_of_scene(scene)
    yield from (plant.rate, plant.acting, plant.sensed, plant.start, plant.rest, plant.p, plant.x_names)
    yield from (plant.signals.u(at) for at in _INSTANTS)
    yield from (plant.signals.w(at) for at in _INSTANTS)
    yield input_fields(plant.system.finger_model)


def lanes(scene: ControlScene) -> Iterator[object]:
    """What environments make of a closed loop."""
    with patch.object(sensing, "Periods", lambda *given: given):
        plants = plants_of((scene,))
        sensed = sensing.sensing_of(plants, None)
    yield from (plants.p, plants.start, plants.forces, plants.setpoints, plants.periods, plants.period)
    yield from (sensed, scene.input_limits, scene.controller.input.rate_max)
    observed = observed_of(plants, sensed, np.zeros((plants.model.nx, 2)))
    yield from (observed.names, observed.bounds, observed.setpoints)


def loop(scene: ControlScene) -> Iterator[object]:
    """What export-c makes of a closed loop."""
    yield from (names_of(scene), Loop.of(scene, REALS["double"], ["mpc"]))


MAKERS: dict[str, tuple[type[BaseModel], Callable[[Any], Iterator[object]], tuple[str, ...]]] = {
    "export-mjcf": (Scene, chain_of_hinges, tuple(Scene.model_fields)),
    "plant.guides": (Scene, chain_of_guides, ("finger", "gravity", "contacts", *_AROUND)),
    "statics, modes": (Scene, equilibrium_and_modes, tuple(set(Scene.model_fields) - set(_AROUND))),
    "export-c": (Scene, package, tuple(Scene.model_fields)),
    "export-web": (Scene, page, tuple(Scene.model_fields)),
    "environments": (ControlScene, lanes, tuple(ControlScene.model_fields)),
    "export-c of closed loops": (ControlScene, loop, tuple(ControlScene.model_fields)),
}
"""By consumer the kind of scene, what it makes, and the keys that are its own."""
