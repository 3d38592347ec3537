"""Frictions of a motor-driven finger from a log of its motor and its tip: chains of guides of drawn friction."""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import Estimate, Fit, Reading, TipPath
from tests.identification_cases import at_tip
from tests.motor_cases import MOTOR, NOISE, STEP, plant
from tests.tendon_cases import CABLE, OFFSET, PASSIVE, STIFFNESS
from tests.truth.servo import ServoedChain

SAMPLE, DURATION = 0.02, 3.0
SCATTER = 3e-4
"""Of the camera that sees the tip [m]."""
COMMAND = (0.0, 0.9, 0.3, 0.7, 0.2, 0.9)
"""Of the servo at equal times [rad]: loops, and one inside another."""


def log(driven: ServoedChain, seed: int) -> tuple[np.ndarray, ...]:
    """Instants, commands, tip (T, 2), motor angle and torque, with noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(1, round(DURATION / SAMPLE) + 1) * SAMPLE
    times = np.linspace(0.0, DURATION, len(COMMAND))
    per, rows = round(SAMPLE / driven.chain.time_step), []
    for start in t - SAMPLE:
        for k in range(per):
            driven.advance(float(np.interp(start + (k + 1) * driven.chain.time_step, times, COMMAND)))
        rows.append([*(driven.chain.tip + SCATTER * rng.standard_normal(2)), *driven.readings(STEP, NOISE, rng)])
    return (t, times, *np.array(rows).T)


def fitted(seed: int) -> tuple[Fit, dict[str, float]]:
    """What a fit finds that starts from guesses, and the truth that was drawn."""
    rng = np.random.default_rng(seed)
    friction, dry, stiffer = rng.uniform(0.08, 0.25), rng.uniform(0.5, 2.0), rng.uniform(0.8, 1.25)
    t, times, x, y, angle, torque = log(plant(friction, stiffness=stiffer, dry=dry), seed)
    scene = cg.Scene(
        finger={
            **PASSIVE,
            "tendons": [{**CABLE, "offset": OFFSET, "friction": 0.1, "drive": MOTOR}],
        },
        gravity=(0.0, 0.0),
        fidelity={"family": "clothoid", "elements": 2},
        actuation={"angles": [{"times": times.tolist(), "values": list(COMMAND), "interpolation": "linear"}]},
        initial={"pose": "straight"},
    )
    data = TipPath(
        t,
        [
            *at_tip(x, y, SCATTER),
            Reading("motor_angle", angle, sigma=STEP),
            Reading("torque", torque, sigma=NOISE),
        ],
    )
    asked = [Estimate(name=name) for name in ("bending_stiffness", "tendon_friction", "drive_coulomb_friction")]
    truth = {
        "bending_stiffness": STIFFNESS * stiffer,
        "tendon_friction": friction,
        "drive_coulomb_friction": 2e-3 * dry,
    }
    return cg.identify(scene, data, parameters=asked), truth


@pytest.mark.deep
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_frictions_of_a_motor_driven_finger_are_those_that_were_drawn(seed):
    """What the law of two cells misses of the tension, some percent, passes for friction of the motor."""
    fit, truth = fitted(seed)
    assert fit["bending_stiffness"] == pytest.approx(truth["bending_stiffness"], rel=0.01)
    assert fit["tendon_friction"] == pytest.approx(truth["tendon_friction"], abs=0.01)
    assert fit["drive_coulomb_friction"] == pytest.approx(truth["drive_coulomb_friction"], abs=6e-4)
