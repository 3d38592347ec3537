"""A grasp that holds at one friction holds at any greater one, however thin the set of postures is that touch."""

from __future__ import annotations

import pytest

from benchmarks.grasp_populations import document
from continuum_grasp import optimize_grasp
from continuum_grasp.scene import GraspScene


def test_more_friction_loses_no_grasp_before_the_corner_of_a_box():
    """Of 4,700 seeds some five arrive, and none of those that are nearest to the set."""
    scene = GraspScene.model_validate(document("one", 7, elements=8))
    tensions = []
    for friction in (0.79, 0.85, 0.9):
        result = optimize_grasp(scene.changed({"contacts.friction": friction}), raise_on_failure=False)
        assert result.verified, result.message
        tensions.append(result.tension)
    assert tensions == pytest.approx(sorted(tensions, reverse=True), rel=1e-6)


@pytest.mark.deep
@pytest.mark.filterwarnings("error")
def test_without_friction_a_map_is_sampled_by_all_else():
    """Three fingers of `benchmarks.grasp_populations`: with cells of no size, 63.5 N were called optimal."""
    data = document("three", 2, elements=8)
    data["contacts"]["friction"] = 0.0
    assert optimize_grasp(GraspScene.model_validate(data)).tension < 30.6


@pytest.mark.xfail(reason="derivatives of friction are of one side where it is zero", strict=False)
@pytest.mark.parametrize(("population", "k"), [("one", 2), ("three", 4)])
def test_what_the_first_friction_saves_is_the_derivative(population, k):
    """Against full searches with a little friction: -1.2e6 N and, with one sign for both sides, 146 N were reported."""
    data = document(population, k, elements=8) | {"stability": "ignore"}
    data["contacts"]["friction"] = 0.0
    for support in data["supports"].values():
        support["friction"] = 0.0
    scene = GraspScene.model_validate(data)
    without = optimize_grasp(scene)
    (derivative,) = (one.derivative for one in without.sensitivity if one.name.startswith("friction"))
    saved = optimize_grasp(scene.changed({"contacts.friction": 1e-4})).tension - without.tension
    assert derivative == pytest.approx(saved / 1e-4, rel=2e-3)
