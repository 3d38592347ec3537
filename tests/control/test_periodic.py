"""The periodic loop on a clock of its own."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.control import Controller, periodic
from continuum_grasp.control.status import Status
from continuum_grasp.errors import InputError


class Clock:
    """Goes on by what is slept, by what steps take, and a nanosecond for every look."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        self.now += 1e-9
        return self.now

    def sleep(self, time: float) -> None:
        self.now += time + 1e-5


class Steps(Controller):
    """A controller of 10 ms whose steps take as long as they are set to."""

    period = 0.01

    def __init__(self, clock: Clock, durations) -> None:
        self.clock, self.durations, self.calls = clock, iter(durations), []

    def step(self, measurement, *, late=None, applied=None):
        self.calls.append((measurement, late, applied))
        if applied is None:
            self.clock.now += next(self.durations)
        return SimpleNamespace(u=np.array([float(len(self.calls))]), status=Status.SOLVED)


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(periodic, "time", made)
    return made


def run(clock, durations, **options):
    control = Steps(clock, durations)
    written = []
    found = periodic.run_periodic(control, lambda: "y", written.append, duration=0.1, **options)
    return found, control.calls, written


def test_cycles_keep_their_instants(clock):
    found, calls, written = run(clock, [0.002, 0.006] * 5)
    assert (len(found.jitter), found.overruns, found.skipped) == (10, 0, 0)
    assert found.jitter == pytest.approx(1e-5, abs=1e-7)
    assert found.latency == pytest.approx([0.002, 0.006] * 5, abs=1e-7)
    assert [u[0] for u in written] == list(range(1, 11))
    assert calls == [("y", None, None)] * 10
    assert found.summary()["cycles"] == found.status["solved"] == 10


def test_spinning_takes_out_what_sleeping_adds(clock):
    assert run(clock, [0.002] * 10, spin=2e-5)[0].jitter == pytest.approx(0.0, abs=1e-7)


def test_a_late_command_is_reported_and_missed_cycles_are_replaced(clock):
    found, calls, _ = run(clock, [0.002, 0.035] + [0.002] * 6)
    assert (found.overruns, found.skipped, len(found.jitter)) == (1, 2, 8)
    assert [late for _, late, _ in calls] == [None, None, True, True, True] + [None] * 5
    assert [y for y, _, applied in calls if applied is not None] == [None, None]
    assert all(applied[0] == 2.0 for _, _, applied in calls[2:4])
    assert found.jitter[2] == pytest.approx(0.005, abs=1e-4)


def test_the_rest_of_a_period_may_be_used_and_overrun(clock):
    rests = iter([0.001, 0.011, 0.001] + [0.0] * 7)
    found, calls, _ = run(clock, [0.002] * 10, idle=lambda: clock.sleep(next(rests)))
    assert (found.overruns, found.skipped) == (1, 0)
    assert [late for _, late, _ in calls] == [None] * 10


@pytest.mark.parametrize(
    "wrong", [{"duration": 0.0}, {"duration": 1e300}, {"duration": 1.0, "spin": 0.01}, {"duration": 1.0, "spin": -1.0}]
)
def test_times_are_checked(clock, wrong):
    with pytest.raises(InputError):
        periodic.run_periodic(Steps(clock, []), lambda: None, lambda u: None, **wrong)
