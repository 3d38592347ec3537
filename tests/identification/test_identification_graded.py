"""Estimates of graded rods are factors on their stiffness and mass; truths by integration and from closed forms."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import continuum_grasp as cg
from continuum_grasp.addons.identification import Estimate
from continuum_grasp.base import InputError
from continuum_grasp.model import FingerModel
from tests.identification_cases import bare_scene, frequency, rung, weighed
from tests.rods import rod_scene

STEPPED = {
    "length": 1.0,
    "sections": [
        {"to": 0.4, "bending_stiffness": 1.0, "linear_density": 1.0},
        {"to": 1.0, "bending_stiffness": 0.1, "linear_density": 0.3},
    ],
}
FREQUENCIES = np.array([4.40472332, 17.38616520]) / (2 * math.pi)
"""Of that rod, clamped, by transfer matrices [Hz]."""
CONE = {"length": 0.2, "youngs_modulus": 2e6, "density": 1100.0, "sections": [{"to": 0.2, "diameter": [0.01, 0.004]}]}
LOADS = np.array([0.0, 0.05, 0.1, 0.2])


def tip_of_cone(load: float, modulus: float) -> np.ndarray:
    """Tip x, y of the weightless cone along +x under a load downwards: m' = load cos(angle), by shooting."""

    def bent(moment: float) -> np.ndarray:
        def rates(s, y):
            d = 0.01 - 0.03 * s
            return [y[1] / (modulus * math.pi * d**4 / 64), load * math.cos(y[0]), math.cos(y[0]), math.sin(y[0])]

        return solve_ivp(rates, (0.0, 0.2), [0.0, moment, 0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]

    found = bent(brentq(lambda m: bent(m)[1], -0.2 * load, 1e-9)) if load else bent(0.0)
    return found[2:]


def cone_scene(**keys):
    loads = [{"kind": "force", "at": 0.2, "force": [0.0, 0.0]}]
    return rod_scene(CONE, elements=4, gravity=(0.0, 0.0), loads=loads, **keys)


def poses(modulus):
    tips = np.array([tip_of_cone(load, modulus) for load in LOADS])
    return weighed(tips, LOADS)


@pytest.mark.deep
def test_density_of_a_stepped_rod_from_its_frequencies():
    """A rod that is lighter by a factor rings faster by its root."""
    scene = rod_scene(STEPPED, elements=6, gravity=(0.0, 0.0))
    fit = cg.identify(scene, rung(*FREQUENCIES / math.sqrt(1.3)), parameters=["linear_density"])
    assert fit["linear_density"] == pytest.approx(1.3, rel=2e-3)
    assert fit.units == ("1",)
    heavier = fit.apply()
    assert heavier.finger.rod.factors.linear_density == fit["linear_density"]
    assert heavier.finger.rod.mass == pytest.approx(1.3 * (0.4 + 0.6 * 0.3), rel=2e-3)
    again = cg.identify(heavier, rung(*FREQUENCIES / math.sqrt(1.3)), parameters=["linear_density"])
    assert again["linear_density"] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.deep
def test_modulus_and_stiffness_of_a_cone_from_its_shapes():
    data = poses(2.6e6)
    modulus = cg.identify(cone_scene(), data, parameters=["youngs_modulus"])
    assert modulus["youngs_modulus"] == pytest.approx(2.6e6, rel=2e-3)
    factor = cg.identify(cone_scene(), data, parameters=[Estimate(name="bending_stiffness", start=0.8)])
    assert factor["bending_stiffness"] == pytest.approx(1.3, rel=2e-3)
    for fit in (modulus, factor):
        assert fit.apply().finger.rod.youngs_modulus == pytest.approx(2.6e6, rel=2e-3)


def test_changes_are_those_of_the_run_time_parameters():
    """The model with factors as arguments is the model of the scene that has them."""
    factors = {"bending_stiffness": 1.2, "linear_density": 0.7, "rotary_inertia": 2.0}
    finger = cone_scene().finger
    arguments = FingerModel(finger, family="clothoid", elements=3, parameters=tuple(factors))
    changed = FingerModel(finger.changed({"rod.factors": factors}), family="clothoid", elements=3)
    assert list(arguments.p_nominal) == [1.0, 1.0, 1.0]
    x, w = np.linspace(-1.0, 2.0, arguments.nx), np.zeros(arguments.nw)
    expected = np.array(arguments.forward_dynamics(x, [0.01], w, list(factors.values())))
    assert np.array(changed.forward_dynamics(x, [0.01], w, [])) == pytest.approx(expected, rel=1e-9)


def test_friction_of_a_list_of_tendons_is_that_of_all():
    tendons = [{"offset": 0.004, "max_tension": 5.0}, {"offset": -0.004, "max_tension": 5.0, "to": 0.1}]
    scene = cone_scene(family="clothoid", finger={"tendons": tendons, "half_thickness": 0.005})
    fit = cg.identify(bare_scene(), rung(frequency(1)), parameters=["bending_stiffness"])
    friction = {"targets": (("tendon_friction", 1.0, False),), "values": np.array([0.2]), "names": ("tendon_friction",)}
    changed = dataclasses.replace(fit, **friction).apply(scene)
    assert [tendon.friction for tendon in changed.finger.tendon_list] == [0.2, 0.2]


REFUSED = {
    "a modulus of two materials": (STEPPED, "youngs_modulus", "needs a rod whose whole stiffness follows"),
    "a curvature of sections": (
        {**CONE, "sections": [{"to": 0.2, "diameter": 0.01, "rest_curvature": 1.0}]},
        "rest_curvature",
        "state the rest_curvature of the finger",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_single_number_is_refused(name):
    rod, parameter, words = REFUSED[name]
    with pytest.raises(InputError, match=words):
        cg.identify(rod_scene(rod), rung(1.0), parameters=[parameter])


def test_factors_are_for_graded_rods():
    with pytest.raises(InputError, match="factors: is for a graded rod"):
        cg.Rod(length=1.0, linear_density=1.0, bending_stiffness=1.0, factors={"linear_density": 2.0})
