"""Plans of fingers with friction, winches or motors; from inside: intervals of shooting, each with its steps.

Plans of fingers whose tendons have friction, winches or motors, against the equations of motion by scipy.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import continuum_grasp as cg
from continuum_grasp.addons.planning import MotionPlan, PlanScene, PlanStatus
from continuum_grasp.addons.planning.condensed import Condensed, _Model
from continuum_grasp.addons.planning.guess import first_state_of_plan, smooth_path
from continuum_grasp.addons.planning.motion import PlannedMotion
from continuum_grasp.addons.planning.search import PlanSearch
from continuum_grasp.addons.planning.shooting import amplification, derived, fewest_evaluations, shooting_interval
from continuum_grasp.base import InputError
from continuum_grasp.scene import Tendons
from tests.control_cases import CABLE, DRIVES, HAND
from tests.marks import few
from tests.plan_cases import small, two_arcs
from tests.truth.differences import differences

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


def tips(finger, instants, values, times, family="clothoid", start=None):
    """Tip positions at times of two elements under inputs that are straight lines, and held after the last."""
    model = cg.System(finger, family=family, elements=2, gravity=(0, 0))
    dynamics = model.forward_dynamics

    def inputs(t):
        return [np.interp(t, instants, column) for column in np.transpose(values)]

    def rate(t, x):
        return np.array(dynamics(x, inputs(t), [], [])).ravel()

    start = model.state(u=list(values[0])) if start is None else start
    ends = solve_ivp(rate, (0.0, times[-1]), start, method="LSODA", rtol=1e-7, atol=1e-9, t_eval=times).y.T
    return np.array([np.array(model.tip(x, inputs(t), [])).ravel() for t, x in zip(times, ends, strict=True)])


def held(asked, first, last, ramp, rest, weight, start=None):
    """A plan to where a finger can be held, by inputs that go from first to last and a rest; how far its tip ends from
    there, and how far it moves on [m].
    """
    family = asked.fidelity.family
    (aim,) = tips(asked.finger, [0.0, ramp], [first, last], [rest], family, start)
    found = cg.plan(asked.replaced(goal={"tip": {"value": tuple(aim), "weight": weight}, "end": "held"}))
    begin = None if start is None else found.x[0]
    end, later = tips(asked.finger, found.t, found.u, [0.4, 0.6], family, begin)
    return found, np.linalg.norm(end - aim), np.linalg.norm(later - end)


ENDS = {"winches": ((0.0, 0.0), (0.0065, -0.0055)), "servos": ((0.016, 0.016), (0.8, -0.7)), None: ((1, 1), (8, 2))}
"""Inputs of the straight finger, and inputs that bend it."""
CASES = [(0.0, "winches", 1), (0.25, "winches", 1), (0.15, None, 2), (0.15, "servos", 1), (0.3, "winches", 2)]


@pytest.mark.deep
@pytest.mark.parametrize(("friction", "drive", "cells"), few(CASES, 2))
def test_plan_takes_the_tip_to_its_goal_and_holds_it(friction, drive, cells):
    asked, (first, last) = scene(friction, drive, {"friction_cells": cells}), ENDS[drive]
    # With friction it cannot be held where it could be without; weights are against squares of meters, or of newtons.
    found, off, moved = held(asked, first, last, 0.4, 0.6, 1e6 if drive else 1e9)
    assert off < 1e-3
    assert moved < 2e-4
    assert found.deviation.tip < 1e-3 * found.length
    if friction and drive != "servos":  # whose motors have friction of their own
        # Tendons come to rest sliding, and so the finger stays where it is to the micrometer.
        assert moved < 2e-6
    if drive == "winches":
        tensions = np.array(
            [np.array(found.prediction.tensions(x, u, [])).ravel() for x, u in zip(found.x, found.u, strict=True)]
        )
        assert np.abs(found.u).max() <= 0.012 + 1e-9
        assert tensions.min() >= 1.0 - 1e-3  # half the pretension


BENT = [
    # friction, cells, family, history, lengths at first and at last [m]
    (0.3, 2, "arc", "pulling", (0.0070, -0.0064), (0.0020, -0.0014)),
    (0.25, 2, "arc", "releasing", (0.0025, -0.0019), (0.0060, -0.0054)),
    (0.15, 1, "clothoid", "pulling", (0.0063, -0.0057), (0.0010, -0.0004)),
]


@pytest.mark.deep
@pytest.mark.parametrize(("friction", "cells", "family", "history", "first", "last"), few(BENT, 1))
def test_plan_of_a_bent_finger_turns_friction_around(friction, cells, family, history, first, last):
    asked = scene(
        friction,
        tendons={"friction_cells": cells},
        fidelity={"family": family, "elements": 2},
        initial={"pose": "equilibrium", "reached_by": history},
        input={**DRIVES["winches"][1], "form": "linear", "initial": first},
    )
    start = first_state_of_plan(asked, PlannedMotion(asked).prediction)[0]
    # After sliding the other way.
    found, off, moved = held(asked, first, last, 0.6, 1.0, 1e6, start)
    assert off < 1e-4
    assert moved < 2e-6
    states = [k for k, name in enumerate(found.x_names) if name.startswith("friction_")]
    assert (found.x[0, states] * found.x[-1, states] < -0.8).all()


ARCS = {"family": "arc", "elements": 2}
OTHERS = [
    # friction, drive, its last command
    (0.15, "pulley", [0.006]),  # m
    (0.1, "torques", [0.07, 0.016]),  # N m
    (0.2, "servo", [-0.7]),  # rad
    (0.2, "geared", [0.06]),
]


@pytest.mark.deep
@pytest.mark.parametrize(("friction", "drive", "last"), few(OTHERS, 2))
def test_plan_of_one_pulley_and_of_motors_without_servo(friction, drive, last):
    asked = scene(friction, drive, {"friction_cells": 1}, fidelity=ARCS)
    found, off, moved = held(asked, list(asked.initial_input), last, 0.4, 0.8, 1e7)
    assert found.status == "feasible"  # slopes of dry friction are not exact: of tendons or of motors
    assert off < 1e-4
    assert moved < 2e-6
    tensions = [np.array(found.prediction.tensions(x, u, [])).min() for x, u in zip(found.x, found.u, strict=True)]
    # On one pulley the bend decides how much the other tendon pulls.
    assert min(tensions) == 0.0 if len(last) == 1 else min(tensions) >= 1.0 - 1e-3


@pytest.mark.parametrize(("drive", "end"), [("torques", "held"), ("torques", "still"), ("winches", "held")])
def test_search_begins_at_a_posture_with_taut_tendons(drive, end):
    """A slack tendon has no slopes, and its motor runs away: plans ended 50 mm from their goals."""
    search = PlanSearch(scene(0.0, drive, fidelity=ARCS, goal={"tip": {"value": AIM, "weight": 1e6}, "end": end}))
    model, last = search.motion.prediction, search.last
    tensions = np.array(model.tensions(model.at_rest(last.q, last.u), last.u, model.p_nominal)).ravel()
    assert tensions.min() >= 1.0 - 2e-2  # half the pretension, by least squares


def test_weighted_goal_that_a_limit_keeps_out_of_reach_is_missed():
    limits = {"least_tension": 1.0}  # of the tendon that one pulley pays out: a bound of the bend
    found = cg.plan(scene(0.0, "pulley", fidelity=ARCS, bounds=limits))
    assert found.status == "goal_missed"
    off = np.linalg.norm(found.tip[-1] - AIM)
    assert any(f"goal tip: violated by {off:.3g} m" in warning for warning in found.warnings)
    assert off > 0.05


@pytest.mark.parametrize(("steps", "stages"), [(3, 2), (5, 4), (2, 9)])
def test_an_interval_is_that_of_a_linear_motion_by_its_matrix_exponential(steps, stages):
    """Of order 2 in state and input, and its Jacobian exactly that of its own steps."""
    a = np.array([[0.0, 1.0, 0.3], [-40.0, -3.0, 2.0], [0.0, 0.0, 0.0]])  # the last state is the input, which is held
    z, d, t = ca.SX.sym("z", 4), ca.SX.sym("d", 1), 0.2
    rate = z[3] * ca.vertcat(ca.mtimes(a[:2], z[:3]), 0.5 * z[2] ** 2)
    flow = derived("flow", z, d, rate, exact=False, squared=ca.sqrt(z[3]) * z[2])
    at = np.array([0.3, -0.2, 0.7, t])
    numbers, errors = np.zeros((1, 0)), []
    for count in (steps * 4, steps * 8):
        term = shooting_interval(flow, 2, 1, count, stages)
        numbers = np.zeros((1, count + 1))
        end = np.array(term.value(at, numbers)).ravel()
        errors.append(np.abs(end[:2] - (expm(a * t) @ at[:3])[:2]).max())
        assert end[2] == pytest.approx(0.5 * t * 0.7**2, rel=1e-12)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
    expected = differences(lambda z: term.value(z, numbers), at)
    assert np.array(term.jacobian(at, numbers)) == pytest.approx(expected, abs=1e-7)
    assert np.array(term.hessian(at, numbers, [0.0, 0.0, 1.0]))[2, 2] == pytest.approx(t)


@pytest.mark.parametrize("stages", [2, 5, 18])
def test_steps_are_stable_as_far_as_published(stages):
    """Along 0.65 s^2 of the negative axis (Sommeijer, Shampine, Verwer), and of order 2 at its end."""
    reach = 2.0 / 3.0 * (stages**2 - 1.0) * (1.0 - 2.0 / 15.0 * 2.0 / 13.0)
    assert np.abs(amplification(stages, -np.linspace(0.0, 0.999 * reach, 4001))).max() <= 1.0 + 1e-12
    assert np.abs(amplification(stages, -1.2 * reach)) > 1.0
    small = np.array([1e-3, 1e-3j])
    assert amplification(stages, small) == pytest.approx(np.exp(small), abs=1e-9)


@pytest.mark.parametrize("given", [None, 7])
def test_steps_are_the_fewest_that_are_stable(given):
    """Of modes with damping that grows with the stiffness: eigenvalues on a circle, then on the axis."""
    frequency, lag, length = np.geomspace(10.0, 5e3, 200), 2e-3, 0.02
    roots = [np.roots([1.0, lag * f**2, f**2]) for f in frequency]
    steps, stages = fewest_evaluations(np.concatenate(roots).astype(complex), length, given)

    def stable(steps, stages):
        z = np.concatenate(roots) * length / steps
        slow = z[np.abs(z * steps) <= 2.0 * np.pi]
        off = np.abs(amplification(stages, slow) ** steps - np.exp(slow * steps)).max()
        calm = all((np.abs(amplification(stages, factor * z)) <= 1.0 + 1e-12).all() for factor in (1.0, 1.5))
        return calm and (given or off <= 1e-3)

    assert given in (None, steps)
    assert stable(steps, stages)
    assert not any(stable(k, s) for s in (2, stages - 1) for k in ([given] if given else [steps * stages // s - 1]))


def test_no_step_seems_worse_than_none():
    """Rows violated by little more or less than counts, of a motion that cannot keep its speed: where steps were chosen
    by one measure and judged by another, a search ended by rounding, and called its goal out of reach.
    """
    asked = two_arcs(method="single_shooting", goal={"bending": (0.4, 0.2), "end": "still"}, bounds={"speed": 2.0})
    search = PlanSearch(asked)
    w = search.problem.start(smooth_path(search.motion, search.x0, search.first, search.last))
    condensed = Condensed(search.problem, 1e-5, search.feasible)
    end = condensed.solve(w, search.budget, 100)
    model = _Model(condensed, condensed._moved(end.x))
    rng, usual = np.random.default_rng(0), condensed._residual(model._point)
    for penalty in (3e3, 3e6):
        for _ in range(10):
            rows = usual + search.feasible / 2.0 * rng.standard_normal(usual.size)
            step, left, _ = model.step(1e-4, penalty, rows)
            assert -model.change(step) + penalty * (condensed.beyond(rows) - left) >= 0.0


@pytest.mark.parametrize(
    ("drive", "unit", "key"),
    [
        (None, "N2/s", "finger.tendons.max_tension"),
        ("winches", "m2/s", "input.lengths"),
        ("pulley", "m2/s", "input.lengths"),
        ("servos", "rad2/s", "input.angles"),
        ("torques", "(N m)2/s", "input.torques"),
    ],
)
def test_objective_and_limits_are_those_of_what_drives_take(drive, unit, key):
    asked = scene(0.0, drive, fidelity={"family": "arc", "elements": 1})
    made = MotionPlan(asked, PlanStatus.OPTIMAL, "", np.zeros(2), np.zeros((2, 1)), np.zeros((2, 2)), 0.0)
    assert made.objective_unit == unit
    assert asked.limit_keys == key


def test_an_input_limit_that_stops_a_plan_is_named_by_its_key():
    """Of a chamber, whose pressure is not that of tendons."""
    rod = {"length": 0.15, "linear_density": 0.03, "bending_stiffness": 0.01}
    chamber = {"area": 40e-6, "offset": 0.005, "max_pressure": 60e3, "time_constant": 0.03}
    changes = {"finger": {"rod": rod, "pressure": [chamber]}, "goal": {"bending": [1.0], "end": "held"}}
    found = cg.plan(small(**changes, input={}, intervals=8), raise_on_failure=False)
    assert found.status == "infeasible"
    assert "the input limit stops it" in found.message
    assert found.advice == "raise the input's limits (finger.pressure.max_pressure)"
    assert found.constraints["input"].key == "finger.pressure.max_pressure"


@pytest.mark.parametrize(
    ("friction", "drive", "changes", "message"),
    [
        (0.0, "winches", {"method": "collocation"}, "not for tendons with friction, winches or motors"),
        (0.15, None, {"method": "collocation"}, "not for tendons with friction, winches or motors"),
        (0.15, None, {"solver": {"method": "sqp", "hessian": "gauss_newton"}}, "has its own"),
    ],
)
def test_what_does_not_go_together_is_refused(friction, drive, changes, message):
    with pytest.raises(InputError, match=message):
        scene(friction, drive, **changes)
