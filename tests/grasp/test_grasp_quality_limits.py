"""The numbers of grasp quality: each decides otherwise on either side of it, or keeps a promise."""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.grasp.quality import lp
from continuum_grasp.grasp.quality.lp import Cones, solve_lp, solve_socp


def believed(excess, monkeypatch):
    """Whether an optimum is believed that breaks a bound of one by a part of one and the number."""

    class Solver:
        def __call__(self, **problem):
            return {"x": ca.DM([(1.0 + excess) / (1.0 - excess)])}

        def stats(self):
            return {"return_status": "Optimal"}

    fake = SimpleNamespace(DM=ca.DM, sparsify=ca.sparsify, Sparsity=ca.Sparsity, conic=lambda *_: Solver())
    monkeypatch.setattr(lp, "ca", fake)
    return solve_lp([-1.0], np.zeros((0, 1)), [], [], 0.0, 1.0).optimal


def test_points_that_break_a_limit_are_no_optima(monkeypatch):
    """A hundred times what the solver is asked for."""
    assert believed(0.99e-7, monkeypatch)
    assert not believed(1.01e-7, monkeypatch)


def cones_of(rng, size, count):
    offsets = 0.3 * rng.normal(size=(count, 2))
    spare = np.linalg.norm(offsets, axis=1) + rng.uniform(0.1, 1.0, count)
    return Cones.made(rng.normal(size=(count, 2, size)), offsets, 0.3 * np.abs(rng.normal(size=(count, size))), spare)


def test_problems_with_many_optima_take_few_rounds(monkeypatch):
    """A cost of one unknown alone; without what is worth a point well inside, one of them takes 73 rounds."""
    solved = []
    monkeypatch.setattr(lp, "solve_lp", lambda *problem: solved.append(1) or solve_lp(*problem))
    rng, rounds = np.random.default_rng(0), []
    for _ in range(40):
        size, count = int(rng.integers(3, 8)), int(rng.integers(1, 5))
        cones, before = cones_of(rng, size, count), len(solved)
        found = solve_socp(
            -np.eye(size)[0], np.zeros((0, size)), [], [], np.full(size, -5.0), np.full(size, 5.0), cones
        )
        rounds.append(len(solved) - before)
        assert found.optimal
    assert max(rounds) < 25


@pytest.mark.parametrize("cost", [1.0, 1e-6])
def test_being_well_inside_a_cone_is_worth_less_than_the_cost(cost):
    """The point of a disc that is farthest in one direction."""
    matrix = np.eye(2)[None]
    cones = Cones.made(matrix, np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1))
    found = solve_socp([-0.6 * cost, -0.8 * cost], np.zeros((0, 2)), [], [], [-9.0] * 2, [9.0] * 2, cones)
    assert found.x == pytest.approx([0.6, 0.8], abs=2e-4)
    assert math.isclose(found.objective, -cost, rel_tol=1e-6)
