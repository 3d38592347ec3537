"""Every solver on problems with known solutions; budget, deadline and Ctrl-C stop each of them.

Problems and solutions: W. Hock, K. Schittkowski, Test Examples for Nonlinear Programming Codes, Springer 1981,
doi:10.1007/978-3-642-48320-2, by their numbers there.
"""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from typing import get_args

import casadi as ca
import numpy as np
import pytest
from grasp_scenes import INTO_PLANE, make_scene
from numpy.testing import assert_allclose
from plan_cases import two_arcs

from continuum_grasp.addons.planning import PlanSolver, plan
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.nlp import (
    NLP,
    Attempt,
    Budget,
    Constraints,
    Multipliers,
    Settings,
    Solver,
    SolverStatus,
    Start,
    Summand,
    summed,
)
from continuum_grasp.scene import GraspSolver

METHODS = get_args(GraspSolver.model_fields["method"].annotation)
INF = np.inf


def problem_21():
    x = ca.SX.sym("x", 2)
    start = Start(np.array([-1.0, -1.0]), *np.array([[2.0, -50.0], [50.0, 50.0]]), *np.array([[10.0], [INF]]))
    return NLP("hs21", x, 0.01 * x[0] ** 2 + x[1] ** 2 - 100.0, 10.0 * x[0] - x[1]), start, [2.0, 0.0]


def problem_35():
    x = ca.MX.sym("x", 3)
    f = (
        9
        - 8 * x[0]
        - 6 * x[1]
        - 4 * x[2]
        + 2 * x[0] ** 2
        + 2 * x[1] ** 2
        + x[2] ** 2
        + 2 * x[0] * x[1]
        + 2 * x[0] * x[2]
    )
    start = Start(np.full(3, 0.5), np.zeros(3), np.full(3, INF), np.array([-INF]), np.array([3.0]))
    return NLP("hs35", x, f, x[0] + x[1] + 2 * x[2]), start, [4 / 3, 7 / 9, 4 / 9]


def problem_71():
    x = ca.SX.sym("x", 4)
    g = ca.vertcat(x[0] * x[1] * x[2] * x[3], ca.sumsqr(x))
    start = Start(
        np.array([1.0, 5.0, 5.0, 1.0]), np.ones(4), np.full(4, 5.0), np.array([25.0, 40.0]), np.array([INF, 40.0])
    )
    return NLP("hs71", x, x[0] * x[3] * ca.sum1(x[:3]) + x[2], g), start, [1.0, 4.7429994, 3.8211503, 1.3794082]


