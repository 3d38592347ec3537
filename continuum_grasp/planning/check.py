"""The inputs of a plan, played to a finely integrated model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.prediction import Prediction
from continuum_grasp.core.integrators import step_function
from continuum_grasp.core.rollouts import Rollouts, Signal
from continuum_grasp.errors import NumericalError

Array = NDArray[np.float64]

_EXPLICIT_UP_TO = 200
"""Sub-steps per part up to which the explicit method is taken."""
_RADIUS = 0.1
"""Product of step and fastest rate of the explicit method."""
_IMPLICIT_STEP = 5e-4
"""Longest step of the implicit method, for what is too stiff [s]."""
_COMPILE_FROM = 20_000_000
"""Instructions of a whole motion from which on it is compiled."""


@dataclass(frozen=True)
class Deviation:
    """How far a simulated motion is from a plan.

    Attributes
    ----------
    model : str
        What was simulated.
    tip, final_tip : float
        Largest deviation of the tip, and that at the end [m].
    final_rate : float
        Largest bending rate at the end [rad/s].
    contact_forces : tuple of float
        Normal force at each place where the finger may touch the object, at the end [N].
    """

    model: str
    tip: float
    final_tip: float
    final_rate: float
    contact_forces: tuple[float, ...] = ()


def play(model: Prediction, rate: float, x0: Array, t: Array, u: Array, p: Array, *, linear: bool, parts: int) -> Array:
    """States of a model under inputs, at ``parts`` equal parts of every interval.

    Parameters
    ----------
    rate : float
        Fastest rate of the model [1/s].
    x0 : (nx,) ndarray
    t : (N + 1,) ndarray
        Nodes [s], equally spaced.
    u : (N + 1, nu) ndarray
        Inputs at the nodes.
    p : (2 N parts + 1, np) ndarray or (1, np)
        Parameters at half parts, or constant.
    linear : bool
        Whether the input is linear between the nodes; it is held where not.
    parts : int
        Parts of an interval.

    Returns
    -------
    (N * parts + 1, nx) ndarray

    Raises
    ------
    NumericalError
        If a state is not finite; ``result`` holds the states before.
    """
    intervals, length = len(t) - 1, float(t[1] - t[0])
    method, substeps = _method(rate, length / parts)
    run = _rollout(model, method, intervals * parts * substeps)
    h = length / parts
    states = [x0[None]]
    for k in range(intervals):
        at = np.linspace(0.0, 1.0, 2 * substeps * parts + 1)[:, None]
        rows = u[k] + (u[k + 1] - u[k]) * at if linear else np.tile(u[k], (len(at), 1))
        begin, end = (np.array([2 * parts * j]) for j in (k, k + 1))
        numbers = np.tile(p[0], (len(at), 1))
        if len(p) > 1:
            instants = begin + (end - begin) * at.ravel()
            for j, column in enumerate(p.T):
                numbers[:, j] = np.interp(instants, np.arange(len(p)), column)
        found, count = run(
            np.ascontiguousarray(states[-1][-1:]),
            parts,
            substeps,
            h / substeps,
            Signal(np.ascontiguousarray(rows)[None], rows.shape[1], 0),
            Signal(np.ascontiguousarray(numbers)[None], numbers.shape[1], 0),
            np.zeros(0),
        )
        states.append(found[0, 1 : count[0] + 1])
        if count[0] < parts:
            time = float(t[k] + count[0] * h)
            message = f"the simulated state is not finite after t = {time:g} s"
            raise NumericalError(message, time=time, result=np.concatenate(states))
    return np.concatenate(states)


def _method(rate: float, step: float) -> tuple[str, int]:
    wanted = max(2, math.ceil(rate * step / _RADIUS))
    if wanted <= _EXPLICIT_UP_TO:
        return "rk4", wanted
    return "rodas", max(4, math.ceil(step / _IMPLICIT_STEP))


def _rollout(model: Prediction, method: str, steps: int) -> Rollouts:
    """Parameters take the place of forces: they may vary over time."""
    none = ca.SX.sym("none", 0)
    inputs, names = [model.x, model.u, model.p, none], ["x", "u", "w", "p"]
    rate = model.dynamics(model.x, model.u, model.p)
    dynamics = ca.Function("forward_dynamics", inputs, [rate], names, ["xd"])
    functions = SimpleNamespace(forward_dynamics=dynamics)
    if method == "rodas":
        slopes = [ca.densify(ca.jacobian(rate, v)) for v in (model.x, model.u)]
        functions.linearization = ca.Function("linearization", inputs, slopes, names, ["A", "B"])
    step = step_function(functions, method)
    return Rollouts.of(step, 4 * dynamics.n_instructions() * steps > _COMPILE_FROM)
