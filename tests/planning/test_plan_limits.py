"""The limits of the check of plans: hand-made results just within and just beyond each, and the word of a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plan_cases import small

from continuum_grasp.planning import diagnosis, fine
from continuum_grasp.planning.guess import Path
from continuum_grasp.planning.motion import Motion
from continuum_grasp.planning.problem import PlanProblem
from continuum_grasp.planning.search import Search

LENGTH, TOLERANCE, NODES, PARTS = 0.5, 2e-3, 3, 4
"""Of the hand-made plan: finger [m], greatest deviation per length [1], nodes, and parts of an interval."""


@dataclass
class Made:
    """A plan at rest whose states are x and y of the tip [m], a bound's row and a soft one's [1]."""

    scene: Any
    warnings: tuple[str, ...] = ()
    status: str = "optimal"
    message: str = ""
    advice: str = ""
    deviation: Any = None
    finer: Any = None
    duration: float = 1.0
    length: float = LENGTH

    def __post_init__(self):
        self.t, self.u = np.linspace(0.0, 1.0, NODES), np.zeros((NODES, 1))
        self.x, self.tip = np.zeros((NODES, 4)), np.zeros((NODES, 2))


def rows_of(count):
    return lambda x, u, p: x[2:]


def model_of(names=("x", "y", "row", "soft row")):
    return SimpleNamespace(
        nu=1, p_nominal=(), x_names=names, contact_names=(), tip=lambda x, u, p: x[:2],
        bending_rate=lambda x, u, p: np.zeros(1),
        system=SimpleNamespace(finger_model=SimpleNamespace(lengths=(1.0,), family="arc")),
    )  # fmt: skip


def verdict(monkeypatch, states, *, drift=0.0, method="collocation", end="held", friction=False, finer=0.0):
    """What the check says of states; after the last the tip moves on [m/s], and on a finer model is off [m]."""
    own, other = model_of(("x", "y", "friction_1 [1]", "")) if friction else model_of(), model_of()
    check = SimpleNamespace(tolerance=TOLERANCE, finer="finer" if finer else None, contact_law=None)
    scene = SimpleNamespace(transcription=method, goal=SimpleNamespace(end=end), check=check, contact_law=None)
    scene.model_copy = lambda update: scene

    def simulated(scene, model, path, x0, parts=PARTS):
        if model is other:
            return np.zeros((NODES, 4)) + np.outer(np.arange(NODES) == NODES - 1, [finer, 0.0, 0.0, 0.0])
        after = x0 + np.array([0.6, 0.8, 0.0, 0.0]) * drift * path.duration
        return states if len(path.u) == NODES else np.array([x0, after])

    monkeypatch.setattr(fine, "simulated", simulated)
    monkeypatch.setattr(fine, "parameters_over_time", lambda *_: np.zeros((1, 0)))
    monkeypatch.setattr(fine, "first_state_of_plan", lambda *_: (np.zeros(4), None))
    monkeypatch.setattr(fine, "Prediction", lambda _: other)
    bounded = SimpleNamespace(names=("speed", "comfort"), least=[-1.0, -1.0], most=[2.0, 2.0])
    motion = SimpleNamespace(
        scene=scene, prediction=own, bounded=bounded, hard=np.array([True, False]), rows=SimpleNamespace(map=rows_of)
    )
    return fine.checked(Made(scene), motion)


def at(row, *values):
    """States that are zero but for one row."""
    states = np.zeros((PARTS * (NODES - 1) + 1, 4))
    states[row, : len(values)] = values
    return states


def off(amount, row=PARTS):
    """States whose tip is off by an amount [m] at a row."""
    return at(row, 0.6 * amount, 0.8 * amount)


SHOOTING = {"method": "single_shooting"}
HELD = {**SHOOTING, "end": "held", "friction": True}
VERDICTS = [
    ("tip off the plan [m]", TOLERANCE * LENGTH, "a fine simulation is up to", lambda a: (off(a), {})),
    ("tip off a plan in the inputs alone [m]", TOLERANCE * LENGTH, "no plan: a fine simulation of its inputs",
     lambda a: (off(a), SHOOTING)),
    ("tip that moves on [m/s], in 0.1 s", TOLERANCE * LENGTH / 0.1, "no plan: the tip moves on",
     lambda a: (off(0.0), {**HELD, "drift": a})),
    ("a bound that is left upwards", 2.0 + 1e-3, "between the nodes speed is left", lambda a: (at(2, 0, 0, a), {})),
    ("a bound that is left downwards", 1.0 + 1e-3, "between the nodes speed is left", lambda a: (at(6, 0, 0, -a), {})),
    ("tip off on a finer model [m]", 0.01 * LENGTH, "on 1 elements (arc) the tip ends",
     lambda a: (off(0.0), {"finer": a})),
]  # fmt: skip


@pytest.mark.parametrize(("limit", "text", "made"), [row[1:] for row in VERDICTS], ids=[row[0] for row in VERDICTS])
def test_a_check_says_so_beyond_its_limit_alone(monkeypatch, limit, text, made):
    # Some limits are a bound and a part of a thousand.
    for share, beyond in ((1.0 - 1e-6, False), (1.0 + 1e-6, True)):
        states, how = made(share * limit)
        found = verdict(monkeypatch, states, **how)
        refused = beyond and text.startswith("no plan")
        assert found.status == ("not_solved" if refused else "optimal")
        assert any(said.startswith(text) for said in (*found.warnings, found.message)) is beyond


GOALS = [
    ({}, 1e-5 * 0.1 * 0.3, 1e-5 * 0.5),
    ({"weight": 1.0}, 0.01 * 0.3, 0.05),
    ({"weight": 1.0, "tolerance": 2e-3}, 2e-3, 2e-3),
]
"""Aims of a finger of 0.3 m, and the errors up to which its tip [m] and its bend [rad] meet them."""


@pytest.mark.parametrize(("aim", "length", "angle"), GOALS)
def test_a_goal_is_missed_beyond_its_tolerance_alone(aim, length, angle):
    """A straight finger along y, and goals beside it."""
    for share, missed in ((0.999, []), (1.001, ["goal tip", "goal bending"])):
        tip, bend = (0.6 * share * length, 0.3 - 0.8 * share * length), share * angle
        goal = {"tip": {"value": tip, **aim}, "bending": {"value": (bend,), **aim}, "end": "moving"}
        motion = Motion(small(goal=goal, intervals=2))
        problem = PlanProblem(motion, np.zeros(motion.nx))
        w = problem.start(Path(np.zeros((3, motion.nx)), np.zeros((3, 1)), 0.1))
        found, worst = diagnosis.missed_goals(problem, w, weighted="weight" in aim)
        assert [text.split(":")[0] for text in found] == missed
        assert worst == pytest.approx(share * max(length / 0.03, angle / 0.5), rel=1e-9)


def test_a_shape_is_met_by_an_arc_through_its_points():
    bend, at = 0.8, (0.1, 0.3)
    points = [0.3 / bend * np.array((np.cos(bend * s / 0.3) - 1.0, np.sin(bend * s / 0.3))) for s in at]
    goal = {"shape": {"at": at, "value": np.array(points).tolist()}, "end": "moving"}
    motion = Motion(small(goal=goal, intervals=2))
    problem = PlanProblem(motion, np.zeros(motion.nx))
    w = problem.start(Path(np.tile([bend, 0.0], (3, 1)), np.zeros((3, 1)), 0.1))
    assert diagnosis.missed_goals(problem, w, weighted=False) == ([], pytest.approx(0.0, abs=1e-9))


LEVERS = [
    ("input", lambda f: {"input": {"moment_max": 0.02 * f}}),
    ("input rate", lambda f: {"input": {"moment_max": 0.3, "rate_max": 0.5 * f}}),
    ("duration", lambda f: {"duration": 0.01 * f}),
    ("curvature", lambda f: {"bounds": {"curvature": 0.8 * f}}),
]


@pytest.mark.parametrize(("name", "changes"), LEVERS)
def test_the_strength_of_a_limit_is_what_widening_it_gains(name, changes):
    """Against differences of the least distance of problems solved anew."""

    def nearest(factor):
        search = Search(small(intervals=5, **changes(factor)))
        problem, motion = search._near_goal, search.motion
        path = Path(np.zeros((6, motion.nx)), np.zeros((6, 1)), motion.scene.duration_range[1])
        attempt = search._solved(problem, problem.start(path))
        assert attempt.violation < 1e-6
        return problem, attempt

    step = 1e-3
    wider, narrower = (nearest(1.0 + sign * step)[1].objective for sign in (1.0, -1.0))
    strengths = diagnosis._strengths(*nearest(1.0))
    assert strengths[name] == pytest.approx((narrower - wider) / (2 * step), rel=5e-3)
