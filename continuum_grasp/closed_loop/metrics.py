"""How well a closed loop did: tracking, effort, violated bounds, times and counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.closed_loop.readings import Bound
from continuum_grasp.control.ocp.cost_terms import Tracked, tracked_groups
from continuum_grasp.scene.cost import Reference

Array = NDArray[np.float64]

FINAL = 0.1
"""Last share of the run over which the final error is averaged: noise averages out, and a step has settled."""
_STOOD = 0.5
"""Time for which a setpoint has to stand for its error at the end to count [s]: some periods of a finger's sway."""
_OFF = 0.05
"""Error at the end from which on a setpoint is missed, per length of the finger [1]; of angles twice that [rad], which
moves the tip as far; of forces twice that share of them, or of a newton, as of weighted goals of plans."""


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
    """Time that a phase of the controller took, or the whole step [s]."""

    name: str
    median: float
    p99: float
    max: float


@dataclass(frozen=True)
class Metrics:
    """A closed loop in numbers.

    ``tracking`` is per quantity that is followed; distances of points are Euclidean, over all of them for sections.
    ``cost`` is the sum over the run of the controller's own running cost, on the plant. ``effort_rms`` is of the
    input's deviation from the setpoint of effort, or from its least where there is none [N or N m], ``rate_rms`` of
    its rate [N/s or N m/s]. ``late`` counts steps that took longer than the deadline; ``mismatch`` is the greatest
    mean squared normalized innovation of a sensor, about 1 where sensors and model agree.
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
        """Return a table of four columns: what, and three values with their units."""
        found = [("tracking error", "r.m.s.", "max", "final")]
        found += [
            (t.name, amount(t.rms, t.unit), amount(t.max, t.unit), amount(t.final, t.unit)) for t in self.tracking
        ]
        found.append(("bound", "worst", "exceeded", ""))
        found += [(v.name, amount(v.worst, v.unit), f"{100 * v.share:.1f} %", "") for v in self.violations]
        return found + self.time_rows()

    def time_rows(self) -> list[tuple[str, str, str, str]]:
        """Return the rows of that table which say how long the phases of a step and the whole step took."""
        found = [(t.name, amount(t.median, "s"), amount(t.p99, "s"), amount(t.max, "s")) for t in self.times]
        return [("time", "median", "99 %", "max"), *found]

    def pairs(self) -> dict[str, str]:
        """Single values by name."""
        counts = {"status": self.statuses, "anomalies": self.anomalies, "health": self.health}
        words = {k: ", ".join(f"{n} {name}" for name, n in v.items()) or "none" for k, v in counts.items()}
        return {
            "closed-loop cost": f"{self.cost:.6g}",
            "effort": f"{amount(self.effort_rms, self.input_unit)} r.m.s.",
            "input rate": f"{amount(self.rate_rms, self.input_unit + '/s')} r.m.s.",
            "late": f"{self.late}",
            **words,
            "mismatch": f"{self.mismatch:.2g} at most",
        }


def tracking_of(group: Tracked, error: Array) -> Tracking:
    """Evaluate the errors of one tracked quantity (K + 1, nr)."""
    own = error[:, group.columns]
    last = own[-max(1, round(FINAL * len(own))) :].mean(axis=0)
    # A point's error is the length of its vector; other quantities are scalars, points of one dimension.
    size = 2 if group.of_points else 1
    sizes = np.linalg.norm(own.reshape(len(own), -1, size), axis=2)
    final = np.linalg.norm(last.reshape(-1, size), axis=1).max()
    return Tracking(group.label, group.unit, rms(sizes), float(sizes.max()), float(final))


def missed_setpoints(
    names: Sequence[str], tracked: Array, r: Array, t: Array, reference: Reference, length: float
) -> tuple[str, ...]:
    """Say what ends how far from setpoints r (K + 1, nr) which stood long enough to be met, by names of columns."""
    found = []
    for group in tracked_groups(names):
        rows, off = r[:, group.columns], tracking_of(group, tracked - r).final
        others = np.flatnonzero((rows != rows[-1]).any(axis=1))
        stood = t[-1] - t[others[-1] + 1 if others.size else 0]
        # Zeros that nobody stated are a default, and no aim.
        aim = rows.any() or getattr(reference, group.reference) is not None
        force = max(1.0, float(np.abs(rows[-1]).max()))
        limit = {"m": _OFF * length, "rad": 2.0 * _OFF, "N": 2.0 * _OFF * force}[group.unit]
        # Instants are sums of rounded periods.
        if aim and off > limit and stood >= max(_STOOD, FINAL * t[-1]) * (1.0 - 1e-9):
            found.append(
                f"{group.label}: {amount(off, group.unit)} off a setpoint that stood; likely cause: no posture that "
                "inputs within their bounds hold is there, or something is in the way"
            )
    return tuple(found)


def violation_of(bound: Bound) -> Violation:
    """Evaluate a bound; what exceeds it by rounding alone does not count."""
    worst = float(bound.excess.max())
    rounding = 1e-9 * max(1.0, float(np.abs(bound.excess).max()))
    return Violation(bound.name, bound.unit, worst, float(np.mean(bound.excess > rounding)))


def times_of(name: str, column: Array) -> Times:
    """Evaluate the durations of a phase (K) [s]."""
    return Times(name, float(np.median(column)), float(np.quantile(column, 0.99)), float(column.max()))


def rms(values: Array) -> float:
    """Root of the mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def amount(value: float, unit: str) -> str:
    """Format a value with a unit that people read."""
    factor, word = {"m": (1e3, "mm"), "s": (1e6, "us")}.get(unit, (1.0, unit))
    return f"{value * factor:.3g} {word}".strip()
