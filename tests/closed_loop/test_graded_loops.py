"""Control of graded rods: those with the same values everywhere are the uniform ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from continuum_grasp.closed_loop.plant_model import PlantModel, plant_scene
from continuum_grasp.control.ocp.scene_problem import stages_of
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene.load import load

STEPS = Path(__file__).parents[2] / "configs/mpc/tip_steps.yaml"


@pytest.fixture(scope="module")
def pair():
    """A loop with a uniform rod, and with the same cut into three sections."""
    uniform = load(STEPS, ["plant.fidelity.elements=3", "parameters=[]", "estimator.disturbances={tip_moment: 0.01}"])
    rod = uniform.finger.rod
    same = {"bending_stiffness": rod.stiffness, "linear_density": rod.mass_per_length}
    same |= {"rotary_inertia": rod.inertia_per_length, "diameter": rod.diameter}
    sections = [{"to": to, **same} for to in (0.05, 0.11, rod.length)]
    return uniform, uniform.replaced(finger=uniform.finger.replaced(rod={"length": rod.length, "sections": sections}))


def test_a_controller_of_equal_sections_is_that_of_the_uniform_rod(pair):
    rng = np.random.default_rng(3)
    models = [Prediction(scene) for scene in pair]
    stages = [stages_of(scene, model) for scene, model in zip(pair, models, strict=True)]
    for _ in range(3):
        x, u = rng.uniform(-3.0, 3.0, stages[0].nx), rng.uniform(1.0, 20.0, 2)
        for name in ("dynamics", "rows", "outputs"):
            first, second = (np.array(getattr(s, name)(x, u, s.p_nominal)).ravel() for s in stages)
            assert second == pytest.approx(first, rel=1e-12, abs=1e-12 * np.abs(first).max())


def test_a_plant_of_equal_sections_is_the_uniform_one(pair):
    rng, plants = np.random.default_rng(4), [PlantModel(scene) for scene in pair]
    assert plant_scene(pair[1]).finger.profile.bending_stiffness(0.1) == pytest.approx(1.1 * 6.11e-3)
    for _ in range(3):
        x, u = rng.uniform(-2.0, 2.0, plants[0].nx), rng.uniform(1.0, 20.0, 2)
        w = np.zeros(plants[0].nw)
        first, second = (np.array(p.forward_dynamics(x, u, w, p.p)).ravel() for p in plants)
        assert second == pytest.approx(first, rel=1e-12, abs=1e-12 * np.abs(first).max())
