"""Problems of one's own: optima by an independent transcription, the linear limit, names, and what is refused."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

import continuum_grasp as cg
from continuum_grasp.control.status import Anomaly, Status
from continuum_grasp.core.compiler import find_compiler
from continuum_grasp.errors import InputError
from tests.rti_problems import GRAVITY, cart_pole, cart_pole_rates

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler here")

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
        assert command.status == Status.ROW_VIOLATED
        assert command.violated == pytest.approx({"power": power}, rel=1e-5)
    else:
        assert (command.status == Status.ROW_VIOLATED) == bool(command.violated) == (power > 1e-5)


def test_a_long_horizon_of_a_linear_problem_is_the_linear_quadratic_regulator():
    """Against scipy's algebraic Riccati equation."""
    a, b = np.array([[0.0, 1.0], [-4.0, -0.1]]), np.array([[0.0], [2.0]])
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = cg.ControlProblem(
        states=x,
        inputs=u,
        dynamics=a @ x + b @ u,
        cost={"x": (x, [3.0, 1.0]), "u": (u, 0.5)},
        stages=200,
        stage=0.1,
        substeps=20,
    )
    held = expm(0.1 * np.block([[a, b], [np.zeros((1, 3))]]))
    p = solve_discrete_are(held[:2, :2], held[:2, 2:], 0.1 * np.diag([3.0, 1.0]), 0.05 * np.eye(1))
    gain = np.linalg.solve(0.05 + held[:2, 2:].T @ p @ held[:2, 2:], held[:2, 2:].T @ p @ held[:2, :2])
    for state in ([1.0, 0.0], [-0.3, 2.0]):
        command = cg.rti(problem).step(state)
        assert command.status == Status.SOLVED
        np.testing.assert_allclose(command.u, -gain @ state, rtol=1e-6)


