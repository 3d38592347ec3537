"""The plant as a controller meets it: it takes commands, is integrated accurately, and gives measurements."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError, check_arguments
from continuum_grasp.closed_loop.integration import Integration
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.closed_loop.shared_object import SharedModel
from continuum_grasp.closed_loop.wiring import Wiring
from continuum_grasp.control import Prediction
from continuum_grasp.core import CodeKind
from continuum_grasp.scene import ControlScene


class Plant:
    """A finger that differs from its controller's model.

    Commands hold for a period. Measurements are as old as ``sensors.delay``; between the integrator's steps the state
    is interpolated linearly. Measurements from before the start show the finger as it was at the start.

    Parameters
    ----------
    scene : ControlScene
        The scene.
    prediction : Prediction, optional
        The controller's model, where it exists already; a measurement without an estimator is its state.
    period : float, optional
        Control period [s]; by default the scene's.
    model : PlantModel, optional
        Its equations, where they differ from the scene's plant.
    seed : int, optional
        Seed of the measurement noise; by default ``plant.seed`` of the scene.

    Attributes
    ----------
    model : PlantModel
    method : Method
        Its integration method.
    sensors : Sensors
    t : float
        Time since the start [s].
    x : (nx,) ndarray
        State now.
    """

    @check_arguments
    def __init__(
        self,
        scene: ControlScene,
        prediction: Prediction | None = None,
        period: float | None = None,
        model: PlantModel | None = None,
        seed: int | None = None,
    ) -> None:
        self.model = PlantModel(scene) if model is None else model
        self.period = scene.controller.step if period is None else period
        self.method = self.model.method_for(self.period)
        self.sensors = Sensors(scene, self.model, Prediction(scene) if prediction is None else prediction, seed)
        names = self.sensors.names, self.model.u_names
        self._believed = Wiring.of(scene.mounting, *names, "mounting")
        self._real = Wiring.of(scene.bench_mounting, *names, "plant.mounting")
        self._wired = scene.mounting != scene.bench_mounting
        self.x = self.model.start.copy()
        self.t = 0.0
        # What measurements may still show: instants, states, and the inputs that led to them.
        self._past_t = np.zeros(1)
        self._past_x = self.x[None]
        self._past_u = self.model.rest_input[None]

    def seen(self) -> tuple[float, Array]:
        """Return instant [s] and state (nx) that measurements which arrive now show."""
        at = max(self.t - self.sensors.delay, 0.0)
        return at, np.array([np.interp(at, self._past_t, column) for column in self._past_x.T])

    def measure(self) -> Array:
        """Return the measurement that arrives now (ny)."""
        at, x = self.seen()
        # The input of the step that contains the instant; 1e-12 s: instants are sums of rounded steps.
        k = min(int(np.searchsorted(self._past_t, at - 1e-12)), len(self._past_t) - 1)
        read = self.sensors.read(x, self._past_u[k], self.model.forces(at)[0])
        return self._believed.readings.back(self._real.readings(read)) if self._wired else read

    def acting(self, command: Array) -> Array:
        """Tensions or moment of the drives at rest by a command (nu), through believed and true connections.

        A tendon that would push is slack.
        """
        if not self._wired:
            return command
        exerted = self._real.commands.back(self._believed.commands(command))
        return np.maximum(exerted, 0.0) if self.model.scene.finger.tendon_list else exerted

    def advance(self, u: ArrayLike) -> Array:
        """Apply tensions [N] or a tip moment [N m] (nu) for one period; return its states (substeps + 1, nx).

        Raises
        ------
        InputError
            If the command has the wrong size or is not finite.
        NumericalError
            If the motion does not stay finite.
        """
        command = self.checked(u)
        (states,) = SharedPlant((self,)).moved([self.x], [command], self.t)
        self.reach(states, command)
        return states

    def checked(self, u: ArrayLike) -> Array:
        """A command (nu) as an array; an InputError where its size is wrong or it is not finite."""
        command = np.array(u, dtype=float).reshape(-1)
        if command.size != self.model.nu or not np.all(np.isfinite(command)):
            raise InputError(f"u: expected {self.model.nu} finite entries, got {command.tolist()}")
        return command

    def reach(self, states: Array, command: Array) -> None:
        """Go on to the end of a period by its states (substeps + 1, nx) under a command (nu)."""
        substeps = self.method.substeps
        instants = np.asarray(self.t + self.period / substeps * np.arange(1, substeps + 1), dtype=float)
        needed = self._past_t >= instants[0] - self.sensors.delay - self.period
        needed[-1] = True  # the state before the step, from which ``measure`` interpolates
        self._past_t = np.concatenate([self._past_t[needed], instants])
        self._past_x = np.concatenate([self._past_x[needed], states[1:]])
        self._past_u = np.concatenate([self._past_u[needed], np.tile(command, (substeps, 1))])
        self.x = states[-1]
        self.t = self.t + self.period

    @property
    def command(self) -> Array:
        """Last command (nu)."""
        command: Array = self._past_u[-1]
        return command


class SharedPlant:
    """Plants of fingers at one instant that move together and measure each for itself; one moves alone.

    ``model`` has their equations, where they exist already.
    """

    def __init__(self, plants: Sequence[Plant], model: SharedModel | None = None) -> None:
        self.plants = tuple(plants)
        alone = len(self.plants) == 1
        self._joint = None if alone else model or SharedModel([plant.model for plant in plants])

    @property
    def _integration(self) -> Integration:
        """Integrators of the plants, made once for each model."""
        model = self._joint or self.plants[0].model
        integration: Integration = model.integration(self.plants[0].method.name)
        return integration

    def prepare(self, periods: float = math.inf) -> CodeKind:
        """Compile the integrator, if so many periods pay for it; return the kind of its code."""
        return self._integration.prepare(periods * self.plants[0].method.substeps)

    def advance(self, commands: Sequence[ArrayLike]) -> list[Array]:
        """Apply the command (nu) of each finger for one period as `Plant.advance` does; return the states of each."""
        if self._joint is None:  # a plant of the user's own may advance in its own way
            return [self.plants[0].advance(commands[0])]
        known = [plant.checked(u) for plant, u in zip(self.plants, commands, strict=True)]
        states = self.moved([plant.x for plant in self.plants], known, self.plants[0].t)
        for plant, plant_states, command in zip(self.plants, states, known, strict=True):
            plant.reach(plant_states, command)
        return states

    def moved(self, x: Sequence[Array], u: Sequence[Array], start: float, finer: int = 1) -> list[Array]:
        """Return the states (substeps + 1, nx) of each over a period from states x, with ``finer`` times the steps.

        The plants stay as they are.
        """
        first = self.plants[0]
        joint = self._joint
        u = [plant.acting(command) for plant, command in zip(self.plants, u, strict=True)]
        timing = start, first.period, finer * first.method.substeps
        if joint is None:
            return [self._integration.advance(x[0], u[0], *timing)]
        return joint.parts(self._integration.advance(joint.joined(x), np.concatenate(u), *timing))


class Sensors:
    """Measurements of a plant: noisy, late, and only what ``estimator.measured`` names.

    Without an estimator the controller is given its state, exactly: the one whose section angles and their rates are
    nearest to the plant's, four sections to an element. ``names`` has name and unit of each measured number, ``delay``
    the age of measurements when they arrive [s], ``std`` (ny) the standard deviation of each one's noise, ``value`` the
    function (x, u, w) of the measured quantities without it.
    """

    def __init__(self, scene: ControlScene, plant: PlantModel, prediction: Prediction, seed: int | None) -> None:
        self._rng = np.random.default_rng(scene.plant.seed if seed is None else seed)
        if scene.estimator is None:
            self.names: tuple[str, ...] = prediction.x_names
            self.delay = 0.0
            self.std = np.zeros(len(self.names))
            self.value = plant.function("state", y=_nearest_state(plant, prediction))
            return
        by_sensor = plant.sensor_expressions(scene.estimator.measured, prediction)
        measured = {name: value for of in by_sensor.values() for name, value in of.items()}
        self.names = tuple(measured)
        self.delay = scene.estimator.delay if scene.plant.delay is None else scene.plant.delay
        self.std = scene.plant.noise * np.array([scene.measurement_std(name) for name in self.names])
        self.value = plant.function("measured", y=ca.vertcat(*measured.values()))

    def read(self, x: Array, u: Array, w: Array) -> Array:
        """Measure a state (ny), with noise."""
        return np.array(self.value(x, u, w)).ravel() + self.std * self._rng.standard_normal(len(self.std))


def _nearest_state(plant: PlantModel, prediction: Prediction) -> ca.SX:
    """A controller's state (nx) from the plant's; exact where the controller's model has the plant's shapes.

    Angles of sections are affine in the bending coordinates, so that coordinates and rates are linear least squares
    of them; friction states of tendons are means over their cells, all other states (drive, object) the plant's.
    """
    n = prediction.system.n
    length = plant.scene.finger.rod.length
    edges = np.cumsum([0.0, *prediction.system.finger_model.lengths])
    # 4: sections of each element of the controller's model whose angles are compared: more than the two bending
    # coordinates of a clothoid, so that the least squares average over the element
    parts = [np.linspace(a, b, 4 + 1)[1:] for a, b in pairwise(edges)]
    at = tuple(float(s) for s in np.minimum(np.concatenate(parts), length))
    angles = _angles(prediction, at)
    plant_states = plant.named_states | _friction_states(plant, prediction) | _section_states(plant, prediction)
    others = [plant_states[name] for name in prediction.x_names[2 * n :]]
    # With zero coordinates: the base's angle, and what a tip moment alone bends where the tip's curvature matches it.
    offset, rate = angles(ca.vertcat(ca.SX(2 * n, 1), *others))
    straight = np.array(angles(np.zeros(prediction.nx))[0])
    units = np.eye(prediction.nx)[:n]
    inverse = ca.DM(np.linalg.pinv(np.hstack([np.array(angles(e)[0]) - straight for e in units])))
    q = ca.mtimes(inverse, plant.sections(at)[1] - offset)
    qd = ca.mtimes(inverse, plant.angle_rates(at) - rate)
    return ca.vertcat(q, qd, *others)


def _friction_states(plant: PlantModel, prediction: Prediction) -> dict[str, ca.SX]:
    """Friction states of a controller's cells by name: those at which friction acts as along the plant's."""
    states: dict[str, ca.SX] = {}
    for number, cells in enumerate(prediction.system.finger_model.structure.cell_sets):
        edges = np.cumsum([0.0, *(cell.length for cell in cells.cells)])
        names = cells.names(number + 1)
        tendon = cells.tendons[0]
        side = cells.sides[0]
        parts = [(0.0, edges[-1])] * (len(names) - len(cells.cells)) + list(pairwise(edges.tolist()))
        for name, (a, b) in zip(names, parts, strict=True):
            # The inverse of the cubic by which a state acts.
            acts = side * plant.friction_along(tendon, a, b)
            states[name] = 2.0 * ca.sin(ca.asin(acts) / 3.0)
    return states


def _angles(model: Prediction, at: tuple[float, ...]) -> ca.Function:
    """Angles of sections and their rates, from the state alone: neither depends on the input, which is set to zero."""
    angle = model.sections(at)(model.x, model.u, model.p)[1]
    rate = ca.jtimes(angle, model.x, model.dynamics(model.x, model.u, model.p))
    full = ca.Function("angles", [model.x, model.u, model.p], [angle, rate])
    x = ca.SX.sym("x", model.nx)
    values = full.call([x, ca.SX(ca.DM.zeros(model.nu)), ca.SX(ca.DM(model.p_nominal))])
    angles: ca.Function = ca.Function("angles", [x], values)
    return angles


def _section_states(plant: PlantModel, prediction: Prediction) -> dict[str, ca.SX]:
    """States of laws of the sections of a controller by name: the mean of the plant's over the same part."""
    section_states: dict[str, ca.SX] = {}
    laws = zip(*(model.system.finger_model.structure.laws for model in (prediction, plant)), strict=False)
    for predicted, other in laws:
        if not predicted.law.names(1):
            continue
        edges = _shares(predicted.ports)
        known = _shares(other.ports)
        states = [[plant.named_states[name] for name in other.law.names(k + 1)] for k in range(len(other.ports))]
        for k, (start, end) in enumerate(pairwise(edges.tolist()), start=1):
            shares = np.clip(np.minimum(known[1:], end) - np.maximum(known[:-1], start), 0.0, None) / (end - start)
            for name, every in zip(predicted.law.names(k), zip(*states, strict=True), strict=True):
                section_states[name] = ca.dot(ca.DM(shares), ca.vertcat(*every))
    return section_states


def _shares(ports: Sequence[Any]) -> Array:
    """Ends of the parts of a finger that its ports stand for, as shares of it; the first one is 0."""
    sums = np.cumsum([0.0, *(float(port.measure) for port in ports)])
    return np.asarray(sums / sums[-1])
