"""Scatter of estimates from residuals that follow one another in time and are correlated.

Least squares weigh all rows as if they were independent. What the estimates scatter is then the sandwich B M B, with
B = (J^T J)^-1 and M = J^T G J, where G is the covariance of the residuals: here their own autocovariance, of all
readings of a motion with each other, tapered by Parzen's window (E. Parzen, 1957), which leaves M without negative
variances (W. K. Newey, K. D. West, 1987, doi:10.2307/1913610).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LAGS_BEYOND = 5
"""Lags in a row whose correlation must be that of noise, where the correlation has ended [1] (D. N. Politis, 2003)."""
_WINDOW = 3.0
"""Length of the window per lag at which the correlation ends [1]: of 2, 3 and 4, the least whose 90 % intervals cover
0.81 to 0.93 for residuals of five colors; Parzen's window is below a half from 0.36 of its length on."""
_FREEDOM = 3.71
"""Degrees of freedom of a variance by Parzen's window, per length of the series over that of the window [1]."""


def last_lag(residuals: Array) -> int:
    """Lag at which the autocorrelation of the columns of residuals (T, readings) has ended; 0 for noise."""
    count = len(residuals)
    limit, found = 2.0 * math.sqrt(math.log10(count) / count), 0
    for column in residuals.T:
        own = _autocovariance(column[:, None])[:, 0, 0]
        if not own[0] > 0.0:
            continue
        beyond = np.flatnonzero(np.abs(own) > limit * own[0])
        # the first lag behind which so many are those of noise
        ends = [int(k) for k, after in zip(beyond, [*beyond[1:], np.inf], strict=True) if after - k > _LAGS_BEYOND]
        found = max(found, ends[0])
    return found


def middle(jacobian: Array, residuals: Array) -> tuple[Array, float]:
    """J^T G J (n, n) of one series, and its degrees of freedom.

    ``residuals`` are (T, readings), ``jacobian`` (T, readings, n).
    """
    count, readings, n = jacobian.shape
    last = last_lag(residuals)
    if last == 0:
        flat = jacobian.reshape(-1, n)
        return float(np.mean(residuals**2)) * flat.T @ flat, float(residuals.size)
    length = min(_WINDOW * last + 1.0, float(count))
    tapered = _parzen(np.arange(count) / length)[:, None, None] * _autocovariance(residuals)
    spectra = np.fft.rfft(jacobian, 2 * count, axis=0)
    total = np.zeros((n, n))
    for one in range(readings):
        for other in range(readings):
            # G e of the lags of both signs, by a circulant of twice the size
            both = np.concatenate([tapered[:, one, other], [0.0], tapered[:0:-1, other, one]])
            turned = np.fft.irfft(np.fft.rfft(both)[:, None] * spectra[:, other], 2 * count, axis=0)[:count]
            total += jacobian[:, one].T @ turned
    return 0.5 * (total + total.T), _FREEDOM * count / length


def _autocovariance(residuals: Array) -> Array:
    """Mean of r_i(t + lag) r_j(t), (lags, readings, readings), over T at all lags."""
    count = len(residuals)
    spectra = np.fft.rfft(residuals, 2 * count, axis=0)
    return np.fft.irfft(spectra[:, :, None] * spectra[:, None].conj(), 2 * count, axis=0)[:count] / count


def _parzen(x: Array) -> Array:
    near, far = 1.0 - 6.0 * x**2 + 6.0 * x**3, 2.0 * np.maximum(1.0 - x, 0.0) ** 3
    return np.where(x <= 0.5, near, far)
