"""Setpoints of a controller's nodes against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.control import Outputs, Prediction, Setpoints
from continuum_grasp.scene import (
    CircleReference,
    ControllerSettings,
    ControlScene,
    Fidelity,
    Finger,
    Reference,
    Rod,
    RowSamples,
    Tendons,
)

FINGER = Finger(
    rod=Rod(length=0.18, linear_density=0.034, bending_stiffness=6.11e-3),
    tendons=Tendons(offset=0.005, min_tension=1.5, max_tension=60.0),
)
TIMES = np.array([-0.5, 0.0, 0.1, 0.25, 0.4, 0.999, 1.0, 1.3, 5.0])


def points(cost, functions=None, **reference):
    scene = ControlScene(
        finger=FINGER,
        gravity=(0.0, 0.0),
        fidelity=Fidelity(family="arc", elements=2),
        controller=ControllerSettings(cost=cost),
        reference=Reference(**reference),
    )
    model = Prediction(scene)
    return Setpoints.of(Outputs.of(scene.controller.cost, model), scene.reference, functions)


def test_a_circle_waits_and_then_turns_at_constant_speed():
    circle = CircleReference(center=(0.02, 0.1), radius=0.03, frequency=-0.8, phase=0.5, start=0.25)
    rows = points({"tip": 1.0, "effort": 1.0}, tip=circle).rows(TIMES)
    turned = 0.5 - 2 * math.pi * 0.8 * np.maximum(TIMES - 0.25, 0.0)
    assert rows[:, 0] == pytest.approx(0.02 + 0.03 * np.cos(turned), abs=1e-15)
    assert rows[:, 1] == pytest.approx(0.1 + 0.03 * np.sin(turned), abs=1e-15)


def test_held_samples_change_at_their_instants():
    samples = RowSamples(times=(0.0, 0.25, 1.0), values=((0.1, 0.2), (0.3, 0.4), (0.5, 0.6)), interpolation="hold")
    rows = points({"bending": 1.0, "effort": 1.0}, bending=samples).rows(TIMES)
    assert rows[:, 0].tolist() == [0.1, 0.1, 0.1, 0.3, 0.3, 0.3, 0.5, 0.5, 0.5]
    assert rows[:, 1].tolist() == [0.2, 0.2, 0.2, 0.4, 0.4, 0.4, 0.6, 0.6, 0.6]


def test_linear_samples_lie_on_straight_lines_and_smooth_ones_on_the_quintic():
    times, values = (0.0, 1.0), ((0.0, 1.0), (2.0, 0.0))
    linear = RowSamples(times=times, values=values, interpolation="linear")
    rows = points({"bending": 1.0, "effort": 1.0}, bending=linear).rows(TIMES)
    s = np.clip(TIMES, 0.0, 1.0)
    assert rows[:, :2] == pytest.approx(np.stack([2 * s, 1 - s], axis=1), abs=1e-15)
    smooth = RowSamples(times=times, values=values)
    rows = points({"bending": 1.0, "effort": 1.0}, bending=smooth).rows(TIMES)
    rise = s**3 * (10 - 15 * s + 6 * s**2)  # the quintic with no rate and no acceleration at both ends
    assert rows[:, :2] == pytest.approx(np.stack([2 * rise, 1 - rise], axis=1), abs=1e-14)


def test_what_is_not_said_is_zero_and_tensions_are_the_least():
    cost = {"tip": 1.0, "bending": 1.0, "speed": 1.0, "effort": 1.0, "input_rate": 1.0}
    found = points(cost, tip=(0.05, 0.16))
    assert found.names[:4] == ("tip_x [m]", "tip_y [m]", "bending_1 [rad]", "bending_2 [rad]")
    assert found.rows([0.0, 1.0]).tolist() == [[0.05, 0.16, 0, 0, 0, 0, 1.5, 1.5, 0, 0]] * 2


def test_inputs_have_setpoints_of_their_own():
    rows = points({"tip": 1.0, "effort": 1.0}, tip=(0.0, 0.18), input=(3.0, 4.0)).rows(0.0)
    assert rows.tolist() == [[0.0, 0.18, 3.0, 4.0]]


def test_functions_of_time_take_the_place_of_references():
    ellipse = {"tip": lambda t: (0.02 * math.cos(t), 0.15 + 0.01 * math.sin(t))}
    rows = points({"tip": 1.0, "effort": 1.0}, ellipse, tip=(0.0, 0.18)).rows(TIMES)
    assert rows[:, :2] == pytest.approx(np.stack([0.02 * np.cos(TIMES), 0.15 + 0.01 * np.sin(TIMES)], axis=1))


@pytest.mark.parametrize(
    ("functions", "said"),
    [
        ({"nose": lambda t: (0.0, 0.0)}, "functions: expected some of tip"),
        ({"tip": (0.0, 0.18)}, "functions.tip: expected a function of time"),
        ({"bending": lambda t: (0.0, 0.0)}, "which have a weight in controller.cost, got 'bending'"),
        ({"tip": lambda t: (0.0, 0.0, 0.0)}, "t = 0.5 s: expected 2 finite entries"),
        ({"tip": lambda t: (math.nan, 0.0)}, "expected 2 finite entries"),
        ({"tip": lambda t: np.array([1j, 0.0])}, "t = 0.5 s: expected numbers"),
    ],
)
def test_wrong_functions_are_refused(functions, said):
    with pytest.raises(InputError, match=said):
        points({"tip": 1.0, "effort": 1.0}, functions, tip=(0.0, 0.18)).rows(0.5)


def test_references_of_the_wrong_width_are_refused():
    with pytest.raises(InputError, match=r"reference\.bending: expected 2 entries, got 3"):
        points({"bending": 1.0, "effort": 1.0}, bending=(0.1, 0.2, 0.3))
