"""Calls of a controller in a log: one per period, whose row may be late, missing or there twice."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array

_FIRST = 256
"""Rows by which the clock of a log is found at first [1]: it stands out of their scatter, up to 0.4 periods to either
side."""
_CLOCK = 0.06
"""Part by which the clock of a log may differ from the controller's period [1]: loops that sleep between calls are so
much slower."""


class Calls(NamedTuple):
    """K calls, one per period.

    Attributes
    ----------
    t : (K,) ndarray
        Their instants [s]: the times of their rows, and where there is none, the times by the clock of the log.
    seen : (K,) ndarray of bool
        Whether the log has a row of the call.
    step : float
        Time from call to call by the log [s].
    """

    t: Array
    seen: NDArray[np.bool_]
    step: float

    def last(self, t: Array, values: Array) -> Array:
        """Last of the samples at instants t (M,) that had come since the call before (K,); NaN where none had."""
        taken = np.full(len(self.t), np.nan)
        # 1e-6: share of a period by which stamps that are one are written differently
        k = np.searchsorted(self.t, t - 1e-6 * self.step)
        taken[k[k < len(taken)]] = values[k < len(taken)]  # of several the last one stays
        return taken


def calls_of(stamps: Array, commanded: Array, period: float) -> Calls:
    """Calls that rows at increasing instants ``stamps`` (M,) [s] show; ``commanded`` (N,) are those with a command.

    Stamps lie about even instants, however they scatter about these; a row belongs to the nearest one. Where commands,
    or without any of them rows, are more often than periods, nothing says which of them is a call's: calls are a
    ``period`` apart from the first row on.
    """
    calling = commanded if commanded.size > 1 else stamps
    if calling.size > 1 and np.median(np.diff(calling)) < 0.5 * period:
        t = stamps[0] + period * np.arange(np.floor((stamps[-1] - stamps[0]) / period + 1e-6) + 1.0)
        seen = np.isin(np.arange(t.size), np.searchsorted(t, stamps - 1e-6 * period))
        return Calls(t, seen, period)
    known = commanded if commanded.size else stamps
    start, step = _clock(known, period)
    # a row with a command tells the instant of its call; of the others, those of periods without one
    others = np.setdiff1d(stamps, known)
    k = _apart(np.round((known - start) / step).astype(int))
    between = np.round((others - start) / step).astype(int)
    free = ~np.isin(between, k)
    k = np.append(between[free], k)
    known = np.append(others[free], known)
    first = int(k.min())
    t = start + step * np.arange(first, k.max() + 1.0)
    seen = np.zeros(t.size, dtype=bool)
    seen[k - first], t[k - first] = True, known
    return Calls(t, seen, step)


def _clock(stamps: Array, period: float) -> tuple[float, float]:
    """Instant of a call and time from call to call [s] about which stamps (M,) scatter.

    On a circle whose turn is that time their mean is farthest from the middle (Rayleigh's test). Of the first rows this
    says it roughly, of twice as many each time ever more finely.
    """
    rate = 1.0 / period
    count = _FIRST
    reach = _CLOCK / period
    while True:
        t = stamps[:count] - stamps[0]
        fine = 0.125 / max(float(t[-1]), period)  # an eighth of a turn at the last stamp
        steps = np.arange(1.0, np.ceil(reach / fine) + 1.0)
        rates = rate + fine * np.concatenate([[0.0], np.column_stack([steps, -steps]).ravel()])
        means = np.array([np.exp(2j * np.pi * one * t).mean() for one in rates])
        # of rates that are alike, as rows that are all an even number of periods apart have them, the first is nearest
        best = int(np.argmax(np.round(np.abs(means), 2)))
        rate = float(rates[best])
        reach = 2.0 * fine
        if count >= stamps.size:
            break
        count *= 2
    turns = rate * t - float(np.angle(means[best])) / (2.0 * np.pi)
    k = np.round(turns)
    if not np.ptp(k):
        return float(stamps[0]), period
    step, start = np.polyfit(k, stamps, 1)
    return float(start), float(step)


def _apart(k: NDArray[np.int_]) -> NDArray[np.int_]:
    """Numbers of calls (M,) of rows in their order: one of two rows with one number takes a free one beside it."""
    k = k.copy()
    for i in np.flatnonzero(np.diff(k) == 0):
        if i + 2 == len(k) or k[i + 2] > k[i + 1] + 1:
            k[i + 1] += 1
        elif k[i] == k[i + 1] and (i == 0 or k[i - 1] < k[i] - 1):
            k[i] -= 1
    return k
