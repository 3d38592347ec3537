"""Learn the forces that a controller's model misses from its logs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from os import PathLike
from time import perf_counter
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arguments import check_arguments
from continuum_grasp.control.log import ControlLog
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.errors import InputError
from continuum_grasp.identification.control_logs import Log, read_logs, refuse_implausible
from continuum_grasp.identification.residual import OneStepError, ResidualFit
from continuum_grasp.identification.smoothing import Smoother, Steps
from continuum_grasp.model.learned_residual import distance, terms
from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.learned_residual import LearnedResidual, ResidualTraining
from continuum_grasp.scene.load import scene_of

Array = NDArray[np.float64]

_LEARNING = Consumer(
    "identify of a residual", refused={"object": "a residual is learned from free motion: leave the object out"}
)
_KERNELS = (0, 6, 12)
"""Numbers of kernels that are tried [1]. Twelve add a fifth to a controller's step with two clothoids."""
_WIDTH = 6.0
"""Distance at which a kernel ends [standard deviations of the logs]; 3 and 9 give errors within a fifth of it."""
_RIDGES = (1e-6, 1e-4, 1e-2)
"""Weights of the squared weights per that of the errors that are tried [1]."""
_AHEAD = 10
"""Periods of the predictions by which kernels and ridge are chosen [1]. One period does not do: the difference between
tip moment and shape tells the friction of the next instant best, and a model that feeds it back diverges in a plan."""
_EVERY = 5
"""Periods from one such prediction to the next [1]."""
_SIMPLER = 1.1
"""Error of fewer kernels per the least one that is accepted [1]: their time is saved in every step."""
_GAIN = 0.7
"""Share of the one-step errors of the tip's velocity that must be left at most, or nothing was learned [1]: of logs of
the model itself, what the smoother takes for forces leaves 0.8."""
_HARM = 1.0
"""Share of the errors over ten periods that must be left at most [1]. Friction that sticks is in these and in no
function of the state, so that they fall less: to 0.6 to 0.9 with tendon friction."""
_EDGE = 5
"""Periods at both ends of a log that are left out [1]: states are uncertain where one side shows nothing."""
_LEAST = 100
"""Least number of periods per feature [1]."""
_SHRINK = 0.05
"""Added to the variances of scaled features [1], so that directions in which the logs hardly vary do not count as far
away at once: a shape and its tip moment move together within 5 %."""
_ROUNDS = 20
"""Rounds of moving the kernels to the means of points near them [1]; they settle in about ten."""


