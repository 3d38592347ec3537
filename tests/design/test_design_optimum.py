"""Best designs against closed forms: the moment M = (T1 - T2) e that a grasp needs does not depend on the offset e."""

from __future__ import annotations

import math
import re
from itertools import product

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.design import DesignNumber, DesignStatus, Evaluation
from continuum_grasp.base import SolverError

ARCS = "configs/grasp/mug_arcs.yaml"
OFFSET = "finger.tendons.offset"
LEAST = 1.0
"""Tension of the tendon that only stays in tension [N]."""


@pytest.fixture(scope="module")
def moment():
    """M [N m] of the mug."""
    return moment_of(stability="ignore")


def moment_of(**changes):
    """M [N m] of a scene."""
    grasp = cg.optimize_grasp(cg.load(ARCS).changed(changes))
    left, right = sorted(grasp.fingers["finger"].tensions, reverse=True)
    assert right == pytest.approx(LEAST, abs=1e-6)
    return (left - right) * 0.005


def designed(stability="ignore", **keys):
    given = {
        "scene": ARCS,
        "set": {"stability": stability},
        "variables": {OFFSET: {"min": 0.003, "max": 0.006, "name": "e"}},
        "minimize": "tension + 1e4 * e",
        "solver": {"starts": 1, "tolerance": 1e-10},
        **keys,
    }
    return cg.optimize_design(given)


def test_sensitivities_are_those_of_the_least_worst_cost():
    """Least over x of max(x, y - x) is y / 2; least of x + 2 y with 2 x >= 1 is 1 / 2 + 2 y; both with y at a bound."""

    def row(value, slope):
        return DesignNumber("", "", (), value, np.array(slope))

    both = (row(0.3, [1.0, 0.0]), row(0.3, [-1.0, 1.0]), row(0.1, [5.0, 5.0]))
    assert Evaluation(np.array([0.3, 0.0]), both, (), ()).slope == pytest.approx([0.0, 0.5], abs=1e-6)
    limit = row(0.0, [2.0, 0.0])
    found = Evaluation(np.array([0.5, 0.0]), (row(0.3, [1.0, 2.0]),), (limit,), ()).slope
    assert found == pytest.approx([0.0, 2.0], abs=1e-5)


def test_the_best_offset(moment):
    """Least of M / e + 2 T2 + k e."""
    found = designed()
    assert found.status is DesignStatus.OPTIMAL
    assert found.values[OFFSET] == pytest.approx(math.sqrt(moment / 1e4), rel=1e-4)
    assert found.best.cost == pytest.approx(2.0 * math.sqrt(moment * 1e4) + 2.0 * LEAST, rel=1e-8)
    assert found.statistics["full_searches"] == 2
    assert found.warnings


@pytest.mark.deep
def test_the_best_offset_of_grasps_that_bear_a_push():
    """Small pushes need more than balance: M is another one, and does not depend on the offset either."""
    moment = moment_of(stability="require")
    found = designed(stability="require")
    assert found.status is DesignStatus.OPTIMAL
    assert found.values[OFFSET] == pytest.approx(math.sqrt(moment / 1e4), rel=1e-4)


def test_a_limit_decides(moment):
    found = designed(minimize="e", limits={"tension": {"max": 50.0}})
    assert found.values[OFFSET] == pytest.approx(moment / (50.0 - 2.0 * LEAST), rel=1e-6)
    assert found.active == ("tension at most 50 (scene)",)


def test_a_limit_of_zero_is_that_of_a_number(moment):
    """A billion times its amount, it acted nowhere: the optimum had a slope left, and its message said so."""
    found = designed(minimize="e", limits={"tension - 50": {"max": 0.0}})
    assert found.status is DesignStatus.OPTIMAL
    assert found.values[OFFSET] == pytest.approx(moment / (50.0 - 2.0 * LEAST), rel=1e-6)
    assert found.active == ("tension - 50 at most 0 (scene)",)
    assert found.gradient == pytest.approx([0.0], abs=1e-6)


@pytest.mark.deep
@pytest.mark.parametrize(("expression", "limit"), [("tension", 20.0), ("tension - 20", 0.0)])
def test_limits_that_no_design_satisfies(moment, expression, limit):
    with pytest.raises(SolverError, match=f"no design satisfies {expression} at most {limit:g}") as caught:
        designed(limits={expression: {"max": limit}})
    assert caught.value.result.status is DesignStatus.LIMITS_VIOLATED
    off = float(re.search(r"off by ([\d.]+) at the closest", str(caught.value))[1])
    assert off == pytest.approx(moment / 0.006 + 2.0 * LEAST - 20.0, rel=0.01)


