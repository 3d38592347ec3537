"""The NLP on which other solvers are compared with the real-time iteration, and the figures made of runs."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from benchmarks.harness import CONFIGS
from benchmarks.mpc import cases as mpc_cases
from benchmarks.mpc.nlp import Nlp
from benchmarks.mpc.peers import converged
from benchmarks.mpc.world import World
from continuum_grasp.control import Controller

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


def test_soft_and_hard_problems_agree_where_bounds_can_be_satisfied():
    case = mpc_cases.arcs(steps=4, horizon=8)
    runs = [converged(case, soft=soft) for soft in (True, False)] + [converged(case, exact=True)]
    assert all(run.good.all() for run in runs)
    for run in runs[1:]:
        np.testing.assert_allclose(run.u, runs[0].u, atol=2e-5)


def test_cost_of_a_violated_row():
    case = mpc_cases.arcs(steps=1, horizon=5)
    s = case.stages
    x = np.array([[0.0, 0.0, 15.0 * 1.2, 0.0]])
    error = case.references[0, 0, :2]
    tracking = 0.5 * s.stage * (100.0 * error @ error + 0.01 * 18.0**2)
    penalty = 100.0 * 0.2 + 0.5 * 1000.0 * 0.2**2
    assert case.cost(np.vstack([x, x]), np.zeros((1, 1))) == pytest.approx(tracking + penalty, rel=1e-12)
    assert case.excess(np.vstack([x, x]), np.zeros((1, 1))) == pytest.approx(0.2)


def test_the_cheap_plant_of_a_controller_rests_where_the_rod_does():
    controller = Controller(CONFIGS / "mpc" / "nitinol_moment.yaml", deadline=math.inf)
    world, p = World(controller), controller.stages.p_nominal
    for _ in range(50):
        measured = world.step(np.zeros(1), p)
    np.testing.assert_allclose(measured[:2], [0.5127, -0.2846], atol=2e-4)  # of the exact rod, as in that file