@check_arguments
def learn_residual(
    scene: ControlScene | str | PathLike[str],
    logs: Sequence[Log],
    *,
    holdout: Sequence[Log] = (),
    progress: Callable[[float], None] | None = None,
) -> ResidualFit:
    """Learn the generalized forces that the model of a controller misses, from what it measured and commanded.

    Parameters
    ----------
    scene : ControlScene or path-like
        The controller, whose estimator says what its logs measured; a residual that it has is left out.
    logs : sequence of ControlLog or path-like
        Logs of free motion, as ``ControlRun.log`` and ``log.csv`` of a run have them.
    holdout : sequence of ControlLog or path-like
        Further logs, on which the residual is tried and from which nothing is learned.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    ResidualFit

    Raises
    ------
    InputError
        If logs and scene do not fit together, or the logs are too short.
    SolverError
        If a log cannot be that of this finger, with the status ``implausible``.
    NumericalError
        If the model does not follow a log.

    Notes
    -----
    States along the logs come from a smoother that lets unknown forces act. What the model misses of each period is
    then linear in the weights of the residual, which are those of least squares with a ridge; the number of kernels and
    the ridge are those that predict ten periods best. The same logs give the same residual.

    Examples
    --------
    >>> from continuum_grasp.identification import learn_residual
    >>> fit = learn_residual("configs/mpc/learned_friction.yaml", ["configs/mpc/learned_friction_log.csv"])
    >>> fit.errors[0].velocity_with < 0.5 * fit.errors[0].velocity
    True
    """
    started = perf_counter()
    scene = scene_of(scene, ControlScene)
    _LEARNING.check(scene)
    if scene.fidelity.residual is not None:
        scene = scene.changed({"fidelity.residual": None})
    report = progress or (lambda share: None)
    smoother = Smoother(scene)
    model = smoother.model
    own = read_logs([*logs, *holdout], model.u_names, smoother.y_names, smoother.period)
    if not logs:
        raise InputError("expected a log at least", key="data")
    features = _Features(model)
    names = features.names
    rows = sum(len(log.t) for log in own[: len(logs)])
    if rows < _LEAST * len(names) or any(len(log.t) <= 4 * _EDGE for log in own):
        raise InputError(
            f"expected {_LEAST * len(names)} periods or more to learn from ({_LEAST} for each of "
            f"{', '.join(names)}), {4 * _EDGE + 1} in each log, got {rows} in {len(logs)}",
            key="data",
        )
    for log in own:
        refuse_implausible(scene, log, smoother.delay)
    smoother.choose_noise(own[: len(logs)])
    report(0.5)
    steps = [_inner(smoother, log) for log in own]
    report(0.8)
    learned, choice = _learn(smoother, features, steps[: len(logs)], [log.name for log in own[: len(logs)]])
    tip, found = _TipErrors(model), []
    for k, (log, own_steps) in enumerate(zip(own, steps, strict=True)):
        found.append(_tried(tip, features, learned, own_steps, log.name, k >= len(logs)))
    errors, without, with_residual, far = zip(*found, strict=True)
    report(1.0)
    left, whole = (np.concatenate(rows[: len(logs)])[:, 2:] for rows in (with_residual, without))
    gained = np.sum(left**2) <= _GAIN**2 * np.sum(whole**2) and choice.share <= _HARM
    status = "learned" if gained else "nothing_learned"
    return ResidualFit(
        residual=learned if status == "learned" else None,
        errors=errors,
        without=np.vstack(without),
        with_residual=np.vstack(with_residual),
        distance=np.concatenate(far),
        scene=scene,
        status=status,
        warnings=_warnings(status, errors),
        statistics={
            "total_s": perf_counter() - started,
            "kernels": choice.kernels,
            "ridge": choice.ridge,
            "error_share": choice.share,
            "force_drift": smoother.drift,
            "drive_noise": smoother.drives,
        },
    )


class _Features:
    """Features of a residual along periods: coordinates, rates, and what drives exert, or inputs without a lag."""

    def __init__(self, model: Prediction) -> None:
        finger, own = model.system.finger_model, model.system
        self.model, self.n = model, finger.n
        self.coordinates = tuple(finger.x_names[: finger.n])
        driven = [model.x_names[one.state] for one in model.driven]
        acting = [name for name in driven if name in own.x_names or name in own.u_names]
        self.drives = tuple(acting or own.u_names[: model.nu])
        found = dict(zip([*model.u_names, *model.x_names], ca.vertsplit(ca.vertcat(model.u, model.x)), strict=True))
        self.symbols = [*ca.vertsplit(model.x[: 2 * finger.n]), *(found[name] for name in self.drives)]
        self.names = (*model.x_names[: 2 * finger.n], *self.drives)
        self._of = ca.Function("features", [model.x, model.u], [ca.vertcat(*self.symbols)])

    def within(self, steps: Steps) -> Array:
        """Features (K, d) half-way through each period."""
        x = 0.5 * (steps.before + steps.predicted)
        return np.array(self._of.map(len(x))(x.T, steps.u.T)).reshape(-1, len(x), order="F").T


def _inner(smoother: Smoother, log: ControlLog) -> Steps:
    """The periods of a log without its ends."""
    states = smoother.states(log)
    inner = slice(_EDGE, len(states) - _EDGE - smoother.delay)
    return smoother.steps(states[inner], log.u[inner][:-1])


class _Choice(NamedTuple):
    kernels: int
    ridge: float
    share: float


