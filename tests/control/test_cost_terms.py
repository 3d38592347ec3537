"""Cost terms: each entry where the table says it is, and the orientation of the tip against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import run_closed_loop
from continuum_grasp.control import ControlParts, Prediction, stages_of
from tests.control_cases import ROD, hand_scene, rod_scene, swing_scene
from tests.truth.differences import differences

ANGLE = 0.8
"""Setpoint of the tip's orientation [rad]."""
TRACKED = {
    "horizon": {"stages": 15, "stage": 0.01},
    "cost": {"tip_angle": {"running": 50.0, "terminal": 5.0}, "speed": 0.05, "input_rate": 2.0},
    "input": {"moment_max": 0.3, "rate_max": 3.0},
}
TURNED = {"controller": TRACKED, "reference": {"tip_angle": ANGLE}}


def test_the_orientation_is_that_of_the_backbones_end():
    """The tangent is (-sin, cos) of it, here by the last micrometer of the backbone."""
    model = Prediction(hand_scene())
    stages = stages_of(hand_scene(controller={"cost": {"tip_angle": 1.0, "effort": 0.1}}, reference={"tip_angle": 0.0}))
    x = np.array(model.at_rest([4.0, -2.0], [10.0, 2.0]))
    short, end = np.array(model.sections((0.18 - 1e-6, 0.18))(x, [10.0, 2.0], model.p_nominal)[0]).T
    tangent = (end - short) / 1e-6
    (angle,) = np.array(stages.outputs(x, [10.0, 2.0], stages.p_nominal))[:1, 0]
    assert (-math.sin(angle), math.cos(angle)) == pytest.approx(tuple(tangent), abs=1e-5)


def test_its_gradient_is_that_of_finite_differences():
    stages = stages_of(swing_scene(**TURNED))
    x, u, r = np.array([0.4, 0.3, 0.5, -0.2, 0.05]), np.array([0.1]), np.zeros(stages.nr)
    cost = lambda z: float(stages.cost(z[:-1], z[-1:], stages.p_nominal, r, stages.weights)[0])  # noqa: E731
    z, gradient = np.append(x, u), stages.cost(x, u, stages.p_nominal, r, stages.weights)[1]
    assert np.array(gradient).ravel() == pytest.approx(differences(cost, z)[0], rel=1e-6, abs=1e-7)


def test_the_rate_of_the_input_is_its_change_over_a_stage():
    """As what is tracked [N m/s], and per its limit as what is bounded."""
    stages = stages_of(swing_scene(**TURNED))
    x = np.zeros(stages.nx)
    x[-1] = 0.07  # the input before
    tracked, rows = (np.array(of(x, 0.1, stages.p_nominal)).ravel() for of in (stages.outputs, stages.rows))
    assert tracked[-1] == pytest.approx(0.03 / 0.01)
    assert dict(zip(stages.c_names, rows, strict=True))["tip_moment_rate"] == pytest.approx(0.03 / 0.01 / 3.0)


@pytest.mark.deep
def test_the_tip_turns_to_its_setpoint_and_stays():
    """Arcs in a plane without gravity: the angle is tip moment times length per EI, whatever the elements."""
    run = run_closed_loop(swing_scene(**TURNED, duration=2.0))
    (tracking,) = run.metrics().tracking
    assert (tracking.name, tracking.unit) == ("tip angle", "rad")
    assert run.tracked[-1, 0] == pytest.approx(ANGLE, abs=2e-3)
    assert run.u[-1, 0] == pytest.approx(ANGLE * ROD.rod.bending_stiffness / ROD.rod.length, rel=5e-3)


def test_degrees_are_out_of_its_range_and_turns_are_not():
    scene = swing_scene(**TURNED)
    model = Prediction(scene)
    least, most = ControlParts.of_scene(scene, model).ranges.r[0]
    assert least < -6.0 * math.pi
    assert 6.0 * math.pi < most < 90.0


@pytest.mark.parametrize(
    ("cost", "reference", "message"),
    [
        ({"tip_angle": 1.0, "effort": 1.0}, {}, "controller.cost.tip_angle: needs reference.tip_angle"),
        ({"tip": 1.0, "effort": 1.0}, {"tip": (0.0, 0.5), "tip_angle": 0.1}, "reference.tip_angle: nothing tracks it"),
        (
            {"tip": 1.0, "effort": 1.0},
            {"tip": (0.0, 0.5), "bending": (0.1, 0.1)},
            r"reference\.bending: nothing tracks it: give controller\.cost\.bending a weight",
        ),
        (
            {"tip": 1.0, "input_rate": 1.0},
            {"tip": (0.0, 0.5), "input": (2.0, 2.0)},
            r"reference\.input: nothing tracks it: give controller\.cost\.effort a weight",
        ),
    ],
)
def test_weight_and_setpoint_need_each_other(cost, reference, message):
    with pytest.raises(InputError, match=message):
        rod_scene(controller={"cost": cost, "input": {"moment_max": 0.3}}, reference=reference)
