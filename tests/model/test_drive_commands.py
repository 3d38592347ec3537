"""Commands of drives for the tensions of a grasp, against lengths of arcs and compliances by hand."""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.model import DriveCommands
from tests.tendon_cases import LENGTH, OFFSET, PASSIVE

CABLE = {"axial_stiffness": 1e4, "series_stiffness": 2e4}
GIVE = 1.0 / 2e4 + LENGTH / 1e4
"""Elongation of a whole tendon and what is in series with it [m/N]."""
S = np.linspace(0.0, LENGTH, 2001)
BEND = 1.5


def finger(friction=0.0, **drive):
    own = {"offset": OFFSET, "max_tension": 60.0, "friction": friction}
    return cg.Finger(**PASSIVE, tendons=own | (CABLE | {"drive": drive} if drive else {}))


def test_tensions_are_their_own_commands():
    assert DriveCommands(finger(), S).of([20.0, 2.0], BEND * S / LENGTH) == pytest.approx([20.0, 2.0])


def test_winches_wind_up_the_path_of_an_arc_and_its_elongation():
    found = DriveCommands(finger(kind="length", time_constant=0.02, pretension=3.0), S).of(
        [20.0, 2.0], BEND * S / LENGTH
    )
    assert found == pytest.approx([OFFSET * BEND + GIVE * 17.0, -OFFSET * BEND - GIVE * 1.0])


def test_a_pulley_that_winds_up_its_second_tendon_is_the_mirror_image():
    """Of a finger that its second tendon closes, commands and the limits while it holds are those of the first."""
    own = DriveCommands(finger(kind="length", time_constant=0.02, arrangement="one_pulley", pretension=3.0), S)
    first = own.of([20.0, 2.0], BEND * S / LENGTH)
    assert first == pytest.approx([OFFSET * BEND + GIVE * 17.0])
    assert own.of([2.0, 20.0], -BEND * S / LENGTH) == pytest.approx(-first)
    assert own.closing([True, False]).tolist() == [1.0]
    assert own.closing([False, True]).tolist() == [-1.0]
    assert own.closing([False, False]).tolist() == [0.0]
    assert DriveCommands(finger(), S).closing([False, True]).tolist() == [0.0, 1.0]
    apart = DriveCommands(finger(kind="length", time_constant=0.02), S)
    assert apart.closing([False, True]).tolist() == [0.0, 1.0]


def test_friction_leaves_less_of_a_tension_to_elongate():
    mu = 0.3
    found = DriveCommands(finger(mu, kind="length", time_constant=0.02), S).of([20.0, 2.0], BEND * S / LENGTH)
    # The mean of exp(-mu bend) along an arc; what is let out has more tension at its end.
    pulled, let_out = ((1.0 - np.exp(-sign * mu * BEND)) / (sign * mu * BEND) for sign in (1.0, -1.0))
    expected = [OFFSET * BEND + 20.0 * (5e-5 + 1.8e-5 * pulled), -OFFSET * BEND + 2.0 * (5e-5 + 1.8e-5 * let_out)]
    assert found == pytest.approx(expected, rel=1e-6)


def test_a_servo_turns_further_by_its_torque():
    drive = {"kind": "motor", "winch_radius": 0.008, "inertia": 2e-6, "torque_max": 0.5, "position_gain": 2.0}
    found = DriveCommands(finger(**drive, arrangement="one_pulley", pretension=3.0), S).of(
        [20.0, 0.0], BEND * S / LENGTH
    )
    # The second tendon is slack: 20 N are more than twice the pretension.
    assert found == pytest.approx([(OFFSET * BEND + GIVE * 17.0) / 0.008 + 0.008 * 20.0 / 2.0])
    # Behind a gear by its twist, and by half its play towards the flank that bears.
    gear = {"arrangement": "one_pulley", "backlash": 0.02, "gear_stiffness": 5.0, "pretension": 3.0}
    ahead = np.array([0.01 + 0.008 * 20.0 / 5.0])
    for way, pulled in ((1.0, [20.0, 0.0]), (-1.0, [0.0, 20.0])):
        assert DriveCommands(finger(**drive, **gear), S).of(pulled, way * BEND * S / LENGTH) == pytest.approx(
            way * (found + ahead)
        )
