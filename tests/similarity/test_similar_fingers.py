"""Units of keys and names: a finger in other units of length, mass and time moves alike, by powers of two exactly."""

from __future__ import annotations

from contextlib import suppress
from itertools import chain

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.model import System
from continuum_grasp.scene import Scene
from tests.features import FEATURES, Feature, scene_of
from tests.similarity.similar import larger, power

PLAIN = {"fidelity": {"family": "arc", "elements": 2}, "gravity": [1.0, -9.0], "parameters": ["gravity"]}


def mixed(seed: int) -> Feature:
    """Three to five features that a scene takes together."""
    rng = np.random.default_rng(seed)
    while True:
        some = [FEATURES[k] for k in rng.choice(len(FEATURES), rng.integers(3, 6), replace=False)]
        together = Feature(", ".join(one.name for one in some), dict(chain(*(one.changes.items() for one in some))))
        with suppress(InputError):
            scene_of(Scene, together, PLAIN)
            return together


MIXED = [mixed(seed) for seed in range(16)]


@pytest.mark.parametrize("feature", [*FEATURES, *MIXED], ids=lambda one: one.name)
def test_a_finger_in_other_units_moves_alike(feature: Feature):
    sizes = {"L": 2, "M": 6, "T": 4}
    scene = scene_of(Scene, feature, PLAIN)
    models = [System(each) if each.object else cg.FingerModel(each) for each in (scene, larger(scene, sizes))]
    rng, (model, _) = np.random.default_rng(0), models
    names = {"x": model.x_names, "u": model.u_names, "w": model.w_names, "p": model.p_names}
    values = {key: rng.uniform(0.1, 0.9, len(entries)) for key, entries in names.items()}
    values["u"] *= 10.0 if "tension" in str(model.u_names) else 1e-3
    factors = {
        key: np.array([2.0 ** power(n[n.index("[") :], sizes) for n in entries]) for key, entries in names.items()
    }
    values["p"] = np.array(model.p_nominal)
    assert models[1].p_nominal == pytest.approx(factors["p"] * values["p"], rel=1e-15)
    small = np.array(model.forward_dynamics(*values.values())).ravel()
    large = np.array(models[1].forward_dynamics(*(factors[key] * values[key] for key in values))).ravel()
    scale = np.abs(small).max()
    assert large * 2.0 ** sizes["T"] / factors["x"] == pytest.approx(small, rel=1e-9, abs=1e-12 * scale)
