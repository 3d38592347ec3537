"""A log in the periods of a controller: replayed as it is or read otherwise; noise, delay and lag that it shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.signal import lfilter

from continuum_grasp.arrays import Array
from continuum_grasp.control.controller import Controller
from continuum_grasp.control.estimation.noise import measurement_std
from continuum_grasp.control.log import COMMANDED, ControlLog
from continuum_grasp.control.parts import delay_periods
from continuum_grasp.errors import InputError
from continuum_grasp.labels import name_of, split_unit, unit_of
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.table import read_table

SWAPPED = " swapped"
"""End of the name of a trial with swapped channels."""
LATER = 6
"""Periods by which measurements are tried to be older than stated [1]."""


class Retuned(NamedTuple):
    """A number of the configuration beside that of the log; NaN where the log does not show it."""

    name: str
    unit: str
    configured: float
    logged: float

    def __str__(self) -> str:
        logged = "not shown by the log" if math.isnan(self.logged) else f"{self.logged:.3g} {self.unit} by the log"
        return f"{logged}, {self.configured:.3g} {self.unit} configured"


class Periods:
    """A log in the periods of a controller."""

    def __init__(self, scene: ControlScene, log: ControlLog | str | PathLike[str]) -> None:
        controller = Controller(scene, deadline=math.inf)
        if controller.estimation is None:
            raise InputError("a replay needs an estimator", key="estimator")
        self.controller, self.estimation = controller, controller.estimation
        self._names, inputs = controller.measurement_names, tuple(COMMANDED + n for n in controller.stages.u_names)
        self._columns = columns_of(log, (*self._names, *inputs))
        if not any(self._columns[name][0].size for name in self._names):
            file = None if isinstance(log, ControlLog) else str(log)
            raise InputError(f"the log has none of {', '.join(self._names)}", file=file)
        instants = np.concatenate([t for t, _ in self._columns.values()])
        start, period = float(instants.min()), controller.period
        self.t: Array = start + period * np.arange(math.floor((instants.max() - start) / period + 1e-6) + 1.0)
        # A command that is given at an instant acts from then on: what acted until then is the one before.
        self._applied = np.column_stack([self._last(name, self.t - 1e-3 * period, math.inf) for name in inputs])
        self.logged = np.column_stack([self._last(name, self.t, period) for name in inputs])
        missing = [name for name in (*self._names, *inputs) if not self._columns[name][0].size]
        self.warnings = (f"the log has no {', '.join(map(name_of, missing))}",) if missing else ()

    def _last(self, name: str, at: Array, age: float) -> Array:
        """Last sample (K,) of a channel at instants (K,), to 1e-6 periods; NaN where it is as old as ``age`` [s]."""
        t, values = self._columns[name]
        if not t.size:
            return np.full(len(at), np.nan)
        rounding = 1e-6 * self.controller.period
        k = np.searchsorted(t, at + rounding, side="right") - 1
        return np.where((k >= 0) & (t[k] > at - age + rounding), values[k], np.nan)

    def measured(self, later: float = 0.0) -> Array:
        """Measurements (K, nm), or those of so much later [s]."""
        return np.column_stack([self._last(name, self.t + later, self.controller.period) for name in self._names])

    def run(self, y: Array) -> list[Any]:
        """Commands in all periods by measurements (K, nm)."""
        self.controller.reset()
        return [
            self.controller.step(row, applied=u if np.isfinite(u).all() else None, late=False)
            for row, u in zip(y, self._applied, strict=True)
        ]

    def trials(self, y: Array) -> list[tuple[str, Array]]:
        """Measurements without each channel, and with channels of one sensor and unit swapped, by what was done."""
        there = [k for k in range(len(self._names)) if np.isfinite(y[:, k]).any()]
        trials = list[tuple[str, Array]]()
        for k in there if len(there) > 1 else ():
            trials.append((name_of(self._names[k]), y.copy()))
            trials[-1][1][:, k] = np.nan
        alike = [(self.estimation.device(name), unit_of(name)) for name in self._names]
        for a, b in combinations(there, 2):
            if alike[a] == alike[b]:
                order = np.arange(y.shape[1])
                order[[a, b]] = b, a
                trials.append((f"{name_of(self._names[a])} and {name_of(self._names[b])}{SWAPPED}", y[:, order]))
        return trials

    def frozen(self) -> tuple[str, ...]:
        """Channels with as many equal readings in a row as no noise has."""
        if self.controller.scene.estimator is None or not self.controller.scene.estimator.frozen:
            return ()
        frozen = []
        for name in self._names:
            changes = np.flatnonzero(np.diff(self._columns[name][1], prepend=np.nan, append=np.nan))
            # 20: equal readings in a row of a sensor that is frozen: noise does not repeat itself
            if np.diff(changes).max(initial=0) >= 20:
                frozen.append(name_of(name))
        return tuple(frozen)

    # -- numbers of the log -------------------------------------------------------------------------------------------

    def noises(self) -> list[Retuned]:
        """Noise of each channel: what a parabola through neighbors leaves of four samples in a row, in the median."""
        noises, scene = [], self.controller.scene
        for name in self._names:
            (t, values), std = self._columns[name], math.nan
            if len(t) > 8:
                at, y = (np.lib.stride_tricks.sliding_window_view(v, 4) for v in (t, values))
                apart = at[:, :, None] - at[:, None, :] + np.eye(4)
                weights = 1.0 / apart.prod(axis=2)
                rest = (weights * y).sum(axis=1) / np.linalg.norm(weights, axis=1)
                std = 1.4826 * float(np.median(np.abs(rest)))  # of a normal distribution
            noises.append(Retuned(f"noise of {name_of(name)}", unit_of(name), measurement_std(scene, name), std))
        return noises

    def delay(self) -> Retuned:
        """Age of measurements: that at which they agree best, between periods by a parabola."""
        period, stated = self.controller.period, delay_periods(self.controller.scene)
        ages, left, count = np.arange(0, stated + LATER), list[float](), 0
        for age in ages:
            with_variances = innovations(self.run(self.measured((age - stated) * period)))
            left.append(float(np.nanmean(disagreement(with_variances))))
            count = int((with_variances[:, 1] > 0.0).sum())
        k, best = int(np.argmin(left)), math.nan
        # 20.0: logarithm of the likelihood of a delay, per that of the least likely one, from which on it is stated
        if 0.5 * count * math.log(max(left) / min(left)) > 20.0:
            best = float(ages[k])
            if 0 < k < len(ages) - 1:
                before, at, after = left[k - 1 : k + 2]
                best += 0.5 * (before - after) / max(before - 2.0 * at + after, 1e-300)
        return Retuned("delay", "s", period * stated, period * best)

    def lag(self) -> list[Retuned]:
        """Time constant of drives whose inputs are measured: a critically damped lag, fitted with a delay."""
        scene, names = self.controller.scene, self.controller.stages.u_names
        if scene.lag is None or scene.finger.winches:
            return []
        y, period, u = self.measured(), self.controller.period, np.vstack([self._applied[1:], self._applied[-1:]])
        pairs = [(u[:, k], y[:, self._names.index(name)]) for k, name in enumerate(names) if name in self._names]
        pairs = [
            (commanded, seen)
            for commanded, seen in pairs
            if np.isfinite(commanded).all() and np.ptp(commanded) > 0.0 and np.isfinite(seen).any()
        ]
        if not pairs:
            return [Retuned("lag", "s", scene.lag, math.nan)]
        t = period * np.arange(len(u))

        def missed(numbers: Array) -> float:
            time, delay = np.abs(numbers)
            pole, ratio = math.exp(-period / time), period / time
            after = [0.0, 1.0 - pole * (1.0 + ratio), pole * (pole - 1.0 + ratio)]
            total = 0.0
            for commanded, seen in pairs:
                begin = seen[np.isfinite(seen)][0]
                acts = begin + lfilter(after, [1.0, -2.0 * pole, pole**2], commanded - begin)
                total += float(np.nansum((np.interp(t - delay, t, acts) - seen) ** 2))
            return total

        stated = np.array([scene.lag, max(delay_periods(scene), 0.5) * period])
        optimum = minimize(missed, stated, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9, "maxiter": 400})
        return [Retuned("lag", "s", scene.lag, float(abs(optimum.x[0])))]


def columns_of(log: ControlLog | str | PathLike[str], wanted: Sequence[str]) -> dict[str, tuple[Array, Array]]:
    """Instants [s] and values of channels by name and unit: increasing, without gaps; none of what a log lacks."""
    if isinstance(log, ControlLog):
        names = [*(COMMANDED + name for name in log.u_names), *log.y_names]
        t, columns = log.t, dict(zip(names, [*log.u.T, *log.y.T], strict=True))
    else:
        table = read_table(str(log))
        heading = "t" if "t" in table.headings else "time"
        t, columns = table.in_si(heading, "s"), {}
        table.check_order(t, heading, np.arange(t.size), strict=False)
        for label in wanted:
            name, unit = split_unit(label)
            if name in table.headings:
                columns[label] = table.in_si(name, unit, gaps=True)
    channels = {}
    for label in wanted:
        values = columns.get(label, np.full(t.size, np.nan))
        there = np.isfinite(values)
        instants, first = np.unique(t[there], return_index=True)
        channels[label] = instants, values[there][first]
    return channels


def innovations(commands: Sequence[Any]) -> Array:
    """Innovations and their variances (K, 2, ny)."""
    return np.array([command.innovation for command in commands])


def disagreement(periods: Array) -> Array:
    """Mean squared normalized innovation (ny) by innovations and variances (K, 2, ny); NaN if never compared."""
    # 30.0: cap of a squared normalized innovation, as in ``control/c/ekf.h``: one sample alone is no wrong sensor
    square = np.minimum(periods[:, 0] ** 2 / np.where(periods[:, 1] > 0.0, periods[:, 1], np.nan), 30.0)
    count = np.isfinite(square).sum(axis=0)
    return np.where(count > 0, np.nansum(square, axis=0) / np.maximum(count, 1), np.nan)
