"""Shipped loops in other units: controller, estimator and plant have no times, lengths or forces of their own.

Exponents of time are even, since densities of noise have roots of seconds.
"""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.scene import load
from tests.rods import ROOT
from tests.similarity.similar import larger, power

SMALL, LARGE = {"L": -6, "M": -17, "T": -4}, {"L": 4, "M": 12, "T": 2}
CALLS = 30
"""Of a loop [1]: most setpoints jump within them."""
UNITS = {"tensions": "N", "lengths": "m", "angles": "rad", "tip_moment": "N m", "torques": "N m", "pressures": "Pa"}
NAMES = sorted(path.stem for path in (ROOT / "configs/mpc").glob("*.yaml"))
pytestmark = [pytest.mark.deep, pytest.mark.filterwarnings("ignore:.*is in (milli)?meters:UserWarning")]


@pytest.mark.parametrize(
    ("name", "sizes"),
    [pytest.param(name, (SMALL, LARGE)[k % 2], id=name) for k, name in enumerate(NAMES)],
)
def test_a_loop_is_that_of_another_size(name, sizes):
    scene = load(ROOT / f"configs/mpc/{name}.yaml")
    scene = scene.replaced(duration=CALLS * scene.controller.step)
    of_input = UNITS[scene.finger.input_keys[0]]
    one = cg.run_closed_loop(scene)
    other = cg.run_closed_loop(larger(scene, sizes, of_input=of_input))
    u, tip = (2.0 ** power(unit, sizes) for unit in (of_input, "m"))
    assert np.abs(other.u / u - one.u).max() < 1e-6 * np.abs(one.u).max()
    assert np.abs(other.tip / tip - one.tip).max() < 1e-6 * scene.finger.rod.length
    assert list(other.status) == list(one.status)
    assert list(other.health) == list(one.health)
