"""Problems of one's own: optima by an independent transcription, the linear limit, names, and what is refused."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.control import Anomaly, CommandStatus
from continuum_grasp.core import Compiler
from tests.rti_problems import cart_pole, cart_pole_rates

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")

START = np.array([0.3, 0.9, 0.0, 0.0])


def by_ipopt(start, target, guess):
    """Written anew from the equations alone: multiple shooting by RK4, slacks of the power, exact Hessian."""
    n, h = 25, 0.02
    x, u, s = ca.MX.sym("x", 4, n + 1), ca.MX.sym("u", n), ca.MX.sym("s", n)
    f = ca.Function(
        "f", [v := ca.MX.sym("v", 4), w := ca.MX.sym("w")], [ca.vertcat(*cart_pole_rates(ca.vertsplit(v), w))]
    )
    cost, equal, limited = 0, [x[:, 0] - start], []
    for k in range(n):
        end = x[:, k]
        for _ in range(2):
            k1 = f(end, u[k])
            k2 = f(end + h / 2 * k1, u[k])
            k3 = f(end + h / 2 * k2, u[k])
            end = end + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(end + h * k3, u[k]))
        equal.append(x[:, k + 1] - end)
        q, a, v_, w_ = (x[i, k] for i in range(4))
        cost += 0.02 * (2 * (q - target) ** 2 + 40 * ca.sin(a / 2) ** 2 + 0.1 * w_**2 + 0.1 * v_**2 + 0.01 * u[k] ** 2)
        limited += [u[k] * v_ - 8 - s[k], -u[k] * v_ - 8 - s[k]]
        cost += 0.01 * s[k] / 8 + 0.5 * 0.5 * (s[k] / 8) ** 2
    cost += 0.5 * ((x[0, n] - target) ** 2 + 40 * ca.sin(x[1, n] / 2) ** 2 + x[3, n] ** 2)
    z, g = ca.veccat(x, u, s), ca.vertcat(*equal, *limited)
    count, free = 4 * (n + 1), np.full(4, np.inf)
    solve = ca.nlpsol(
        "s",
        "ipopt",
        {"x": z, "f": cost, "g": g},
        {"ipopt.print_level": 0, "print_time": False, "ipopt.tol": 1e-12, "ipopt.sb": "yes"},
    )
    cart = np.r_[0.6, np.inf, np.inf, np.inf]
    high = np.r_[free, np.tile(cart, n), np.full(n, 12.0), np.full(n, np.inf)]
    low = np.r_[-free, np.tile(-cart, n), np.full(n, -12.0), np.zeros(n)]
    found = solve(
        x0=np.r_[guess.x.ravel(), guess.u.ravel(), np.zeros(n)],
        lbx=low,
        ubx=high,
        lbg=np.r_[np.zeros(count), np.full(2 * n, -np.inf)],
        ubg=0,
    )
    assert solve.stats()["success"]
    values = np.array(found["x"]).ravel()
    return values[:count].reshape(-1, 4), values[count : count + n]


@pytest.mark.parametrize("target", [0.0, 0.59])
def test_converged_iterations_of_a_cart_pole_end_at_the_optimum(target):
    solver = cg.rti(cart_pole(), start_iterations=60)
    command = solver.step(START, {"position": target})
    x, u = by_ipopt(START, target, command.plan)
    np.testing.assert_allclose(command.plan.x, x, atol=1e-6)
    np.testing.assert_allclose(command.planned("force"), u, atol=1e-6 * np.abs(u).max())
    assert command.residual < 1e-6
    assert np.isclose(np.abs(u), 12.0, atol=1e-6).any()
    # The power is beyond its soft bound, which the status says by name.
    power = np.abs(u * x[:-1, 2]).max() / 8.0 - 1.0
    if target == 0.0:
        assert command.status == CommandStatus.ROW_VIOLATED
        assert command.violated == pytest.approx({"power": power}, rel=1e-5)
    else:
        assert (command.status == CommandStatus.ROW_VIOLATED) == bool(command.violated) == (power > 1e-5)


# ---- names and shapes ----


def test_vectors_by_name_are_those_in_order():
    first, second = cg.rti(cart_pole()), cg.rti(cart_pole())
    named = first.step(
        {"angle": 0.9, "position": 0.3, "rate": 0.0, "speed": 0.0},
        {"position": 0.1, "pole": [0.2, -0.1]},
        {"gravity": 9.0},
        applied={"force": 1.0},
    )
    names = cart_pole().stages.r_names
    assert names == ("position", "pole_1", "pole_2", "speed", "force")
    ordered = second.step(START, [0.1, 0.2, -0.1, 0.0, 0.0], [9.0], applied=[1.0])
    np.testing.assert_array_equal(named.plan.u, ordered.plan.u)
    assert named.inputs == {"force": named.u[0]}
    np.testing.assert_array_equal(named.planned("rate"), named.plan.x[:, 3])
    with pytest.raises(InputError, match="expected one of force, position"):
        named.planned("torque")


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda s: s.step([0.0, 0.0]), r"x: expected \(4,\), got \(2,\)"),
        (lambda s: s.step({"angle": 0.0, "position": 0, "rate": 0, "speed": 0, "tilt": 1}), "there is no 'tilt'"),
        (lambda s: s.step(START, {"tip": 1.0}), r"\(position, pole, speed, force\)"),
        (lambda s: s.reference(pole=[1.0, math.nan]), "pole: expected finite"),
        (lambda s: s.step(START, None, [1.0, 2.0]), r"parameters: expected \(1,\)"),
        (lambda s: s.reference(angle=0.0), "expected setpoints of weighted quantities"),
        (lambda s: s.reference(pole=lambda t: 1.0) or s.step(START), "expected 2 finite entries"),
    ],
)
def test_wrong_names_and_shapes_of_a_step_are_refused(call, match):
    with pytest.raises(InputError, match=match):
        call(cg.rti(cart_pole()))


def test_numbers_of_a_step_that_are_not_finite_do_not_raise():
    command = cg.rti(cart_pole()).step(START, {"pole": [1.0, math.nan]})
    assert command.anomaly & Anomaly.BAD_SETPOINTS


X, U, OTHER = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("other")
GOOD = {"states": X, "inputs": U, "dynamics": U - X, "cost": {"x": (X, 1.0), "u": (U, 1.0)}, "stages": 3, "stage": 0.1}


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"dynamics": [X, U]}, "dynamics: expected 1 expressions, got 2"),
        ({"dynamics": OTHER}, "dynamics: unknown symbols other"),
        ({"states": X + 1}, "states: expected a column of SX symbols"),
        ({"dynamics": ca.MX.sym("x")}, "expand"),
        ({"states": [X, ca.SX.sym("x")], "dynamics": [U, U]}, "more than one x"),
        ({"inputs": []}, "inputs: expected at least one"),
        ({"inputs": X}, "given twice among states, inputs, parameters and previous: x"),
        ({"cost": {"x": (X, -1.0)}}, "no negative"),
        ({"cost": {"x": (X, [1.0, 2.0])}}, "cost.x.weight: expected 1 entries, got 2"),
        ({"cost": {"u": (U, 1.0, 1.0)}}, "a final weight needs an expression of only the states"),
        ({"bounds": {"y": (0, 1)}}, "bounds: expected names of states and inputs, got y"),
        ({"bounds": {"u": (1, 0)}}, "bounds.u"),
        ({"rows": {"r": (X, 0.0, 1.0, (-1.0, 0.0))}}, "no negative penalty"),
        ({"bounds": {"x": (0, 1)}, "rows": {"x_2": (X, 0, 1), "x_": (ca.vertcat(X, X), 0, 1)}}, None),
        ({"bounds": {"x": (0, 1)}, "rows": {"x": (X, 0, 1)}}, "there is more than one x"),
        ({"cost": {1: (X, 1.0)}}, "cost: expected words"),
        ({"parameters": OTHER}, "nominal: other missing: expected other"),
        ({"stages": 0}, "stages"),
        ({"method": "euler"}, "method"),
    ],
)
def test_what_does_not_fit_together_is_refused_with_its_key(changes, match):
    if match is None:
        assert cg.ControlProblem(**{**GOOD, **changes}).stages.nc == 4
        return
    with pytest.raises(InputError, match=match):
        cg.ControlProblem(**{**GOOD, **changes})


@pytest.mark.parametrize(
    ("cost", "expected"),
    [
        ({"u": (U, 1.0)}, 0.7),  # nothing but the input: its setpoint
        ({"x": (X, 0.0, 1.0), "u": (U, 1e-6)}, None),
        ({"x": (X, 1.0)}, [0.9, 0.9, 0.0]),  # as fast as the row allows; the last input moves nothing that counts
    ],
)
def test_costs_without_a_term_of_one_kind(cost, expected):
    """At the end alone, of states alone, of inputs alone; two entries of a row with a bound each."""
    rows = {"both": (ca.vertcat(X, U), [-5.0, -3.0], [5.0, 0.9])}
    solver = cg.rti(cg.ControlProblem(**{**GOOD, "cost": cost, "rows": rows}))
    solver.reference(**({"x": 0.2} if "x" in cost else {"u": 0.7}))
    command = solver.step([0.0])
    assert command.status == CommandStatus.SOLVED
    if expected is not None:
        np.testing.assert_allclose(command.planned("u"), expected, atol=1e-6)
    else:
        assert command.planned("x")[-1] == pytest.approx(0.2, abs=0.01)
    assert command.planned("u").max() <= 0.9 + 1e-6


# ---- state and fallback ----


def test_a_state_that_is_not_finite_follows_the_last_plan_and_then_goes_to_the_safe_input():
    solver = cg.rti(cart_pole(), safe={"force": 2.0})
    plan = solver.step(START).plan
    found = [solver.step([0.0, math.nan, 0.0, 0.0]) for _ in range(60)]
    assert found[0].status == CommandStatus.PREVIOUS_PLAN
    assert found[0].anomaly & Anomaly.MISSING
    np.testing.assert_array_equal(found[0].u, plan.u[1])
    assert found[-1].status == CommandStatus.SAFE_RAMP
    assert found[-1].inputs == {"force": 2.0}
    assert all(np.all(np.abs(command.u) <= 12.0) for command in found)


def test_the_input_before_limits_the_change():
    """A bounded change per stage of an input that would jump."""
    x, u, before = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("before")
    problem = cg.ControlProblem(
        states=x,
        inputs=u,
        previous=before,
        dynamics=u,
        cost={"x": (x, 100.0), "u": (u, 1.0)},
        rows={"change": (u - before, -0.2, 0.2)},
        stages=20,
        stage=0.1,
    )
    solver = cg.rti(problem)
    command = solver.step([1.0], applied=[0.1])
    changes = np.diff(np.r_[0.1, command.planned("u")])
    assert np.abs(changes).max() == pytest.approx(0.2, abs=1e-6)
    assert command.u[0] == pytest.approx(-0.1, abs=1e-6)


def test_a_guess_chooses_on_which_side_a_disc_is_passed():
    """By symmetry both plans are mirror images; a plan at rest has no side, and stays before the disc."""
    x, y, vx, vy = (ca.SX.sym(name) for name in ("x", "y", "vx", "vy"))
    ax, ay = ca.SX.sym("ax"), ca.SX.sym("ay")
    problem = cg.ControlProblem(
        states=[x, y, vx, vy],
        inputs=[ax, ay],
        dynamics=[vx, vy, ax, ay],
        cost={"goal": (ca.vertcat(x - 1.0, y, vx, vy), 1.0, 10.0), "push": (ca.vertcat(ax, ay), 0.05)},
        rows={"disc": (ca.hypot(x, y), 0.5, ca.inf)},
        stages=20,
        stage=0.15,
    )
    solver, start, along = cg.rti(problem, sqp_iterations=20), [-1.0, 0.0, 0.0, 0.0], np.linspace(-1.0, 1.0, 21)
    plans = []
    for side in (1.0, -1.0):
        solver.reset(guess={"x": along, "y": 0.8 * side * np.cos(0.5 * np.pi * along)})
        plans.append(solver.step(start))
    left, right = plans
    assert left.planned("y").max() > 0.4
    assert left.planned("y") == pytest.approx(-right.planned("y"), abs=1e-9)
    assert not left.violated
    solver.reset()
    assert solver.step(start).cost > 5.0 * left.cost
    # An optimum is where an iteration stays.
    once = cg.rti(problem, sqp_iterations=1)
    once.reset(guess={name: left.planned(name) for name in ("x", "y", "vx", "vy", "ax", "ay")})
    assert once.step(start).planned("y") == pytest.approx(left.planned("y"), abs=1e-6)
    for guess, key in (({"z": 0.0}, "guess"), ({"ax": along}, "guess.ax"), ({"x": np.nan}, "guess.x")):
        with pytest.raises(InputError, match=key):
            solver.reset(guess=guess)
