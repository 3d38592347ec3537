"""Solutions next to a known one, against a closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.grasp.problem.near import NearSolver
from continuum_grasp.nlp import NLP, Budget, Start, Status
from continuum_grasp.nlp.optimality import optimality_error

MOST = 0.3
"""Of y: below that of the nearest point of the circle."""


def nearest(most=MOST, at=(0.9, 0.4)):
    """The point of the unit circle, y bounded, that is nearest to (2, 1)."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 0)
    problem = NLP("nearest", x, (x[0] - 2.0) ** 2 + (x[1] - 1.0) ** 2, ca.dot(x, x), p)
    free, one = np.full(2, np.inf), np.ones(1)
    return problem, Start(np.array(at), -free, np.array([np.inf, most]), one, one)


def test_it_is_the_nearest_point_within_bounds_with_its_multipliers():
    problem, start = nearest()
    found = NearSolver(problem).solve(start, Budget())
    x = math.sqrt(1.0 - MOST**2)
    force = (2.0 - x) / x
    assert found.status is Status.SOLVED
    assert found.x == pytest.approx([x, MOST], abs=1e-8)
    assert found.multipliers.constraints == pytest.approx([force], abs=1e-6)
    assert found.multipliers.bounds == pytest.approx([0.0, 2.0 * (1.0 - MOST) - 2.0 * force * MOST], abs=1e-6)
    assert optimality_error(problem, start, found.x, found.multipliers) < 1e-6


def test_without_a_bound_that_acts_it_lies_on_the_line_to_the_target():
    problem, start = nearest(most=1.0)
    found = NearSolver(problem).solve(start, Budget())
    assert found.status is Status.SOLVED
    assert found.x == pytest.approx(np.array([2.0, 1.0]) / math.sqrt(5.0), abs=1e-8)


@pytest.mark.parametrize(("second", "status"), [(0.3, Status.SOLVED), (0.31, Status.FAILED)])
@pytest.mark.parametrize("lower", [0.0, -math.inf])
def test_an_equation_or_limit_that_follows_from_another_matters_only_where_it_contradicts(lower, second, status):
    problem, start = nearest()
    twice = NLP("twice", problem.x, problem.f, ca.vertcat(problem.g, 0.3 * problem.g), problem.p)
    lower, upper = np.array([1.0, second + lower]), np.array([1.0, second])
    found = NearSolver(twice).solve(replace(start, lower=lower, upper=upper), Budget())
    if np.isinf(lower[1]):
        status = Status.SOLVED
    assert found.status is status
    if status is Status.SOLVED:
        x = math.sqrt(1.0 - MOST**2)
        assert found.x == pytest.approx([x, MOST], abs=1e-8)
        assert found.multipliers.constraints @ [1.0, 0.3] == pytest.approx((2.0 - x) / x, abs=1e-6)


def test_out_of_iterations_nothing_is_solved_and_the_error_says_how_far_off():
    problem, start = nearest(most=1.0, at=(0.0, 1.0))  # on the circle, a quarter of it away
    found = NearSolver(problem).solve(start, Budget(left=0))
    assert found.status is not Status.SOLVED
    assert found.error == pytest.approx(4.0)  # the gradient (-4, 0), without multipliers
