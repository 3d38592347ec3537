"""Motion of plants by steps of a method of ``INTEGRATORS``."""

from __future__ import annotations

import numpy as np

from continuum_grasp.base import Array, NumericalError
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.closed_loop.shared_object import SharedModel
from continuum_grasp.core import (
    CodeKind,
    Rollouts,
)
from continuum_grasp.model import Remade


class Integration(Remade):
    """Integrates a plant, or several that touch one object, over periods of constant input.

    By a method of ``INTEGRATORS``.
    """

    def __init__(self, model: PlantModel | SharedModel, method: str) -> None:
        self._model = model
        self.run = Rollouts.by(method, model, what="the plant")

    def prepare(self, steps: float) -> CodeKind:
        """Compile the steps, if their number pays for it; return the kind of their code."""
        return self.run.code.expect(steps).kind

    def advance(self, x: Array, u: Array, start: float, period: float, substeps: int) -> Array:
        """Compute the states (substeps + 1, nx) at equal instants of a period [s], from x (nx) with constant u (nu).

        Where one is not finite, or has no solution, ``NumericalError`` states when, and holds the states before.
        """
        states, done, why = self._steps(x, np.ascontiguousarray(u, dtype=float), start, period / substeps, substeps)
        if done == substeps:
            return states
        time = start + done * period / substeps
        last = states[done]
        text = why.format(time=f"{time:g}", last=last.tolist())
        raise NumericalError(text, time=time, state=last, result=states[: done + 1])

    def _steps(self, x: Array, u: Array, start: float, step: float, count: int) -> tuple[Array, int, str]:
        """States, how many after the first are good, and a reason where the next one is not."""
        model = self._model
        steady = self._model.steady
        # At the start, the middle and the end of each step, where the methods evaluate forces.
        instants = 1 if steady else 2 * count + 1
        rows = model.forces(start + np.arange(instants) * (0.5 * step))
        begin = np.ascontiguousarray(x, dtype=float)[None]
        states, valid = self.run(begin, count, 1, step, u, rows, model.p)
        why = (
            "the plant's state is not finite after t = {time} s (last finite state {last}): its loads or inputs bend "
            "it further than its elements can; see plant.fidelity.elements and loads"
        )
        return states[0], int(valid[0]), why
