"""A plant cheap enough for a million control periods: a controller's own model with other disturbances, compiled."""

from __future__ import annotations

from functools import partial

import casadi as ca
import numpy as np

from benchmarks.mpc.cases import state_step
from continuum_grasp.base import Array
from continuum_grasp.control import Controller
from continuum_grasp.control.estimation.model import estimation_of
from continuum_grasp.control.estimation.noise import ranges_of
from continuum_grasp.core import CSource
from continuum_grasp.core.caller import Caller
from continuum_grasp.core.code import Backend, FunctionCode

FINER = 2
"""Runge-Kutta steps of the plant for one of the controller's model."""
RESTS = 600
"""Steps after which a plant under a constant input rests, whose motion is damped."""
DAMPED = 0.9
"""Share of its rates that each of these steps leaves."""


class World:
    """The plant of a controller; its state ``z`` may be set.

    That is the state of the estimator, disturbances included, or that of the model where there is none, which has
    ``nx`` entries. ``ranges`` are the limits of the controller's numbers.
    """

    def __init__(self, controller: Controller) -> None:
        model, stages, scene = controller.prediction, controller.stages, controller.scene
        estimation = None if scene.estimator is None else estimation_of(scene, model, stages.method)
        self.ranges = ranges_of(scene, model, stages, estimation)
        self.nx = model.nx
        self._rates = [k for k, name in enumerate(model.x_names) if "_rate " in name]
        nz = model.nx if estimation is None else estimation.nz
        z, u, p = ca.MX.sym("z", nz), ca.MX.sym("u", stages.nu), ca.MX.sym("p", stages.np)
        count = FINER * max(1, round(stages.substeps * controller.period / stages.stage))
        after = z
        for _ in range(count):
            step = controller.period / count
            if estimation is None:
                held = ca.vertcat(after, u[: stages.nx - nz])
                after = state_step(stages)(held, u, p, step)[:nz]
            else:
                after = estimation.flow(after, u, p, step)
        measured = after if estimation is None else estimation.outputs(after, u, p)[0]
        outputs = [ca.densify(after), ca.densify(measured)]
        world = ca.Function("world", [z, u, p], outputs, ["z", "u", "p"], ["zn", "y"])
        backend = Backend(what="the plant of a benchmark")
        code = FunctionCode(world, partial(CSource([world]).of_core, "world"), backend, from_python=True)
        self._advance = Caller(world, code, np.array(stages.p_nominal)).prepare()
        mixing = np.eye(nz) if estimation is None else estimation.mixing
        self._unmix = np.linalg.pinv(mixing)
        self._rest = (np.eye(mixing.shape[1]) - self._unmix @ mixing) @ np.full(mixing.shape[1], 5.0)
        delay = 0 if scene.estimator is None else round(scene.estimator.delay / controller.period)
        self.first = np.zeros(nz)
        self.first[: model.nx] = controller.first
        self.z = self.first.copy()
        self._ring = [self._still(controller)] * delay

    def _still(self, controller: Controller) -> Array:
        """What is measured before anything has moved."""
        rest = np.clip(np.zeros(controller.stages.nu), controller.stages.u_min, None)
        return self._seen(self._advance(self.z, rest, controller.stages.p_nominal)[1])

    def _seen(self, y: Array) -> Array:
        return self._unmix @ y + self._rest

    def step(self, u: Array, p: Array) -> Array:
        """Go on for a period; what is measured then (of the past, where measurements are late)."""
        self.z[:], y = self._advance(self.z, u, p)
        self._ring.append(self._seen(y))
        return self._ring.pop(0)

    def sound(self) -> bool:
        """Whether the state is where the model means something."""
        x = self.z[: self.nx]
        return bool(np.isfinite(self.z).all() and (np.abs(x) <= self.ranges.x[:, 1]).all())

    def reset(self) -> None:
        """Back to the first state, disturbances unchanged."""
        self.z[: self.nx] = self.first[: self.nx]

    def rest(self, u: Array, p: Array, steps: int = RESTS) -> Array:
        """Measurements while the plant comes to rest under an input, from the first state: a row per step.

        Rates are damped beyond the model's, which moves no rest: a heavy rod swings for a minute else.
        """
        self.reset()
        rows = []
        for _ in range(steps):
            rows.append(self.step(u, p))
            self.z[self._rates] *= DAMPED
        return np.array(rows)
