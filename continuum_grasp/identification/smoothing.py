"""States of a controller's model along a log, by a smoother that lets unknown forces act on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.estimation.model import estimation_of
from continuum_grasp.control.estimation.noise import noise_of
from continuum_grasp.control.log import ControlLog
from continuum_grasp.control.ocp.scene_problem import stages_of
from continuum_grasp.control.prediction import Prediction, first_state
from continuum_grasp.control.settings import delay_periods
from continuum_grasp.core.calls import straight_function
from continuum_grasp.core.integrators import differentiated_step
from continuum_grasp.errors import NumericalError
from continuum_grasp.model.planar import solve_ldl
from continuum_grasp.scene.control import ControlScene

Array = NDArray[np.float64]

_DRIFTS = (0.005, 0.02, 0.05, 0.1, 0.3)
"""Changes of the unknown forces in a second, standard deviation per that force which bends the finger over its range
[1], of which the likeliest is taken: on logs of tendons with friction, 0.02 to 0.05."""
_DRIVES = (1.0, 0.1, 0.01)
"""Shares of the estimator's noise of drives [1], of which the likeliest is taken: it allows for drives that the model
hardly knows, and would take forces on the finger for theirs."""
_CHOSEN = 800
"""Periods by which both are chosen [1], spread over the logs; they take a millisecond each and a value."""
_SURE = 1e-6
"""Standard deviation of coordinates per period, per their range [1], and of rates per range and period: nearly none,
since the unknown forces explain what the model does not."""
_START = 5.0
"""Standard deviation of the unknown forces at the start, as their change in so many periods [1]."""


class Steps(NamedTuple):
    """Periods of a log: from states ``before`` (K, nx) to ``after`` under commands ``u`` (K, nu).

    ``predicted`` (K, nx) is what the model makes of ``before``, ``by_force`` (K, nx, n) its derivative by generalized
    forces that act throughout the period.
    """

    before: Array
    after: Array
    u: Array
    predicted: Array
    by_force: Array


class _Pass(NamedTuple):
    """Estimates (K, nz) of the state with the forces, by what was measured until then and before then, their
    covariances, the derivatives from one period to the next, and the logarithm of the likelihood.
    """

    ahead: Array
    ahead_cov: Array
    before: Array
    before_cov: Array
    slopes: Array
    likelihood: float


class Smoother:
    """States of a scene's controller along its logs.

    Generalized forces that the model misses are random walks, which are estimated with the state by an extended Kalman
    filter and a backward pass (H. E. Rauch, F. Tung, C. T. Striebel, AIAA Journal 3 (1965) 1445, doi:10.2514/3.3166).

    Raises
    ------
    InputError
        If the scene has no estimator, or its pieces do not fit.
    """

    def __init__(self, scene: ControlScene) -> None:
        self.scene = scene
        self.model = Prediction(scene)
        self._stages = stages_of(scene, self.model)
        self._estimation = estimation_of(scene, self.model, self._stages.method)
        self.period, self.delay = scene.controller.step, delay_periods(scene)
        self.n, self.nx = self.model.system.finger_model.n, self.model.nx
        self._p = np.array(self.model.p_nominal)
        self.drift, self.drives = _DRIFTS[1], _DRIVES[1]
        self._substeps = max(1, math.ceil(self._stages.substeps * self.period / self._stages.stage - 1e-9))

    @property
    def y_names(self) -> tuple[str, ...]:
        """Name and unit of each measurement."""
        return self._estimation.measurement_names

    def _rate(self, forces: ca.SX) -> ca.SX:
        """Rate of the state with further generalized forces (n), at nominal parameters."""
        model, n = self.model, self.n
        mass = ca.SX(model.system.internal(*(model.arguments[k] for k in (0, 1, 3)))[0])
        extra = solve_ldl([[mass[i, j] for j in range(n)] for i in range(n)], ca.vertsplit(forces))
        rate = model.dynamics(model.x, model.u, model.p) + ca.vertcat(ca.SX(n, 1), *extra, ca.SX(self.nx - 2 * n, 1))
        (found,) = ca.substitute([ca.densify(rate)], [model.p], [ca.SX(ca.DM(self._p))])
        return found

    @cached_property
    def _step(self) -> ca.Function:
        """(z, u) -> next x, its derivative by z = [x, forces], over a period."""
        model, n, nx = self.model, self.n, self.nx
        forces = ca.SX.sym("forces", n)
        z, rate = ca.vertcat(model.x, forces), self._rate(forces)
        found = {"rate": rate, "jacobian": ca.densify(ca.jacobian(rate, z))}
        slope = straight_function("residual_slope", {"z": z, "u": model.u}, found)
        start, u, h = ca.MX.sym("z", nx + n), ca.MX.sym("u", model.nu), ca.MX(self.period / self._substeps)
        state, by = start, ca.MX(ca.DM.eye(nx + n))
        for _ in range(self._substeps):
            end, own = differentiated_step(self._stages.method, "residual", slope, state, (u,), h)
            by = ca.mtimes(ca.vertcat(own, ca.horzcat(ca.MX(n, nx), ca.MX.eye(n))), by)
            state = ca.vertcat(end, start[nx:])
        return ca.Function("period", [start, u], [state[:nx], ca.densify(by[:nx, :])])

    def flow(self, forces: ca.SX, weights: ca.SX) -> ca.Function:
        """(x, u, weights) -> next x over a period, under forces (n) as functions of the model's x, u and weights."""
        model, rate = self.model, self._rate(forces)
        found = {"rate": rate, "jacobian": ca.densify(ca.jacobian(rate, model.x))}
        slope = straight_function("learned_slope", {"x": model.x, "u": model.u, "weights": weights}, found)
        x, u, w = (ca.MX.sym("v", size.numel()) for size in (model.x, model.u, weights))
        state, h = x, ca.MX(self.period / self._substeps)
        for _ in range(self._substeps):
            (state,) = differentiated_step(self._stages.method, "learned", slope, state, (u, w), h, instants=0)
        return ca.Function("flow", [x, u, w], [state])

    @cached_property
    def _measured(self) -> ca.Function:
        """(x, u) -> what is compared, and its derivative by x."""
        z, u = ca.SX.sym("z", self._estimation.nz), ca.SX.sym("u", self.model.nu)
        y, by = self._estimation.outputs(z, u, ca.SX(ca.DM(self._p)))
        rest = z[self.nx :]
        y, by = ca.substitute([y, by[:, : self.nx]], [rest], [ca.SX.zeros(rest.numel())])
        return ca.Function("compared", [z[: self.nx], u], [ca.densify(y), ca.densify(by)])

    @cached_property
    def _noise(self) -> tuple[Array, Array, Array]:
        """Variances of z per period and at the start, and of what is compared."""
        n, nx = self.n, self.nx
        process, initial, measured = noise_of(self.scene, self.model, self._estimation)
        made = self.model.system.finger_model.structure
        reach = np.array(made.coordinate_limits())
        stiffness = np.array(self.model.system.internal(np.zeros(self.model.system.nx), *self._at_rest)[1])
        rows = np.concatenate([process[:nx], (np.diag(stiffness) * reach) ** 2]) * self.period
        rows[:n], rows[n : 2 * n] = (_SURE * reach) ** 2, (_SURE * reach / self.period) ** 2
        return rows, initial[:nx], measured

    def choose_noise(self, logs: Sequence[ControlLog]) -> None:
        """Take the drift of the unknown forces, and the noise of the drives, by which the logs are likeliest."""
        cut = [_head(log, _CHOSEN // len(logs)) for log in logs]
        for key, values in (("drift", _DRIFTS), ("drives", _DRIVES)):
            found = [self._likelihood(cut, key, value) for value in values]
            setattr(self, key, values[int(np.argmax(found))])

    def _likelihood(self, logs: Sequence[ControlLog], key: str, value: float) -> float:
        setattr(self, key, value)
        return sum(self._filter(log).likelihood for log in logs)

    @property
    def _at_rest(self) -> tuple[Array, Array]:
        system = self.model.system
        return np.zeros(system.nu), self._p[: system.np]

    def compared(self, log: ControlLog) -> Array:
        """Measurements of each state (K, ny), NaN where one is missing: a delay after its measurement."""
        mixed = np.full((len(log.y), self._estimation.ny), np.nan)
        rows = np.where(np.isfinite(log.y), log.y, np.nan)
        # A sum with a share of zero does not miss what is missing.
        for row, shares in zip(mixed.T, self._estimation.mixing, strict=True):
            used = shares != 0.0
            row[: len(rows) - self.delay] = (rows[:, used] @ shares[used])[self.delay :]
        return mixed

    def _filter(self, log: ControlLog) -> _Pass:
        """The pass forward.

        Raises
        ------
        NumericalError
            If estimates do not stay finite: the log is not of this model.
        """
        n, nx, nz = self.n, self.nx, self.nx + self.n
        process, initial, variance = self._noise
        process = process * np.repeat([1.0, self.drives**2, self.drift**2], [2 * n, nx - 2 * n, n])
        y, count = self.compared(log), len(log.t)
        z = np.concatenate([first_state(self.scene, self.model), np.zeros(n)])
        cov = np.diag(np.concatenate([initial, _START**2 * process[nx:]]))
        ahead, before = np.zeros((count, nz)), np.zeros((count, nz))
        ahead_cov, before_cov, slopes = (np.zeros((count, nz, nz)) for _ in range(3))
        likelihood = 0.0
        for k in range(count):
            before[k], before_cov[k] = z, cov
            seen = np.isfinite(y[k])
            if seen.any():
                # The input of a measurement is that before it, as the estimator has it.
                value, slope = (np.array(part) for part in self._measured(z[:nx], log.u[max(k - 1, 0)]))
                h, innovation = np.hstack([slope, np.zeros((len(slope), n))])[seen], (y[k] - value.ravel())[seen]
                spread = h @ cov @ h.T + np.diag(variance[seen])
                gain = np.linalg.solve(spread, h @ cov).T
                z, left = z + gain @ innovation, np.eye(nz) - gain @ h
                # Joseph's form, which stays positive.
                cov = left @ cov @ left.T + (gain * variance[seen]) @ gain.T
                size = innovation @ np.linalg.solve(spread, innovation) + np.linalg.slogdet(spread)[1]
                likelihood -= 0.5 * float(size)
            ahead[k], ahead_cov[k] = z, cov
            end, by = (np.array(part) for part in self._step(z, log.u[k]))
            slopes[k] = np.vstack([by, np.hstack([np.zeros((n, nx)), np.eye(n)])])
            z, cov = np.concatenate([end.ravel(), z[nx:]]), slopes[k] @ cov @ slopes[k].T + np.diag(process)
            if not (np.all(np.isfinite(z)) and np.all(np.isfinite(cov))):
                raise NumericalError(
                    f"{log.name}: the model does not follow the log after t = {log.t[k]:g} s: it has other units, "
                    "another delay or another finger than the scene says",
                    time=float(log.t[k]),
                )
        return _Pass(ahead, ahead_cov, before, before_cov, slopes, likelihood)

    def states(self, log: ControlLog) -> Array:
        """Smoothed states (K, nx) at the instants of a log.

        Raises
        ------
        NumericalError
            If estimates do not stay finite.
        """
        found = self._filter(log)
        smooth = found.ahead.copy()
        for k in range(len(smooth) - 2, -1, -1):
            # In standard deviations: states differ by ten orders of magnitude in their units.
            unit = np.sqrt(np.maximum(np.diag(found.before_cov[k + 1]), 1e-300))
            spread = found.before_cov[k + 1] / unit[:, None] / unit
            back = np.linalg.solve(spread, found.slopes[k] @ found.ahead_cov[k] / unit[:, None]).T / unit
            smooth[k] += back @ (smooth[k + 1] - found.before[k + 1])
        return smooth[:, : self.nx]

    def steps(self, states: Array, u: Array) -> Steps:
        """Periods between states (K + 1, nx) under commands (K, nu)."""
        z = np.hstack([states[:-1], np.zeros((len(u), self.n))])
        ends, slopes = zip(*(self._step(row, command) for row, command in zip(z, u, strict=True)), strict=True)
        predicted, by = np.array(ends).reshape(len(u), -1), np.array([np.array(s) for s in slopes])
        return Steps(states[:-1], states[1:], u, predicted, by[:, :, self.nx :])


def _head(log: ControlLog, count: int) -> ControlLog:
    """The first periods of a log."""
    part = slice(max(count, 2))
    return ControlLog(log.t[part], log.u[part], log.y[part], log.u_names, log.y_names, log.name)
