"""Plans of fingers whose tendons have friction, winches or motors, against the equations of motion by scipy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import continuum_grasp as cg
from continuum_grasp.errors import InputError
from continuum_grasp.planning.fine import checked
from continuum_grasp.planning.guess import smooth_path
from continuum_grasp.planning.motion import Motion
from continuum_grasp.planning.search import Search
from continuum_grasp.scene import Tendons
from continuum_grasp.scene.plan import PlanScene
from tests.control_cases import CABLE, DRIVES, HAND
from tests.marks import few

AIM = (-0.0957, 0.1398)


def scene(friction=0.0, drive="winches", tendons=None, **changes):
    """The hand finger, which is to bend by 1.2 rad."""
    own, limits = {**CABLE, "drive": DRIVES[drive][0]} if drive else {}, DRIVES[drive][1] if drive else {}
    lagging = {"offset": 0.005, "min_tension": 1.0, "max_tension": 60.0, "time_constant": 0.02}
    given = {
        "finger": HAND.replaced(tendons=Tendons(**{**(own or lagging), "friction": friction, **(tendons or {})})),
        "gravity": (0.0, 0.0),
        "fidelity": {"family": "clothoid", "elements": 2},
        "initial": {"pose": "straight"},
        "input": {**limits, "form": "linear"},
        "goal": {"tip": {"value": AIM, "weight": 1e6}, "end": "held"},
        "objective": "least_input_rate",
        "duration": 0.4,
        "intervals": 20,
    }
    return PlanScene(**{**given, **changes})


def tips(finger, instants, values, times):
    """Tip positions at times of two clothoids under inputs that are straight lines, and held after the last."""
    model = cg.System(finger, family="clothoid", elements=2, gravity=(0, 0))
    dynamics = model.forward_dynamics

    def inputs(t):
        return [np.interp(t, instants, column) for column in np.transpose(values)]

    def rate(t, x):
        return np.array(dynamics(x, inputs(t), [], [])).ravel()

    start = model.state(u=list(values[0]))
    ends = solve_ivp(rate, (0.0, times[-1]), start, method="LSODA", rtol=1e-7, atol=1e-9, t_eval=times).y.T
    return np.array([np.array(model.tip(x, inputs(t), [])).ravel() for t, x in zip(times, ends, strict=True)])


ENDS = {"winches": ((0.0, 0.0), (0.0065, -0.0055)), "servos": ((0.016, 0.016), (0.8, -0.7)), None: ((1, 1), (8, 2))}
"""Inputs of the straight finger, and inputs that bend it."""
CASES = [(0.0, "winches", 1), (0.25, "winches", 1), (0.15, None, 1), (0.15, "servos", 1), (0.15, None, 2)]
CASES += [(0.1, "winches", 2), (0.3, "winches", 2)]


@pytest.mark.parametrize(("friction", "drive", "cells"), few(CASES, 2))
def test_plan_takes_the_tip_to_its_goal_and_holds_it(friction, drive, cells):
    asked, (first, last) = scene(friction, drive, {"friction_cells": cells}), ENDS[drive]
    # Where it can be held: with friction that is not where it could be without.
    (aim,) = tips(asked.finger, [0.0, 0.4], [first, last], [0.6])
    weight = 1e6 if drive else 1e9  # against squares of meters, or of newtons
    found = cg.plan(asked.replaced(goal={"tip": {"value": tuple(aim), "weight": weight}, "end": "held"}))
    end, later = tips(asked.finger, found.t, found.u, [0.4, 0.6])
    assert np.linalg.norm(end - aim) < 1e-3
    assert np.linalg.norm(later - end) < 2e-4
    assert found.deviation.tip < 1e-3 * found.length
    if friction and drive != "servos":  # whose motors have friction of their own
        # Tendons come to rest sliding, and so the finger stays where it is to the micrometer.
        assert np.linalg.norm(later - end) < 2e-6
    if drive == "winches":
        tensions = np.array(
            [np.array(found.prediction.tensions(x, u, [])).ravel() for x, u in zip(found.x, found.u, strict=True)]
        )
        assert np.abs(found.u).max() <= 0.012 + 1e-9
        assert tensions.min() >= 1.0 - 1e-3  # half the pretension


def test_iterations_do_not_depend_on_rounding():
    """Of winches without friction: starts that differ by shares of 1e-12 to 1e-3."""
    search = Search(scene())
    w = search.problem.start(smooth_path(search.motion, search.x0, search.first, search.last, 0.0))
    rng = np.random.default_rng(0)
    found = [
        search._solved(search.problem, w * (1.0 + size * rng.standard_normal(w.size)))
        for size in (0.0, 1e-12, 1e-6, 1e-3)
    ]
    assert all(attempt.converged for attempt in found)
    assert max(attempt.iterations for attempt in found) <= 5
    assert np.ptp([attempt.objective for attempt in found]) <= 1e-4 * found[0].objective


def test_plan_that_a_fine_simulation_does_not_reproduce_is_none():
    asked = scene()
    found = cg.plan(asked)
    altered = checked(replace(found, u=1.05 * found.u), Motion(asked))
    assert (altered.status, altered.solved) == ("not_solved", False)
    assert "a fine simulation of its inputs is up to" in altered.message


@pytest.mark.parametrize(
    ("friction", "drive", "changes", "message"),
    [
        (0.0, "winches", {"method": "collocation"}, "not for tendons with friction, winches or motors"),
        (0.15, None, {"method": "multiple_shooting"}, "not for tendons with friction, winches or motors"),
        (0.0, "torques", {}, "not for motors under commanded torques or currents"),
        (0.15, None, {"solver": {"method": "sqp", "hessian": "gauss_newton"}}, "has its own"),
    ],
)
def test_what_does_not_go_together_is_refused(friction, drive, changes, message):
    with pytest.raises(InputError, match=message):
        scene(friction, drive, **changes)
