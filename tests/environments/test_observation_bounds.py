"""Bounds of what an environment observes; from inside: bounds of each state, and how they are rounded."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import step

import continuum_grasp as cg
from continuum_grasp.addons.learning.environments.plants import plants_of
from continuum_grasp.addons.learning.environments.sensing import single_precision, state_bounds


def test_bounds_in_single_precision_are_the_nearest_outside():
    rng = np.random.default_rng(2)
    bounds = np.sort(rng.standard_normal((400, 2)) * 10.0 ** rng.uniform(-6.0, 6.0, (400, 1)), axis=1)
    low, high = single_precision(bounds)
    assert np.all(low <= bounds[:, 0])
    assert np.all(high >= bounds[:, 1])
    infinite = np.float32(np.inf)
    assert np.all(np.nextafter(low, infinite) > bounds[:, 0])
    assert np.all(np.nextafter(high, -infinite) < bounds[:, 1])


def test_rates_of_tensions_are_bounded_by_those_after_a_jump():
    """The greatest rate of the critically damped lag of the fastest drive, by its response to a step."""
    pytest.importorskip("gymnasium")
    from continuum_grasp.addons.learning import FingerEnv

    lags = [0.012, 0.031]
    sample = {"count": 2, "keys": {"plant.time_constant": {"choice": lags}}}
    plant = {"plant.fidelity": {"family": "matched_clothoid", "elements": 2}, "duration": 0.1}
    scene = {"scene": "configs/mpc/steady_tip.yaml", "set": plant, "sample": sample}
    env = FingerEnv(scene, sensors="state", substeps=8)
    own = {one.plant.time_constant for one in env.lanes.scenes}
    fastest = min(own | {0.02})  # that of the finger
    t = np.linspace(0.0, 10.0 * fastest, 200001)
    _, response = step(([1.0], [fastest**2, 2.0 * fastest, 1.0]), T=t)
    jump = float(env.action_space.high[0] - env.action_space.low[0])
    at = env.lanes.observation_names.index("tension_1_rate [N/s]")
    assert env.observation_space.high[at] == pytest.approx(jump * np.gradient(response, t).max(), rel=1e-6)


@pytest.mark.parametrize("sides", [[0.005], [0.005, -0.005]])
def test_tensions_that_lag_beside_chambers_start_at_rest_within_bounds_of_their_own(sides):
    """Pressures, which are commanded at once here, are no states: each state goes by its name."""
    chambers = [{"area": 6e-5, "offset": e, "min_pressure": 1e4, "max_pressure": 8e4} for e in sides]
    coarse = {"family": "clothoid", "elements": 1}
    changes = {"finger.pressure": chambers, "finger.tendons.time_constant": 0.02, "plant.fidelity": coarse}
    scene = cg.load("configs/mpc/steady_tip.yaml").changed({**changes, "fidelity": coarse, "estimator": None})
    plants = plants_of((scene,))
    model, tension = plants.model, plants.scenes[0].finger.tendons
    start, bounds = (dict(zip(model.x_names, of, strict=True)) for of in (plants.start[0], state_bounds(plants, 1e3)))
    most = (tension.max_tension - tension.min_tension) / (np.e * 0.02)
    for name in ("tension_1", "tension_2"):
        assert start[f"{name} [N]"] == tension.min_tension
        assert bounds[f"{name} [N]"].tolist() == [tension.min_tension, tension.max_tension]
        assert start[f"{name}_rate [N/s]"] == 0.0
        assert bounds[f"{name}_rate [N/s]"] == pytest.approx([-most, most], rel=1e-12)
