"""A finger with one tendon on a motor: its controller, and a chain of guides that differs from it."""

from __future__ import annotations

import math

import continuum_grasp as cg
from tests.tendon_cases import CABLE, LENGTH, OFFSET, PASSIVE, STIFFNESS
from tests.truth.servo import ServoedChain
from tests.truth.tendon_motion import MovingFinger

RADIUS = 0.008
STEP, NOISE = 2.0 * math.pi / 16384, 2e-4
MOTOR = {
    "kind": "motor",
    "winch_radius": RADIUS,
    "inertia": 2e-6,
    "viscous_friction": 1e-5,
    "coulomb_friction": 2e-3,
    "torque_max": 0.4,
    "position_gain": 0.8,
    "rate_gain": 2.5e-3,
}


def short_scene() -> cg.ControlScene:
    """A controller of a short horizon, which is given angles and torques."""
    return cg.ControlScene(
        finger={**PASSIVE, "tendons": [{**CABLE, "friction": 0.1, "drive": MOTOR}]},
        gravity=(0.0, 0.0),
        fidelity={"family": "clothoid", "elements": 2},
        controller={
            "horizon": {"stages": 4, "stage": 0.005},
            "cost": {"tip_angle": {"running": 1.0}, "effort": 0.1},
            "input": {"angles": (-1.5, 1.5)},
        },
        reference={"tip_angle": 0.0},
        initial={"pose": "straight"},
        estimator={"measured": {"angle": STEP / math.sqrt(12.0), "torque": NOISE}},
    )


def plant(
    friction, *, stiffness=1.0, dry=1.0, payload=0.0, pushed=None, hinges=20, time_step=5e-4, **motor
) -> ServoedChain:
    """A chain of guides on its motor, other than the model by factors and a payload [kg]."""
    chain = MovingFinger(
        LENGTH,
        STIFFNESS * stiffness,
        OFFSET,
        friction,
        sides=(1.0,),
        hinges=hinges,
        time_step=time_step,
        tip_mass=0.002 + payload,
        pushed=pushed,
    )
    return ServoedChain(chain, 0.0, dry=2e-3 * dry, **motor)
