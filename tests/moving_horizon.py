"""Estimation over a whole record at once, by IPOPT; the check of the extended Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.control.estimation.estimator import Estimator
from continuum_grasp.core.call import real_array
from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.nlp import NLP, Budget, Settings, Start, new_solver

Array = NDArray[np.float64]

_ABSENT = 1e-9
"""Weight of a missing measurement relative to that of one [1]: keeps the problem's structure, and its square is below
rounding."""


@dataclass(frozen=True)
class Smoothed:
    """Most likely states and disturbances (K, nz) at the times of the measurements, and half the sum of squares."""

    z: Array
    cost: float


def moving_horizon(
    estimator: Estimator, measurements: ArrayLike, inputs: ArrayLike, *, p: ArrayLike | None = None
) -> Smoothed:
    """Estimate the motion that explains a record with the least start error, noise and measurement errors.

    Multiple shooting over all periods of the record: z_(k+1) = F(z_k, u_k) + L_k e_k with the noise L_k e_k of the
    estimator's own covariance, linearized along the estimator's run over the same record. The last state is what the
    estimator approximates (C. V. Rao, J. B. Rawlings, D. Q. Mayne, doi:10.1109/TAC.2002.808470). Measurements (K, ny)
    are NaN where nothing was measured; inputs (K - 1, nu) were applied between them. The estimator is reset and run.
    """
    model, settings = estimator.estimation, estimator.settings
    measured, applied = np.atleast_2d(real_array("measurements", measurements)), real_array("inputs", inputs)
    count = len(measured)
    if estimator.delay:
        raise InputError("a record needs no delay: shift its measurements instead", key="estimator.delay")
    if count < 2 or measured.shape[1] != model.nm or applied.shape != (count - 1, estimator.prediction.nu):
        raise InputError(
            f"expected (K, {model.nm}) measurements and (K - 1, {estimator.prediction.nu}) inputs, got "
            f"{measured.shape} and {applied.shape}"
        )
    nominal = estimator.prediction.p_nominal if p is None else p
    fixed = ca.DM(np.asarray(nominal, float))
    steps, h = int(np.asarray(settings["substeps"])), estimator.period / int(np.asarray(settings["substeps"]))
    filtered = _filtered(estimator, measured, applied, nominal)
    compared = np.nan_to_num(measured) @ model.mixing.T
    missing = (np.isnan(measured) @ (model.mixing != 0.0).T) > 0
    weights = np.where(missing, _ABSENT, 1.0) / np.sqrt(np.asarray(settings["variance"]))
    z, e = ca.MX.sym("z", model.nz, count), ca.MX.sym("e", model.nz, count - 1)
    after = ca.MX(z[:, :-1])
    for _ in range(steps):
        after = model.flow.map(count - 1)(after, ca.DM(applied.T), ca.repmat(fixed, 1, count - 1), h)
    roots = [_noise_root(estimator, filtered[k], applied[k], fixed, steps, h) for k in range(count - 1)]
    gaps = [after[:, k] + ca.mtimes(ca.DM(roots[k]), e[:, k]) - z[:, k + 1] for k in range(count - 1)]
    later = ca.DM(np.vstack([applied, applied[-1:]]).T)
    expected = model.outputs.map(count)(z, later, ca.repmat(fixed, 1, count))[0]
    start = (z[:, 0] - ca.DM(_start(estimator))) / ca.DM(np.sqrt(np.asarray(settings["initial"])))
    errors = ca.vertcat(start, ca.vec(e), ca.vec(ca.DM(weights.T) * (expected - ca.DM(compared.T))))
    guess = np.concatenate([filtered.ravel(), np.zeros(e.numel())])
    values, cost = _least_squares(ca.vertcat(ca.vec(z), ca.vec(e)), errors, ca.vertcat(*gaps), guess)
    return Smoothed(values[: z.numel()].reshape(count, model.nz), cost)


def _start(estimator: Estimator) -> Array:
    return np.concatenate([estimator.first, np.zeros(estimator.estimation.nz - estimator.prediction.nx)])


def _filtered(estimator: Estimator, measured: Array, applied: Array, p: ArrayLike) -> Array:
    """States of the extended Kalman filter (K, nz)."""
    estimator.reset(u=applied[0])
    before = np.vstack([applied[:1], applied])
    return np.array([estimator.step(y, u, p=p).z for y, u in zip(measured, before, strict=True)])


def _noise_root(estimator: Estimator, z: Array, u: Array, p: ca.DM, steps: int, h: float) -> Array:
    """L with L L' the covariance of the noise over a period."""
    intensity = np.diag(np.asarray(estimator.settings["noise"]))
    covariance = np.zeros_like(intensity)
    state = ca.DM(z)
    for _ in range(steps):
        state, *slopes = estimator.estimation.step(state, u, p, h)
        f, g = (np.array(a) for a in slopes)
        added = f @ intensity @ f.T + 4.0 * g @ intensity @ g.T + intensity
        covariance = f @ covariance @ f.T + h / 6.0 * added
    values, vectors = np.linalg.eigh(covariance)
    root: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _least_squares(x: ca.MX, errors: ca.MX, gaps: ca.MX, guess: Array) -> tuple[Array, float]:
    """Minimize half the sum of squares with zero gaps, by Gauss-Newton steps of IPOPT."""
    slope = ca.jacobian(errors, x)
    p, scale, multipliers = ca.MX.sym("p", 0), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", gaps.numel())
    hessian = ca.Function(
        "nlp_hess_l",
        [x, p, scale, multipliers],
        [ca.triu(scale * ca.mtimes(slope.T, slope))],
        ["x", "p", "lam_f", "lam_g"],
        ["triu_hess_gamma_x_x"],
    )
    problem = NLP("moving_horizon", x, 0.5 * ca.sumsqr(errors), gaps, p, {"hess_lag": hessian}, semidefinite=True)
    free, none = np.full(len(guess), np.inf), np.zeros(gaps.numel())
    found = new_solver(Settings(tolerance=1e-8)).solve(problem, Start(guess, -free, free, none, none), Budget())
    if not found.converged:
        raise SolverError(
            "moving horizon estimation",
            status=found.outcome,
            advice="the record may have outliers (NaN leaves them out), or noise that is far too small",
        )
    return found.x, found.objective