def test_the_implicit_method_takes_stiff_dynamics():
    """A rate of 1e4/s: the state follows the input, whose optimum is then a static one."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = cg.ControlProblem(
        states=x,
        inputs=u,
        dynamics=1e4 * (u - x),
        cost={"x": (x, 1.0, 1.0), "u": (u, 1.0)},
        stages=10,
        stage=0.1,
        method="sdirk2",
    )
    solver = cg.rti(problem)
    solver.reference(x=1.0)
    command = solver.step([0.0])
    np.testing.assert_allclose(command.planned("u")[1:-1], 0.5, atol=1e-3)


def test_the_cart_pole_swings_up_and_follows_its_parameters():
    problem = cart_pole()
    solver = cg.rti(problem)
    step = ca.Function(
        "step", [x := ca.MX.sym("x", 4), u := ca.MX.sym("u")], [ca.vertcat(*cart_pole_rates(ca.vertsplit(x), u))]
    )
    plant = ca.integrator("plant", "cvodes", {"x": x, "u": u, "ode": step(x, u)}, 0.0, 0.04)
    state = np.array([0.0, math.pi - 0.05, 0.0, 0.0])
    seen = []
    for _ in range(150):
        command = solver.step(state, parameters={"gravity": GRAVITY})
        seen.append(command.status)
        state = np.array(plant(x0=state, u=command.u)["xf"]).ravel()
    assert abs(math.sin(state[1] / 2)) < 5e-3
    assert np.abs(state[2:]).max() < 0.05
    assert not any(status.fallback for status in seen)
    assert sum(solver.statistics["status"].values()) == 150


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
        (lambda s: s.step({"angle": 0.0}), "x: position, speed, rate missing"),
        (lambda s: s.step({"angle": 0.0, "position": 0, "rate": 0, "speed": 0, "tilt": 1}), "there is no 'tilt'"),
        (lambda s: s.step(START, {"tip": 1.0}), r"\(position, pole, speed, force\)"),
        (lambda s: s.step(START, {"pole": 1.0}), "pole: expected"),
        (lambda s: s.step(START, {"pole": [1.0, math.nan]}), "pole: expected finite"),
        (lambda s: s.step(START, np.zeros(3)), "reference"),
        (lambda s: s.step(START, None, {"mass": 1.0}), "there is no 'mass'"),
        (lambda s: s.step(START, None, [1.0, 2.0]), r"parameters: expected \(1,\)"),
        (lambda s: s.reset({"torque": 1.0}), "there is no 'torque'"),
        (lambda s: s.reference(angle=0.0), "expected setpoints of what has a weight"),
        (lambda s: s.reference(pole=lambda t: 1.0) or s.step(START), "expected 2 finite entries"),
    ],
)
def test_wrong_names_and_shapes_of_a_step_are_refused(call, match):
    with pytest.raises(InputError, match=match):
        call(cg.rti(cart_pole()))


X, U, OTHER = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("other")
GOOD = {"states": X, "inputs": U, "dynamics": U - X, "cost": {"x": (X, 1.0), "u": (U, 1.0)}, "stages": 3, "stage": 0.1}


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"dynamics": [X, U]}, "dynamics: expected 1 expressions, got 2"),
        ({"dynamics": OTHER}, "dynamics: unknown symbols other"),
        ({"states": X + 1}, "states: expected a column of SX symbols"),
        ({"states": ca.MX.sym("x")}, "states: expected"),
        ({"dynamics": ca.MX.sym("x")}, "expand"),
        ({"states": [X, ca.SX.sym("x")], "dynamics": [U, U]}, "more than one x"),
        ({"inputs": []}, "inputs: expected at least one"),
        ({"inputs": X}, "given twice among states, inputs, parameters and previous: x"),
        ({"previous": U}, "given twice.*: u"),
        ({"cost": {}}, "cost: expected at least one"),
        ({"cost": {"x": X}}, "cost.x: expected"),
        ({"cost": {"x": (X, -1.0)}}, "no negative"),
        ({"cost": {"x": (X, [1.0, 2.0])}}, "cost.x.weight: expected 1 entries, got 2"),
        ({"cost": {"u": (U, 1.0, 1.0)}}, "a final weight needs an expression of the states"),
        ({"bounds": {"y": (0, 1)}}, "bounds: expected names of states and inputs, got y"),
        ({"bounds": {"u": (1, 0)}}, "bounds.u"),
        ({"bounds": {"u": (math.nan, 0)}}, "bounds.u"),
        ({"rows": {"r": (X, 1.0, 0.0)}}, "rows.r"),
        ({"rows": {"r": (X, 0.0, 1.0, (-1.0, 0.0))}}, "no negative penalty"),
        ({"bounds": {"x": (0, 1)}, "rows": {"x_2": (X, 0, 1), "x_": (ca.vertcat(X, X), 0, 1)}}, None),
        ({"bounds": {"x": (0, 1)}, "rows": {"x": (X, 0, 1)}}, "there is more than one x"),
        ({"rows": {"r": (ca.vertcat(X, U), [0, 0, 0], 1)}}, "rows.r: expected 2 entries, got 3"),
        ({"cost": {1: (X, 1.0)}}, "cost: expected words"),
        ({"parameters": OTHER}, "nominal: expected a value of each parameter"),
        ({"previous": [OTHER, ca.SX.sym("more")]}, "previous: expected 1"),
        ({"stages": 0}, "stages"),
        ({"stage": 0.0}, "stage"),
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
    assert command.status == Status.SOLVED
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
    assert found[0].status == Status.PREVIOUS_PLAN
    assert found[0].anomaly & Anomaly.MISSING
    np.testing.assert_array_equal(found[0].u, plan.u[1])
    assert found[-1].status == Status.SAFE_RAMP
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


def test_rows_change_from_stage_to_stage_and_hold_at_the_end_alone():
    """A mass above a floor of which each node has its own, at rest in the end: the quadratic program of HiGHS."""
    n, h = 10, 0.1
    place, speed, time, push = (ca.SX.sym(name) for name in ("place [m]", "speed [m/s]", "time [s]", "push [m/s2]"))
    now, floor = ca.SX.sym("now"), ca.SX.sym("floor", n + 1)
    node = (time - now) / h
    below = sum(floor[k] * ca.fmax(0.0, 1.0 - ca.fabs(node - k)) for k in range(n + 1))
    solver = cg.rti(
        cg.ControlProblem(
            states=[place, speed, time],
            inputs=push,
            parameters=ca.vertcat(now, floor),
            nominal=dict.fromkeys(["now", *(f"floor_{k}" for k in range(n + 1))], 0.0),
            dynamics=[speed, push, 1.0],
            cost={"place": (place, 1.0), "push": (push, 0.01)},
            rows={
                "floor": (place - below, 0.0, ca.inf),
                "rest": (ca.if_else(node > n - 0.5, speed, 0.0), -0.05, 0.05),
            },
            stages=n,
            stage=h,
        ),
        sqp_iterations=20,
        start_iterations=20,
    )
    free, held = np.array([[1.0, h], [0.0, 1.0]]), np.array([0.5 * h**2, h])
    x = np.array([1.0, 0.0])
    for k in range(3):
        floors = 0.5 * np.sin(2.0 * h * (k + np.arange(n + 1))) + 0.3
        command = solver.step([*x, k * h], parameters=[k * h, *floors])
        opti = ca.Opti("conic")
        path, pushes = opti.variable(2, n + 1), opti.variable(n)
        opti.subject_to(path[:, 0] == x)
        for j in range(n):
            opti.subject_to(path[:, j + 1] == free @ path[:, j] + held * pushes[j])
            opti.subject_to(path[0, j + 1] >= floors[j + 1])
        opti.subject_to(opti.bounded(-0.05, path[1, n], 0.05))
        opti.minimize(0.5 * h * (ca.sumsqr(path[0, :n]) + 0.01 * ca.sumsqr(pushes)))
        opti.solver("highs", {"highs": {"output_flag": False}})
        assert command.planned("place") == pytest.approx(np.ravel(opti.solve().value(path[0, :])), abs=1e-4)
        x = free @ x + held * command.u[0]


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