def _learn(
    smoother: Smoother, features: _Features, logs: Sequence[Steps], names: Sequence[str]
) -> tuple[LearnedResidual, _Choice]:
    """The residual by least squares, its kernels and ridge by predictions over ten periods."""
    steps = Steps(*(np.concatenate(parts) for parts in zip(*logs, strict=True)))
    made, n = features.model.system.finger_model, features.n
    values = features.within(steps)
    center, scale = values.mean(axis=0), values.std(axis=0)
    still = [name for name, spread in zip(features.names, scale, strict=True) if spread <= 0.0]
    if still:
        raise InputError(f"{still[0]} does not vary in the logs: expected a motion that bends the finger", key="data")
    z = (values - center) / scale
    inverse = np.linalg.inv(z.T @ z / len(z) + _SHRINK * np.eye(len(center)))
    metric = np.triu(np.linalg.cholesky(inverse).T)
    missed = (steps.after - steps.predicted)[:, : 2 * n]
    unit = np.sqrt(np.mean(missed**2, axis=0))
    unit = np.where(unit > 0.0, unit, 1.0)
    targets, slopes = missed / unit, steps.by_force[:, : 2 * n] / unit[:, None]

    def residual(kernels: Array, weights: Array | None = None, **more: Any) -> LearnedResidual:
        size = 1 + 3 * n + n * len(features.drives) + len(kernels)
        return LearnedResidual(
            family=made.family,
            elements=tuple(made.lengths),
            coordinates=features.coordinates,
            drives=features.drives,
            center=tuple(center.tolist()),
            scale=tuple(scale.tolist()),
            metric=tuple(map(tuple, metric.tolist())),
            radius=float(np.sqrt(((z @ metric.T) ** 2).sum(axis=1).max())),
            kernels=tuple(map(tuple, kernels.tolist())),
            width=_WIDTH,
            weights=tuple(map(tuple, (np.zeros((n, size)) if weights is None else weights).tolist())),
            **more,
        )

    ahead, tried = _Ahead(smoother, logs), []
    for count in _KERNELS:
        kernels = _kernels(z, count)
        empty = residual(kernels)
        weights = ridge_weights(_along(partial(terms, empty), values), slopes, targets, _RIDGES)
        own = ca.SX.sym("weights", n * len(empty.weights[0]))
        forces = ca.mtimes(ca.reshape(own, -1, n).T, ca.vertcat(*map(ca.SX, terms(empty, features.symbols))))
        flow = smoother.flow(forces, own)
        tried += [(ahead.share(flow, one), ridge, kernels, one) for ridge, one in zip(_RIDGES, weights, strict=True)]
    least = min(share for share, *_ in tried)
    simplest = min(len(kernels) for share, _, kernels, _ in tried if share <= _SIMPLER * least)
    share, ridge, kernels, best = min(
        (one for one in tried if len(one[2]) == simplest), key=lambda one: (one[0], one[1])
    )
    training = ResidualTraining(logs=tuple(names), rows=len(z), ridge=ridge, error_share=share)
    return residual(kernels, best.reshape(n, -1), training=training), _Choice(len(kernels), ridge, share)


class _Ahead:
    """Predictions of the tip over some periods, from smoothed states along logs."""

    def __init__(self, smoother: Smoother, logs: Sequence[Steps]) -> None:
        self._tip = _TipErrors(smoother.model)
        edges = np.cumsum([0, *(len(log.u) for log in logs)])
        self._starts = np.concatenate([np.arange(a, b - _AHEAD, _EVERY) for a, b in pairwise(edges)])
        self._steps = Steps(*(np.concatenate(parts) for parts in zip(*logs, strict=True)))

    def share(self, flow: ca.Function, weights: Array) -> float:
        """Root mean square of the error, per that without a residual [1]; infinite where it diverges."""
        left, nominal = (self._square(flow, self._starts, w) for w in (weights, np.zeros_like(weights)))
        return float(np.sqrt(left / nominal)) if nominal > 0.0 and np.isfinite(left) else np.inf

    def _square(self, flow: ca.Function, starts: NDArray[np.intp], weights: Array) -> float:
        """Sum of the squared errors of the tip's position."""
        x, run = self._steps.before[starts].T, flow.map(len(starts))
        for j in range(_AHEAD):
            x = np.array(run(x, self._steps.u[starts + j].T, np.tile(weights[:, None], len(starts))))
        error = self._tip.between(x.T, self._steps.after[starts + _AHEAD - 1], self._steps.u[starts])[:, :2]
        return float(np.sum(error**2))


