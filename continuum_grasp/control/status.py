"""Status, health and anomalies of a command; as in ``c/controller.h``, ``c/supervisor.h`` and ``c/checks.h``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from enum import IntEnum, IntFlag
from typing import Any

import numpy as np

from continuum_grasp.base import Array

CALL_RATE = "call rate"
"""Name of the supervised quantity that is no sensor."""


class CommandStatus(IntEnum):
    """Origin of a command."""

    SOLVED = 0
    """A new plan."""
    ITERATION_LIMIT = 1
    """A new plan, whose QP was not solved to its tolerance."""
    ROW_VIOLATED = 2
    """A new plan that violates a soft constraint."""
    PREVIOUS_PLAN = 3
    """The previous plan, until its end."""
    SAFE_RAMP = 4
    """The ramp to the safe input (of a finger least tensions or no moment), at a bounded rate."""

    @property
    def fallback(self) -> bool:
        """Whether there is no new plan."""
        return self >= CommandStatus.PREVIOUS_PLAN


class Health(IntEnum):
    """Whether sensors, model and call rate agree."""

    OK = 0
    MISMATCH = 1
    """A sensor contradicts the model."""
    DETUNED = 2
    """``input_rate`` is raised, because a sensor contradicts the model while the command is active."""
    FROZEN = 3
    """A reading does not move; it counts as missing until it does."""
    TRIPPED = 4
    """The command goes to the least tensions or to no moment, and stays there until ``Controller.rearm``."""
    OFFSET = 5
    """The measured tip stays away from a setpoint that stands, for longer than the loop needs (``Command.offset``)."""


class OffsetCause(IntEnum):
    """Why the measured tip stays away from a setpoint that stands."""

    NONE = 0
    UNEXPECTED = 1
    """The plan ends at the setpoint: camera, load or stiffness are not as the model has them."""
    UNREACHED = 2
    """The plan ends away from the setpoint too, though no limit holds it: the inputs do not lead the tip there, or
    other weights outweigh it."""
    LIMITED = 3
    """The plan ends away from the setpoint, with an input at its limit or a soft constraint violated."""


class Trip(IntEnum):
    """Why a controller is tripped."""

    NONE = 0
    SWINGING = 1
    CONTRADICTED = 2
    AWAY = 3
    UNSEEN = 4
    UNANSWERED = 5
    IMPLAUSIBLE = 6


class Sight(IntEnum):
    """Worth of an estimate."""

    SEES = 0
    CONTRADICTED = 1
    """A sensor contradicts the model."""
    PREDICTS = 2
    """Nothing shows the shape of the finger in this call."""
    BLIND = 3
    """The controller is tripped, a reading is frozen, or for as long as a plan lasts nothing showed the shape, or no
    plan was found."""


class Anomaly(IntFlag):
    """Anomalies of a call, as bits."""

    MISSING = 1
    ABSURD = 2
    OUTLIER = 4
    REOPENED = 8
    BLIND = 16
    ESTIMATE_LIMITED = 32
    ESTIMATE_RESTARTED = 64
    BAD_SETPOINTS = 128
    BAD_PARAMETERS = 256
    BAD_APPLIED = 512
    LATE = 1024
    NOT_SOLVED = 2048
    INPUT_LIMITED = 4096
    RATE_LIMITED = 8192
    FROZEN = 16384
    BEYOND_LIMIT = 32768
    PLAN_GAPS = 65536
    MISSED_CALLS = 131072
    CLOCK = 262144
    OLD = 524288
    OUT_OF_REACH = 1048576

    @property
    def description(self) -> str:
        """Meaning of a single bit."""
        return ANOMALY_TEXTS.get(self) or f"a reading: {MEASUREMENT_TEXTS[MeasurementVerdict[str(self.name)]]}"


class MeasurementVerdict(IntEnum):
    """Verdict on a measurement."""

    USED = 0
    MISSING = 1
    ABSURD = 2
    OUTLIER = 3
    REOPENED = 4
    ALONE = 5
    FROZEN = 6


MEASUREMENT_TEXTS = {
    MeasurementVerdict.MISSING: "not measured",
    MeasurementVerdict.ABSURD: "infinite or beyond its limits",
    MeasurementVerdict.OUTLIER: "outlier rejected",
    MeasurementVerdict.REOPENED: "too many outliers: used with bounded influence",
    MeasurementVerdict.FROZEN: "frozen: the reading does not move",
}
ANOMALY_TEXTS = {
    Anomaly.BLIND: "no measurement for a whole horizon",
    Anomaly.ESTIMATE_LIMITED: "an estimated disturbance was clipped to its limits",
    Anomaly.ESTIMATE_RESTARTED: "the estimate was not finite or beyond its limits; the estimator restarted",
    Anomaly.BAD_SETPOINTS: "a setpoint is not finite or beyond its limits",
    Anomaly.BAD_PARAMETERS: "a parameter is not finite or beyond its limits; the last good ones are used",
    Anomaly.BAD_APPLIED: "the applied input is not finite or beyond its limits; the last command is assumed",
    Anomaly.LATE: "the last command was late",
    Anomaly.NOT_SOLVED: "the real-time iteration failed",
    Anomaly.INPUT_LIMITED: "the planned input was outside its limits",
    Anomaly.RATE_LIMITED: "the planned input changed faster than its rate limit allows",
    Anomaly.BEYOND_LIMIT: "the last command exceeded a limit; this one returns to it as fast as allowed",
    Anomaly.PLAN_GAPS: "the plan did not satisfy the model: replaced, or integrated again",
    Anomaly.MISSED_CALLS: "calls were missed: the prediction covers the time that passed",
    Anomaly.CLOCK: "the time of the call is ignored: it stands still, goes back, or is not a number",
    Anomaly.OLD: "the measurement is not newer than the last one: ignored",
    Anomaly.OUT_OF_REACH: "a setpoint is out of the finger's reach: the command aims at it, but cannot reach it",
}


_UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
"""Unit of a clock by how many times too fast it seems to go [1]."""


def _unit_of(missed: float) -> str:
    """Return the unit of a clock that would explain a number of missed calls; empty if it was a stall."""
    return next((unit for factor, unit in _UNITS.items() if 0.5 < (missed + 1.0) / factor < 2.0), "")


def texts(anomalies: int, verdicts: Sequence[float], names: Sequence[str], missed: float = 0.0) -> tuple[str, ...]:
    """Describe the bits of ``Anomaly`` and the verdict on each measurement in words, one sentence each.

    An anomaly of a measurement begins with the measurement's name. ``missed`` is how many calls were missed.
    """
    unit = _unit_of(missed)
    lengths = {
        Anomaly.MISSED_CALLS: f"{missed:.3g} {ANOMALY_TEXTS[Anomaly.MISSED_CALLS]}",
        Anomaly.CLOCK: f"the time of the call is ignored: it counts {unit}" if unit else ANOMALY_TEXTS[Anomaly.CLOCK],
    }
    measured = [
        f"{name.split(' ')[0]}: {MEASUREMENT_TEXTS[MeasurementVerdict(int(verdict))]}"
        for name, verdict in zip(names, verdicts, strict=True)
        if int(verdict) in MEASUREMENT_TEXTS
    ]
    return (*measured, *[lengths.get(bit, text) for bit, text in ANOMALY_TEXTS.items() if anomalies & bit])


_TRIPS = {
    Trip.SWINGING: "contradicts the model and the command swings though `input_rate` is raised 64-fold",
    Trip.CONTRADICTED: "contradicts the model by many standard deviations",
    Trip.AWAY: "contradicts the model and the tip stays far from its setpoint",
    Trip.UNSEEN: "is missing, beyond its limits or does not move, and nothing else shows the shape",
    Trip.UNANSWERED: "does not respond to the drives",
    Trip.IMPLAUSIBLE: "leads to an implausible estimated disturbance",
}


_OFFSETS = {
    OffsetCause.NONE: "no plan shows why",
    OffsetCause.UNEXPECTED: (
        "the plan ends at the setpoint, so camera (scale, shift, turn), load or stiffness are not the model's: "
        "commission the camera, or name the load in estimator.disturbances"
    ),
    OffsetCause.UNREACHED: (
        "the plan ends away from the setpoint too: the inputs do not lead the tip there (one pair of tendons moves it "
        "on one curve), or other weights outweigh cost.tip"
    ),
    OffsetCause.LIMITED: (
        "the plan ends away from the setpoint too, with an input at its limit or a soft constraint violated"
    ),
}


_LAGS = {
    1: "shorter delay or lag than the model's (a first-order lag is `drive_order: 1`)",
    -1: "longer delay or lag than the model's",
    0: "another delay or lag than the model's",
}


def health_text(
    health: Health,
    suspect: str | None,
    reason: Trip = Trip.NONE,
    ahead: int = 0,
    missed: float = 0.0,
    offset: float = 0.0,
    cause_of_offset: OffsetCause = OffsetCause.NONE,
) -> str:
    """Describe a health in words, with its likely cause; empty for OK.

    ``suspect`` is the quantity that contradicts the model, or the frozen reading; ``ahead`` is 1 if a drive runs ahead
    of the model's, -1 if it falls behind; ``missed`` is the number of calls missed before this one; ``offset`` is the
    distance of the tip from a setpoint that it does not reach [m], or 0, with its reason in ``cause_of_offset``.
    """
    if health == Health.OK:
        return ""
    away = f"stays {1e3 * offset:.3g} mm from its setpoint" if offset > 0.0 else ""
    if suspect == CALL_RATE:
        unit = _unit_of(missed)
        cause = f"`time` is in seconds, and the clock counts {unit}; else " if unit else ""
        cause += "call the controller once per period, or change controller.period"
    elif health == Health.FROZEN or reason == Trip.UNSEEN:
        cause = (
            "a sensor or its driver is off or stuck, or has other units than its name says; quantized readings "
            "need estimator.frozen: false"
        )
    elif reason == Trip.UNANSWERED:
        cause = "an old image, a camera that sees something else, or an unknown contact that holds the finger"
    else:
        cause = f"{_LAGS[ahead]}, swapped or rotated axes, wrong scale, or an unknown contact"
    if away and suspect == "tip":
        cause = _OFFSETS[cause_of_offset]
    what = {
        Health.OFFSET: away,
        Health.MISMATCH: "contradicts the model",
        Health.DETUNED: "contradicts the model, so `input_rate` is raised",
        Health.FROZEN: "does not move and counts as missing",
        Health.TRIPPED: f"{_TRIPS.get(reason, 'contradicts the model')}: the command goes to the safe input",
    }[health]
    also = f", and {away}" if away and suspect == "tip" and what != away else ""
    return f"{suspect or 'something'} {what}{also}; likely cause: {cause}"


_RETAINED = 1 << 16
"""Steps whose durations are retained [1]: 11 minutes at 100 Hz, 2 MB."""
_PHASES = ("estimate", "prepare", "feedback", "step")


def spread(values: Array) -> dict[str, float]:
    """Compute median, 99th percentile and maximum."""
    return {"median": float(np.median(values)), "p99": float(np.percentile(values, 99)), "max": float(values.max())}


class Statistics:
    """Counts of steps, and of those later than the deadline, since the last reset; durations of the last 65,536."""

    def __init__(self) -> None:
        self.steps = self.late = 0
        self._status, self._health = [0] * len(CommandStatus), [0] * len(Health)
        self._anomalies: Counter[int] = Counter()
        self._times = np.zeros((_RETAINED, len(_PHASES)))

    def add(self, status: int, anomalies: float, ticks: Array, elapsed: int, late: bool, health: int = 0) -> None:
        """Count a step; durations in nanoseconds."""
        row = self._times[self.steps % _RETAINED]
        row[:3], row[3] = ticks, elapsed
        self.steps += 1
        self.late += late
        self._status[status] += 1
        self._health[health] += 1
        if anomalies:
            # Counted by all bits at once; a step has no time to take them apart.
            self._anomalies[int(anomalies)] += 1

    def as_dict(self) -> dict[str, Any]:
        """Return all counts, and the spread of each phase and of the whole step in Python [s], as plain values."""
        recent = 1e-9 * self._times[: self.steps]
        anomalies = {
            (bit.name or "").lower(): sum(count for bits, count in self._anomalies.items() if bits & bit)
            for bit in Anomaly
        }
        return {
            "steps": self.steps,
            "late": self.late,
            "fallbacks": sum(self._status[kind] for kind in CommandStatus if kind.fallback),
            "status": {kind.name.lower(): self._status[kind] for kind in CommandStatus},
            "health": {kind.name.lower(): self._health[kind] for kind in Health},
            "anomalies": {name: count for name, count in anomalies.items() if count},
            "times": {name: spread(recent[:, k]) for k, name in enumerate(_PHASES)} if self.steps else {},
        }
