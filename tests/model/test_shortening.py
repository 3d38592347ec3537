"""Rods that their tendons shorten: closed forms, power, and estimates from made-up poses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import continuum_grasp as cg
from continuum_grasp.addons.identification import Poses, Reading
from tests.finger_cases import energy_rate

LENGTH, STIFFNESS, RADIUS, OFFSET = 0.2, 8e-3, 4e-3, 6e-3
UNIFORM = {"length": LENGTH, "linear_density": 0.05, "bending_stiffness": STIFFNESS}
TAPER = {
    "length": LENGTH,
    "density": 1100.0,
    "youngs_modulus": 1e6,
    "sections": [{"to": LENGTH, "diameter": [0.016, 0.008]}],
}


def finger(rod=UNIFORM, **more):
    tendons = {"offset": OFFSET, "max_tension": 50.0}
    return cg.Finger.model_validate({"rod": rod, "tendons": tendons, "gyration_radius": RADIUS, **more})


@pytest.mark.parametrize(("family", "elements"), [("arc", 3), ("clothoid", 2), ("matched_clothoid", 2)])
def test_equal_tensions_shorten_the_straight_rod_by_their_sum(family, elements):
    model = cg.FingerModel(finger(), family=family, elements=elements, gravity=(0.0, 0.0), input_rates=False)
    x, y = model.tip(np.zeros(model.n), [10.0, 10.0], []).full().ravel()
    assert (x, y) == pytest.approx((0.0, LENGTH / (1.0 + 20.0 * RADIUS**2 / STIFFNESS)), abs=1e-14)


@pytest.mark.parametrize("family", ["arc", "clothoid"])
def test_one_tendon_bends_an_arc_by_the_angle_of_the_whole_length_and_the_radius_of_what_is_left(family):
    tension = 12.0
    scene = cg.Scene(
        finger=finger(),
        gravity=(0.0, 0.0),
        actuation={"tensions": [tension, 0.0]},
        fidelity={"family": family, "elements": 2},
    )
    found = cg.equilibrium(scene)
    bend = tension * OFFSET * LENGTH / STIFFNESS
    left = LENGTH / (1.0 + tension * RADIUS**2 / STIFFNESS)
    assert found.tip == pytest.approx(left / bend * np.array([np.cos(bend) - 1.0, np.sin(bend)]), abs=1e-9)


def test_a_tapered_rod_is_shortened_by_its_thin_end_the_better_the_more_elements():
    """Against the integral of what is left of each part up to the end of the tendon, of 1 / (1 + T / E A)."""
    tension, to = 4.0, 0.15
    tendon = [{"offset": 2e-3, "to": to, "max_tension": 10.0}]

    def left(s):
        diameter = 0.016 - 0.008 * s / LENGTH
        return 1.0 / (1.0 + tension / (1e6 * np.pi * diameter**2 / 4.0))

    exact = quad(left, 0.0, to)[0] + LENGTH - to
    errors = []
    for elements in (4, 8):
        own = finger(TAPER, tendons=tendon, gyration_radius=0.004)
        model = cg.FingerModel(own, family="arc", elements=[LENGTH / elements] * elements)
        errors.append(abs(float(model.tip(np.zeros(elements), [tension], [])[1]) - exact))
    assert errors[0] < 2e-4 * LENGTH
    assert errors[1] < errors[0] / 3.5  # second order


@pytest.mark.parametrize(("family", "elements"), [("arc", 3), ("clothoid", 2)])
def test_tensions_that_stay_give_the_power_that_the_finger_takes(family, elements):
    """Weight, inertia and velocity products of the shorter finger are those of one energy."""
    masses = [{"at": 0.13, "mass": 0.01}, {"at": LENGTH, "mass": 0.02}]
    model = cg.FingerModel(finger(masses=masses), family=family, elements=elements, tip_force=False)
    u = np.array([15.0, 4.0])
    taken = energy_rate(model, u)
    rng, n = np.random.default_rng(3), model.n
    for _ in range(5):
        state = np.concatenate([2.0 * rng.standard_normal(n), 20.0 * rng.standard_normal(n)])
        rate = model.forward_dynamics(state, u, [], []).full().ravel()
        power = float(model.actuation(state[:n], u, []).full().ravel() @ state[n:])
        assert taken(state, rate) == pytest.approx(power, rel=1e-9, abs=1e-9 * abs(power))


def test_modulus_and_radius_come_out_of_made_up_poses():
    scene = cg.Scene(
        finger=finger(),
        gravity=(0.0, 0.0),
        fidelity={"family": "clothoid", "elements": 2},
        actuation={"tensions": [0.0, 0.0]},
    )
    tensions, stiffness, radius = np.array([2.0, 6.0, 10.0, 14.0]), 9e-3, 5e-3
    bends, left = tensions * OFFSET * LENGTH / stiffness, LENGTH / (1.0 + tensions * radius**2 / stiffness)
    readings = [
        Reading("x", left / bends * (np.cos(bends) - 1.0), sigma=1e-4),
        Reading("y", left / bends * np.sin(bends), sigma=1e-4),
    ]
    poses = Poses(readings, {"tension_1": tensions})
    fit = cg.identify(scene, poses, parameters=["bending_stiffness", "gyration_radius"])
    assert fit["bending_stiffness"] == pytest.approx(stiffness, rel=1e-6)
    assert fit["gyration_radius"] == pytest.approx(radius, rel=1e-6)
    assert fit.apply().finger.gyration_radius == fit["gyration_radius"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tendons": None}, "gyration_radius: needs tendons"),
        ({"tendons": {"offset": OFFSET, "max_tension": 50.0, "friction": 0.1}}, "gyration_radius: needs tensions"),
        ({"tendons": {"offset": OFFSET, "max_tension": 50.0, "time_constant": 0.1}}, "gyration_radius: needs tensions"),
    ],
)
def test_tensions_that_are_not_those_commanded_are_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        finger(**changes)


def test_friction_that_is_sought_is_refused():
    with pytest.raises(cg.InputError, match="have no friction"):
        cg.FingerModel(finger(), parameters=["tendon_friction"])
