"""Models of controllers of fingers with winches, motors and tendon friction: inputs, limits, states, motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.control import Prediction
from continuum_grasp.simulation import initial_state
from tests.control_cases import DRIVES, HAND, driven_scene
from tests.truth.differences import differences

UNITS = {"length": "m", "torque": "N m", "angle": "rad"}
EACH = ("winches", "torques", "servos")


@pytest.mark.parametrize("name", DRIVES)
def test_motion_is_that_of_the_simulation(name):
    scene = driven_scene(name)
    model = Prediction(scene)
    # Plans of servos are bounded by the torque that motors have, and do not saturate.
    drive = DRIVES[name][0] | ({"torque_max": 1e6} if "servo" in name else {})
    finger = scene.finger.with_tendons(drive=drive)
    # Cables that are let go have 3e-3 of their stiffness in plans, which wind them up again by that; one pulley always
    # pulls one of them.
    share = 3e-3 if name in EACH else 0.0
    simulated = cg.System(finger, family="clothoid", elements=2, gravity=(0, 0), slack_stiffness=share)
    assert list(model.x_names) == simulated.x_names
    quantity = model.u_names[0].split("_")[0]
    assert list(model.u_names) == [f"{quantity}_{k + 1} [{UNITS[quantity]}]" for k in range(2 if name in EACH else 1)]
    rng = np.random.default_rng(1)
    for _ in range(5):
        x = model.first_state() + rng.normal(size=model.nx) * 0.02
        x[-4:] = rng.uniform(-1.5, 1.5, 4)
        u = rng.uniform(*map(np.array, scene.input_limits))
        expected = np.array(simulated.forward_dynamics(x, u, [], [])).ravel()
        assert np.allclose(np.array(model.dynamics(x, u, [])).ravel(), expected, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("name", DRIVES)
def test_rest_input_holds_the_straight_finger_at_its_pretension(name):
    scene = driven_scene(name)
    model = Prediction(scene)
    x = model.first_state()
    assert np.allclose(np.array(model.dynamics(x, scene.rest_input, [])), 0.0, atol=1e-9)
    # Torques on one pulley have no hold on its pretension: cables of 2 N are there at zero torque.
    assert np.allclose(np.array(model.tensions(x, scene.rest_input, [])), 2.0, atol=1e-6)


def test_commands_of_motors_are_limited_by_their_torque():
    assert driven_scene("torques").input_limits == ((-0.25, -0.25), (0.25, 0.25))
    assert driven_scene("servo").input_limits == ((-1.5,), (1.5,))


@pytest.mark.parametrize("reached_by", ["pulling", "releasing"])
def test_the_first_state_has_the_history_that_the_scene_names(reached_by):
    """That of the simulation with the same initial state; the two histories hold different tensions."""
    start = {"pose": "equilibrium", "reached_by": reached_by}
    start["held_by"] = [{"kind": "force", "at": 0.18, "force": (-0.1, 0.0)}]
    scene = driven_scene("winches", initial=start)
    model = Prediction(scene)
    lengths = {"lengths": scene.rest_input}
    simulated = cg.Scene(
        finger=scene.finger,
        gravity=(0, 0),
        fidelity=scene.fidelity,
        initial=scene.initial,
        actuation=lengths,
    )
    found = model.first_state()
    assert np.allclose(found, initial_state(simulated, cg.FingerModel(simulated)), rtol=1e-9, atol=1e-12)
    assert np.abs(found[-4:]).min() > 0.1


@pytest.mark.parametrize(
    ("name", "limits", "key"),
    [
        ("winches", {}, "controller.input.lengths"),
        ("servo", {"rate_max": 5.0}, "controller.input.angles"),
        ("torques", {"lengths": (0.0, 0.01)}, "controller.input.lengths"),
        ("winches", {"lengths": (0.0, 0.01), "angles": (0.0, 1.0)}, "controller.input.angles"),
    ],
)
def test_limits_that_a_drive_lacks_or_does_not_take_are_refused(name, limits, key):
    with pytest.raises(InputError, match=key):
        driven_scene(name, controller={"input": limits})


def test_other_refusals():
    with pytest.raises(InputError, match="min_tension"):
        driven_scene("winches", tendons={"min_tension": 1.0})
    with pytest.raises(InputError, match="reached_by: has no effect"):
        driven_scene(
            "winches", finger=HAND, controller={"input": {}}, initial={"pose": "rest", "reached_by": "pulling"}
        )


@pytest.mark.parametrize("name", ["winches", "servo"])
def test_fastest_rate_bounds_random_linearizations(name):
    """Over shapes and tensions in the working range, stuck and sliding, from differences of the motion."""
    scene = driven_scene(name)
    model = Prediction(scene)
    most = model.fastest_rate(*map(np.array, scene.input_limits))
    rng = np.random.default_rng(3)
    for sliding in (0.0, 1.5):
        q = rng.uniform(0.0, 5.0, 3)
        x = model.at_rest(q, scene.rest_input, np.full(4, sliding), pulled=15.0)
        rate = lambda at: np.array(model.dynamics(at, scene.rest_input, [])).ravel()  # noqa: E731
        slope = differences(rate, x, 1e-7 * np.maximum(1.0, np.abs(x)))
        assert np.abs(np.linalg.eigvals(slope)).max() < 1.2 * most


@pytest.mark.parametrize("name", ["servos", "servo"])
def test_a_plan_of_servos_is_a_motion_of_motors_that_saturate(name):
    """A setpoint that jumps asks for all the torque there is; a first stage by another integrator, which has it."""
    scene = driven_scene(name, controller={"start_iterations": 20}, tendons={"friction": 0.0})
    control = cg.Controller(scene, deadline=math.inf)
    command = control.step(control.first, {"tip": (-0.12, 0.10)})
    assert not command.violated
    model = cg.System(scene.finger, gravity=scene.gravity, family="clothoid", elements=2)
    drive = scene.finger.tendons.drive
    p, x, u = model.p_nominal, command.plan.x, command.plan.u
    angles = [k for k, label in enumerate(model.x_names) if label.startswith("motor_angle") and "rate" not in label]
    torque = drive.position_gain * (u - x[:-1, angles]) - drive.rate_gain * x[:-1, [k + 1 for k in angles]]
    assert np.abs(torque).max() == pytest.approx(drive.torque_max, rel=1e-6)
    for k in range(3):
        found = solve_ivp(
            lambda t, y, at: np.array(model.forward_dynamics(y, at, [], p)).ravel(),
            (0.0, 0.01),
            x[k, : model.nx],
            method="Radau",
            rtol=1e-8,
            atol=1e-9,
            args=(u[k],),
        )
        assert found.y[angles, -1] == pytest.approx(x[k + 1, angles], abs=0.02)
