"""Some of the hard cases of ``benchmarks.bench_hard_cases``, and that their judge sees what is wrong."""

from __future__ import annotations

import math
import os
import time
import warnings

import numpy as np
import pytest

from benchmarks.hard_cases import attempt as judging
from benchmarks.hard_cases.attempt import REFUSED, RIGHT, WARNED, WRONG, Attempt, Found, judge
from benchmarks.hard_cases.motion import motion_attempts
from benchmarks.hard_cases.motion_truth import true_states
from benchmarks.hard_cases.scenes import FAMILIES, nitinol
from benchmarks.hard_cases.statics import static_attempts
from continuum_grasp.core.compiler import find_compiler
from continuum_grasp.errors import InputError, NumericalError, SolverError
from tests.marks import few

EVERY_FAMILY = (
    "at rest, coiled to 1.05 times the range",
    "at rest, coiled to 3.1 times the range",
    "standing, straight and unstable",
    "standing, buckled to both sides",
    "column, tip turned by 1.5 rad, both sides",
    "both shapes under 0.7 of the snap load",
)
QUICK = [
    *(f"{case}, {family}, equilibrium" for case in EVERY_FAMILY for family in FAMILIES),
    "at rest without loads, arc, equilibrium",
    "at rest, pushed by 1e-9 EI/L2, matched_clothoid, equilibrium",
    "at rest, pushed by 10 EI/L2, clothoid, equilibrium",
    "at rest, one element 1 % of the other, matched_clothoid, float",
    "at rest, 100-fold tip mass, matched_clothoid, equilibrium",
    "snap-through under a rising load, matched_clothoid, equilibrium",
    "straight exactly, matched_clothoid, auto",
    "straight exactly, arc, float",
    "standing exactly, beyond buckling, arc, auto",
    "nearly straight, 1e-6 rad, matched_clothoid, auto",
    "nearly straight, 1e-6 rad, arc, reference",
    "one element 1 % of the other, matched_clothoid, auto",
    "one element 1 % of the other, arc, float",
    "light short tip, 30 kHz, arc, auto",
    "light short tip, 30 kHz, arc, rk4",
    "light short tip, 30 kHz, arc, float",
    "100-fold tip mass, matched_clothoid, auto",
    "100-fold tip mass, matched_clothoid, float",
    "1,000 periods without damping: energy, arc, auto",
    "1,000 periods without damping: energy, matched_clothoid, auto",
    "1,000 periods without damping: energy, matched_clothoid, float",
    "contact force reversed in 1 ms, matched_clothoid, auto",
    "contact force reversed in 2 ns, arc, auto",
    "contact force reversed in 2 ns, arc, reference",
    "tension 0 to 40 N in 2 ns, arc, auto",
    "tension 0 to 40 N in 2 ns, matched_clothoid, auto",
    "tension 0 to 40 N in 20 ms, matched_clothoid, auto",
    "tension 0 to 40 N in 1 ms, lag of 5 ms, arc, auto",
    "tension 0 to 40 N in 1 ms, lag of 5 ms, arc, float",
    "let go at 1.2 times the range, arc, auto",
    "let go at 2.9 times the range, arc, auto",
    "let go at 3.1 times the range, matched_clothoid, auto",
]


@pytest.fixture(scope="module")
def attempts():
    """All attempts by name."""
    return {attempt.name: attempt for make in (static_attempts, motion_attempts) for attempt in make()}


@pytest.mark.parametrize("name", few(sorted(QUICK, key=lambda name: "1,000 periods" in name), len(QUICK) // 3))
def test_a_hard_case_ends_as_expected(name, attempts):
    if name.endswith("float") and find_compiler() is None:
        pytest.skip("no C compiler here")
    judged = judge(attempts[name])
    assert judged.kind in attempts[name].expected, judged.verdict


def test_names_are_distinct(attempts):
    assert len(attempts) == sum(1 for make in (static_attempts, motion_attempts) for _ in make())


def raising(error: BaseException):
    raise error


def warning() -> Found:
    warnings.warn("thin ice", UserWarning, stacklevel=1)
    return Found(0.0, 1)


OUTCOMES = {
    "an answer": (lambda: Found(1e-6, 3), RIGHT, "right"),
    "a wrong one": (lambda: Found(1e-2, 3), WRONG, "WRONG: error 0.01 over 0.001"),
    "no number": (lambda: Found(math.nan, 3), WRONG, "WRONG: not a number"),
    "an infinite one with a warning": (lambda: Found(math.inf, 3, ("beyond",)), WRONG, "WRONG: not a number"),
    "what it says itself": (lambda: Found(0.1, 3, ("beyond the range",)), WARNED, "warned: beyond the range"),
    "a warning of Python": (warning, WARNED, "warned: thin ice"),
    "wrong input": (lambda: raising(InputError("no such name")), REFUSED, "refused: no such name"),
    "numbers": (lambda: raising(NumericalError("lost\nmore")), REFUSED, "refused: lost"),
    "a solver": (lambda: raising(SolverError("none found", status="x")), REFUSED, "refused: none found (status: x)"),
    "a crash": (lambda: raising(KeyError("q")), WRONG, "WRONG: KeyError: 'q'"),
}


@pytest.mark.parametrize("name", OUTCOMES)
def test_the_judge_sees(name):
    run, kind, verdict = OUTCOMES[name]
    judged = judge(Attempt("case", "arc", "auto", run, 1e-3))
    assert (judged.kind, judged.verdict) == (kind, verdict)
    assert judged.surprising is (kind != RIGHT)


@pytest.mark.skipif(os.name == "nt", reason="needs alarms")
def test_what_hangs_is_stopped(monkeypatch):
    monkeypatch.setattr(judging, "PATIENCE", 1)
    judged = judge(Attempt("case", "arc", "auto", lambda: time.sleep(60), 1e-3))
    assert judged.verdict == "WRONG: no answer in 1 s"


def test_the_truth_of_motions_is_that_of_an_oscillator():
    """One arc without mass at its tip, bent by 1e-5 rad: a cosine, with the frequency of its mass matrix."""
    from continuum_grasp.model import FingerModel

    scene = nitinol("arc", 1, initial={"q": [1e-5]}, time={"duration": 0.1, "step": 0.001})
    model = FingerModel(scene)
    mass = float(np.array(model.mass_matrix([0.0], [0.0], [])).ravel()[0])
    stiffness = float(np.array(model.elastic([1.0], [0.0], [])).ravel()[0])
    t = np.linspace(0.0, 0.1, 101)
    assert true_states(scene)[:, 0] == pytest.approx(1e-5 * np.cos(math.sqrt(stiffness / mass) * t), abs=1e-11)
