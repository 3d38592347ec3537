"""The plants of an environment: one compiled model, and what each scene of a sweep sets in it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.sweeps import Sweep, SweepPlan
from continuum_grasp.base import Array, InputError
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.control import Outputs, Prediction, Setpoints
from continuum_grasp.model import Parameters, element_lengths
from continuum_grasp.scene import Consumer, ControlScene, Scene, doubt, scene_of
from continuum_grasp.simulation import Signals

MOST_SCENES = 10_000
"""Scenes of a sweep that an environment draws from [1]: each is checked beforehand, in about 5 ms."""


@dataclass(frozen=True)
class Plants:
    """All plants that an environment draws from.

    ``p`` (D, np), ``start`` (D, nx) and ``forces`` (D, nw) have a row per scene; ``setpoints`` (D or 1, K + 1 or 1, nr)
    are at the ends of ``periods`` of length ``period`` [s], constant ones once.
    """

    scenes: tuple[ControlScene, ...]
    keys: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...]
    model: PlantModel
    prediction: Prediction
    outputs: Outputs
    p: Array
    start: Array
    forces: Array
    setpoints: Array
    periods: int
    period: float


def rows_of(table: NDArray[Any], drawn: NDArray[np.int64], at: NDArray[np.int64]) -> NDArray[Any]:
    """Rows (count, width) of a table (scenes, periods, width), in which what does not vary has one entry."""
    scenes, times, width = table.shape
    flat = table.reshape(-1, width)
    if len(flat) == 1:
        return np.repeat(flat, len(drawn), axis=0)
    places = drawn * (times * (scenes > 1)) + np.minimum(at, times - 1) * (times > 1)
    rows: NDArray[Any] = flat.take(places, axis=0)
    return rows


def scenes_of(
    given: ControlScene | Sweep | str | os.PathLike[str] | Mapping[str, Any],
) -> tuple[tuple[ControlScene, ...], tuple[str, ...], tuple[tuple[Any, ...], ...]]:
    """The scenes of an environment, and of a sweep its varied keys and their values in each scene."""
    if isinstance(given, (str, os.PathLike)):
        loaded = scene_of(given, (ControlScene, Sweep))
        given = given if isinstance(loaded, Sweep) else loaded
    if isinstance(given, ControlScene):
        return (given,), (), ((),)
    plan = SweepPlan.of(given)
    if plan.variation.kind != "mpc":
        raise InputError("an environment needs a closed loop (finger, controller, ...), got a grasp", key="scene")
    if len(plan) > MOST_SCENES:
        raise InputError(f"expected {MOST_SCENES} scenes at most, got {len(plan)}", key="sample.count")
    points = list(plan)
    scenes: list[ControlScene] = []
    for point in points:
        try:
            scenes.append(ControlScene(**plan.data_of(point)))
        except InputError as error:
            drawn = ", ".join(f"{key} = {value}" for key, value in zip(plan.keys, point.labels, strict=True))
            raise InputError(f"scene {point.index} ({drawn}): {error}") from None
    return tuple(scenes), plan.keys, tuple(point.labels for point in points)


_LANES = Consumer(
    "environments",
    refused={
        "plant.guides": "a chain of guides does not run in vector lanes: leave it out",
        "loads.force.times": "loads of an environment must be constant",
        **dict.fromkeys(("mounting", "plant.mounting"), "an environment counts as the model does: leave it out"),
    },
    otherwise={
        **{
            f"controller.bounds.{key}": "an environment neither keeps it nor charges for what leaves it"
            for key in ("curvature", "speed", "keep_out", "penalty")
        },
        "plant.seed": "episodes draw their noise by the seed of reset()",
    },
    unneeded={
        **Consumer.LIMITS_OF_BENDING,
        "name": "a title alone",
        "log": "of logs of a bench",
        **{
            f"controller.{key}": "of a controller: an agent is in its place"
            for key in (
                *("sqp_iterations", "start_iterations", "start_calls", "iterations", "scenarios", "supervisor"),
                *("deadline", "horizon.method", "horizon.substeps"),
            )
        },
        "controller.cost.*.terminal": "rewards are running costs",
        **{
            f"estimator.{key}": "of an estimator: observations are measurements"
            for key in (
                *("disturbances", "spread", "adapt", "acceleration_std", "initial_std"),
                *("object_acceleration_std", "outlier", "frozen"),
            )
        },
    },
)


def plants_of(
    scenes: Sequence[ControlScene], keys: tuple[str, ...] = (), values: tuple[tuple[Any, ...], ...] = ((),)
) -> Plants:
    """Build one model of scenes that differ in parameters, starts, constant loads and setpoints alone."""
    first = scenes[0]
    if first.duration is None:
        raise InputError("an environment needs a duration [s], after which an episode is truncated", key="duration")
    for text in dict.fromkeys(text for scene in scenes for text in _LANES.check(scene)):
        key, _, otherwise = text.partition(": ")
        doubt(key, otherwise)
    for scene in scenes[1:]:
        _check_fixed(first, scene, keys)
    around = [PlantModel.plant_scene(scene) for scene in scenes]
    of_finger, (object_names, of_object) = _finger_parameters(around), _object_parameters(scenes)
    plant_of = partial(PlantModel, parameters=[*of_finger], object_parameters=object_names)
    model = plant_of(first)
    # Run-time parameters are in this order: the finger's, the object's, the lag of the drive.
    lag = [name for name in of_finger if name not in model.parameters]
    p = np.hstack([*(of_finger[name] for name in model.parameters), of_object, *(of_finger[name] for name in lag)])
    prediction = Prediction(first)
    outputs = Outputs.of(first.controller.cost, prediction)
    periods = max(1, round(first.duration / first.controller.step))
    times = first.controller.step * np.arange(periods + 1)
    table = np.array([Setpoints.of(outputs, scene.reference).rows(times) for scene in scenes])
    if np.all(table == table[:, :1]):
        table = table[:, :1]
    if np.all(table == table[:1]):
        table = table[:1]
    plants = Plants(
        tuple(scenes),
        keys,
        values,
        model,
        prediction,
        outputs,
        np.ascontiguousarray(p),
        np.array([model.start_of(variant) for variant in around]),
        np.array([_forces(model, variant) for variant in around]),
        np.ascontiguousarray(table),
        periods,
        first.controller.step,
    )
    for k in _that_differ(values):
        _check_plant(plants, k, plant_of(_with_friction(scenes[k], first)))
    return plants


def _that_differ(values: Sequence[tuple[Any, ...]]) -> list[int]:
    """Few scenes that have another value than the first one of every key that varies."""
    chosen: list[int] = []
    for key, first in enumerate(values[0]):
        if not any(values[k][key] != first for k in chosen):
            chosen += [k for k in reversed(range(len(values))) if values[k][key] != first][:1]
    return chosen


def _of_contact(scene: ControlScene) -> tuple[Any, ...]:
    """The part of a scene's object and contacts that no parameter or state has."""
    body, law = scene.object, scene.contact_law
    if body is not None:
        angle = 0.0 if scene.object_moves else body.angle
        body = body.replaced(mass=1.0, position=(0.0, 0.0), angle=angle)
    if law is not None:
        law = law.replaced(friction=1.0)
    return body, law, scene.supports, scene.table, scene.object_moves


