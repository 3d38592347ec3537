"""A plan on contacts that full steps would repeat forever, and what ends it.

The finger of configs/mission/mug.yaml holds the mug with 3.8 of 5.4 N. The plan (repeated_plan.csv, found on a plant in
MuJoCo) lets go, comes back and squeezes. Moved on by a stage and iterated once, it is itself again: its nodes are no
motion of the model, their gaps never close, and none of it is carried out.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.mission import assign_mission
from continuum_grasp.control import Anomaly, stages_of
from tests.rods import after
from tests.rti_problems import cart_pole, cart_pole_rates

MUG = (0.0386, 0.00176)
"""Where the estimator takes the mug to be [m]."""
KNOWN = [0.0062, 0.24838, 0.23891, 0.14728, 0.00074]
"""Bending stiffness [N m2] and forces at contact and tip [N] that it took the model to lack."""
STATE = [5.314, 10.345, 21.093, 18.319, 0.036, -0.01, 0.017, -0.12, 0.21, 0.004]
HELD = [44.345, 2.245]
FORCE = 5.422
WEIGHTS = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.05, 0.05, 0.05, 0.05, 1e-3, 1e-3, 1e-5, 1e-5])
SETPOINTS = np.array([0.0, 0.0, 0.0, 0.0, FORCE, 0.0, 0.0, 0.0, 0.0, 49.951, 1.049, 0.0, 0.0])
LIMITS = {"u_min": np.array([42.458, 1.0]), "u_max": np.array([60.0, 4.0])}
PLAN = np.loadtxt(Path(__file__).parent / "repeated_plan.csv", delimiter=",", skiprows=1)


@cache
def scene():
    (of,) = assign_mission("configs/mission/mug.yaml").assignments
    return of.control.replaced(estimator=None, object=of.control.object.replaced(position=MUG))


@cache
def controller():
    control = cg.Controller(scene(), deadline=math.inf)
    control.change(weights=WEIGHTS, **LIMITS)
    return control


def with_plan(control):
    """The controller with that plan in its memory, where its own is found by its numbers."""
    control.reset(u=HELD)
    own = control.step(STATE, SETPOINTS, p=KNOWN).plan.x[:, :1].tobytes()[:8]
    saved = bytearray(control.save_state())
    doubles = np.concatenate([PLAN[:, :12].ravel(), PLAN[:-1, 12:].ravel()])
    at = saved.index(own)
    saved[at : at + doubles.nbytes] = doubles.tobytes()
    control.restore(bytes(saved))


def driven(stages, x, u):
    """The state a stage later, by the CasADi function."""
    return np.array(stages.step(x, u, KNOWN, stages.stage)[0]).ravel()


def force(stages, x, u):
    return float(np.array(stages.outputs(x, u, KNOWN)).ravel()[4])


def gap(stages, x, u):
    """Largest gap in the curvatures of a plan [1/m]."""
    ends = np.array([driven(stages, *node) for node in zip(x[:-1], u, strict=True)])
    return np.abs(ends - x[1:])[:, :4].max()


@pytest.mark.deep
def test_a_controller_integrates_its_inputs():
    control = controller()
    stages = control.stages
    with_plan(control)
    x, said = np.array([*STATE, *HELD]), []
    for k in range(60):
        command = control.step(x[:10], SETPOINTS, p=KNOWN)
        said += [k] if Anomaly.PLAN_GAPS in command.anomaly else []
        x = driven(stages, x, command.u)
    # Two checks, half a horizon of 20 stages apart.
    assert len(said) == 1
    assert 10 < said[0] <= 20
    assert command.cost < 1e-3
    assert gap(stages, command.plan.x, command.plan.u) < 1e-3
    assert force(stages, x, command.u) == pytest.approx(FORCE, abs=0.02)


@pytest.mark.deep
def test_motion_is_no_gap():
    """A force that rises and falls moves the finger within every plan."""
    control = controller()
    control.reset(u=HELD)
    x, stage = np.array([*STATE, *HELD]), control.stages.stage
    rows = np.tile(SETPOINTS, (control.stages.stages + 1, 1))
    for k in range(40):  # a period
        rows[:, 4] = 4.9 + 0.4 * np.sin(2.0 * np.pi * stage * (k + np.arange(len(rows))) / 0.4)
        command = control.step(x[:10], rows, p=KNOWN)
        assert Anomaly.PLAN_GAPS not in command.anomaly
        x = driven(control.stages, x, command.u)


def mass_at_a_wall():
    """A point mass that presses against a wall of a penalty law, 100 N/mm, with a force that is tracked."""
    x, speed, push = ca.SX.sym("x [m]"), ca.SX.sym("speed [m/s]"), ca.SX.sym("push [N]")
    force = 1e5 * (x + ca.sqrt(x**2 + 9e-8)) / 2
    return cg.ControlProblem(
        states=[x, speed],
        inputs=push,
        dynamics=[speed, (push - force - 5.0 * speed) / 0.05],
        cost={"force": (force, 1.0), "speed": (speed, 0.01), "push": (push, 1e-3)},
        bounds={"push": (-10.0, 10.0)},
        rows={"pressed": (x, -1.0, ca.inf)},
        stages=20,
        stage=0.01,
        method="sdirk2",
    )


def pressed(solver, steps=80):
    """Press with 5, 1 and 5 N; commands, and the forces that result."""
    stages, x = solver.stages, np.array([-0.005, 0.0])
    commands, forces = [], []
    for k in range(2 * steps):
        target = 5.0 if k // (steps // 2) % 2 == 0 else 1.0
        commands.append(solver.step(x, {"force": target, "push": target}))
        x = stages.ends(x[None], commands[-1].u[None], np.zeros(0))[0]
        forces.append(float(stages.outputs(x, commands[-1].u, [])[0]))
    return commands, forces


def test_checked_plans_of_a_users_model_press_as_they_should():
    commands, forces = pressed(cg.rti(mass_at_a_wall(), check_gaps=True))
    said = [k for k, command in enumerate(commands) if Anomaly.PLAN_GAPS in command.anomaly]
    assert said
    assert len(said) < 8
    np.testing.assert_allclose([forces[k] for k in (39, 79, 119)], [5.0, 1.0, 5.0], atol=0.01)
    assert all(value < 1e-6 for value in commands[-1].gaps.values())


def test_checks_leave_a_linear_problem_alone():
    """Its plans are motions of the model, though their cost rises a millionfold with a setpoint."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = cg.ControlProblem(
        states=x,
        inputs=u,
        dynamics=ca.vertcat(x[1], u - 4.0 * x[0]),
        cost={"x": (x, [3.0, 1.0]), "u": (u, 0.5)},
        stages=10,
        stage=0.1,
    )
    checked, other = (cg.rti(problem, check_gaps=check) for check in (True, False))
    state = np.array([1e-3, 0.0])
    for k in range(20):
        target = {"x": [1.0 if k > 12 else 0.0, 0.0]}
        command = checked.step(state, target)
        np.testing.assert_array_equal(command.u, other.step(state, target).u)
        assert not command.anomalies
        state = command.plan.x[1]


def test_gaps_are_those_of_an_independent_integration():
    """Of a plan that has not converged, by scipy: one stage after the other, with the input held."""
    problem = cart_pole()
    command = cg.rti(problem, start_iterations=1).step([0.0, 2.0, 0.0, 0.0], parameters={"gravity": 8.0})
    rates = ca.Function("f", [x := ca.SX.sym("x", 4), u := ca.SX.sym("u")], cart_pole_rates(ca.vertsplit(x), u, 8.0))
    most = np.zeros(4)
    for state, push, following in zip(command.plan.x, command.plan.u, command.plan.x[1:], strict=False):
        end = after(0.04, lambda y, p=push: rates(y, p), state)
        most = np.maximum(most, np.abs(end - following))
    assert list(command.gaps) == ["position", "angle", "speed", "rate"]
    np.testing.assert_allclose(list(command.gaps.values()), most, rtol=1e-3)


def test_free_motion_has_no_checks():
    assert controller().stages.checks_gaps
    assert not stages_of(cg.load("configs/mpc/keep_out.yaml")).checks_gaps
