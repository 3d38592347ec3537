"""Closed loops of fingers that are coils at rest, or that are asked to become coils, with no range stated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import run_closed_loop
from continuum_grasp.control import Prediction
from continuum_grasp.scene import ControlScene
from tests.marks import few

TURN = 2.0 * math.pi
LENGTH, STIFFNESS, OFFSET = 0.18, 4e-3, 4e-3


def loop(rest_turns, reference, duration=1.0, **keys) -> ControlScene:
    """A finger of some turns at rest whose tendons bend it by 10.8 rad at their limit; costs track the reference."""
    cost = {"effort": 1e-6, "input_rate": 1e-6, "speed": 1e-3, **dict.fromkeys(reference, 10.0)}
    return ControlScene.model_validate(
        {
            "schema_version": 1,
            "finger": {
                "rod": {"length": LENGTH, "bending_stiffness": STIFFNESS, "linear_density": 0.03},
                "damping": {"material": 3e-4},
                "rest_curvature": rest_turns * TURN / LENGTH,
                "tendons": {"offset": OFFSET, "max_tension": 60.0, "time_constant": 0.02},
            },
            "gravity": [0.0, 0.0],
            "fidelity": {"family": "clothoid", "elements": 2},
            "duration": duration,
            "reference": reference,
            "controller": {"horizon": {"stages": 20, "stage": 0.02}, "cost": cost},
            **keys,
        }
    )


def ranges(scene) -> np.ndarray:
    return np.array(Prediction(scene).system.finger_model.ranges)


def test_controllers_evaluate_coils_and_the_angles_that_are_asked_for():
    plain = ranges(loop(0.0, {"tip_angle": [1.0]}))
    assert plain == pytest.approx([TURN / 3.0] * 2)
    assert ranges(loop(1.54, {"tip_angle": [1.0]})) == pytest.approx(0.5 * 1.54 * TURN + 0.5 * plain)
    for asked in ({"tip_angle": [9.0]}, {"bending": [4.5, -4.5]}):
        assert np.all(ranges(loop(0.0, asked)) >= 1.5 * 4.5)
    uneven = ranges(loop(0.0, {"bending": [1.0, -4.5]}))
    assert uneven[1] >= 1.5 * 4.5


@pytest.mark.parametrize("rest", [0.0, 1.54, -1.54])
def test_angles_beyond_what_the_drives_bend_are_refused(rest):
    """60 N at 4 mm bend 10.8 rad; twice that may be asked for above the shape at rest."""
    driven = 60.0 * OFFSET * LENGTH / STIFFNESS
    limit = 2.0 * driven + abs(rest) * TURN
    for sign in (-1.0, 1.0):
        loop(rest, {"tip_angle": [sign * 0.99 * limit]})
        with pytest.raises(ValueError, match=r"out of reach: expected .* \(as far as its elements may bend\)"):
            loop(rest, {"tip_angle": [sign * 1.01 * limit]})
    with pytest.raises((InputError, ValueError), match=r"-3 to 3 rad"):
        loop(0.0, {"tip_angle": [3.1]}, fidelity={"family": "clothoid", "elements": 2, "bending_range": 1.5})


@pytest.mark.deep
@pytest.mark.parametrize(
    ("rest", "angle"), few([(1.54, 0.5), (0.0, 2.9 * math.pi), (-1.54, 0.5), (1.54, 1.54 * TURN + 2.0)], 4)
)
def test_a_loop_uncoils_and_coils_a_finger(rest, angle):
    run = run_closed_loop(loop(rest, {"tip_angle": [angle]}))
    assert run.ended == "finished"
    assert run.warnings == ()
    assert run.tracked[-1, 0] == pytest.approx(angle, abs=0.1)
    # The plant is evaluated wherever it was.
    assert run.readings.range_use(run.x, np.vstack([run.u, run.u[-1:]]), run.w).max() <= 1.0
    # A pure moment bends a circle: the tension that holds it.
    held = (angle - rest * TURN) * STIFFNESS / LENGTH / OFFSET
    assert run.u[-1, 0] - run.u[-1, 1] == pytest.approx(held, rel=0.1)
