"""QPs of the real-time iteration: their data, and their solutions against other solvers."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from benchmarks.real_time_iteration import RealTimeIteration
from continuum_grasp.control import Stages
from continuum_grasp.core import Compiler
from tests.rti_cases import SIZES, change_of_plan, changed, disturb, qp_of, random_stages

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")

EPS = {"double": 2.0**-52, "float": 2.0**-23}


@lru_cache
def iteration(k: int, precision: str = "double", lanes: bool = False) -> RealTimeIteration:
    """Of random stages of a size."""
    return RealTimeIteration(random_stages(k, SIZES[k]), precision=precision, lanes=lanes)


@lru_cache
def easy(precision: str) -> RealTimeIteration:
    """A problem of which single precision has enough digits: penalty weights near what they have to outweigh."""
    stages = random_stages(3, SIZES[0])
    penalties = {"linear": np.full(stages.nc, 5.0), "quadratic": np.full(stages.nc, 10.0)}
    return RealTimeIteration(random_stages(3, SIZES[0], **penalties), precision=precision)


@pytest.mark.parametrize("lanes", [False, True])
@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_qp_is_that_of_the_stage_functions(precision, lanes):
    """Evaluated by CasADi, two sub-steps chained by hand; inputs beyond their bounds are linearized at the bounds."""
    rti = RealTimeIteration(random_stages(1, SIZES[1], substeps=2), precision=precision, lanes=lanes)
    s, o, p = rti.stages, rti.settings, np.ones(1)
    rng = np.random.default_rng(5)
    refs = rng.normal(size=(s.stages + 1, s.nr))
    rti.plan[0][:], rti.plan[1][:] = rng.normal(size=rti.plan[0].shape), 3.0 * rng.normal(size=rti.plan[1].shape)
    rti.prepare(refs, p)
    q = rti.qp()
    close = {"rtol": 2000 * EPS[precision], "atol": 2000 * EPS[precision]}
    np.testing.assert_array_equal(q["u"], np.clip(rti.plan[1], o.u_min, o.u_max))
    for k in range(s.stages):
        middle, a1, b1 = (np.array(v) for v in s.step(q["x"][k], q["u"][k], p, 0.5))
        end, a2, b2 = (np.array(v) for v in s.step(middle, q["u"][k], p, 0.5))
        given = (q["x"][k], q["u"][k], p, refs[k], s.weights)
        cost, g, h, c, jacobian = (np.array(v) for v in s.cost(*given))
        h[s.nx :, s.nx :] += np.diag(o.regularization)
        for name, expected in {"A": a2 @ a1, "B": a2 @ b1 + b2, "g": g[:, 0], "H": h, "l": cost[0, 0]}.items():
            np.testing.assert_allclose(q[name][k], expected, err_msg=name, **close)
        np.testing.assert_allclose(q["defect"][k], end[:, 0] - q["x"][k + 1], **close)
        np.testing.assert_allclose(q["c"][k], c[:, 0], **close)
        np.testing.assert_allclose(q["C"][k], jacobian, **close)
    _, g, h, c, jacobian = (np.array(v) for v in s.terminal(q["x"][-1], p, refs[-1], s.terminal_weights))
    np.testing.assert_allclose(q["g"][-1], np.r_[g[:, 0], np.zeros(s.nu)], **close)
    np.testing.assert_allclose(q["H"][-1, : s.nx, : s.nx], h, **close)
    np.testing.assert_allclose(q["c"][-1], np.r_[c[:, 0], np.zeros(s.nc - s.ns)], **close)
    np.testing.assert_allclose(q["C"][-1, : s.ns, : s.nx], jacobian, **close)


@pytest.mark.parametrize("k", range(len(SIZES)))
def test_without_bounds_it_is_one_linear_system(k):
    stages = random_stages(k, SIZES[k])
    none = {name: np.full_like(getattr(stages, name), -Stages.ABSENT) for name in ("u_min", "c_min")}
    none |= {name: np.full_like(getattr(stages, name), Stages.ABSENT) for name in ("u_max", "c_max")}
    rti = iteration(k)
    with changed(rti, **none):
        x0 = disturb(rti, np.random.default_rng(k))
        q = qp_of(rti, x0)
        report = rti.feedback(x0)
    system = np.block([[q.H, q.E.T], [q.E, np.zeros((len(q.e), len(q.e)))]])
    expected = np.linalg.solve(system, np.r_[-q.g, q.e])[: len(q.g)]
    assert (report.status, report.iterations, report.violation) == (0, 0, 0.0)
    np.testing.assert_allclose(change_of_plan(rti), expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("k", range(len(SIZES)))
def test_the_answer_is_that_of_an_active_set_solver(k):
    """By qpOASES, on the QP with slacks as variables; 300 QPs in all."""
    rti, rng = iteration(k), np.random.default_rng(100 + k)
    for _ in range(50):
        x0 = disturb(rti, rng)
        q = qp_of(rti, x0)
        report = rti.feedback(x0)
        found, expected = change_of_plan(rti), q.solve()
        assert report.status in (0, 2)
        assert np.abs(found - expected).max() <= 1e-6 * np.abs(expected).max()
        assert report.cost - rti.qp()["l"].sum() == pytest.approx(q.cost(expected), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("k", [0, 1, 3, 5])
def test_rows_that_inputs_at_their_bounds_push_beyond_theirs(k):
    """Neither the solution without bounds nor the bounds that were active before tell of them. By qpOASES, and so a QP
    with the same matrices from another state.
    """
    rti, rng = iteration(k), np.random.default_rng(k)
    tried, far, row = 0, 1e6, np.ones(rti.stages.nc)
    unbounded, weights = {"c_min": -far * row, "c_max": far * row}, {"linear": 10.0 * row, "quadratic": 100.0 * row}
    for _ in range(60):
        x0 = disturb(rti, rng)
        with changed(rti, **unbounded, linear=0.0 * row, quadratic=0.0 * row):
            rti.feedback(x0)
            bounded = change_of_plan(rti)
        with changed(rti, **unbounded, **weights):
            q = qp_of(rti, x0)
        free = np.linalg.solve(np.block([[q.H, q.E.T], [q.E, np.zeros((len(q.e),) * 2)]]), np.r_[-q.g, q.e])
        without, within = (far + (q.C @ z - q.c_max).max() for z in (free[: len(q.g)], bounded))
        if within <= without + 1e-3:
            continue
        tried += 1
        with changed(rti, c_min=-far * row, c_max=(without + 0.3 * (within - without)) * row, **weights):
            for state in (x0, 1.1 * x0):
                q = qp_of(rti, state)
                rti.feedback(state)
                found, expected = change_of_plan(rti), q.solve()
                assert np.abs(found - expected).max() <= 1e-6 * np.abs(expected).max()
    assert tried > 5


def test_single_precision_keeps_three_digits():
    rng = np.random.default_rng(2)
    double, single = easy("double"), easy("float")
    for _ in range(50):
        state = rng.bit_generator.state
        x0 = 0.3 * disturb(double, rng)
        rng.bit_generator.state = state
        disturb(single, rng)
        assert double.feedback(x0).status in (0, 2)
        assert single.feedback(x0).status in (0, 2)
        expected, found = change_of_plan(double), change_of_plan(single)
        assert np.abs(found - expected).max() <= 1e-3 * np.abs(expected).max()


def optimality(rti: RealTimeIteration, q, z: np.ndarray) -> float:
    """Least norm of the gradient that multipliers of the right signs leave, over that of its terms: zero at an optimum.

    With the states eliminated, by the inputs alone.
    """
    n, nx, nu = rti.stages.stages, rti.stages.nx, rti.stages.nu
    nz = nx + nu
    inputs = np.concatenate([np.arange(k * nz + nx, (k + 1) * nz) for k in range(n)])
    states = np.setdiff1d(np.arange(len(z)), inputs)
    by_inputs = np.zeros((len(z), len(inputs)))
    by_inputs[inputs] = np.eye(len(inputs))
    by_inputs[states] = np.linalg.solve(q.E[:, states], -q.E[:, inputs])
    gradient = (q.H @ z + q.g) @ by_inputs
    columns, least, most = [], [], []
    scale = 1e-6 * (1.0 + np.abs(z).max())
    for j, i in enumerate(inputs):
        for bound, sign in ((q.low[i], -1.0), (q.high[i], 1.0)):
            if abs(z[i] - bound) <= scale:
                columns.append(sign * np.eye(len(inputs))[j])
                least.append(0.0)
                most.append(np.inf)
    for row, low, high, linear, quadratic in zip(q.C, q.c_min, q.c_max, q.linear, q.quadratic, strict=True):
        for over, sign in ((low - row @ z, -1.0), (row @ z - high, 1.0)):
            if over > -scale:
                columns.append(sign * row @ by_inputs)
                least.append(0.0 if over <= scale else linear + quadratic * (over - scale))
                most.append(linear + quadratic * max(over + scale, 0.0))
    terms = np.abs(gradient).max()
    if columns:
        matrix = np.array(columns).T
        fit = lsq_linear(matrix, -gradient, (np.array(least), np.maximum(most, np.array(least) + 1e-12)), tol=1e-14)
        gradient = gradient + matrix @ fit.x
        terms = max(terms, np.abs(matrix * fit.x).max())
    return float(np.abs(gradient).max() / terms)


DEGENERATE = {
    "an input that cannot move": lambda s: {"u_min": np.full(s.nu, 0.2), "u_max": np.full(s.nu, 0.2)},
    "rows that must not move": lambda s: {"c_min": np.full(s.nc, 0.1), "c_max": np.full(s.nc, 0.1)},
    "no weight on states": lambda s: {"weights": np.r_[np.zeros(s.nx), s.weights[s.nx :]]},
    "no weight on inputs": lambda s: {"weights": np.r_[s.weights[: s.nx], np.zeros(s.nu)]},
    "a weight at the end alone": lambda s: {"weights": np.zeros(s.nr)},
    "quadratic penalties alone": lambda s: {"linear": np.zeros(s.nc)},
    "linear penalties alone": lambda s: {"quadratic": np.zeros(s.nc), "linear": np.full(s.nc, 3.0)},
    "rows that cost nothing": lambda s: {"quadratic": np.zeros(s.nc), "linear": np.zeros(s.nc)},
    "hard rows": lambda s: {"quadratic": np.full(s.nc, 1e6), "linear": np.full(s.nc, 1e4)},
    "tiny range": lambda s: {"u_min": np.full(s.nu, -1e-6), "u_max": np.full(s.nu, 1e-6)},
    "one-sided inputs": lambda s: {"u_min": np.zeros(s.nu), "u_max": np.full(s.nu, Stages.ABSENT)},
}


@pytest.mark.parametrize("changes", DEGENERATE.values(), ids=DEGENERATE)
def test_degenerate_qps_are_solved(changes):
    """Multipliers of the right signs and sizes balance the gradient, which proves a convex QP solved."""
    rti, rng = iteration(1), np.random.default_rng(11)
    with changed(rti, **changes(rti.stages)):
        for _ in range(20):
            x0 = disturb(rti, rng)
            q = qp_of(rti, x0)
            assert rti.feedback(x0).status in (0, 2)
            z = change_of_plan(rti)
            np.testing.assert_allclose(q.E @ z, q.e, atol=1e-9 * (1.0 + np.abs(q.e).max()))
            assert optimality(rti, q, z) <= 1e-5


@pytest.mark.parametrize("k", range(len(SIZES)))
def test_any_state_gets_a_plan(k):
    """From 1e-6 to 1e6 times the bounds: nothing fails, no input leaves its bounds, the plan begins at the state."""
    rti, rng = iteration(k), np.random.default_rng(k)
    o = rti.settings
    for j in range(300):
        x0 = disturb(rti, rng, spread=10.0 ** rng.uniform(-3, 0.5)) * 10 ** rng.uniform(-6, 6) ** (j % 2)
        report = rti.feedback(x0)
        x, u = rti.plan
        assert report.status >= 0
        assert np.isfinite(report.cost)
        assert np.isfinite(x).all()
        assert np.all((u >= o.u_min) & (u <= o.u_max))
        np.testing.assert_allclose(x[0], x0, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("k", range(len(SIZES)))
def test_an_answer_does_not_depend_on_those_before(k):
    """They tell which bounds to try first: those of its own solution, at once; those of another, in the end."""
    rti, rng = iteration(k), np.random.default_rng(k)
    x0 = disturb(rti, rng)
    first = rti.feedback(x0), *(part.copy() for part in rti.plan)
    for j in range(20):
        others = (5.0 * rng.normal(size=x0.size) for _ in range(j % 4))
        before = [rti.feedback(other) for other in others]
        again = rti.feedback(x0), *rti.plan
        assert again[0].status == first[0].status
        assert again[0].iterations <= 2 or before
        assert again[0].cost == pytest.approx(first[0].cost, rel=1e-7)
        for one, other in zip(first[1:], again[1:], strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6 * np.abs(one).max())


@pytest.mark.parametrize("k", range(len(SIZES)))
@pytest.mark.parametrize("most", [1, 2, 5, 12])
def test_a_problem_takes_no_more_factorizations_than_are_set(k, most):
    """Far from its solution a plan is still one: inputs within their bounds; and the status says that it is far."""
    rti, rng = iteration(k), np.random.default_rng(k)
    o = rti.settings
    with changed(rti, iterations=most):
        for _ in range(60):
            x0 = disturb(rti, rng)
            report = rti.feedback(x0)
            x, u = rti.plan
            assert report.iterations <= most
            assert report.status in (1, 2) or report.kkt <= 100 * o.tolerance
            assert np.all((u >= o.u_min) & (u <= o.u_max))
            np.testing.assert_allclose(x[0], x0, rtol=1e-12, atol=1e-12)


def test_without_a_feasible_input_the_violation_is_reported():
    """A row of the state is bounded to less than what the first state allows."""
    rti = iteration(0)
    rng = np.random.default_rng(0)
    disturb(rti, rng)
    x0 = 20.0 * rng.normal(size=rti.stages.nx)
    q = qp_of(rti, x0)
    report = rti.feedback(x0)
    y = q.C @ change_of_plan(rti)
    over = np.maximum(q.c_min - y, y - q.c_max).max()
    assert over > 0.1
    assert report.status == 2
    assert report.violation == pytest.approx(over, rel=1e-9)
