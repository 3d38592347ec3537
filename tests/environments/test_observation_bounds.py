"""Bounds of what an environment observes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import step


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
