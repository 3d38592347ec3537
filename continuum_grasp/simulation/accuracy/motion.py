"""Motions against a reference model, and how long they and the equations take."""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import get_clock_info, perf_counter, thread_time

import numpy as np

from continuum_grasp.base import Array, InputError, NumericalError
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import FAMILIES, INTEGRATORS, Scene, Timing
from continuum_grasp.simulation.accuracy.choice import choices
from continuum_grasp.simulation.accuracy.truth import Truth
from continuum_grasp.simulation.initial import initial_state
from continuum_grasp.simulation.run import integrate
from continuum_grasp.simulation.signals import Signals

_FINE = (8, 12)
"""Clothoids of the two reference motions; their difference shows how good the second is, by the fourth order."""
INSTANTS = 200
"""At which tips are compared: 5 ms apart in a motion of a second."""
_SUBSTEPS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 1024)
"""Steps between two instants that are tried; the pace is known to the ratio of neighbors, from 4 on at most 1.5."""


@dataclass(frozen=True)
class TipMotion:
    """Tip of the finger over time."""

    t: Array  # (T,) instants [s]
    tip: Array  # (T, 2) world positions [m]
    error: float = math.nan  # estimated, r.m.s., per length; NaN for a motion that is compared, not a reference


@dataclass(frozen=True)
class Pace:
    """Speed of a model at a given error of the time steps alone."""

    steps_per_second: int  # Runge-Kutta steps per second of model time
    step_ns: float  # time of one [ns], in C if a compiler is available
    error: float  # greatest of the tip by the steps, per length
    tip: Array  # (T, 2) world positions at the instants of a ``Motion`` with far finer steps [m]

    @property
    def real_time_factor(self) -> float:
        return 1e9 / (self.steps_per_second * self.step_ns)


def timing_of_comparison(scene: Scene) -> Timing:
    """A time span of at most a second with some two hundred instants."""
    if scene.time is None:
        raise InputError("comparing motions needs time: {duration: ..., step: ...}", key="time")
    # 1.0: longest motion that is compared [s]: a phase error grows with time and hides every other in the end
    span = min(scene.time.duration, 1.0)
    return Timing(duration=span, step=span / INSTANTS, method="auto")


def reference_motion(scene: Scene, truth: Truth) -> TipMotion:
    """Compute the motion with 12 free clothoids; the motion with 8, and longer steps, show its error.

    Steps are implicit for stiff elements: twelve elements of the hand's finger on winches change at 6e6 1/s.
    """
    # 2e-7: error of the time steps of reference motions, per length: far below what twelve clothoids leave
    timing = timing_of_comparison(scene).model_copy(update={"tolerance": 2e-7})
    fine = {c.elements: c for c in choices(scene, truth, FAMILIES.default(free_tip=True), 1e-9)}
    tips = []
    for count in _FINE:
        fidelity = fine[count].fidelity
        trajectory = integrate(scene.model_copy(update={"fidelity": fidelity, "time": timing}))
        tips.append(trajectory.tip)
    # The errors e and e (8/12)^4 have a known difference: the finer one is this difference times share / (1 - share).
    share = (_FINE[0] / _FINE[1]) ** 4
    error = rms(tips[1] - tips[0]) / scene.finger.rod.length * share / (1.0 - share)
    return TipMotion(trajectory.t, tips[1], error + trajectory.time_error)


def pace(scene: Scene, model: FingerModel, tolerance: float = 1e-4) -> Pace:
    """Find the fewest Runge-Kutta steps whose tip stays within a tolerance of the same model with fine steps.

    The scene, with the fidelity of the model, states inputs, loads and start; the tolerance is per length. Raises
    NumericalError if no tried number of steps suffices.
    """
    core = Core(model)
    signals = Signals(scene, model)
    step = timing_of_comparison(scene).step
    x0 = initial_state(scene, model)

    def tip(substeps: int, instants: int = INSTANTS) -> Array:
        """Return world positions (instants + 1, 2) [m] with a number of steps between two instants."""
        t = np.arange(2 * instants * substeps + 1) * (0.5 * step / substeps)
        u, w = signals.u(t), signals.w(t)
        once = (u[0], w[0]) if signals.constant else (u, w)
        states = core.rollout(x0, instants, step, u=once[0], w=once[1], substeps=substeps)
        return np.asarray(core.batch("tip", states[:, : model.n], u[:: 2 * substeps], None))

    finest: Array | None = None
    for k, substeps in enumerate(_SUBSTEPS):
        try:
            # 10: instants until which steps that are too long have mostly run away: those are given up after a
            # twentieth
            tip(substeps, 10)
            path = tip(substeps)
        except NumericalError:
            continue
        # The first stable number, refined by four at least: fourth order leaves 1/256 of its error.
        if finest is None:
            finest = tip(max(4 * substeps, _SUBSTEPS[min(k + 6, len(_SUBSTEPS) - 1)]))
        error = float(np.linalg.norm(path - finest, axis=1).max()) / model.finger.rod.length
        if error <= tolerance:
            return Pace(round(substeps / step), INTEGRATORS["rk4"].evaluations * evaluation_ns(model), error, finest)
    raise NumericalError(f"more than {_SUBSTEPS[-1]} sub-steps of {step:g} s are needed")


def rms(off: Array) -> float:
    """Root mean square of distances given as vectors (T, 2)."""
    return float(np.sqrt(np.mean(np.sum(np.square(off), axis=1))))


_STEPS = 2000
"""Steps of a timed rollout: 8,000 evaluations, which take far longer than the resolution of the timers."""


def evaluation_ns(model: FingerModel) -> float:
    """Measure the median processor time of one forward dynamics inside a Runge-Kutta rollout [ns].

    The code is C if a compiler is available. Each evaluation waits for the previous one, as in any simulation. The work
    of other processes does not count if the system measures processor time finely enough.
    """
    clock = thread_time if get_clock_info("thread_time").resolution <= 1e-6 else perf_counter
    core = Core(model)
    core.prepare_rollout("rk4")
    start = np.zeros(model.nx)
    # Not zero, whose powers are denormal numbers, which processors are slow with.
    start[: model.n] = 0.4 * np.array(model.structure.coordinate_limits())
    times = []
    # 7: timed rollouts; the median counts
    for _ in range(7):
        began = clock()
        core.rollout(start, _STEPS, 1e-9)
        times.append(clock() - began)
    return float(1e9 * np.median(times) / (INTEGRATORS["rk4"].evaluations * _STEPS))
