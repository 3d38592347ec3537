"""Frequencies and decay rates of small vibrations: in a signal, and about a finger at rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.addons.identification.data import Reading, column
from continuum_grasp.addons.identification.rows import Dual, Resting, symbols
from continuum_grasp.base import Array, InputError, SolverError, check_arguments
from continuum_grasp.model import FingerModel
from continuum_grasp.simulation import poles

_LEAST_SAMPLES = 12
"""Least samples of a signal: two per unknown; a damped sine with offset and drift has six."""


class DampedSine(NamedTuple):
    """Frequency and decay rate of exp(-decay_rate t) (a cos + b sin)(2 pi frequency t) + offset + drift t.

    Attributes
    ----------
    frequency : float
        [Hz].
    decay_rate : float
        [1/s].
    """

    frequency: float
    decay_rate: float


@check_arguments
def fit_damped_sine(t: ArrayLike, signal: ArrayLike, name: str = "signal") -> DampedSine:
    """Fit one damped sine with offset and drift to a signal.

    The spectrum gives the start of ``scipy.optimize.curve_fit``.

    Parameters
    ----------
    t : (T,) array_like
        Instants, increasing [s].
    signal : (T,) array_like
    name : str
        Name in messages.

    Raises
    ------
    InputError
        If there are too few samples, or they do not fit.
    SolverError
        If the signal has no vibration.

    Examples
    --------
    >>> import numpy as np
    >>> from continuum_grasp.addons.identification import fit_damped_sine
    >>> t = np.linspace(0.0, 2.0, 401)
    >>> fit = fit_damped_sine(t, 0.01 * np.exp(-0.5 * t) * np.cos(2 * np.pi * 3.0 * t))
    >>> round(fit.frequency, 6), round(fit.decay_rate, 6)
    (3.0, 0.5)
    """
    from scipy.optimize import curve_fit

    instants = column(f"{name}.t", t)
    values = column(name, signal, instants.size)
    if instants.size < _LEAST_SAMPLES or np.any(np.diff(instants) <= 0.0):
        raise InputError(f"expected {_LEAST_SAMPLES} samples or more, at instants that increase", key=name)
    at = instants - instants[0]
    start = _spectral_peak(at, values, name)
    span = float(at[-1])
    guess = np.array([start, 0.5 / span])
    # beside the peak by a factor of four; from growth by exp(5) over the record to decay within part of a period
    lower = (0.25 * start, -5.0 / span)
    upper = (4.0 * start, 50.0 * start)
    linear = np.linalg.lstsq(_basis(at, *guess), values, rcond=None)[0]
    free = [np.inf] * 4

    def signal_of(at: Array, frequency: float, decay: float, *weights: float) -> Array:
        return np.asarray(_basis(at, frequency, decay) @ weights)

    try:
        bounds = [*lower, *np.negative(free)], [*upper, *free]
        parameters, covariance = curve_fit(signal_of, at, values, [*guess, *linear], bounds=bounds, x_scale="jac")
    except RuntimeError:  # the search does not end
        parameters = np.array([*guess, *linear])
        covariance = np.full((6, 6), np.inf)
    left = values - signal_of(at, *parameters)
    sine = _basis(at, *parameters[:2])[:, :2] @ parameters[2:4]
    noise, strength = (float(np.sqrt(np.mean(v**2))) for v in (left, sine))
    # a sine fitted to noise alone leaves most of it
    if not np.isfinite(covariance[0, 0]) or strength <= 0.5 * noise:
        raise SolverError(
            f"{name}: no damped vibration found",
            status="no vibration",
            violated=[f"residual of {noise:.3g}, vibration of {strength:.3g}"],
            advice="choose a window in which one mode rings",
        )
    return DampedSine(float(parameters[0]), float(parameters[1]))


def damped_sine(t: Array, signal: Array, frequency: float, decay_rate: float) -> Array:
    """The damped sine of some frequency [Hz] and decay rate [1/s], with offset and drift, that is nearest to a signal
    (T,).
    """
    basis = _basis(t - t[0], frequency, decay_rate)
    return np.asarray(basis @ np.linalg.lstsq(basis, signal, rcond=None)[0])


def _spectral_peak(t: Array, values: Array, name: str) -> float:
    """Frequency [Hz] of the greatest peak of the spectrum, with offset and drift taken off."""
    from scipy.signal import periodogram

    steps = max(64, t.size)
    # evenly sampled, windowed against leakage, and padded with zeros eightfold, which interpolates the spectrum
    even = np.linspace(0.0, t[-1], steps)
    sampled = {"fs": 1.0 / even[1], "window": "hann", "nfft": 8 * steps, "detrend": "linear"}
    frequencies, power = periodogram(np.interp(even, t, values), **sampled)
    beyond = frequencies >= 1.0 / t[-1]  # less than a period is drift
    if not beyond.any() or not power[beyond].max() > 0.0:
        raise SolverError(f"{name}: no damped vibration found", status="no vibration", advice="the signal is constant")
    return float(frequencies[beyond][np.argmax(power[beyond])])


def _basis(t: Array, frequency: float, decay: float) -> Array:
    envelope = np.exp(-decay * t)
    phase = 2.0 * np.pi * frequency * t
    return np.stack([envelope * np.cos(phase), envelope * np.sin(phase), np.ones_like(t), t / t[-1]], axis=1)


class Vibrations:
    """Readings of natural modes, by a number of unknowns.

    InputError, which names the data, if this finger's vibrations are not predicted.
    """

    def __init__(self, model: FingerModel, readings: Sequence[Reading], unknowns: int, name: str) -> None:
        beyond = {
            "on motors": (model.structure.motors, "their inertia swings along"),
            "whose material relaxes": (model.finger.damping.relaxation, "a part of its stiffness follows with a lag"),
        }
        for which, (there, why) in beyond.items():
            if there:
                message = f"frequencies of a finger {which} are not predicted, since {why}: give a trajectory"
                raise InputError(message, key=name)
        self._pencil = _pencil(model)
        self._slopes = self._pencil.forward(unknowns)
        self._readings = [(reading.of or 1, reading.quantity == "frequency") for reading in readings]

    def at(self, resting: Resting) -> Dual:
        """Predictions (readings,) about a row at rest."""
        state = resting.q.value, resting.z.value
        three = mass, damping, stiffness = [np.array(matrix) for matrix in self._pencil(*state)]
        moved = [np.array(slope) for slope in self._slopes(*state, *three, resting.q.slope, resting.z.slope)]
        predictions = {}
        for mode in dict.fromkeys(mode for mode, _ in self._readings):
            pole, left, right = _mode(mass, damping, stiffness, mode)
            # l* (s^2 M + s D + K) r = 0 differentiated: ds = l* (s^2 dM + s dD + dK) r / -(l* (2 s M + D) r); dl and
            # dr drop out, since l and r are null vectors (P. Lancaster, 1964, doi:10.1007/BF01386087)
            turned = (pole**2 * moved[0] + pole * moved[1] + moved[2]).reshape(right.size, -1, right.size)
            change = left.conj() @ (turned @ right) / -(left.conj() @ (2.0 * pole * mass + damping) @ right)
            predictions[mode, True] = pole.imag / (2.0 * np.pi), change.imag / (2.0 * np.pi)
            predictions[mode, False] = -pole.real, -change.real
        chosen = [predictions[key] for key in self._readings]
        return Dual(np.array([value for value, _ in chosen]), np.array([slope for _, slope in chosen]))


def _pencil(model: FingerModel) -> ca.Function:
    """Mass, damping and stiffness of small motions as a function of q and z = [u, w, p]."""
    q, u, w, p = symbols(model)
    qd, qdd = (ca.SX.sym(name, model.n) for name in ("qd", "qdd"))
    # As it was pulled there.
    pulled = (np.append(np.zeros(len(model.friction_names)), 1.0),) if model.friction_names else ()
    missing = model.inverse_dynamics(q, qd, qdd, u, w, p, *pulled)
    at_rest = [qd, qdd], [ca.SX.zeros(model.n), ca.SX.zeros(model.n)]
    three = [ca.densify(ca.substitute([ca.jacobian(missing, by)], *at_rest)[0]) for by in (qdd, qd, q)]
    return ca.Function("pencil", [q, ca.vertcat(u, w, p)], ca.cse(three), ["q", "z"], ["M", "D", "K"])


def _mode(
    mass: Array, damping: Array, stiffness: Array, number: int
) -> tuple[complex, NDArray[np.complex128], NDArray[np.complex128]]:
    """Pole (rate and pulsation [1/s]), left and right shape of the mode of that number, from 1."""
    eigenvalues = poles(mass, stiffness, damping)
    # of each pair of conjugates one; those without imaginary part do not vibrate
    ringing = sorted(eigenvalues[eigenvalues.imag > 1e-9 * np.abs(eigenvalues).max()], key=lambda pole: pole.imag)
    if len(ringing) < number:
        raise SolverError(
            f"mode {number} does not ring: only {len(ringing)} of {len(mass)} modes do",
            status="overdamped",
            advice="give another mode, take more elements, or bound damping and stiffness",
        )
    pole = complex(ringing[number - 1])
    # null vectors: the singular vectors of the least singular value
    left, _, right = np.linalg.svd(pole**2 * mass + pole * damping + stiffness)
    return pole, left[:, -1], right[-1].conj()
