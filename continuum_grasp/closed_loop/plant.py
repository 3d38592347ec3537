"""The plant as a controller meets it: it takes commands and gives measurements."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.closed_loop.integration import Integration, choose_method
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.closed_loop.sensors import Sensors
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.errors import InputError
from continuum_grasp.scene.control import ControlScene

__all__ = ["Plant"]

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
