"""What a controller's command is, and what was noticed on the way; as in ``c/controller.h`` and ``c/checks.h``."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum, IntFlag

__all__ = ["Anomaly", "Status", "Verdict", "texts"]


class Status(IntEnum):
    """What a command is."""

    SOLVED = 0
    """Of a new plan."""
    ITERATION_LIMIT = 1
    """Of a new plan, whose quadratic programme was not solved to its tolerance."""
    ROW_VIOLATED = 2
    """Of a new plan that leaves a soft bound."""
    PREVIOUS_PLAN = 3
    """Of the last plan, as long as it lasts."""
    SAFE_RAMP = 4
    """On the way to the least tensions or to no moment, at a bounded rate."""

    @property
    def fallback(self) -> bool:
        """Whether there was no new plan."""
        return self >= Status.PREVIOUS_PLAN


class Anomaly(IntFlag):
    """What was noticed."""

    MISSING = 1
    ABSURD = 2
    OUTLIER = 4
    REOPENED = 8
    BLIND = 16
    ESTIMATE_LIMITED = 32
    ESTIMATE_RESTARTED = 64
    BAD_SET_POINTS = 128
    BAD_PARAMETERS = 256
    BAD_APPLIED = 512
    LATE = 1024
    NOT_SOLVED = 2048
    INPUT_LIMITED = 4096
    RATE_LIMITED = 8192
    BEYOND_LIMIT = 16384


class Verdict(IntEnum):
    """What became of a measurement."""

    USED = 0
    MISSING = 1
    ABSURD = 2
    OUTLIER = 3
    REOPENED = 4
    ALONE = 5


_OF_MEASUREMENTS = {
    Verdict.MISSING: "not measured",
    Verdict.ABSURD: "infinite or beyond its limits",
    Verdict.OUTLIER: "an outlier, left out",
    Verdict.REOPENED: "an outlier for a while, so the estimate was moved to it",
}
_OF_THE_REST = {
    Anomaly.BLIND: "nothing was measured for as long as a plan lasts",
    Anomaly.ESTIMATE_LIMITED: "an estimated disturbance was moved into its limits",
    Anomaly.ESTIMATE_RESTARTED: "the estimate was not finite or beyond its limits, the estimator started again",
    Anomaly.BAD_SET_POINTS: "a set-point is not finite or beyond its limits",
    Anomaly.BAD_PARAMETERS: "a parameter is not finite or beyond its limits; the last good ones are used",
    Anomaly.BAD_APPLIED: "the input said to be applied is not finite or beyond its limits; the last command is assumed",
    Anomaly.LATE: "the last command was late",
    Anomaly.NOT_SOLVED: "the real-time iteration failed",
    Anomaly.INPUT_LIMITED: "the planned input was outside its limits",
    Anomaly.RATE_LIMITED: "the planned input was further from the last one than its rate allows in a stage",
    Anomaly.BEYOND_LIMIT: "the command is beyond a limit that was moved past it, and approaches it as fast as allowed",
}


def texts(anomalies: int, verdicts: Sequence[float], names: Sequence[str]) -> tuple[str, ...]:
    """Anomalies in words.

    Parameters
    ----------
    anomalies : int
        Bits of ``Anomaly``.
    verdicts : sequence of float
        What became of each measurement.
    names : sequence of str
        Names of the measurements.

    Returns
    -------
    tuple of str
        One sentence each; those of measurements begin with their name.
    """
    measured = [
        f"{name.split(' ')[0]}: {_OF_MEASUREMENTS[Verdict(int(verdict))]}"
        for name, verdict in zip(names, verdicts, strict=True)
        if int(verdict) in _OF_MEASUREMENTS
    ]
    return (*measured, *[text for bit, text in _OF_THE_REST.items() if anomalies & bit])
