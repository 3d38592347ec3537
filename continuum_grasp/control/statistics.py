"""Counts and durations of a controller's steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.status import Anomaly, Health, Status

__all__ = ["Statistics", "spread"]

Array = NDArray[np.float64]

_RETAINED = 1 << 16
"""Steps whose durations are retained [1]: 11 minutes at 100 Hz, 2 MB."""
_PHASES = ("estimate", "prepare", "feedback", "step")


def spread(values: Array) -> dict[str, float]:
    """Compute median, 99th percentile and maximum."""
    return {"median": float(np.median(values)), "p99": float(np.percentile(values, 99)), "max": float(values.max())}


class Statistics:
    """Counts since the last reset, and durations of the last 65,536 steps.

    Attributes
    ----------
    steps, late : int
        Steps, and those that took longer than the deadline.
    """

    def __init__(self) -> None:
        self.steps = self.late = 0
        self._status = [0] * len(Status)
        self._health = [0] * len(Health)
        self._anomalies: dict[int, int] = {}
        self._times = np.zeros((_RETAINED, len(_PHASES)))

    def add(self, status: int, anomalies: float, ticks: Array, elapsed: int, late: bool, health: int = 0) -> None:
        """Count a step; durations in nanoseconds."""
        row = self._times[self.steps % _RETAINED]
        row[:3] = ticks
        row[3] = elapsed
        self.steps += 1
        self.late += late
        self._status[status] += 1
        self._health[health] += 1
        if anomalies:
            self._anomalies[int(anomalies)] = self._anomalies.get(int(anomalies), 0) + 1

    @property
    def status(self) -> dict[str, int]:
        """Commands by their status."""
        return {kind.name.lower(): self._status[kind] for kind in Status}

    @property
    def health(self) -> dict[str, int]:
        """Commands by the controller's health."""
        return {kind.name.lower(): self._health[kind] for kind in Health}

    @property
    def fallbacks(self) -> int:
        """Commands without a new plan."""
        return sum(count for kind, count in zip(Status, self._status, strict=True) if kind.fallback)

    @property
    def anomalies(self) -> dict[str, int]:
        """Steps with each anomaly."""
        return {
            (bit.name or "").lower(): sum(count for bits, count in self._anomalies.items() if bits & bit)
            for bit in Anomaly
        }

    @property
    def times(self) -> dict[str, dict[str, float]]:
        """Median, 99th percentile and maximum of each phase, and of the whole step in Python [s]."""
        recent = 1e-9 * self._times[: min(self.steps, _RETAINED)]
        if not len(recent):
            return {}
        return {name: spread(recent[:, k]) for k, name in enumerate(_PHASES)}

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values."""
        return {
            "steps": self.steps,
            "late": self.late,
            "fallbacks": self.fallbacks,
            "status": self.status,
            "health": self.health,
            "anomalies": {name: count for name, count in self.anomalies.items() if count},
            "times": self.times,
        }
