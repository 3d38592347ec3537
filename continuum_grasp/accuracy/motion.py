"""Motions against a reference model, and what they cost in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.accuracy.choice import choices
from continuum_grasp.accuracy.timing import evaluation_ns
from continuum_grasp.accuracy.truth import Truth
from continuum_grasp.core import Core
from continuum_grasp.errors import InputError, NumericalError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.families import default_family
from continuum_grasp.scene.integrators import INTEGRATORS
from continuum_grasp.scene.simulate import Scene, Timing
from continuum_grasp.simulation.initial import initial_state
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.simulate import simulate

__all__ = ["INSTANTS", "Motion", "Pace", "Runs", "pace", "reference_motion", "rms"]

Array = NDArray[np.float64]

_FINE = (8, 12)
"""Clothoids of the two reference motions; their difference shows how good the second is, by the fourth order."""
_SPAN = 1.0
"""Longest motion that is compared [s]: a phase error grows with time and hides every other in the end."""
INSTANTS = 200
"""At which tips are compared: 5 ms apart in a motion of a second."""
_SUBSTEPS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 1024)
"""Steps between two instants that are tried; the pace is known to the ratio of neighbors, from 4 on at most 1.5."""


@dataclass(frozen=True)
class Motion:
    """Tip of the finger over time.

    Attributes
    ----------
    t : (T,) ndarray
        Instants [s].
    tip : (T, 2) ndarray
        World positions [m].
    error : float
        Estimated r.m.s. error of the tip per length; NaN for a motion that is compared, not a reference.
    """

    t: Array
    tip: Array
    error: float = math.nan


@dataclass(frozen=True)
class Pace:
    """How fast a model runs at a given error of the time steps alone.

    Attributes
    ----------
    steps_per_second : int
        Runge-Kutta steps per second of model time.
    step_ns : float
        Time of one [ns], in C where there is a compiler.
    error : float
        Greatest error of the tip by the steps, per length.
    tip : (T, 2) ndarray
        World positions of the tip at the instants of a ``Motion`` with far finer steps [m].
    """

    steps_per_second: int
    step_ns: float
    error: float
    tip: Array

    @property
    def real_time_factor(self) -> float:
        """Model time per time."""
        return 1e9 / (self.steps_per_second * self.step_ns)


def timing_of_comparison(scene: Scene) -> Timing:
    """A time span of at most a second with some two hundred instants.

    Raises
    ------
    InputError
        If the scene has no time.
    """
    if scene.time is None:
        raise InputError("comparing motions needs time: {duration: ..., step: ...}", key="time")
    span = min(scene.time.duration, _SPAN)
    return Timing(duration=span, step=span / INSTANTS, method="auto")


def reference_motion(scene: Scene, truth: Truth) -> Motion:
    """The motion with 12 free clothoids; its error is estimated from that with 8.

    Raises
    ------
    NumericalError
        If the motion stops.
    """
    timing = timing_of_comparison(scene).model_copy(update={"method": "rk4"})
    fine = {c.elements: c for c in choices(scene, truth, default_family(free_tip=True), 1e-9)}
    tips = []
    for count in _FINE:
        fidelity = fine[count].fidelity
        trajectory = simulate(scene.model_copy(update={"fidelity": fidelity, "time": timing}))
        tips.append(trajectory.tip)
    share = (_FINE[0] / _FINE[1]) ** 4
    error = rms(tips[1] - tips[0]) / scene.finger.rod.length * share / (1.0 - share)
    return Motion(trajectory.t, tips[1], error)


def pace(scene: Scene, model: FingerModel, tolerance: float = 1e-4) -> Pace:
    """Fewest Runge-Kutta steps whose tip stays within a tolerance of that of the same model with fine steps.

    Parameters
    ----------
    scene : Scene
        With time and with the fidelity of the model; what moves it and where it starts.
    model : FingerModel
    tolerance : float
        Greatest error of the tip by the steps, per length.

    Raises
    ------
    NumericalError
        If no number of steps that is tried does.
    """
    run = Runs(scene, model)
    finest: Array | None = None
    for k, substeps in enumerate(_SUBSTEPS):
        try:
            tip = run.tip(substeps)
        except NumericalError:
            continue
        if finest is None:
            finest = run.tip(max(4 * substeps, _SUBSTEPS[min(k + 6, len(_SUBSTEPS) - 1)]))
        error = float(np.linalg.norm(tip - finest, axis=1).max()) / model.finger.rod.length
        if error <= tolerance:
            return Pace(
                round(substeps / run.step), INTEGRATORS["rk4"].evaluations * evaluation_ns(model), error, finest
            )
    raise NumericalError(f"more than {_SUBSTEPS[-1]} sub-steps of {run.step:g} s are needed")


class Runs:
    """Rollouts of one model in its scene with any number of sub-steps."""

    def __init__(self, scene: Scene, model: FingerModel) -> None:
        self.step = timing_of_comparison(scene).step
        self._core, self._signals, self._n = Core(model), Signals(scene, model), model.n
        self._x0 = initial_state(scene, model)

    def states(self, substeps: int, method: str = "rk4") -> Array:
        """States (INSTANTS + 1, nx) with so many steps between two instants."""
        t = np.arange(2 * INSTANTS * substeps + 1) * (0.5 * self.step / substeps)
        u, w = self._signals.u(t), self._signals.w(t)
        if self._signals.constant:
            u, w = u[0], w[0]
        return self._core.rollout(self._x0, INSTANTS, self.step, u=u, w=w, substeps=substeps, method=method)

    def tip(self, substeps: int, method: str = "rk4") -> Array:
        """World positions (INSTANTS + 1, 2) of the tip [m]."""
        states = self.states(substeps, method)
        u = self._signals.u(self.step * np.arange(INSTANTS + 1))
        return np.asarray(self._core.batch("tip", states[:, : self._n], u, None))

    def seconds(self, substeps: int, method: str = "rk4") -> float:
        """Median time of a rollout [s]."""
        times = []
        for _ in range(7):
            began = perf_counter()
            self.states(substeps, method)
            times.append(perf_counter() - began)
        return float(np.median(times))


def rms(off: Array) -> float:
    """Root mean square of distances given as vectors (T, 2)."""
    return float(np.sqrt(np.mean(np.sum(np.square(off), axis=1))))
