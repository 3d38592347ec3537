"""Frequency and decay rate of a ring-down."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.arguments import check_arguments
from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.identification.data import column
from continuum_grasp.identification.least_squares import least_squares

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

    The spectrum gives the start; frequency and decay rate are then sought by least squares, with the linear
    coefficients eliminated at each step (G. H. Golub and V. Pereyra, 1973, doi:10.1137/0710036).

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
    instants = column(f"{name}.t", t)
    values = column(name, signal, instants.size)
    if instants.size < _LEAST_SAMPLES or np.any(np.diff(instants) <= 0.0):
        raise InputError(f"expected {_LEAST_SAMPLES} samples or more, at instants that increase", key=name)
    at = instants - instants[0]
    start = _spectral_peak(at, values, name)
    span = float(at[-1])
    # beside the peak by a factor of four; from growth by exp(5) over the record to decay within part of a period
    lower, upper = np.array([0.25 * start, -5.0 / span]), np.array([4.0 * start, 50.0 * start])
    sizes = np.array([0.1 / span, 1.0 / span])
    found = least_squares(partial(_projected, at, values), np.array([start, 0.5 / span]), lower, upper, sizes)
    frequency, decay = (float(value) for value in found.values)
    basis = _basis(at, frequency, decay)
    weights = np.linalg.lstsq(basis, values, rcond=None)[0]
    left = values - basis @ weights
    noise, strength = (float(np.sqrt(np.mean(part**2))) for part in (left, basis[:, :2] @ weights[:2]))
    # a sine fitted to noise alone leaves most of it
    if not found.converged or strength <= 0.5 * noise:
        raise SolverError(
            f"{name}: no damped vibration found",
            status="no vibration",
            violated=[f"residuals of {noise:.3g} beside a vibration of {strength:.3g}"],
            advice="choose a window in which one mode rings",
        )
    variance = float(left @ left) / max(1, at.size - 6)  # six unknowns
    covariance = variance * np.linalg.inv(found.jacobian.T @ found.jacobian)
    amplitude = float(np.hypot(weights[0], weights[1]))
    return DampedSine(frequency, decay, np.sqrt(np.diag(covariance)), amplitude, noise / strength)


def _spectral_peak(t: Array, values: Array, name: str) -> float:
    """Frequency [Hz] of the greatest peak of the spectrum, with offset and drift taken off."""
    steps = max(64, t.size)
    # evenly sampled, windowed against leakage, and padded with zeros eightfold, which interpolates the spectrum
    even = np.linspace(0.0, t[-1], steps)
    line = np.polyfit(t, values, 1)
    detrended = np.interp(even, t, values - np.polyval(line, t)) * np.hanning(steps)
    power = np.abs(np.fft.rfft(detrended, 8 * steps)) ** 2
    frequencies = np.fft.rfftfreq(8 * steps, even[1])
    beyond = frequencies >= 1.0 / t[-1]  # less than a period is drift
    if not beyond.any() or not power[beyond].max() > 0.0:
        raise SolverError(f"{name}: no damped vibration found", status="no vibration", advice="the signal is constant")
    return float(frequencies[beyond][np.argmax(power[beyond])])


def _basis(t: Array, frequency: float, decay: float) -> Array:
    envelope, phase = np.exp(-decay * t), 2.0 * np.pi * frequency * t
    return np.stack([envelope * np.cos(phase), envelope * np.sin(phase), np.ones_like(t), t / t[-1]], axis=1)


def _projected(t: Array, values: Array, nonlinear: Array) -> tuple[Array, Array]:
    """Residuals after the best linear coefficients, and their Jacobian after Kaufman."""
    basis = _basis(t, *nonlinear)
    orthogonal, _ = np.linalg.qr(basis)
    weights = np.linalg.lstsq(basis, values, rcond=None)[0]
    ring = basis[:, :2] @ weights[:2]
    turned = basis[:, 1] * -weights[0] + basis[:, 0] * weights[1]
    columns = np.stack([2.0 * np.pi * t * turned, -t * ring], axis=1)
    # Kaufman's approximation drops the term with the derivative of the pseudo-inverse (L. Kaufman, 1975,
    # doi:10.1007/BF01932995)
    columns -= orthogonal @ (orthogonal.T @ columns)
    return basis @ weights - values, columns
