"""The plant as a controller meets it: it takes commands, is integrated accurately, and gives measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.closed_loop.sensors import Sensors
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.core.integrators import step_function
from continuum_grasp.core.rollouts import Rollouts, Signal
from continuum_grasp.errors import InputError, NumericalError
from continuum_grasp.model.remade import Remade
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.simulation.spectrum import TARGET_RADIUS, sample_shapes

Array = NDArray[np.float64]


class Plant:
    """A finger that differs from what its controller knows.

    Parameters
    ----------
    scene : ControlScene
        The scene.
    prediction : Prediction, optional
        The controller's model, where it is made already; what is measured without an estimator is its state.
    period : float, optional
        Control period [s]; that of the scene where not given.
    model : PlantModel, optional
        Its equations, where they are not those of the scene's plant.
    seed : int, optional
        Of the measurement noise; ``plant.seed`` of the scene where not given.

    Attributes
    ----------
    model : PlantModel
        Its equations.
    method : Method
        How it is integrated.
    sensors : Sensors
    t : float
        Time since the start [s].
    x : (nx,) ndarray
        State now.

    Notes
    -----
    Commands hold for a period. Measurements are as old as ``sensors.delay``; between the integrator's steps the state
    is interpolated linearly. Those of before the start show the finger as it was at the start.
    """

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
        self.method = choose_method(self.model, self.period)
        self.sensors = Sensors(scene, self.model, Prediction(scene) if prediction is None else prediction, seed)
        self._integration = Integration(self.model, self.method.name)
        self.x = self.model.start.copy()
        self.t = 0.0
        self._u = self.model.rest_input
        self._past_t, self._past_x = np.zeros(1), self.x[None]
        self._past_u = self._u[None]

    @property
    def compiled(self) -> bool:
        """Whether the integrator is compiled."""
        return self._integration.compiled

    def measure(self) -> Array:
        """The measurement that arrives now (ny)."""
        at = max(self.t - self.sensors.delay, 0.0)
        x = np.array([np.interp(at, self._past_t, column) for column in self._past_x.T])
        k = min(int(np.searchsorted(self._past_t, at - 1e-12)), len(self._past_t) - 1)
        return self.sensors.read(x, self._past_u[k], self.model.forces(at)[0])

    def advance(self, u: ArrayLike) -> Array:
        """Apply a command for one period.

        Parameters
        ----------
        u : (nu,) array_like
            Tensions [N] or tip moment [N m].

        Returns
        -------
        (substeps + 1, nx) ndarray
            States from the beginning to the end of the period.

        Raises
        ------
        InputError
            If the command has the wrong size or is not finite.
        NumericalError
            If the motion does not stay finite.
        """
        command = np.array(u, dtype=float).reshape(-1)
        if command.size != self.model.nu or not np.all(np.isfinite(command)):
            raise InputError(f"u: expected {self.model.nu} finite entries, got {command.tolist()}")
        substeps = self.method.substeps
        states = self._integration.advance(self.x, command, self.t, self.period, substeps)
        instants = np.asarray(self.t + self.period / substeps * np.arange(1, substeps + 1), dtype=float)
        self._remember(instants, states[1:], command)
        self.x, self.t, self._u = states[-1], self.t + self.period, command
        return states

    def replayed(self, x: Array, u: Array, start: float, refinement: int = 2) -> Array:
        """State at the end of a period that began in another state, by finer steps; the plant stays as it is."""
        found: Array = self._integration.advance(x, u, start, self.period, refinement * self.method.substeps)[-1]
        return found

    def _remember(self, instants: Array, states: Array, u: Array) -> None:
        """Keep what measurements may still show."""
        needed = self._past_t >= instants[0] - self.sensors.delay - self.period
        needed[-1] = True
        self._past_t = np.concatenate([self._past_t[needed], instants])
        self._past_x = np.concatenate([self._past_x[needed], states])
        self._past_u = np.concatenate([self._past_u[needed], np.tile(u, (len(instants), 1))])


_EXPLICIT_UP_TO = 40
"""Sub-steps per control period up to which the explicit method is taken."""
_LONGEST = 1.25e-3
"""Longest step of either method [s]; on fingers of a hand it follows a step of the input to 1e-6."""
_CONTACT_STEP = 1e-4
"""Step of ros2, which must resolve contacts [s]."""
_SHAPES = 4
"""Shapes at which the fastest rate is taken: each costs a linearization of the fine model on the virtual machine."""


@dataclass(frozen=True)
class Method:
    """How a plant is integrated: method of ``core``, steps of it per control period, fastest rate [1/s]."""

    name: str
    substeps: int
    radius: float


def choose_method(model: PlantModel, period: float) -> Method:
    """The cheaper of explicit and implicit steps, from the largest eigenvalue over some shapes.

    Parameters
    ----------
    period : float
        Control period [s].
    """
    system, w = model.system, model.forces(0.0)[0]
    radius = 0.0
    for q in sample_shapes(system.finger_model, model.start[: system.n])[:_SHAPES]:
        x = model.start.copy()
        x[: system.n] = q
        a = np.array(model.linearization(x, model.rest_input, w, model.p)[0])
        if np.all(np.isfinite(a)):
            radius = max(radius, float(np.abs(np.linalg.eigvals(a)).max()))
    if system.surroundings is not None:
        return Method("ros2", math.ceil(period / _CONTACT_STEP - 1e-9), radius)
    wanted, least = math.ceil(radius * period / TARGET_RADIUS), math.ceil(period / _LONGEST - 1e-9)
    if wanted <= max(_EXPLICIT_UP_TO, least):
        return Method("rk4", max(wanted, least, 1), radius)
    return Method("rodas", max(least, 1), radius)


class Integration(Remade):
    """Integrates a plant over periods of constant input.

    Parameters
    ----------
    method : str
        Name in ``INTEGRATORS``.
    """

    def __init__(self, model: PlantModel, method: str) -> None:
        self._model = model
        self._run = Rollouts.of(step_function(model, method))
        self.compiled = self._run.compiled

    def advance(self, x: Array, u: Array, start: float, period: float, substeps: int) -> Array:
        """States (substeps + 1, nx) at equal instants of one period.

        Parameters
        ----------
        x : (nx,) ndarray
            State at the start.
        u : (nu,) ndarray
            Input, constant.
        start, period : float
            Start and length of the period [s].
        substeps : int
            Steps in it.

        Raises
        ------
        NumericalError
            If a state is not finite; it says when, and holds the states before.
        """
        model = self._model
        if model.steady:
            w = Signal(model.forces(start)[:1, None], 0, 0)
        else:
            instants = start + np.arange(2 * substeps + 1) * (0.5 * period / substeps)
            w = Signal(np.ascontiguousarray(model.forces(instants))[None], model.nw, 0)
        inputs = Signal(np.ascontiguousarray(u, dtype=float)[None, None], 0, 0)
        begin = np.ascontiguousarray(x, dtype=float)[None]
        states, valid = self._run(begin, substeps, 1, period / substeps, inputs, w, model.p)
        if valid[0] < substeps:
            time, last = start + valid[0] * period / substeps, states[0, valid[0]]
            raise NumericalError(
                f"the plant's state is not finite after t = {time:g} s (last finite state {last.tolist()}): its loads "
                "or inputs bend it beyond what its model means; see plant.fidelity.bending_range and loads",
                time=time,
                state=last,
                result=states[0, : valid[0] + 1],
            )
        found: Array = states[0]
        return found
