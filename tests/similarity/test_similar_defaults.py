"""Defaults of estimators follow the finger: those of the hand finger are the round numbers they were found with."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.control import ControlParts, Prediction
from continuum_grasp.scene import load
from tests.rods import ROOT
from tests.similarity.similar import larger, power

SIZES = {"L": -6, "M": -17, "T": -4}
pytestmark = pytest.mark.filterwarnings("ignore:.*fits no fingertip:UserWarning")
OPEN = {"estimator.acceleration_std": None, "estimator.object_acceleration_std": None}
HAND = {"estimator.acceleration_std": 10.0, "estimator.object_acceleration_std": 0.1}


def noise(scene):
    """Noise per second and at the start of all unknowns, and their units."""
    parts = ControlParts.of_scene(scene, Prediction(scene))
    units = [name[name.index("[") + 1 : -1] for name in parts.estimated_names]
    return parts.filter["noise"], parts.filter["initial"], np.array(units)


@pytest.mark.parametrize(
    ("name", "left_open", "hand"),
    [
        ("turn_bar", OPEN, HAND),
        ("unknown_payload", {}, {"estimator.adapt.forgetting_time": 60.0}),
    ],
)
def test_noise_that_a_scene_leaves_open_follows_the_finger(name, left_open, hand):
    scene = load(ROOT / f"configs/mpc/{name}.yaml").changed(left_open)
    process, initial, units = noise(scene)
    for found, wanted in zip((process, initial), noise(scene.changed(hand))[:2], strict=True):
        assert found == pytest.approx(wanted, rel=2e-3)
    factors = np.array([2.0 ** power(unit, SIZES) for unit in units]) ** 2
    other_process, other_initial, _ = noise(larger(scene, SIZES))
    assert other_process * 2.0 ** SIZES["T"] / factors == pytest.approx(process, rel=1e-9)
    assert other_initial / factors == pytest.approx(initial, rel=1e-9)
