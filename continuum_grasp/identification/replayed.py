"""A log of a finger through its controller: what that would have believed and commanded, and which sensor disagrees."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from os import PathLike
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter

from continuum_grasp.arguments import check_arguments
from continuum_grasp.control.controller import Controller
from continuum_grasp.control.estimation.noise import measurement_std
from continuum_grasp.control.log import COMMANDED, ControlLog
from continuum_grasp.control.settings import delay_periods
from continuum_grasp.errors import InputError
from continuum_grasp.identification.blocks import Drawn, Entry
from continuum_grasp.identification.comparison import Predicted
from continuum_grasp.identification.table import read_table
from continuum_grasp.labels import name_of, split_unit, unit_of
from continuum_grasp.results.declared import Dimension, File, Picture, Stored
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.load import scene_of

Array = NDArray[np.float64]

_CAP = 30.0
"""Cap of a squared normalized innovation [1], as in ``control/c/ekf.h``: one sample alone is no wrong sensor."""
_TRUST = 12.0
"""Mean squared normalized innovation up to which sensors and model agree [1]: a move with half the stiffness stays
below 9 (``control/c/supervisor.c``), one with drives of 2.5 times the lag below 11."""
_STILL = 20
"""Equal readings in a row [1] of a sensor that is frozen: noise does not repeat itself."""
_LEFT = 0.5
"""Part of the disagreement that is left where the sensor at fault is left out [1], at most."""
_ALIKE = 1.2
"""Disagreements within this factor of the least are alike [1]: the log does not tell which of the sensors it is."""
_SWAPPED = " swapped"
_EVIDENCE = 20.0
"""Logarithm of the likelihood of a delay, per that of the least likely one, from which on it is told [1]."""
_LATER = 6
"""Periods by which measurements are tried to be older than stated [1]."""


class Suspicion(NamedTuple):
    """Sensors read otherwise: mean squared normalized innovation of all that is compared then, and of it as logged."""

    what: str
    after: float
    before: float


class Retuned(NamedTuple):
    """A number of the configuration beside that of the log; NaN where the log does not tell it."""

    name: str
    unit: str
    configured: float
    logged: float

    def __str__(self) -> str:
        found = "not told by the log" if math.isnan(self.logged) else f"{self.logged:.3g} {self.unit} by the log"
        return f"{found}, {self.configured:.3g} {self.unit} configured"


@dataclass(frozen=True)
class Replay(Predicted):
    """What a controller would have believed and commanded in K periods of a log; what it expected is what it believed.

    Attributes
    ----------
    frozen : tuple of str
        Channels that repeat one reading, where ``estimator.frozen`` has that looked for.
    suspicions : tuple of Suspicion
        Each channel left out, and channels of a sensor swapped, the most likely one first.
    retuned : tuple of Retuned
        Noise of each channel, delay of measurements, lag of the drives.
    health : tuple of str
        As of `ControlRun`.
    status : {"consistent", "sensor", "mismatch"}
        Sensors and model agree; or all but one do, named by ``suspects``; or no sensor alone explains it.
    """

    kind: ClassVar[str] = "replay"
    stored: ClassVar[tuple[Stored, ...]] = (
        *Predicted.stored,
        Stored("t", "(period,)", "s", "instants of the controller, from the first of the log on"),
        Stored("innovation", "(period, compared)", "", "measured less expected, one after the other"),
        Stored("innovation_std", "(period, compared)", "", "their standard deviations; NaN where none was compared"),
        Stored("u", "(period, input)", "", "commands that the controller gives"),
        Stored("logged", "(period, input)", "", "commands of the log; NaN where it has none"),
        Stored("estimate", "(period, model_state)", "", "estimated states of the controller's model"),
        Stored("std", "(period, estimated)", "", "standard deviations of states and disturbances"),
        Stored("health", "(period,)", "text", "whether sensors, model and call rate agreed"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        *Predicted.dimensions,
        Dimension("period", "instants of the controller", "t", "s"),
        Dimension("compared", "what is compared with the model", "compared_names"),
        Dimension("input", "inputs of the finger", "u_names"),
        Dimension("model_state", "states of the controller's model", "estimated_names"),
        Dimension("estimated", "states, then disturbances", "estimated_names"),
    )
    texts: ClassVar[tuple[File, ...]] = (File("report.txt", "identification.replayed:Replay.report"),)
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("series", "plotting.identification:plot_series", panels=True),
        Picture("innovations", "plotting.identification:plot_innovations", panels=True),
    )
    predicted: ClassVar[str] = "believed"

    scene: ControlScene  # type: ignore[assignment]
    t: Array
    innovation: Array
    innovation_std: Array
    u: Array
    logged: Array
    estimate: Array
    std: Array
    health: tuple[str, ...]
    frozen: tuple[str, ...]
    suspicions: tuple[Suspicion, ...]
    retuned: tuple[Retuned, ...]
    compared_names: tuple[str, ...]
    u_names: tuple[str, ...]
    estimated_names: tuple[str, ...]
    status: str
    warnings: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def suspects(self) -> tuple[str, ...]:
        """Sensors without which, or read otherwise, others agree; several where the log does not tell them apart."""
        if self.status != "sensor":
            return ()
        if self.frozen:
            return self.frozen
        alike = [one.what for one in self.suspicions if one.after <= _ALIKE * self.suspicions[0].after]
        # Without either of two that are swapped, the others agree too; swapped back, nothing need be left out.
        return tuple([what for what in alike if what.endswith(_SWAPPED)] or alike)

    def pairs(self) -> dict[str, str]:
        """Verdict, the disagreement that each suspicion leaves, commands, and numbers of the log beside those set."""
        both = np.isfinite(self.logged)
        off = float(np.abs((self.u - self.logged)[both]).max()) if both.any() else math.nan
        return {
            "periods": f"{len(self.t)} of {1e3 * self.scene.controller.step:g} ms",
            "sensors": self.status if not self.suspects else f"suspect: {' or '.join(self.suspects)}",
            **{one.what: f"disagreement {one.before:.3g} becomes {one.after:.3g}" for one in self.suspicions},
            "commands": f"{off:.3g} {unit_of(self.u_names[0])} off those of the log at most",
            **{one.name: str(one) for one in self.retuned},
        }

    def report(self) -> str:
        """The pairs as text."""
        return "".join(f"{name}: {value}\n" for name, value in self.pairs().items())

    def details(self) -> dict[str, Any]:
        """Suspicions and numbers of the log, as plain data."""
        suspicions, retuned = [one._asdict() for one in self.suspicions], [one._asdict() for one in self.retuned]
        return {"suspects": list(self.suspects), "suspicions": suspicions, "retuned": retuned}


@check_arguments
def replay(
    scene: ControlScene | str | PathLike[str],
    log: ControlLog | str | PathLike[str],
    *,
    progress: Callable[[float], None] | None = None,
) -> Replay:
    """Run a log through estimator, supervisor and controller of a scene, as if it happened now.

    Each period takes the last sample of each channel since the period before; a channel that has none is absent. The
    finger gets the commands of the log, or where that has none those that are replayed.

    Parameters
    ----------
    scene : ControlScene or path-like
        The scene, with an estimator, or its YAML file. Setpoints are its own, from the first instant of the log on.
    log : ControlLog or path-like
        What was measured: a `ControlLog`, or a table with a column ``t``, measurements by their names, and commands by
        the names of inputs behind ``commanded_``; instants may be uneven, cells empty.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    Replay

    Raises
    ------
    InputError
        If the scene has no estimator, or the log nothing that is measured.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> run = cg.run_closed_loop(cg.load("configs/mpc/steady_tip.yaml", ["duration=0.3"]))
    >>> found = cg.replay("configs/mpc/steady_tip.yaml", run.log)
    >>> found.status, bool(abs(found.u - run.u).max() < 1e-9)
    ('consistent', True)
    """
    known = scene_of(scene, ControlScene)
    periods = _Periods(known, log)
    controller, y, estimation = periods.controller, periods.measured(), periods.estimation
    commands = periods.run(y)
    found = np.array([command.innovation for command in commands])
    innovation, std = found[:, 0], np.sqrt(np.where(found[:, 1] > 0.0, found[:, 1], np.nan))
    own = _disagreement(found)
    suspicions, report = list[Suspicion](), progress or (lambda share: None)
    trials = periods.trials(y)
    for k, (what, other) in enumerate(trials):
        # A quantity of which a part is left out is not compared: its disagreement is NaN.
        after = _disagreement(np.array([command.innovation for command in periods.run(other)]))
        suspicions.append(Suspicion(what, float(np.nanmean(after)), float(np.nanmean(own))))
        report((k + 1.0) / (len(trials) + _LATER))
    suspicions.sort(key=lambda one: one.after)
    frozen, status = periods.frozen(), "consistent" if np.nanmax(own) <= _TRUST else "mismatch"
    explained = bool(suspicions) and suspicions[0].after < _LEFT * suspicions[0].before
    if frozen or (status == "mismatch" and explained):
        status = "sensor"
    seen = np.nan_to_num(y) @ estimation.mixing.T
    entries, believed = list[Entry](), list[float]()
    for j, label in enumerate(estimation.y_names):
        name, unit = split_unit(label)
        for k in np.flatnonzero(np.isfinite(std[:, j])).tolist():
            at = float(periods.t[k])
            entries.append(Entry(f"{name} at {at:g} s", name, unit, seen[k, j], True, None, at, name))
            believed.append(seen[k, j] - innovation[k, j])
    name = log.name if isinstance(log, ControlLog) else str(log)
    lines = Drawn(np.zeros(0), np.zeros((0, 2, 2)), over_time=True)
    return Replay(
        entries=tuple(entries),
        predictions=np.array(believed),
        blocks=((name, len(entries)),),
        drawn=(lines,),
        scene=known,
        t=periods.t,
        innovation=innovation,
        innovation_std=std,
        u=np.array([command.u for command in commands]),
        logged=periods.logged,
        estimate=np.array([command.estimate.x for command in commands]),
        std=np.array([command.estimate.std for command in commands]),
        health=tuple(command.health.name.lower() for command in commands),
        frozen=frozen,
        suspicions=tuple(suspicions),
        retuned=(*periods.noises(), periods.delay(), *periods.lag()),
        compared_names=estimation.y_names,
        u_names=controller.stages.u_names,
        estimated_names=controller.estimated_names,
        status=status,
        warnings=periods.warnings,
        statistics=controller.statistics,
    )


def _disagreement(found: Array) -> Array:
    """Mean squared normalized innovation (ny) by innovations and variances (K, 2, ny); NaN if never compared."""
    square = np.minimum(found[:, 0] ** 2 / np.where(found[:, 1] > 0.0, found[:, 1], np.nan), _CAP)
    count = np.isfinite(square).sum(axis=0)
    return np.where(count > 0, np.nansum(square, axis=0) / np.maximum(count, 1), np.nan)


class _Periods:
    """A log in the periods of a controller."""

    def __init__(self, scene: ControlScene, log: ControlLog | str | PathLike[str]) -> None:
        controller = Controller(scene, deadline=math.inf)
        if controller.estimation is None:
            raise InputError("a replay needs an estimator", key="estimator")
        self.controller, self.estimation = controller, controller.estimation
        self._names, inputs = controller.measurement_names, tuple(COMMANDED + n for n in controller.stages.u_names)
        self._columns = _columns(log, (*self._names, *inputs))
        if not any(name in self._columns for name in self._names):
            file = None if isinstance(log, ControlLog) else str(log)
            raise InputError(f"the log has none of {', '.join(self._names)}", file=file)
        instants = np.concatenate([t for t, _ in self._columns.values()])
        start, period = float(instants.min()), controller.period
        self.t: Array = start + period * np.arange(math.floor((instants.max() - start) / period + 1e-6) + 1.0)
        # A command that is given at an instant acts from then on: what acted until then is the one before.
        self._applied = np.column_stack([self._last(name, self.t - 1e-3 * period, math.inf) for name in inputs])
        self.logged = np.column_stack([self._last(name, self.t, period) for name in inputs])
        missing = [name for name in (*self._names, *inputs) if name not in self._columns]
        self.warnings = (f"the log has no {', '.join(map(name_of, missing))}",) if missing else ()

    def _last(self, name: str, at: Array, age: float) -> Array:
        """Last sample (K,) of a channel at instants (K,), to 1e-6 periods; NaN where it is as old as ``age`` [s]."""
        t, values = self._columns.get(name, (np.zeros(0), np.zeros(0)))
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
        found = list[tuple[str, Array]]()
        for k in there if len(there) > 1 else ():
            found.append((name_of(self._names[k]), y.copy()))
            found[-1][1][:, k] = np.nan
        alike = [(self.estimation.device(name), unit_of(name)) for name in self._names]
        for a, b in combinations(there, 2):
            if alike[a] == alike[b]:
                order = np.arange(y.shape[1])
                order[[a, b]] = b, a
                found.append((f"{name_of(self._names[a])} and {name_of(self._names[b])}{_SWAPPED}", y[:, order]))
        return found

    def frozen(self) -> tuple[str, ...]:
        """Channels with as many equal readings in a row as no noise has."""
        if self.controller.scene.estimator is None or not self.controller.scene.estimator.frozen:
            return ()
        found = []
        for name in self._names:
            changes = np.flatnonzero(
                np.diff(self._columns.get(name, (None, np.zeros(0)))[1], prepend=np.nan, append=np.nan)
            )
            if np.diff(changes).max(initial=0) >= _STILL:
                found.append(name_of(name))
        return tuple(found)

    # -- numbers of the log -------------------------------------------------------------------------------------------

    def noises(self) -> list[Retuned]:
        """Noise of each channel: what a parabola through neighbors leaves of four samples in a row, in the median."""
        found = []
        for name in self._names:
            t, values = self._columns.get(name, (np.zeros(0), np.zeros(0)))
            std = math.nan
            if len(t) > 8:
                at, y = (np.lib.stride_tricks.sliding_window_view(v, 4) for v in (t, values))
                apart = at[:, :, None] - at[:, None, :] + np.eye(4)
                weights = 1.0 / apart.prod(axis=2)
                rest = (weights * y).sum(axis=1) / np.linalg.norm(weights, axis=1)
                std = 1.4826 * float(np.median(np.abs(rest)))  # of a normal distribution
            found.append(
                Retuned(f"noise of {name_of(name)}", unit_of(name), measurement_std(self.controller.scene, name), std)
            )
        return found

    def delay(self) -> Retuned:
        """Age of measurements: that at which they agree best, between periods by a parabola."""
        period, stated = self.controller.period, delay_periods(self.controller.scene)
        ages, left, count = np.arange(0, stated + _LATER), list[float](), 0
        for age in ages:
            commands = self.run(self.measured((age - stated) * period))
            found = np.array([command.innovation for command in commands])
            left.append(float(np.nanmean(_disagreement(found))))
            count = int((found[:, 1] > 0.0).sum())
        k, best = int(np.argmin(left)), math.nan
        if 0.5 * count * math.log(max(left) / min(left)) > _EVIDENCE:
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
            (given, seen)
            for given, seen in pairs
            if np.isfinite(given).all() and np.ptp(given) > 0.0 and np.isfinite(seen).any()
        ]
        if not pairs:
            return [Retuned("lag", "s", scene.lag, math.nan)]
        t = period * np.arange(len(u))

        def missed(numbers: Array) -> float:
            time, delay = np.abs(numbers)
            pole, ratio = math.exp(-period / time), period / time
            after = [0.0, 1.0 - pole * (1.0 + ratio), pole * (pole - 1.0 + ratio)]
            total = 0.0
            for given, seen in pairs:
                begin = seen[np.isfinite(seen)][0]
                acts = begin + lfilter(after, [1.0, -2.0 * pole, pole**2], given - begin)
                total += float(np.nansum((np.interp(t - delay, t, acts) - seen) ** 2))
            return total

        stated = np.array([scene.lag, max(delay_periods(scene), 0.5) * period])
        found = minimize(missed, stated, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9, "maxiter": 400})
        return [Retuned("lag", "s", scene.lag, float(abs(found.x[0])))]


def _columns(log: ControlLog | str | PathLike[str], wanted: Sequence[str]) -> dict[str, tuple[Array, Array]]:
    """Instants [s] and values of the channels that a log has, by name and unit: increasing, without gaps."""
    if isinstance(log, ControlLog):
        t = log.t
        given = dict(
            zip([*(COMMANDED + name for name in log.u_names), *log.y_names], [*log.u.T, *log.y.T], strict=True)
        )
    else:
        table = read_table(str(log))
        t, given = table.in_si("t" if "t" in table.headings else "time", "s"), {}
        for label in wanted:
            name, unit = split_unit(label)
            if name in table.headings:
                given[label] = table.in_si(name, unit, gaps=True)
    found = {}
    for label, values in given.items():
        there = np.isfinite(values)
        instants, first = np.unique(t[there], return_index=True)
        if label in wanted and instants.size:
            found[label] = instants, values[there][first]
    return found
