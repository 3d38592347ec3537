"""Estimators of fingers with winches and motors, on plants that are not their model."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from continuum_grasp.control import Estimator
from tests.control_cases import CABLE, driven_scene
from tests.truth.tendon_motion import MovingFinger

MEASURED = {"tip": 3e-4, "length": 2e-5, "tension": 0.05}


@lru_cache
def winches(**changes) -> Estimator:
    asked = {"measured": MEASURED, **changes}
    return Estimator(driven_scene("winches", estimator=asked, initial={"pose": "straight"}))


def friction(estimator):
    return [k for k, name in enumerate(estimator.names) if name.startswith("friction_")]


def outputs(estimator, z, u):
    found = estimator.estimation.outputs(z, u, estimator.prediction.p_nominal)[0]
    return np.array(found).ravel()


def test_what_drives_measure_has_names_and_is_what_the_law_says():
    """Tensions are stiffness times what is wound up beyond the path; on the straight finger, without friction."""
    own = Estimator(
        driven_scene(
            "servos", estimator={"measured": {"angle": 1e-3, "torque": 1e-3, "tension": 0.1}}, tendons={"friction": 0.0}
        )
    )
    names = ("motor_angle_1 [rad]", "motor_torque_1 [N m]")
    assert set(names) < set(own.measurement_names)
    z = np.zeros(len(own.names))
    z[own.names.index("motor_angle_1 [rad]")], z[own.names.index("motor_angle_1_rate [rad/s]")] = 0.05, 0.2
    found = dict(zip(own.measurement_names, outputs(own, z, [0.1, 0.0]), strict=True))
    compliance = 1.0 / CABLE["series_stiffness"] + 0.18 / CABLE["axial_stiffness"]
    assert found["tension_1 [N]"] == pytest.approx(2.0 + 0.008 * 0.05 / compliance, rel=1e-9)
    assert found["tension_2 [N]"] == pytest.approx(2.0, rel=1e-9)
    assert found["motor_angle_1 [rad]"] == 0.05
    assert found["motor_torque_1 [N m]"] == pytest.approx(2.0 * (0.1 - 0.05) - 0.01 * 0.2, rel=1e-9)


def test_friction_states_stay_where_nothing_slides():
    own = winches()
    z = np.array(own.first)
    at = friction(own)
    z[at] = np.linspace(-0.9, 0.9, len(at))
    own.reset(z)
    y = outputs(own, np.append(z, np.zeros(len(own.names) - z.size)), [0.0, 0.0])
    # At rest on the straight finger, friction exerts nothing.
    for _ in range(50):
        found = own.step(y, [0.0, 0.0])
    assert found.z[at] == pytest.approx(z[at], abs=1e-6)
    # Nothing shows them: what is known of them is their range.
    assert np.all((found.std[at] > 0.5) & (found.std[at] <= 1.0))


def test_no_correction_takes_friction_states_beyond_their_range():
    own = winches()
    at = friction(own)
    own.reset()
    y = outputs(own, np.array([*own.first, *np.zeros(len(own.names) - own.first.size)]), [0.0, 0.0])
    for _ in range(5):
        own.step(y, [0.0, 0.0])
    # A finger that is elsewhere has slid further than the range of its friction states.
    y[0] += 0.004
    found = own.step(y, [0.0, 0.0])
    assert np.abs(found.then[at]).max() == 1.0
    assert np.all(found.std[at] <= 1.0)


@pytest.mark.deep
@pytest.mark.parametrize("guides", [0.1, 0.2])
def test_lengths_and_tensions_alone_show_the_angle_of_the_tip(guides):
    """On a chain of guides with another friction: the angle to 0.03 rad of 1.2; without a model it is unknown."""
    own = Estimator(
        driven_scene("winches", estimator={"measured": {"length": 2e-5, "tension": 0.05}}, initial={"pose": "straight"})
    )
    chain = MovingFinger(
        0.18,
        6.11e-3,
        0.005,
        guides,
        series_compliance=1.0 / CABLE["series_stiffness"],
        hinges=20,
        time_step=1e-3,
        tip_mass=0.0,
    )
    start, rng = 2.0 * (1.0 / CABLE["series_stiffness"] + 0.18 / 1e4), np.random.default_rng(0)
    chain.start([("length", start)] * 2)
    own.reset()
    wrong = []
    for k in range(80):
        wound = 0.007 * np.sin(np.pi * k / 60.0)
        for _ in range(10):
            chain.advance([("length", start + wound), ("length", start - wound)])
        y = np.array([*chain.tensions, wound, -wound]) + [0.05, 0.05, 2e-5, 2e-5] * rng.standard_normal(4)
        found = own.step(y, [wound, -wound])
        bends = np.array(own.prediction.bending(found.z[: own.prediction.nx], [0.0, 0.0], own.prediction.p_nominal))
        wrong.append(float(bends.sum()) - chain.angle)
    assert np.abs(wrong[5:]).max() < 0.03


@pytest.mark.parametrize("periods", [0, 1, 2])
def test_a_torque_that_arrives_late_is_that_of_the_command_of_then(periods):
    """A servo's torque jumps with its command; a reading is taken before the command of its instant is sent."""
    own = Estimator(
        driven_scene(
            "servos",
            estimator={"measured": {"angle": 1e-3, "torque": 1e-3}, "delay": 0.01 * periods},
            tendons={"friction": 0.0},
        )
    )
    p, substeps = own.prediction.p_nominal, int(own.settings["substeps"])
    angle, rate = own.names.index("motor_angle_1 [rad]"), own.names.index("motor_angle_1_rate [rad/s]")
    rest = np.array(own.scene.rest_input)
    z, read = own.first, [outputs(own, own.first, rest)]
    commands = rest + np.random.default_rng(5).uniform(-0.05, 0.05, (8, 2))
    torque = own.measurement_names.index("motor_torque_1 [N m]")
    own.step(read[0], rest)
    for k, u in enumerate(commands):
        for _ in range(substeps):
            z = np.array(own.estimation.flow(z, u, p, own.period / substeps)).ravel()
        y = outputs(own, z, u)
        # The law of the servo, without the estimator's outputs.
        assert y[torque] == pytest.approx(2.0 * (u[0] - z[angle]) - 0.01 * z[rate], rel=1e-9)
        read.append(y)
        found = own.step(read[max(k + 1 - periods, 0)], u)
        assert np.abs(found.innovation).max() < 1e-9
