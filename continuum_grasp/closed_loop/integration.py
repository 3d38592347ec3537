"""Accurate integration of a plant over one control period, in compiled C."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.core.integrators import step_function
from continuum_grasp.core.rollouts import Rollouts, Signal
from continuum_grasp.errors import NumericalError
from continuum_grasp.model.remade import Remade
from continuum_grasp.simulation.spectrum import TARGET_RADIUS, sample_shapes

__all__ = ["Integration", "Method", "choose_method"]

Array = NDArray[np.float64]

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
    model : PlantModel
    period : float
        Control period [s].

    Returns
    -------
    Method
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
    model : PlantModel
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
