"""Solutions next to a known one: against solutions from scratch, and differences of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.nlp import NLP, ActiveSet, Budget, Settings, SolutionSlopes, Start


def solved(t, x=(0.7, 0.2, 0.3)):
    """Least of (x - 2)^2 + (y - 1)^2 + z^2 with x^2 + y^2 <= 1 + t, y + z = 0.4 + t^2, x <= 0.9 - t / 4."""
    start = Start(np.array(x), *_limits(t))
    return start, Settings(tolerance=1e-10, constraint_tolerance=1e-10).solver().solve(problem(), start, Budget())


@cache
def problem():
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    f = (x[0] - 2.0) ** 2 + (x[1] - p[1]) ** 2 + x[2] ** 2
    return NLP("near", x, f, ca.vertcat(x[0] ** 2 + x[1] ** 2 - p[0], x[1] + x[2]), p)


def _limits(t):
    low, high = np.full(3, -9.0), np.array([0.9 - t / 4.0, 9.0, 9.0])
    lower, upper = np.array([-np.inf, 0.4 + t**2]), np.array([0.0, 0.4 + t**2])
    return low, high, lower, upper, np.array([1.0 + t, 1.0 + 0.1 * np.sin(t)])


@pytest.mark.parametrize("t", [1e-3, 0.03, 0.1])
def test_the_same_limits_lead_to_the_solution_of_a_solver(t):
    known, attempt = solved(0.0)
    start, expected = solved(t)
    found = ActiveSet(problem(), known, attempt).near(replace(start, x=attempt.x))
    assert found.x == pytest.approx(expected.x, abs=1e-7)
    assert found.objective == pytest.approx(expected.objective, abs=1e-7)
    assert found.multipliers.constraints == pytest.approx(expected.multipliers.constraints, abs=1e-6)


def test_nothing_is_found_where_other_limits_act():
    """At t = 1 the disc is so large that it does not act."""
    known, attempt = solved(0.0)
    start, expected = solved(1.0)
    assert abs(expected.multipliers.constraints[0]) < 1e-6 < abs(attempt.multipliers.constraints[0])
    assert ActiveSet(problem(), known, attempt).near(start) is None


def test_a_limit_that_acts_no_more_has_a_multiplier_of_the_wrong_sign():
    """Below t = -0.003, x is less than its bound."""
    known, attempt = solved(0.0)
    start, expected = solved(-0.03)
    assert expected.x[0] < start.high[0] - 1e-3
    assert ActiveSet(problem(), known, attempt).near(start) is None


def test_slopes_of_a_solution_are_differences_of_solutions():
    start, attempt = solved(0.2)
    h = 1e-4
    ends = [solved(0.2 + sign * h) for sign in (-1.0, 1.0)]

    def difference(values):
        return (values[1] - values[0]) / (2.0 * h)

    slopes = SolutionSlopes(problem(), start, attempt)
    beside = [end[0] for end in ends]
    assert slopes.unknowns(difference, beside) == pytest.approx(difference([end[1].x for end in ends]), abs=1e-6)
    assert slopes.value(difference, beside) == pytest.approx(difference([end[1].objective for end in ends]), rel=1e-6)