def _kernels(z: Array, count: int) -> Array:
    """Means (count, d) of groups of near samples (S. Lloyd, IEEE Trans. Inf. Theory 28 (1982) 129), from samples evenly
    spread over the logs, so that the same logs give the same ones.
    """
    from scipy.cluster.vq import kmeans2

    start = z[np.linspace(0, len(z) - 1, count + 2).astype(int)[1:-1]]
    return np.asarray(kmeans2(z, start, iter=_ROUNDS, minit="matrix")[0]) if count else start


def _along(function: Callable[[list[ca.SX]], Sequence[ca.SX | float]], values: Array) -> Array:
    """Rows (K, size) of a function of features at values (K, d)."""
    given = ca.SX.sym("features", values.shape[1])
    found = ca.vertcat(*map(ca.SX, function(ca.vertsplit(given))))
    mapped = ca.Function("along", [given], [ca.densify(found)]).map(len(values))
    return np.array(mapped(values.T)).reshape(-1, len(values), order="F").T


def ridge_weights(factors: Array, slopes: Array, targets: Array, ridges: Sequence[float]) -> list[Array]:
    """Weights (n * size,), for each ridge, of targets (K, m) = slopes (K, m, n) weights (n, size) factors (K, size).

    Columns are scaled to a mean square of one, and the ridge counts per row.
    """
    whole = np.einsum("kmn,ks->kmns", slopes, factors).reshape(targets.size, -1)
    unit = np.sqrt(np.mean(whole**2, axis=0))
    unit = np.where(unit > 0.0, unit, 1.0)
    a = whole / unit
    gram, moment, own = a.T @ a, a.T @ targets.ravel(), targets.size * np.eye(len(unit))
    return [np.asarray(np.linalg.solve(gram + ridge * own, moment) / unit) for ridge in ridges]


class _TipErrors:
    """Tip errors of one step from those of the state."""

    def __init__(self, model: Prediction) -> None:
        n = model.system.finger_model.n
        tip = model.tip(model.x, model.u, ca.SX(ca.DM(model.p_nominal)))
        rate = ca.jtimes(tip, model.x[:n], model.x[n : 2 * n])
        self._of = ca.Function("tip", [model.x, model.u], [ca.densify(ca.vertcat(tip, rate))])

    def between(self, x: Array, other: Array, u: Array) -> Array:
        """Differences (K, 4) of position [m] and velocity [m/s] between states (K, nx)."""
        both = [np.array(self._of.map(len(x))(rows.T, u.T)).reshape(4, len(x), order="F").T for rows in (x, other)]
        return np.asarray(both[0] - both[1])


def _tried(
    tip: _TipErrors, features: _Features, residual: LearnedResidual, steps: Steps, name: str, holdout: bool
) -> tuple[OneStepError, Array, Array, Array]:
    """One-step errors of a log, without and with a residual."""
    values = features.within(steps)
    force = _along(partial(terms, residual), values) @ np.array(residual.weights).T
    far = np.sqrt(_along(lambda given: [distance(residual, given)], values)[:, 0])
    predicted = steps.predicted + np.einsum("kij,kj->ki", steps.by_force, force)
    without, with_residual = (tip.between(x, steps.after, steps.u) for x in (steps.predicted, predicted))
    found = OneStepError(
        log=name,
        steps=len(values),
        position=_size(without[:, :2]),
        position_with=_size(with_residual[:, :2]),
        velocity=_size(without[:, 2:]),
        velocity_with=_size(with_residual[:, 2:]),
        beyond=float(np.mean(far > 1.0)),
        holdout=holdout,
    )
    return found, without, with_residual, far


def _size(rows: Array) -> float:
    """Root mean square of the lengths of rows (K, 2)."""
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=1))))


def _warnings(status: str, errors: Sequence[OneStepError]) -> tuple[str, ...]:
    found = []
    if status != "learned":
        found.append(
            "nothing was learned: the model predicts what the logs show as well without a residual, or they show too "
            "little; no residual is written"
        )
    for one in errors:
        if one.holdout and one.beyond > 0.05:
            found.append(
                f"{one.log}: {100 * one.beyond:.0f} % of its periods are beyond the logs, where the residual fades: "
                "learn from motions as large and as fast"
            )
    return tuple(found)
