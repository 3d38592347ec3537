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
