"""Sensitivities to adapted parameters that noise of the estimate alone may have: sensitivities of a finger at rest."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from continuum_grasp.base import Array, SolverError
from continuum_grasp.control.estimation.model import Estimation
from continuum_grasp.control.estimation.noise import noise_of
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene import ControlScene, Finger, Initial

_AWAY = 1e-3
"""Step of difference quotients of sensitivities, in deviations of the states at the start [1]: sensitivities are nearly
linear over it, and rounding of 1e-16 has no effect."""
_SETTLED = 300
"""Periods after which the filter at rest is taken [1]: 3 s at 10 ms."""
_MEMORY = 0.65
"""Natural times of the finger over which sensitivities are averaged [1]: a fifth of the period of its first mode, over
which noise averages out and motion does not; 50 ms of the hand finger."""
_EXCITED = 3.0
"""Least ratio of a sensitivity to the standard deviation of noise [1]. With zero, the lag of a finger at rest drifted
to its least value within 3 s. In motion of the hand finger at 1 Hz, the median ratio to the noise of the straight
finger is 17 for lag and payload, and 170 for the stiffness."""
_FLOOR = 1e-3
"""Variance of a direction of the sensitivities, per total variance [1]."""
_BENT = 0.15
"""Share of the range of an input that bends fingers in the evaluation of noise at rest [1]: 1.3 rad for the hand
finger."""


def memory_of(finger: Finger) -> float:
    """Time over which sensitivities are averaged [s]."""
    return _MEMORY * finger.rod.natural_time


def quiet_sensitivities(scene: ControlScene, model: Prediction, estimation: Estimation, substeps: int) -> Array:
    """Find what noise may explain of the sensitivities of a step to each adapted parameter, (NA, nx, nx).

    Matrices L: noise of the measurements alone moves the estimate of a finger at rest such that the mean s of
    sensitivities, over ``memory_of`` the finger, has a root mean square |L s| of 1 / _EXCITED. By the filter's
    stationary gain with disturbances known, straight and bent, whose covariances add.
    """
    _, initial, measured = noise_of(scene, model, estimation)
    period = scene.controller.step
    p = np.array(model.p_nominal)
    nx = estimation.nx
    scale = np.sqrt(initial[:nx])
    columns = [adapted_state.state for adapted_state in estimation.adapted]
    share = period / (memory_of(scene.finger) + period)
    covariances = np.zeros((len(columns), nx, nx))
    for rest, u in _rests(scene, model):
        z = np.concatenate([rest, np.zeros(estimation.nz - nx)])
        moved, gain = _stationary(scene, model, estimation, z, u, substeps)
        slopes = np.zeros((nx, nx, len(columns)))  # of sensitivities by states
        for k in range(nx):
            away = np.zeros(estimation.nz)
            away[k] = _AWAY * scale[k] if scale[k] > 0.0 else _AWAY
            ends = [np.array(estimation.step(z + side * away, u, p, period / substeps)[1]) for side in (1.0, -1.0)]
            slopes[:, k] = (ends[0] - ends[1])[:nx, columns] / (2.0 * away[k])
        for k, covariance in enumerate(covariances):
            # Errors of the estimate, and behind them the mean of the sensitivities that they make.
            by = share * slopes[:, :, k]
            motion = np.block([[moved, np.zeros((nx, nx))], [by @ moved, (1.0 - share) * np.eye(nx)]])
            covariance += _settled(motion, np.vstack([gain, by @ gain]), measured)[nx:, nx:]
    return np.array([_whitening(covariance, scale) for covariance in covariances])


def _rests(scene: ControlScene, model: Prediction) -> list[tuple[Array, Array]]:
    """Find states at rest with their inputs: the state without input, and bent ones."""
    u = np.array(scene.rest_input)
    friction = bool(model.system.finger_model.friction_names)
    equilibrium = Initial(pose="equilibrium", reached_by="pulling" if friction else None)
    rests = [(model.start_state(Initial(pose="rest"), u.tolist()), u)]
    for k, limit in enumerate(scene.input_limits[1]):
        bent = np.array(u)
        bent[k] += _BENT * (limit - u[k])
        with suppress(SolverError):
            rests.append((model.start_state(equilibrium, bent.tolist()), bent))
    return rests


def _stationary(
    scene: ControlScene, model: Prediction, estimation: Estimation, z: Array, u: Array, substeps: int
) -> tuple[Array, Array]:
    """Error transition of the filter over a period, and its gain, with disturbances known."""
    process, initial, measured = noise_of(scene, model, estimation)
    nx = estimation.nx
    step = scene.controller.step / substeps
    p = np.array(model.p_nominal)
    f, g = (np.array(part)[:nx, :nx] for part in estimation.step(z, u, p, step)[1:])
    h = np.array(estimation.outputs(z, u, p)[1])[:, :nx]
    q = np.diag(process[:nx])
    covariance = np.diag(initial[:nx])
    added = step / 6.0 * (f @ q @ f.T + 4.0 * g @ q @ g.T + q)
    for _ in range(_SETTLED):
        for _ in range(substeps):
            covariance = f @ covariance @ f.T + added
        gain = np.linalg.solve(h @ covariance @ h.T + np.diag(measured), h @ covariance).T
        rest = np.eye(nx) - gain @ h
        covariance = rest @ covariance @ rest.T + gain @ np.diag(measured) @ gain.T
    return rest @ np.linalg.matrix_power(f, substeps), np.asarray(gain, dtype=float)


def _settled(motion: Array, gain: Array, measured: Array) -> Array:
    """Covariance after some periods of a linear motion that measurement noise drives."""
    added = gain @ np.diag(measured) @ gain.T
    covariance = np.zeros_like(motion)
    for _ in range(_SETTLED):
        covariance = motion @ covariance @ motion.T + added
    return covariance


def _whitening(covariance: Array, scale: Array) -> Array:
    """L with a mean square |L s|^2 of 1 / _EXCITED^2 of vectors s of a covariance, in directions that it has."""
    per = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    values, vectors = np.linalg.eigh(per[:, None] * covariance * per)
    values = np.maximum(values, 0.0)
    # Directions without noise have a floor, since sensitivities are linear in it only nearly.
    bounded = values + _FLOOR * values.sum()
    if not bounded.any():
        return np.zeros_like(covariance)
    share = float((values / bounded).sum())
    whitening: Array = (vectors / np.sqrt(bounded * share)).T * per / _EXCITED
    return whitening