_OF_PLANT = "plant.fidelity plant.drive_order plant.noise plant.delay plant.seed"
_SHARED = f"controller estimator duration input_limits rest_input fidelity contacts {_OF_PLANT}".split()


_AROUND = (
    "surroundings but for friction of contact_law, position of a fixed object, and mass and start of one that moves"
)


def _check_fixed(first: ControlScene, scene: ControlScene, keys: Sequence[str]) -> None:
    """Refuse a scene that differs in what all plants of an environment have in common."""
    odd = [name for name in _SHARED if attrgetter(name)(scene) != attrgetter(name)(first)]
    if odd or _of_contact(scene) != _of_contact(first):
        same = odd[0] if odd else _AROUND
        why = f"all plants of an environment have the same {same}, which {', '.join(keys)} changes"
        raise InputError(why, key="sample")


def _finger_parameters(around: Sequence[Scene]) -> dict[str, Array]:
    """The finger's parameters that differ between scenes, by name: values (scenes, size)."""
    by_scene = [_values(scene) for scene in around]
    parameters = {}
    for name, first in by_scene[0].items():
        if any(values.get(name) != first for values in by_scene):
            parameters[name] = np.array([values.get(name, first) for values in by_scene])
    return parameters


def _values(scene: Scene) -> dict[str, list[float]]:
    lengths = element_lengths(scene.finger.profile, scene.contacts, scene.fidelity.elements)
    return Parameters.nominal_values(scene.finger, scene.gravity, lengths)


