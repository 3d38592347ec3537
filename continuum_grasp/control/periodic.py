"""A controller against the clock: a loop of fixed period, with its jitter and overruns."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.arguments import check_arguments, positive, within
from continuum_grasp.control.controller import Controller
from continuum_grasp.control.status import Status, spread
from continuum_grasp.errors import InputError

Array = NDArray[np.float64]

_MOST_CYCLES = 1e8
"""Cycles of one run [1]: their times are held in memory, 1.6 GB; eleven days at 10 ms."""


@dataclass(frozen=True)
class PeriodicRun:
    """Timing and statuses of a periodic loop of K cycles.

    Attributes
    ----------
    period : float
        [s]
    jitter : (K,) ndarray
        Delay of the start of each cycle [s].
    latency : (K,) ndarray
        Time from the start of a cycle until its command was written [s].
    overruns : int
        Cycles that ended after the next one should have begun.
    skipped : int
        Cycles that were skipped for that reason.
    status : dict
        Commands by their status.
    """

    period: float
    jitter: Array
    latency: Array
    overruns: int
    skipped: int
    status: dict[str, int]

    def summary(self) -> dict[str, Any]:
        """Return counts, and median, 99th percentile and maximum of jitter and latency [s]."""
        counts = {"cycles": len(self.jitter), "overruns": self.overruns, "skipped": self.skipped}
        spreads = {"jitter": spread(self.jitter), "latency": spread(self.latency)}
        return {"period": self.period, **counts, **spreads, "status": self.status}


@check_arguments
def run_periodic(
    controller: Controller,
    read: Callable[[], ArrayLike | None],
    write: Callable[[Array], object],
    *,
    duration: float,
    spin: float = 0.0,
    idle: Callable[[], object] | None = None,
) -> PeriodicRun:
    """Read, compute and write once per period of a controller.

    Cycles begin at fixed instants of the monotonic clock, however long the previous ones took. A cycle that ends after
    the next one should have begun is an overrun, and the next begins at once; a command written that late counts as
    late. For each cycle that is missed altogether, the controller steps with the applied input, without a measurement
    and without a new plan. Python's garbage collection is off during the loop: a collection takes longer than a step.

    Parameters
    ----------
    controller : Controller
        The controller, ready to start, with ``deadline=math.inf``: this loop detects late commands itself.
    read : callable
        Returns a measurement in the order of ``measurement_names``, or None, without waiting.
    write : callable
        Takes the command, (nu,).
    duration : float
        Duration [s].
    spin : float
        Last part of the waiting time, spent polling the clock instead of sleeping [s]; less jitter, more load.
    idle : callable, optional
        Called after ``write``, for work that may take the rest of a period.

    Returns
    -------
    PeriodicRun

    Raises
    ------
    InputError
        If a time is not positive, or spinning takes longer than a period.

    Examples
    --------
    >>> import math
    >>> from continuum_grasp.control import Controller, run_periodic
    >>> controller = Controller("configs/mpc/steady_tip.yaml", deadline=math.inf)
    >>> commands = []
    >>> run = run_periodic(controller, lambda: [0.0, 0.18, 1.0, 1.0], commands.append, duration=0.05)
    >>> len(commands) + run.skipped
    5
    """
    period = controller.period
    duration = within("duration", positive("duration", duration), 0.0, _MOST_CYCLES * period)
    cycles = max(1, math.floor(duration / period + 1e-9))
    if not 0.0 <= spin < period:
        raise InputError(f"expected a time from 0 to the period of {period:g} s, got {spin!r:.60}", key="spin")
    jitter, latency = np.zeros(cycles), np.zeros(cycles)
    counts = [0] * len(Status)
    overruns = skipped = count = cycle = 0
    late = False
    with _no_collection():
        # A period ahead, so that the first cycle is not late by what was done until here.
        start = time.perf_counter() + period
        while cycle < cycles:
            release = start + cycle * period
            began = _wait_until(release, spin)
            command = controller.step(read(), late=late or None)
            write(command.u)
            written = time.perf_counter()
            jitter[count], latency[count] = began - release, written - began
            counts[command.status] += 1
            count += 1
            if idle is not None:
                idle()
            passed = int((time.perf_counter() - start) / period)
            late = written - release > period
            overruns += passed > cycle
            missed = max(0, min(passed, cycles) - cycle - 1)
            # Estimator, plan and setpoints keep pace with the clock over cycles that are skipped.
            for _ in range(missed):
                controller.step(None, applied=command.u, late=True)
            skipped += missed
            cycle += 1 + missed
    status = {kind.name.lower(): counts[kind] for kind in Status}
    return PeriodicRun(period, jitter[:count], latency[:count], overruns, skipped, status)


def _wait_until(instant: float, spin: float) -> float:
    """Sleep, then poll the clock; return the time at which the waiting ended."""
    rest = instant - spin - time.perf_counter()
    if rest > 0.0:
        time.sleep(rest)
    now = time.perf_counter()
    while now < instant:
        now = time.perf_counter()
    return now


@contextmanager
def _no_collection() -> Iterator[None]:
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