def problem_6():
    """Rosenbrock's valley as a constraint, with Gauss-Newton derivatives by hand and a parameter, which is 10 there."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g")
    hessian = ca.triu(ca.diagcat(2 * lam_f, 0))
    names = ["x", "p", "lam_f", "lam_g"]
    given = ca.Function("nlp_hess_l", [x, p, lam_f, lam_g], [hessian], names, ["triu_hess_gamma_x_x"])
    start = Start(np.array([-1.2, 1.0]), np.full(2, -INF), np.full(2, INF), np.zeros(1), np.zeros(1), np.array([10.0]))
    nlp = NLP("hs6", x, (1 - x[0]) ** 2, p * (x[1] - x[0] ** 2), p, {"hess_lag": given}, semidefinite=True)
    return nlp, start, [1.0, 1.0]


PROBLEMS = {make.__name__: make for make in (problem_6, problem_21, problem_35, problem_71)}


def solved(method, problem, start, budget=None, **settings) -> Attempt:
    settings = {"tolerance": 1e-8, "constraint_tolerance": 1e-8, "max_iterations": 200} | settings
    return Settings(method, **settings).solver().solve(problem, start, budget or Budget())


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("method", METHODS)
def test_solutions_are_the_published_ones(method, name):
    problem, start, expected = PROBLEMS[name]()
    found = solved(method, problem, start)
    assert found.status is SolverStatus.SOLVED
    assert_allclose(found.x, expected, atol=1e-5)
    assert found.violation < 1e-7
    slopes = ca.Function(
        "s", [problem.x, problem.p], [ca.gradient(problem.f, problem.x), ca.jacobian(problem.g, problem.x)]
    )
    gradient, jacobian = (np.array(v) for v in slopes(found.x, start.p))
    stationary = gradient.ravel() + jacobian.T @ found.multipliers.constraints + found.multipliers.bounds
    assert_allclose(stationary, 0.0, atol=1e-6)


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("method", METHODS)
def test_a_solution_with_its_multipliers_is_found_again_in_fewer_iterations(method, name):
    problem, start, expected = PROBLEMS[name]()
    first = solved(method, problem, start)
    again = solved(method, problem, replace(start, x=first.x, multipliers=first.multipliers))
    assert again.status is SolverStatus.SOLVED
    assert_allclose(again.x, expected, atol=1e-5)
    assert again.iterations < max(first.iterations, 4)


@pytest.mark.parametrize("method", METHODS)
def test_a_problem_without_a_solution_is_not_solved(method):
    problem, start, _ = problem_71()
    found = solved(method, problem, replace(start, lower=np.array([25.0, 200.0]), upper=np.array([INF, 200.0])))
    assert not found.converged
    assert found.status is not SolverStatus.STOPPED
    assert found.violation > 10.0
    if method == "ipopt":
        assert found.status is SolverStatus.INFEASIBLE


@pytest.mark.parametrize("method", METHODS)
def test_more_equations_than_unknowns_print_nothing(method, capfd):
    """Two lines through one point, and one of them twice, which IPOPT refuses: its status says so."""
    x = ca.SX.sym("x", 2)
    problem = NLP("lines", x, ca.sumsqr(x), ca.vertcat(x[0] + x[1], x[0] - x[1], 2 * (x[0] + x[1])))
    values = np.array([1.0, 0.0, 2.0])
    start = Start(np.zeros(2), np.full(2, -9.0), np.full(2, 9.0), values, values)
    found = solved(method, problem, start)
    assert found.status is (SolverStatus.FAILED if method == "ipopt" else SolverStatus.SOLVED)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("ends", "violations", "stalls"),
    [
        ({"patience": 3}, [1.0] * 3, False),
        ({"patience": 3}, [1.0] * 4, True),
        ({"patience": 3}, [1.0, 1.0, 1.0, 0.49, 0.49, 0.49], False),
        ({"patience": 3}, [1.0, 1.0, 1.0, 0.51, 0.51], True),
        ({"patience": 3}, [2.0, 2.0, 3.0, 2.0, 3.0, 2.0], False),
        ({"patience": 3}, [1.0, 1.031, 1.0, 1.031, 1.0], False),
        ({"patience": 3}, [1.0, 1.029, 1.0, 1.029], True),
        ({"patience": 3}, [0.99e-3] * 9, False),
        ({"patience": 3}, [1.01e-3] * 4, True),
        ({"standstill": 2}, [1.0] * 2, False),
        ({"standstill": 2}, [1.0] * 3, True),
        ({"standstill": 2}, [1.0, 0.9991, 0.9982], True),
        ({"standstill": 2}, [1.0, 0.9989, 0.9978], False),
        ({"standstill": 2}, [1.0, 1.0, 0.9, 0.9], False),
        ({"standstill": 2}, [0.99e-3] * 9, False),
    ],
)
def test_so_many_iterations_may_leave_the_violation_until_it_is_halved_or_in_a_row(ends, violations, stalls):
    _, start, _ = problem_71()
    stalling = replace(start, **ends).stalling()
    assert [stalling(violation) for violation in violations][-1] is stalls


@pytest.mark.parametrize("ends", [{"patience": 3}, {"standstill": 1}])
def test_what_has_no_solution_ends_early(ends):
    problem, start, expected = problem_71()
    none = replace(start, lower=np.array([25.0, 200.0]), upper=np.array([INF, 200.0]))
    found, ended = solved("ipopt", problem, none), solved("ipopt", problem, replace(none, **ends))
    assert (ended.status, ended.outcome) == (SolverStatus.STOPPED, "Stalled")
    assert ended.iterations < found.iterations
    assert_allclose(solved("ipopt", problem, replace(start, **ends)).x, expected, atol=1e-5)


@pytest.mark.parametrize(("aside", "outcome"), [(0.0, "Known"), (0.9e-3, "Known"), (1.1e-3, "Solve_Succeeded")])
def test_a_run_ends_at_a_solution_that_is_known(aside, outcome):
    problem, start, _ = problem_71()
    whole = solved("ipopt", problem, start)
    # The last unknown of the start is far from its bound, and comes from above.
    beyond = whole.x - aside * np.eye(4)[2]
    found = solved("ipopt", problem, replace(start, known=[np.full(4, 3.0), beyond]))
    assert found.outcome == outcome
    assert (found.iterations < whole.iterations) is (outcome == "Known")
    assert np.abs(found.x - whole.x).max() < 2e-3


@pytest.mark.parametrize("method", METHODS)
def test_iterations_of_one_run_and_of_all_runs_end_it(method):
    problem, start, _ = problem_71()
    assert solved(method, problem, start, max_iterations=2).status is SolverStatus.ITERATION_LIMIT
    budget = Budget(left=10)
    with budget.share(2) as part:
        found = solved(method, problem, start, part)
    assert (found.status, found.iterations) == (SolverStatus.STOPPED, 2)
    assert found.why_it_ended == "the iterations of this start were used up"  # no user stopped it
    assert (budget.left, budget.over, budget.cut) == (8, False, "")


@pytest.mark.parametrize("method", METHODS)
def test_the_deadline_ends_it(method):
    problem, start, _ = problem_71()
    budget = Budget(until=-1.0)
    found = solved(method, problem, start, budget)
    assert found.status is SolverStatus.STOPPED
    assert found.iterations == 0
    assert budget.cut == "clock"


@pytest.mark.parametrize("method", METHODS)
def test_ctrl_c_ends_it_after_the_iteration(method):
    """Pressed while the third iteration is taken from the budget."""
    problem, start, _ = problem_71()

    class Pressing(Budget):
        def __setattr__(self, name, value):
            super().__setattr__(name, value)
            if (name, value) == ("left", 97):
                os.kill(os.getpid(), signal.SIGINT)

    budget = Pressing(left=100)
    with pytest.raises(KeyboardInterrupt):
        solved(method, problem, start, budget)
    assert budget.left == 97


def problem_by_hand():
    """Minimize (x - 2)^2 / 2 + y^2 / 2 + c z for x <= 1 as a bound, y >= 3 as a constraint and z in [0, 4].

    At (1, 3, 0) the multipliers are 1 of x, -3 of the constraint and -c of z.
    """
    x, c = ca.SX.sym("x", 3), ca.SX.sym("c")
    low, high = np.array([-INF, -INF, 0.0]), np.array([1.0, INF, 4.0])
    start = Start(np.zeros(3), low, high, np.array([3.0]), np.array([INF]), np.array([0.5]))
    return NLP("hand", x, (x[0] - 2) ** 2 / 2 + x[1] ** 2 / 2 + c * x[2], x[1], c), start


@pytest.mark.parametrize(
    ("point", "bounds", "forces", "error"),
    [
        ([1.0, 3.0, 0.0], [1.0, 0.0, -0.5], [-3.0], 0.0),  # the solution
        ([1.0, 3.0, 0.0], [1.0, 0.0, 0.0], [-3.0], 0.5),  # the multiplier of z is missing
        ([1.0, 3.1, 0.0], [1.0, 0.0, -0.5], [-3.1], 0.31),  # 0.1 within the constraint that pushes by 3.1
        ([1.0, 2.8, 0.0], [1.0, 0.0, -0.5], [-2.8], 0.2),  # 0.2 beyond it
        ([1.2, 3.0, 0.0], [0.8, 0.0, -0.5], [-3.0], 0.2),  # beyond the bound of x
        ([2.0, 3.0, 0.0], [0.0, 0.0, -0.5], [-3.0], 1.0),  # without it
        ([1.0, 3.0, 4.0], [1.0, 0.0, -0.5], [-3.0], 2.0),  # z at its other end, the sign that of the lower
        ([1.0, -1.0, 0.0], [1.0, 0.0, -0.5], [1.0], 4.0),  # the constraint pulls, and is violated by 4
        ([np.nan, 3.0, 0.0], [1.0, 0.0, -0.5], [-3.0], INF),
    ],
)
def test_the_error_of_optimality_against_a_problem_by_hand(point, bounds, forces, error):
    problem, start = problem_by_hand()
    found = problem.optimality_error(start, np.array(point), Multipliers(np.array(bounds), np.array(forces)))
    assert found == pytest.approx(error, abs=1e-14)


def test_steep_functions_and_great_multipliers_are_scaled_as_ipopt_does():
    """A gradient of 1000 at the start is scaled to 100; multipliers of 400 in the mean count as 100."""
    x = ca.SX.sym("x")
    problem = NLP("steep", x, 500 * x**2, 1e-3 * x)
    start = Start(np.ones(1), np.full(1, -INF), np.full(1, INF), np.full(1, 2e-3), np.full(1, INF))
    # At 2 the slope of 2000 is held by a multiplier of -2e6; with -1.9e6, 100 are left.
    found = problem.optimality_error(start, np.full(1, 2.0), Multipliers(np.zeros(1), np.full(1, -1.9e6)))
    assert found == pytest.approx(0.1 * 100 / (0.1 * 1.9e6 / 2 / 100), rel=1e-12)
    # A violated steep constraint counts less by as much.
    steep = NLP("steep", x, x, 1e4 * x)
    start = Start(np.ones(1), np.full(1, -INF), np.full(1, INF), np.full(1, 1e4), np.full(1, INF))
    found = steep.optimality_error(start, np.full(1, 0.5), Multipliers(np.zeros(1), np.full(1, -1e-4)))
    assert found == pytest.approx(50.0, rel=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_solution_is_solved_whatever_the_solver_says(method, monkeypatch):
    problem, start, _ = problem_71()
    monkeypatch.setattr(Solver, "statistics", lambda self, function: {"return_status": "Error_In_Step_Computation"})
    found = solved(method, problem, start, tolerance=1e-6)
    assert (found.status, found.outcome) == (SolverStatus.SOLVED, "Error_In_Step_Computation")
    monkeypatch.setattr(Solver, "statistics", lambda self, function: {"return_status": "Solve_Succeeded"})
    early = solved(method, problem, start, Budget(left=3), tolerance=1e-6)
    assert early.status is SolverStatus.FAILED
    assert early.error > 1e-4


@pytest.mark.parametrize("option_set", ["default", "refined", "refined_monotone"])
def test_every_option_set_solves_from_next_to_the_solution(option_set):
    problem, start, expected = problem_71()
    near = replace(start, x=np.array(expected) + 1e-3, option_set=option_set)
    found = solved("ipopt", problem, near)
    assert found.status is SolverStatus.SOLVED
    assert_allclose(found.x, expected, atol=1e-5)


def test_another_solver_finds_the_same_plan():
    """Both with the Hessian of Gauss and Newton."""
    one, two = (plan(two_arcs(solver={"hessian": "gauss_newton", "method": method})) for method in ("ipopt", "sqp"))
    assert two.status == one.status == "optimal"
    assert two.objective == pytest.approx(one.objective, rel=1e-6)
    assert two.x == pytest.approx(one.x, abs=1e-3 * np.abs(one.x).max())


def test_another_solver_finds_the_same_grasp():
    scenes = (
        make_scene("arc", INTO_PLANE, solver=GraspSolver(effort="quick", method=method)) for method in ("ipopt", "sqp")
    )
    one, two = (optimize_grasp(scene) for scene in scenes)
    # Two arcs are too few to be called optimal.
    assert two.status == one.status == "optimal"
    assert two.certificate.passed
    assert two.tension == pytest.approx(one.tension, rel=1e-6)


def test_plans_with_an_indefinite_hessian_are_not_for_sqp():
    with pytest.raises(ValueError, match="hessian: needs gauss_newton"):
        PlanSolver(method="sqp")


def test_violations_are_named_with_their_amounts():
    constraints = Constraints()
    constraints.rows("gap", "contacts.tip", "m", 2, [0.5, 0.1])
    constraints.rows("force", "contacts.force", "N", 3, 2.0, 0.0, 4.0)
    lower, upper = constraints.bounds()
    assert_allclose(lower, [0, 0, 0, 0, 0, 0, 0])
    assert_allclose(upper, [0, 0, 0, 0, 4, 4, 4])
    g = np.array([0.0, 0.01, -0.002, 0.0, -1.0, 2.0, 4.5])
    gap, force = (block.violation(g[block.rows]) for block in constraints.blocks)
    assert (str(gap), gap.index) == ("gap: violated by 0.001 m (contacts.tip)", 1)
    assert (force.amount, force.scaled, force.index) == (2.0, 1.0, 0)
    assert str(replace(force, unit="1", amount=0.00316)) == "force: violated by 0.316 % (contacts.force)"
    assert str(replace(force, amount=INF)) == "force: not a finite number (contacts.force)"
    g[5] = np.nan
    assert constraints.blocks[1].violation(g[constraints.blocks[1].rows]).scaled == INF


@pytest.mark.parametrize(
    ("error", "violation", "solved"), [(0.999, 0.999, True), (1.001, 0.0, False), (0.0, 1.001, False)]
)
def test_a_point_is_solved_up_to_both_tolerances(error, violation, solved):
    solver = Settings("ipopt", tolerance=1e-6, constraint_tolerance=1e-9).solver()
    status = solver._status(SolverStatus.FAILED, 1e-6 * error, 1e-9 * violation)
    assert (status is SolverStatus.SOLVED) == solved


def test_a_sum_of_parts_is_the_problem_written_at_once():
    """Parts share unknowns, parameters and rows, in any order."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)

    def rows(x, p):
        return x[0] * x[1] * p[0], [x[0] * x[2] * p[1], x[1] ** 3]

    value, pair = rows(x, p)
    part = NLP("part", x, value, ca.vertcat(*pair), p)
    first = Summand(part, np.array([3, 0, 1]), np.array([0, 2]), np.array([1, 0]))
    second = Summand(part, np.array([1, 2, 3]), np.array([1, 2]), np.array([1, 2]))
    whole = summed("whole", (4, 3, 3), [first, second])
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", 3)
    f, g = rows([x[3], x[0], x[1]], [p[0], p[2]])
    other, h = rows([x[1], x[2], x[3]], [p[1], p[2]])
    written = NLP("written", x, f + other, ca.vertcat(g[1], g[0] + h[0], h[1]), p)
    at, numbers, forces = [0.7, 1.3, -0.4, 2.1], [2.0, 3.0, 4.0], [0.3, -0.2, 0.9]
    for name, more in {"grad_f": [], "jac_g": [], "hess_lag": [2.0, forces]}.items():
        found, expected = (each.functions[name].call([at, numbers, *more])[-1] for each in (whole, written))
        assert np.array(found) == pytest.approx(np.array(expected), abs=1e-15)
    assert np.array(whole.slope(at, numbers, 2.0, forces)) == pytest.approx(
        np.array(written.slope(at, numbers, 2.0, forces))
    )