@pytest.mark.parametrize("cost", ["tension / (e - 0.005)", "log(e - 0.005)", "tension + sqrt(e - 0.005)"])
def test_a_cost_that_is_no_number_is_no_design(cost):
    """At the start e is 5 mm: infinite, no number, and of infinite slope."""
    with pytest.raises(SolverError, match="not finite") as caught:
        designed(minimize=cost)
    found = caught.value.result
    assert (found.status, found.influences, found.values) == (DesignStatus.NO_GRASP, (), {})


@pytest.mark.deep
def test_the_worst_case_and_the_mean_of_cases():
    cases = {f"{mass} g": {"object.mass": 1e-3 * mass} for mass in (200, 300)}
    moments = [moment_of(stability="ignore", **changes) for changes in cases.values()]
    worst, mean = (designed(cases=cases, over=over).values[OFFSET] for over in ("worst", "mean"))
    assert worst == pytest.approx(math.sqrt(max(moments) / 1e4), rel=1e-4)
    assert mean == pytest.approx(math.sqrt(np.mean(moments) / 1e4), rel=1e-4)


def test_errors_of_manufacture(moment):
    """The worst error makes the offset smaller by d: least of M / (e - d) + 2 T2 + k e."""
    d = 2e-4
    found = designed(tolerances={OFFSET: {"amount": d}})
    assert found.values[OFFSET] == pytest.approx(d + math.sqrt(moment / 1e4), rel=1e-4)
    worst = found.worst_cases[0]
    assert worst.signs == (-1.0,)
    e = found.values[OFFSET]
    nominal = moment / e + 2.0 * LEAST + 1e4 * e
    assert worst.bound == pytest.approx(nominal + moment / e**2 * d, rel=1e-6)
    assert worst.cost == pytest.approx(moment / (e - d) + 2.0 * LEAST + 1e4 * e, rel=1e-8)
    assert found.best.cost == pytest.approx(worst.cost, rel=1e-9)
    (other,) = found.worst_cases[1:]
    assert other.signs == (1.0,)
    assert other.cost == pytest.approx(moment / (e + d) + 2.0 * LEAST + 1e4 * e, rel=1e-8)


@pytest.mark.deep
def test_grasps_may_be_lost_on_the_way(moment):
    """Below M / 59 N the tendons are too weak: minimizing the offset alone ends just above."""
    found = designed(minimize="e", variables={OFFSET: {"min": 0.001, "max": 0.006, "name": "e"}})
    assert found.status is DesignStatus.FEASIBLE
    assert 0 < found.statistics["designs_without_grasp"] <= 40
    least = moment / (60.0 - LEAST)
    assert least < found.values[OFFSET] < 1.01 * least
    assert all(grasp.solved for grasp in found.grasps.values())


def test_no_design_holds_the_object():
    scene = {"object.mass": 30.0}
    found = cg.optimize_design(
        {
            "scene": ARCS,
            "set": scene | {"solver.max_total_iterations": 50},
            "variables": {OFFSET: {"min": 0.004, "max": 0.006}},
            "minimize": "tension",
            "solver": {"starts": 1},
        },
        raise_on_failure=False,
    )
    assert found.status is DesignStatus.NO_GRASP
    assert found.values == {}
    assert "scene" in found.message


@pytest.mark.deep
def test_three_variables_are_at_least_as_good_as_a_sweep():
    """With at most 6 % of the grasps of 10 x 10 x 10 scenes; compared with every second of each here."""
    found = cg.optimize_design("configs/design/mug_finger.yaml")
    assert found.statistics["full_searches"] + found.statistics["solver_runs"] <= 60
    scene = cg.load(ARCS).changed({"solver.max_total_iterations": 400})
    costs = []
    for e, stiffness, y in product(
        np.linspace(0.003, 0.006, 10)[1::2], np.geomspace(3e-3, 12e-3, 10)[::2], np.linspace(-0.07, -0.045, 10)[1::2]
    ):
        there = {OFFSET: e, "finger.rod.bending_stiffness": stiffness, "finger.base.position[1]": y}
        grasp = cg.optimize_grasp(scene.changed(there), raise_on_failure=False)
        costs.append(grasp.tension + 4000.0 * e if grasp.solved else math.inf)
    assert found.best.cost <= min(costs)
