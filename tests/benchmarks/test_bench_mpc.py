"""The NLP on which other solvers are compared with the real-time iteration, and the figures made of runs."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks import mpc_cases
from benchmarks.mpc_loop import LoopRun, primal_residuals
from benchmarks.mpc_nlp import Nlp
from benchmarks.mpc_peers import converged

CASES = {
    "arcs": lambda: mpc_cases.arcs(steps=6, horizon=5),
    "zones": lambda: mpc_cases.arcs(steps=6, horizon=5, zones=True),
    "tendons": lambda: mpc_cases.tendons(steps=6, horizon=5),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    return CASES[request.param]()


def point(nlp, case):
    rng = np.random.default_rng(3)
    w = 0.1 * rng.normal(size=nlp.w.numel())
    return w, nlp.parameters(case.p, case.references[0])


@pytest.mark.parametrize("variational", [False, True])
def test_derivatives_that_are_given_are_those_of_casadi(case, variational):
    nlp = Nlp(case.stages, soft=False, variational=variational)
    problem = nlp.problem
    f, x, g = problem["f"], problem["x"], problem["g"]
    own = ca.Function("own", [x, problem["p"]], [f, ca.gradient(f, x), g, ca.jacobian(g, x)])
    for given, expected in zip(nlp.jac_fg(*point(nlp, case)), own(*point(nlp, case)), strict=True):
        np.testing.assert_allclose(np.array(given), np.array(expected), rtol=1e-10, atol=1e-10)


def test_gauss_newton_hessian_is_that_of_the_squares(case):
    nlp = Nlp(case.stages, soft=False)
    w, p = point(nlp, case)
    s = case.stages
    values = []
    for k, (x, u) in enumerate(nlp.nodes):
        last = k == s.stages
        y = s.outputs(x, ca.MX(s.nu, 1) if last else u, case.p)
        weights = s.terminal_weights if last else s.stage * s.weights
        values.append(ca.sqrt(weights[: s.nt] if last else weights) * (y[: s.nt] if last else y))
    slope = np.array(ca.Function("slope", [nlp.w], [ca.jacobian(ca.vertcat(*values), nlp.w)])(w))
    hessian = np.array(nlp.hess_lag()(w, p, 1.0, 0.0))
    np.testing.assert_allclose(hessian, slope.T @ slope, rtol=1e-9, atol=1e-9 * np.abs(hessian).max())


def test_bounds_of_variables_and_rows_that_stay_are_all_rows(case):
    """At any point the hard problem is violated as far as the rows themselves are."""
    nlp, s = Nlp(case.stages, soft=False), case.stages
    w, p = point(nlp, case)
    w = 300.0 * w
    bounds, g = nlp.bounds, np.array(ca.Function("g", [nlp.w, nlp.p], [nlp.problem["g"]])(w, p)).ravel()
    rows = np.ones(len(g), bool)
    rows[bounds["lbg"] == bounds["ubg"]] = False
    found = np.maximum(
        0.0,
        np.concatenate([bounds["lbx"] - w, w - bounds["ubx"], (bounds["lbg"] - g)[rows], (g - bounds["ubg"])[rows]]),
    )
    x, u = nlp.plan(w)
    expected = [np.maximum(0.0, np.maximum(s.u_min - u, u - s.u_max)).ravel()]
    for k in range(s.stages):
        here = np.array(s.rows(x[k], u[k], case.p)).ravel()
        there = np.array(s.rows(x[k + 1], np.zeros(s.nu), case.p)).ravel()
        value = np.concatenate([there[: s.ns], here[s.ns :]])
        expected.append(mpc_cases.outside(s, value))
    assert (found > 0.0).sum() == (np.concatenate(expected) > 0.0).sum() > 0


def test_soft_and_hard_problems_agree_where_bounds_can_be_satisfied():
    case = mpc_cases.arcs(steps=4, horizon=8)
    runs = [converged(case, soft=soft) for soft in (True, False)] + [converged(case, exact=True)]
    assert all(run.good.all() for run in runs)
    for run in runs[1:]:
        np.testing.assert_allclose(run.u, runs[0].u, atol=2e-5)


def test_plant_follows_the_continuous_motion(case):
    s, p = case.stages, case.plant_p[0]
    u = 0.7 * s.u_min + 0.3 * s.u_max
    right = solve_ivp(
        lambda _, x: np.array(s.dynamics(np.concatenate([x, case.x0[s.nd :]]), u, p)).ravel(),
        (0.0, s.stage),
        case.x0[: s.nd],
        method="DOP853",
        rtol=1e-10,
        atol=1e-12,
    ).y[:, -1]
    reached = np.array(case.plant()(case.x0, u, p)).ravel()
    np.testing.assert_allclose(reached[: s.nd], right, atol=2e-3 * np.abs(right).max())


def test_cost_of_a_violated_row():
    case = mpc_cases.arcs(steps=1, horizon=5)
    s = case.stages
    x = np.array([[0.0, 0.0, 15.0 * 1.2, 0.0]])
    error = case.references[0, 0, :2]
    tracking = 0.5 * s.stage * (100.0 * error @ error + 0.01 * 18.0**2)
    penalty = 100.0 * 0.2 + 0.5 * 1000.0 * 0.2**2
    assert case.cost(np.vstack([x, x]), np.zeros((1, 1))) == pytest.approx(tracking + penalty, rel=1e-12)
    assert case.excess(np.vstack([x, x]), np.zeros((1, 1))) == pytest.approx(0.2)


def linearized(s):
    """End of a stage and its derivatives, by CasADi's differentiation of the Runge-Kutta steps."""
    x, u, p = (ca.SX.sym(name, size) for name, size in (("x", s.nx), ("u", s.nu), ("p", s.np)))
    end = x
    for _ in range(s.substeps):
        end = s.step(end, u, p, s.stage / s.substeps)[0]
    return ca.Function("linear", [x, u, p], [end, ca.jacobian(end, x), ca.jacobian(end, u)])


def test_residuals_of_a_plan_that_obeys_its_linearization(case):
    s, rng = case.stages, np.random.default_rng(5)
    n, nx, nu = s.stages, s.nx, s.nu
    x0, u0 = 0.1 * rng.normal(size=(n + 1, nx)), rng.uniform(s.u_min, s.u_max, (n, nu))
    du = 0.5 * (rng.uniform(s.u_min, s.u_max, (n, nu)) - u0)
    linear = linearized(s)
    x = x0.copy()
    x[0] += 0.01
    for k in range(n):
        following, a, b = (np.array(v) for v in linear(x0[k], u0[k], case.p))
        x[k + 1] = following.ravel() + a @ (x[k] - x0[k]) + b @ du[k]
    guess, plan = (np.concatenate([v.ravel(), w.ravel()])[None] for v, w in ((x0, u0), (x, u0 + du)))
    run = LoopRun(x[:1], u0[:1], np.zeros((1, 2)), 0.0, np.ones(1, bool), guess, plan)
    assert primal_residuals(case, run)[0] < 1e-9 * np.abs(x).max()
    run.plan[0, n * nx] += 1e-3
    assert primal_residuals(case, run)[0] == pytest.approx(1e-3, rel=1e-6)
