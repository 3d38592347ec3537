"""Performance of a closed loop: tracking, effort, violated bounds, times and counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.closed_loop.readings import Bound
from continuum_grasp.control.ocp.setpoints import Tracking, amount


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
        rows = [("tracking error", "r.m.s.", "max", "final")]
        rows += [(t.name, amount(t.rms, t.unit), amount(t.max, t.unit), amount(t.final, t.unit)) for t in self.tracking]
        rows.append(("bound", "worst", "exceeded", ""))
        rows += [(v.name, amount(v.worst, v.unit), f"{100 * v.share:.1f} %", "") for v in self.violations]
        return rows + self.time_rows()

    def time_rows(self) -> list[tuple[str, str, str, str]]:
        """Return the rows of that table which say how long the phases of a step and the whole step took."""
        rows = [(t.name, amount(t.median, "s"), amount(t.p99, "s"), amount(t.max, "s")) for t in self.times]
        return [("time", "median", "99 %", "max"), *rows]

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


def violation_of(bound: Bound) -> Violation:
    """Evaluate a bound; what exceeds it by rounding alone does not count."""
    worst = float(bound.excess.max())
    rounding = 1e-9 * max(1.0, float(np.abs(bound.excess).max()))
    return Violation(bound.name, bound.unit, worst, float(np.mean(bound.excess > rounding)))
