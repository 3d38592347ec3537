"""Timing, side by side, and what is written about it.

A contestant is a callable that takes a number and does its work that many times. ``race`` first calls each
once for one evaluation (cold), then finds how many evaluations fill a sample, then takes the samples in
rounds: every round times every contestant once, in an order drawn anew, so that what disturbs the machine
disturbs all alike. Ratios are formed within rounds.
"""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Contestant = Callable[[int], Any]

# What is compiled for the next process would disturb the next measurement.
os.environ.setdefault("CONTINUUM_GRASP_BACKGROUND", "0")


@dataclass
class Timing:
    """Times of one contestant; seconds."""

    name: str
    cold: float | None = None
    """First call, one evaluation."""
    samples: list[float] = field(default_factory=list)
    """Per evaluation, one sample per round."""
    count: int = 1
    """Evaluations in a sample."""
    converged: int = 0
    failed: int = 0
    """Calls that did and did not end well: raised, or returned False."""
    reason: str = ""
    """Why the last failed."""

    @property
    def status(self) -> str:
        """``ok``, ``failed`` (no sample) or ``partly failed``."""
        if not self.samples:
            return "failed"
        return "partly failed" if self.failed else "ok"

    @property
    def median(self) -> float:
        """Median time of one evaluation [s]; NaN without samples."""
        return quartiles(self.samples)[1]

    def as_json(self) -> dict[str, Any]:
        """Everything, with quartiles."""
        low, middle, high = quartiles(self.samples)
        return {
            "name": self.name,
            "status": self.status,
            "cold_s": self.cold,
            "warm_s": {"median": middle, "first_quartile": low, "third_quartile": high},
            "samples": len(self.samples),
            "evaluations_per_sample": self.count,
            "converged": self.converged,
            "failed": self.failed,
            "reason": self.reason,
        }


def quartiles(values: Sequence[float]) -> tuple[float, float, float]:
    """First quartile, median, third quartile; NaN of nothing."""
    if not len(values):
        return (float("nan"),) * 3
    low, middle, high = np.percentile(values, [25, 50, 75])
    return float(low), float(middle), float(high)


def race(
    contestants: Mapping[str, Contestant],
    *,
    repeats: int = 31,
    sample_seconds: float = 0.01,
    seed: int = 0,
) -> dict[str, Timing]:
    """Time contestants side by side.

    Parameters
    ----------
    contestants : mapping of str to callable
        Each takes how many evaluations to do. One that raises is dropped; one that returns ``False`` is
        counted as failed and goes on.
    repeats : int
        Rounds.
    sample_seconds : float
        How long a sample takes, about.
    seed : int
        Of the order within the rounds.

    Returns
    -------
    dict of str to Timing
        ``samples[k]`` of all that never failed belong to the same round.
    """
    timings = {name: Timing(name) for name in contestants}
    for name, run in contestants.items():
        timings[name].cold = _call(timings[name], run, 1)
        timings[name].count = _fill(timings[name], run, sample_seconds)
    order = random.Random(seed)
    for _ in range(repeats):
        alive = [name for name in contestants if not _dropped(timings[name])]
        order.shuffle(alive)
        for name in alive:
            timing = timings[name]
            seconds = _call(timing, contestants[name], timing.count)
            if seconds is not None:
                timing.samples.append(seconds / timing.count)
    return timings


def ratios(timings: Mapping[str, Timing], reference: str) -> dict[str, tuple[float, float, float]]:
    """How many times as long as the reference each takes: quartiles of the ratios within rounds."""
    base = timings[reference].samples
    found = {}
    for name, timing in timings.items():
        pairs = zip(timing.samples, base, strict=False)
        whole = len(timing.samples) == len(base)
        found[name] = quartiles([a / b for a, b in pairs] if whole else [])
    return found


def _call(timing: Timing, run: Contestant, count: int) -> float | None:
    start = time.perf_counter_ns()
    try:
        result = run(count)
    except Exception as error:
        timing.failed += 1
        timing.reason = f"{type(error).__name__}: {error}"
        return None
    seconds = (time.perf_counter_ns() - start) * 1e-9
    if result is False:
        timing.failed += 1
        timing.reason = "returned False"
    else:
        timing.converged += 1
    return seconds


def _fill(timing: Timing, run: Contestant, seconds: float) -> int:
    """Evaluations that fill a sample."""
    count = 1
    while not _dropped(timing):
        taken = _call(timing, run, count)
        if taken is None or taken >= 0.5 * seconds or count >= 1 << 30:
            break
        count = min(1 << 30, max(2 * count, int(count * min(1e3, 0.7 * seconds / max(taken, 1e-9)))))
    return count


def _dropped(timing: Timing) -> bool:
    return timing.failed > 0 and timing.reason != "returned False"


def count_instructions(function: Any) -> dict[str, int]:
    """Instructions of a CasADi SX function.

    ``total`` is ``Function.n_instructions()``: every operation, and every load of an input entry, store of
    an output entry and constant as one instruction each. Limits on instruction counts in this project mean
    ``total``. ``arithmetic`` leaves loads, stores and constants out; ``divisions`` and ``libm`` (sin, cos,
    sqrt, exp, ...) are part of it.

    Parameters
    ----------
    function : casadi.Function
        An SX function.

    Returns
    -------
    dict of str to int
    """
    import casadi as ca

    if not function.is_a("SXFunction"):
        raise TypeError(f"expected an SX function, got {function.class_name()}: expand() it")
    ids = [function.instruction_id(k) for k in range(function.n_instructions())]
    plain = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
    library = {
        getattr(ca, f"OP_{name}")
        for name in (
            *("SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2", "SINH", "COSH", "TANH", "ASINH", "ACOSH"),
            *("ATANH", "EXP", "EXPM1", "LOG", "LOG1P", "POW", "CONSTPOW", "SQRT", "ERF", "HYPOT", "FMOD"),
        )
    }
    return {
        "total": len(ids),
        "loads": ids.count(ca.OP_INPUT),
        "stores": ids.count(ca.OP_OUTPUT),
        "constants": ids.count(ca.OP_CONST),
        "arithmetic": sum(i not in plain for i in ids),
        "divisions": sum(i in (ca.OP_DIV, ca.OP_INV) for i in ids),
        "libm": sum(i in library for i in ids),
    }
