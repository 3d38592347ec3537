"""How well a closed loop did."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.closed_loop.readings import Bound
from continuum_grasp.control.ocp.cost_terms import Tracked, tracked_groups

Array = NDArray[np.float64]

_FINAL = 0.1
"""Last share of the run over which the final error is averaged: noise averages out, and a step has settled."""


@dataclass(frozen=True)
class Tracking:
    """Distance from the setpoints: root of the mean square, greatest, and that of the mean over the last tenth."""

    name: str
    unit: str
    rms: float
    max: float
    final: float


@dataclass(frozen=True)
class Violation:
    """Greatest amount by which a bound was exceeded (negative: the least distance from it), and for how long."""

    name: str
    unit: str
    worst: float
    share: float


@dataclass(frozen=True)
class Times:
    """Time that a phase of the controller took [s]."""

    name: str
    median: float
    p99: float
    max: float


@dataclass(frozen=True)
class Metrics:
    """A closed loop in numbers.

    Attributes
    ----------
    tracking : tuple of Tracking
        Per quantity that is followed; distances of points are Euclidean, over all of them for sections.
    cost : float
        Sum over the run of the controller's own running cost, on the plant.
    effort_rms : float
        Root of the mean square of the input's deviation from the setpoint of effort, or from its least where there is
        none [N or N m].
    rate_rms : float
        Root of the mean square of the input's rate [N/s or N m/s].
    violations : tuple of Violation
    times : tuple of Times
    late : int
        Steps that took longer than the deadline.
    statuses, anomalies, health : dict of str to int
        How often each occurred.
    mismatch : float
        Greatest mean squared normalized innovation of a sensor; about 1 where sensors and model agree.
    """

    tracking: tuple[Tracking, ...]
    cost: float
    effort_rms: float
    rate_rms: float
    input_unit: str
    violations: tuple[Violation, ...]
    times: tuple[Times, ...]
    late: int
    statuses: dict[str, int]
    anomalies: dict[str, int]
    health: dict[str, int]
    mismatch: float

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Table of four columns: what, and three values with their units."""
        found = [("tracking error", "r.m.s.", "max", "final")]
        for one in self.tracking:
            values = (f"{_amount(v, one.unit)}" for v in (one.rms, one.max, one.final))
            found.append((one.name, *values))  # type: ignore[arg-type]
        found.append(("bound", "worst", "exceeded", ""))
        for bound in self.violations:
            found.append((bound.name, _amount(bound.worst, bound.unit), f"{100 * bound.share:.1f} %", ""))
        found.append(("time", "median", "99 %", "max"))
        for time in self.times:
            found.append((time.name, *(_amount(v, "s") for v in (time.median, time.p99, time.max))))  # type: ignore[arg-type]
        return found

    def pairs(self) -> dict[str, str]:
        """Single values by name."""
        counts = {"status": self.statuses, "anomalies": self.anomalies, "health": self.health}
        words = {k: ", ".join(f"{n} {name}" for name, n in v.items()) or "none" for k, v in counts.items()}
        return {
            "closed-loop cost": f"{self.cost:.6g}",
            "effort": f"{_amount(self.effort_rms, self.input_unit)} r.m.s.",
            "input rate": f"{_amount(self.rate_rms, self.input_unit + '/s')} r.m.s.",
            "late": f"{self.late}",
            **words,
            "mismatch": f"{self.mismatch:.2g} at most",
        }


def metrics_of(
    *,
    error: Array,
    r_names: Sequence[str],
    u: Array,
    u_names: Sequence[str],
    u_min: Array,
    weights: Array,
    period: float,
    bounds: Sequence[Bound],
    phase_names: Sequence[str],
    phase_times: Array,
    deadline: float,
    status: Sequence[str],
    anomalies: Sequence[Sequence[str]],
    health: Sequence[str],
    mismatch: Array,
) -> Metrics:
    """Compute the numbers of a run; ``error`` (K + 1, nr) is tracked less setpoints, the rest as in the run."""
    names = [name.split(" ")[0] for name in r_names]
    inputs = [names.index(name.split(" ")[0]) for name in u_names if name.split(" ")[0] in names]
    away = error[:-1, inputs] if inputs else u - np.maximum(u_min, 0.0)
    held = np.vstack([u[:1], u[:-1]])
    return Metrics(
        tracking=tuple(_tracking(group, error) for group in tracked_groups(r_names)),
        cost=float(0.5 * period * np.sum(weights * error[:-1] ** 2)),
        effort_rms=_rms(np.linalg.norm(away, axis=1)),
        rate_rms=_rms(np.linalg.norm(u - held, axis=1) / period),
        input_unit=u_names[0].split("[")[1][:-1],
        violations=tuple(
            Violation(b.name, b.unit, float(b.excess.max()), float(np.mean(b.excess > _tolerance(b.excess))))
            for b in bounds
        ),
        times=tuple(_times(name, column) for name, column in zip(phase_names, phase_times.T, strict=False)),
        late=int(np.sum(phase_times.sum(axis=1) > deadline)),
        statuses=dict(Counter(status)),
        anomalies=dict(Counter(word for words in anomalies for word in words)),
        health=dict(Counter(health)),
        mismatch=float(mismatch.max(initial=0.0)),
    )


def _tracking(group: Tracked, error: Array) -> Tracking:
    own = error[:, group.columns]
    last = own[-max(1, round(_FINAL * len(own))) :].mean(axis=0)
    if group.of_points:
        parts = own.reshape(len(own), -1, 2)
        sizes, final = np.linalg.norm(parts, axis=2), np.linalg.norm(last.reshape(-1, 2), axis=1).max()
    else:
        sizes, final = np.abs(own), np.abs(last).max()
    return Tracking(group.label, group.unit, _rms(sizes), float(sizes.max()), float(final))


def _times(name: str, column: Array) -> Times:
    return Times(name, float(np.median(column)), float(np.quantile(column, 0.99)), float(column.max()))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _tolerance(excess: Array) -> float:
    """Rounding."""
    return 1e-9 * max(1.0, float(np.abs(excess).max(initial=0.0)))


def _amount(value: float, unit: str) -> str:
    """A value with a unit that people read."""
    scaled: dict[str, Any] = {"m": (1e3, "mm"), "s": (1e6, "us"), "rad": (1.0, "rad")}
    factor, word = scaled.get(unit, (1.0, unit))
    return f"{value * factor:.3g} {word}".strip()