def _object_parameters(scenes: Sequence[ControlScene]) -> tuple[tuple[str, ...], Array]:
    """Names of the object's parameters that the model is to be given, and values (scenes, size) of all that it has."""
    first = scenes[0]
    bodies = [scene.object for scene in scenes if scene.object is not None]
    if first.object is None:
        return (), np.zeros((len(scenes), 0))
    friction = np.array([_friction_of(scene) / (_friction_of(first) or 1.0) for scene in scenes])
    if first.object_moves:  # parameters of every plant with such an object
        masses = [body.mass * scene.plant.object_mass for body, scene in zip(bodies, scenes, strict=True)]
        return (), np.stack([masses, friction * [scene.plant.object_friction for scene in scenes]], axis=1)
    x, y = np.transpose([body.position for body in bodies])
    known = {"friction_factor": friction, "object_x": x, "object_y": y}
    varied = {name: values for name, values in known.items() if np.any(values != values[0])}
    return tuple(varied), np.stack([*varied.values()], axis=1) if varied else np.zeros((len(scenes), 0))


def _with_friction(scene: ControlScene, of: ControlScene) -> ControlScene:
    """A copy of a scene with the friction coefficient of another, which a parameter multiplies."""
    law = scene.contact_law
    return scene if law is None else scene.replaced(contact_law=law.replaced(friction=_friction_of(of)))


def _has_one_friction(scene: ControlScene) -> bool:
    """Whether a factor of all friction coefficients sets the friction of the contact law, and no other one."""
    others = [surface.friction for surface in (scene.table, *scene.supports.values()) if surface is not None]
    return _friction_of(scene) > 0.0 and not any(others)


def _friction_of(scene: ControlScene) -> float:
    return 0.0 if scene.contact_law is None else scene.contact_law.friction


def _forces(model: PlantModel, scene: Scene) -> Array:
    known = Signals(scene, model.system.finger_model).w(0.0)[0]
    row = np.zeros(model.nw)
    row[: len(known)] = known
    return row


def _check_plant(plants: Plants, k: int, separate: PlantModel) -> None:
    """Refuse a scene whose plant, built separately with the same parameters, has other equations than the model."""
    shared = plants.model
    why = None
    if separate.x_names != shared.x_names or separate.w_names != shared.w_names:
        why = "its plant has other states or forces"
    # 1e-8: greatest relative difference of starts [1]: folded constants round otherwise, by 1e-13
    elif not np.allclose(separate.start, plants.start[k], rtol=1e-8, atol=1e-12):
        why = "its plant starts elsewhere"
    elif (
        _friction_of(plants.scenes[k]) != _friction_of(plants.scenes[0]) and not _has_one_friction(plants.scenes[0])
    ) or _equations(separate, Prediction(plants.scenes[k])) != _equations(shared, plants.prediction):
        why = "its plant moves differently"
    if why is not None:
        varied = ", ".join(f"{key} = {value}" for key, value in zip(plants.keys, plants.values[k], strict=True))
        known = ", ".join(sorted(_values(PlantModel.plant_scene(plants.scenes[0]))))
        raise InputError(
            f"scene {k} ({varied}): {why} than the model of scene 0, for any run-time parameters ({known}; of an "
            "object its mass and friction, or its position where it is fixed); vary keys that set these, the start, "
            "constant loads or the reference",
            key="sample",
        )


def _equations(model: PlantModel, prediction: Prediction) -> str:
    """Rates, and readings off the shape, as text: the same for the same operations on the same constants."""
    x, u, w, p = model.symbols
    held = ca.SX.sym("held", model.nu)
    tracked = model.tracked_expression(prediction, held, model.control.controller.horizon.stage)
    values = [model.forward_dynamics(x, u, w, p), tracked, model.tip]
    text: str = ca.Function("equations", [x, u, held, w, p], values).serialize()
    return text
