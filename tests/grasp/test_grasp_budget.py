"""The verdict of a grasp search counts work, the clock is an emergency stop."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest
from grasp_scenes import INTO_PLANE, make_scene

from continuum_grasp.grasp import GraspStatus, optimize_grasp
from continuum_grasp.nlp import Solver
from continuum_grasp.scene import GraspSolver
from tests.marks import few

CLOCKS = ("monotonic", "perf_counter", "process_time", "thread_time", "time")
HELD = {"max_tension": 60.0}
WEAK = {"max_tension": 35.0}


def solved(solver=None, **changes):
    return optimize_grasp(
        make_scene("arc", INTO_PLANE, solver=solver or GraspSolver(effort="quick"), **changes), raise_on_failure=False
    )


def numbers(result):
    """All of a result but the times."""
    reasons = [(r.name, r.limit, r.needed) for r in result.reasons]
    tried = [(a["outcome"], a["iterations"], a["objective"]) for a in result.statistics["attempts"]]
    return result.status, result.message, reasons, tried, {k: np.asarray(v).tobytes() for k, v in result.arrays.items()}


def hurry(monkeypatch, seconds=0.5):
    """Let time pass whenever a clock is read, as for a process that gets little of the processor."""
    readings = itertools.count()
    for name in CLOCKS:
        monkeypatch.setattr(time, name, lambda: seconds * next(readings))


@pytest.mark.parametrize(
    ("changes", "status"), [(HELD, GraspStatus.OPTIMAL), *few([(WEAK, GraspStatus.NOT_SOLVED)], 0)]
)
def test_a_busy_machine_gives_the_same_verdict_bit_by_bit(monkeypatch, changes, status):
    calm = solved(**changes)
    hurry(monkeypatch)
    busy = solved(**changes)
    assert calm.status is status
    assert numbers(busy) == numbers(calm)
    if status is GraspStatus.NOT_SOLVED:
        assert busy.reasons
        assert busy.statistics["total_seconds"] > 60.0


@pytest.mark.parametrize("changes", [HELD, *few([WEAK], 0)])
def test_iterations_are_counted_and_limited(changes):
    free = solved(**changes)
    spent = free.statistics["total_iterations"]
    assert spent >= sum(a["iterations"] for a in free.statistics["attempts"]) > 0
    assert not free.statistics["cut_short"]
    exact = solved(GraspSolver(effort="quick", max_total_iterations=spent + 1), **changes)
    assert numbers(exact) == numbers(free)


def test_a_budget_that_is_too_small_is_no_verdict_and_repeats():
    few = GraspSolver(effort="quick", max_total_iterations=10)
    one, two = solved(few, **WEAK), solved(few, **WEAK)
    assert one.status is GraspStatus.NOT_SOLVED
    assert "max_total_iterations" in one.message + one.advice
    assert one.statistics["cut_short"] == "iterations"
    assert numbers(one) == numbers(two)


def jump_after(monkeypatch, run):
    """Let the emergency stop come with the so-many-th run of the solver."""
    count, whole = [0], Solver.solve

    def counted(self, problem, start, until):
        count[0] += 1
        if count[0] == run:
            until.until = -1.0
        return whole(self, problem, start, until)

    monkeypatch.setattr(Solver, "solve", counted)


@pytest.mark.parametrize("run", [1, 12])
def test_the_clock_gives_no_verdict_but_says_that_it_stopped(monkeypatch, run):
    """The first run of the search, and one of the diagnosis, whose reasons so far are none."""
    jump_after(monkeypatch, run)
    result = solved(**WEAK)
    assert result.status is GraspStatus.STOPPED
    assert not result.solved
    assert not result.reasons
    assert "clock" in result.message
    assert "solver.time_limit" in result.advice
    assert result.statistics["cut_short"] == "clock"


def test_a_grasp_from_before_the_clock_stopped_is_called_so(monkeypatch):
    jump_after(monkeypatch, 2)
    result = optimize_grasp("configs/grasp/mug.yaml")
    assert result.status is GraspStatus.FEASIBLE
    assert "clock" in result.message
    assert any("cut short" in warning for warning in result.warnings)


def test_a_search_says_how_it_stands():
    """The best that it had after each start; at last that of the result, or that reasons are sought."""
    said = []
    result = optimize_grasp(make_scene(elements=4), progress=said.append)
    assert len(said) == result.exploration.starts_solved + result.exploration.starts_failed
    assert said[-1].startswith(f"{result.tension:.4g} N so far; {len(said)} starts tried")
    optimize_grasp(make_scene(mass=60.0), raise_on_failure=False, progress=said.append)
    assert any(text.startswith("no grasp found") for text in said)
