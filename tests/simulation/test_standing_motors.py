"""Motors that stand at an angle: closed forms, slow motions that turn them there, starts from rest, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError, SolverError
from continuum_grasp.simulation import equilibrium_path
from tests.simulation.test_winches import HOLDING, scene
from tests.tendon_cases import LENGTH, OFFSET, STIFFNESS, bend

RADIUS = 0.008
STEADY = {**HOLDING, "presliding_angle": 1e-3, "viscous_friction": 1e-3, "pretension": 6.0}


def standing(drive, at, how=None, *, friction=0.0, **commands):
    initial = {"pose": "equilibrium", "motor_angles": at, **({"reached_by": how} if how else {})}
    return scene(drive, commands, 0.3, tendons={"friction": friction}).replaced(initial=initial)


@pytest.mark.parametrize(
    ("drive", "commands", "scale"),
    [
        ({}, {"torques": [0.0]}, 1.0),
        ({"position_gain": 0.4}, {"angles": [0.0]}, 0.4),
    ],
)
def test_the_bend_is_that_of_what_is_wound_up(drive, commands, scale):
    """Without friction r phi = e bend + (C / 2) (T1 - T2), and e (T1 - T2) = EI bend / L, while both are in tension."""
    found = cg.equilibrium(standing({**STEADY, **drive}, [0.3], **commands))
    compliance = 3e-5 + LENGTH / 1e4
    difference = STIFFNESS / (OFFSET * LENGTH)
    angle = RADIUS * 0.3 / (OFFSET + 0.5 * compliance * difference)
    assert bend(found.model, found.q) == pytest.approx(angle, rel=1e-6)
    torque = RADIUS * difference * angle
    turned = 0.3 if "position_gain" in drive else 0.0
    assert found.u == pytest.approx([turned + torque / scale], rel=1e-6)
    assert found.commands == pytest.approx(turned + (torque + np.array([[-2e-3, 2e-3]])) / scale, rel=1e-6)
    # What balances the tensions leads to the same shape.
    commanded = standing({**STEADY, **drive}, [0.3], **{key: found.u.tolist() for key in commands})
    again = cg.equilibrium(commanded.replaced(initial={"pose": "equilibrium"}))
    assert again.q == pytest.approx(found.q, rel=1e-6)


@pytest.mark.parametrize(("at", "stiffness"), [(0.3, 20.0), (-0.3, 20.0), (0.6, 2e4), (0.004, 20.0)])
def test_before_a_gear_with_play_it_is_the_bend_of_the_drum(at, stiffness):
    """The angle is bend e / r + (C / 2) (T1 - T2) / r + r (T1 - T2) / k + half the play."""
    own = {**STEADY, "backlash": 0.01, "gear_stiffness": stiffness}
    found = cg.equilibrium(standing(own, [at], torques=[0.0]))
    difference = STIFFNESS / (OFFSET * LENGTH)
    per_bend = OFFSET / RADIUS + (0.5 * (3e-5 + LENGTH / 1e4) / RADIUS + RADIUS / stiffness) * difference
    angle = np.sign(at) * max(abs(at) - 0.005, 0.0) / per_bend
    assert bend(found.model, found.q) == pytest.approx(angle, rel=1e-6, abs=1e-9)
    assert found.u == pytest.approx([RADIUS * difference * angle], rel=1e-6, abs=1e-9)
    motion = cg.simulate(standing(own, [at], torques=[float(found.u[0])]))
    assert motion.x[0, 2 * motion.n] == pytest.approx(at, abs=1e-12)
    assert np.abs(motion.x - motion.x[0]).max() < 1e-6


@pytest.mark.parametrize(("how", "most"), [("pulling", 0.6), ("releasing", 1.0)])
def test_it_is_where_a_slow_motion_that_turns_the_motor_there_ends(how, most):
    drive = {**STEADY, "position_gain": 2.0, "rate_gain": 0.01}
    ramp = {"times": [0.0, 0.8, 2.0], "values": [0.0, most, 0.6]}
    motion = cg.simulate(scene(drive, {"angles": [ramp]}, 2.2, tendons={"friction": 0.15}, step=5e-3))
    turned = float(motion.x[-1, 2 * motion.n])
    found = cg.equilibrium(standing(drive, [turned], how, friction=0.15, angles=[0.0]))
    assert found.q == pytest.approx(motion.q[-1], rel=4e-3)
    assert found.tensions == pytest.approx(motion.tensions[-1], rel=4e-3)
    assert np.abs(found.friction_states).min() > 0.99
    # Tendons on the other branch have other tensions, and the finger another shape.
    other = {"pulling": "releasing", "releasing": "pulling"}[how]
    wrong = cg.equilibrium(standing(drive, [turned], other, friction=0.15, angles=[0.0]))
    assert np.abs(wrong.tensions / motion.tensions[-1] - 1.0).max() > 0.1
    least, greatest = found.commands[0]
    assert least <= 0.6 <= greatest


@pytest.mark.parametrize(("share", "stays"), [(0.9, True), (-0.9, True), (3.0, False)])
def test_a_motion_begins_there_and_stays_as_far_as_dry_friction_holds(share, stays):
    found = cg.equilibrium(standing(STEADY, [0.5], "pulling", friction=0.1, torques=[0.0]))
    given = float(found.u[0]) + share * 2e-3
    motion = cg.simulate(standing(STEADY, [0.5], "pulling", friction=0.1, torques=[given]))
    turned = motion.x[:, 2 * motion.n]
    assert turned[0] == pytest.approx(0.5, abs=1e-9)
    assert motion.q[0] == pytest.approx(found.q, rel=1e-9)
    assert (np.abs(turned - 0.5).max() < 1e-6) == stays


def test_each_motor_of_two_stands_where_it_is():
    drive = {**HOLDING, "arrangement": "per_tendon", "pretension": 0.0}
    found = cg.equilibrium(standing(drive, [0.4, -0.8], torques=[0.0, 0.0]))
    compliance, wound = 3e-5 + LENGTH / 1e4, RADIUS * 0.4
    tension = wound / (compliance + OFFSET**2 * LENGTH / STIFFNESS)  # the second one is slack
    assert found.tensions == pytest.approx([tension, 0.0], rel=1e-6, abs=1e-9)
    assert found.u == pytest.approx([RADIUS * tension, 0.0], rel=1e-6, abs=1e-9)


def test_what_is_refused():
    with pytest.raises(InputError, match="motor_angles: needs pose: equilibrium"):
        standing(STEADY, [0.3], torques=[0.0]).replaced(initial={"motor_angles": [0.3], "pose": "rest"})
    with pytest.raises(InputError, match=r"one entry per drive.kind: motor \(1\), got 2"):
        standing(STEADY, [0.3, 0.1], torques=[0.0])
    with pytest.raises(InputError, match=r"one entry per drive\.kind: motor \(0\)"):
        standing({"kind": "length", "time_constant": 0.02}, [0.3], lengths=[0.0, 0.0])
    with pytest.raises(InputError, match="state how it got there"):
        cg.equilibrium(standing(STEADY, [0.3], friction=0.1, torques=[0.0]))
    with pytest.raises(SolverError, match="no equilibrium found") as raised:
        cg.equilibrium(standing({**STEADY, "torque_max": 0.01}, [1.0], torques=[0.0]))
    assert "motor 1 does not balance" in str(raised.value.violated)
    with pytest.raises(InputError, match="have no path"):
        equilibrium_path(standing(STEADY, [0.3], torques=[0.0]), [0.5, 1.0])
