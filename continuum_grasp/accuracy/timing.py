"""How long the equations take, and how far their evaluation is off."""

from __future__ import annotations

from collections.abc import Callable
from time import get_clock_info, perf_counter, thread_time
from typing import Any

import numpy as np

from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.integrators import INTEGRATORS

__all__ = ["evaluation_error", "evaluation_ns"]

_STATES = 64
"""Random states over which the greatest error is taken; seeded, so that the figure repeats."""
_STEPS = 2000
"""Of a timed rollout: 8,000 evaluations, which take far longer than the resolution of the timers."""
_REPEATS = 7
"""Timed rollouts, of which the median counts."""


def evaluation_ns(model: FingerModel, precision: str = "double") -> float:
    """Median processor time of one forward dynamics inside a Runge-Kutta rollout [ns].

    In C where there is a compiler; each evaluation waits for the one before, as in any simulation. What other
    processes do meanwhile does not count where the system tells processor time finely enough.
    """
    clock = thread_time if get_clock_info("thread_time").resolution <= 1e-6 else perf_counter
    core = Core(model, precision=precision)
    core.prepare_rollout("rk4")
    start = np.zeros(model.nx)
    start[: model.n] = 0.4 * np.array(
        model.structure.coordinate_limits()
    )  # not zero, whose powers are numbers that processors are slow with
    times = []
    for _ in range(_REPEATS):
        began = clock()
        core.rollout(start, _STEPS, 1e-9)
        times.append(clock() - began)
    return float(1e9 * np.median(times) / (INTEGRATORS["rk4"].evaluations * _STEPS))


def evaluation_error(dynamics: Callable[..., Any], model: FingerModel) -> float:
    """Greatest error of the accelerations of another evaluation of a model, per their greatest entry over the states.

    Parameters
    ----------
    dynamics : callable
        (x, u, w, p) -> xd, an evaluation that is not exact.
    model : FingerModel
        The same model, evaluated as well as can be. States are spread over its declared bending ranges, at rates that
        swing through them in the time of the rod's first oscillation.
    """
    random = np.random.default_rng(0)
    reach, n = np.array(model.structure.coordinate_limits()), model.n
    rod = model.finger.rod
    rate = 3.516 * np.sqrt(rod.stiffness / (rod.mass_per_length * rod.length**4))
    u, w, p = np.zeros(model.nu), np.zeros(model.nw), np.array(model.p_nominal)
    worst = size = 0.0
    for _ in range(_STATES):
        x = np.zeros(model.nx)
        x[:n] = random.uniform(-1.0, 1.0, n) * reach
        x[n : 2 * n] = random.uniform(-1.0, 1.0, n) * reach * rate
        exact = np.array(model.forward_dynamics(x, u, w, p)).ravel()[n : 2 * n]
        near = np.array(dynamics(x, u, w, p)).ravel()[n : 2 * n]
        worst, size = max(worst, float(np.abs(near - exact).max())), max(size, float(np.abs(exact).max()))
    return worst / size
