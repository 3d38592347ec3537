"""Frequency and decay rate of a ring-down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.arguments import check_arguments
from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.identification.data import column

_LEAST_SAMPLES = 12
"""Least samples of a signal: two per unknown, of which a damped sine with offset and drift has six."""


@dataclass(frozen=True)
class DampedSine:
    """exp(-decay_rate t) (a cos + b sin)(2 pi frequency t) + offset + drift t, with t from the first sample.

    Attributes
    ----------
    frequency : float
        [Hz].
    decay_rate : float
        [1/s].
    deviations : (2,) ndarray
        Standard deviations of both, were the residuals independent.
    amplitude : float
        At the first sample, in the signal's unit.
    misfit : float
        Residuals relative to the signal without offset and drift, both r.m.s. [1].
    """

    frequency: float
    decay_rate: float
    deviations: Array
    amplitude: float
    misfit: float


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
        What messages call it.

    Raises
    ------
    InputError
        If there are too few samples, or they do not fit.
    SolverError
        If there is no vibration to be found.

    Examples
    --------
    >>> import numpy as np
    >>> from continuum_grasp.identification import fit_damped_sine
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
    start, span = _spectral_peak(at, values, name), float(at[-1])
    guess = np.array([start, 0.5 / span])
    # beside the peak by a factor of four; from growth by exp(5) over the record to decay within part of a period
    lower, upper = (0.25 * start, -5.0 / span), (4.0 * start, 50.0 * start)
    linear, free = np.linalg.lstsq(_basis(at, *guess), values, rcond=None)[0], [np.inf] * 4

    def signal_of(at: Array, frequency: float, decay: float, *weights: float) -> Array:
        return np.asarray(_basis(at, frequency, decay) @ weights)

    try:
        found, covariance = curve_fit(
            signal_of,
            at,
            values,
            [*guess, *linear],
            bounds=([*lower, *np.negative(free)], [*upper, *free]),
            x_scale="jac",
        )
    except RuntimeError:  # the search does not end
        found, covariance = np.array([*guess, *linear]), np.full((6, 6), np.inf)
    left = values - signal_of(at, *found)
    noise, strength = (float(np.sqrt(np.mean(v**2))) for v in (left, _basis(at, *found[:2])[:, :2] @ found[2:4]))
    # a sine fitted to noise alone leaves most of it
    if not np.isfinite(covariance[0, 0]) or strength <= 0.5 * noise:
        raise SolverError(
            f"{name}: no damped vibration found",
            status="no vibration",
            violated=[f"residuals of {noise:.3g} beside a vibration of {strength:.3g}"],
            advice="choose a window in which one mode rings",
        )
    deviations, amplitude = np.sqrt(np.diag(covariance)[:2]), float(np.hypot(*found[2:4]))
    return DampedSine(float(found[0]), float(found[1]), deviations, amplitude, noise / strength)


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
    envelope, phase = np.exp(-decay * t), 2.0 * np.pi * frequency * t
    return np.stack([envelope * np.cos(phase), envelope * np.sin(phase), np.ones_like(t), t / t[-1]], axis=1)
