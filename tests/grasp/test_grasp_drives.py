"""Drives of grasps, by closed forms and exact columns; from inside: what is wound up at shapes that are given here.

Drives of grasps: closed forms of pulled and released tendons, exact columns with locked winches, algebra.
"""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from benchmarks.grasp_oracle.check import LIMITS, residuals
from continuum_grasp.grasp import GraspResult, GraspStatus, certify, optimize_grasp
from continuum_grasp.grasp.certificate.drives import WoundTendons
from continuum_grasp.grasp.certificate.friction import TendonFriction
from continuum_grasp.grasp.judge.drives import soft as elongation
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.model import soft
from continuum_grasp.scene import LengthDrive, MotorDrive, Rod, Tendons, load
from tests import certificate_cases as cases
from tests.grasp_scenes import CONFIGS

SERIES, AXIAL = 1.0 / 3e-5, 1e4
"""Stiffnesses of the cable before the finger [N/m] and along it [N]."""
CABLE = {"axial_stiffness": AXIAL, "series_stiffness": SERIES}
LENGTH_DRIVE = LengthDrive(kind="length", time_constant=0.02)
MOTOR = MotorDrive(kind="motor", winch_radius=0.008, inertia=2e-6, coulomb_friction=2e-3, torque_max=0.5)
PULLEY = {"arrangement": "one_pulley", "pretension": 2.0}
L, EI, OFFSET = 0.18, 6.11e-3, 0.005


def mug(drive, friction=0.0, **changes):
    """The mug of the shipped scene, held by a finger with drives."""
    scene = load(CONFIGS / "mug.yaml", ["contacts.reserve=0"])
    tendons = Tendons(offset=OFFSET, max_tension=70.0, friction=friction, drive=drive, **(CABLE if drive else {}))
    fidelity = scene.fidelity.replaced(family="clothoid")
    return scene.replaced(finger=scene.finger.replaced(tendons=tendons), fidelity=fidelity, **changes)


# -- closed forms of a free rod, shared/drives.md section 6: 1 / T falls or rises evenly along it ---------------------


def free_rod(tension, friction, way, elements=60, **more):
    """Scene and arrays of a free rod whose tendon 1 was pulled (way = 1) or let out (-1) all along; T(s) and bend."""
    tendons = Tendons(offset=OFFSET, max_tension=60.0, friction=friction, drive=LENGTH_DRIVE, **CABLE)
    rod = Rod(length=L, linear_density=0.034, bending_stiffness=EI)
    finger = cases.make_finger(rod=rod, tendons=tendons)
    scene, _ = cases.apart(finger, body=cases.BOX, family="clothoid", elements=elements, **more)
    nodes = np.linspace(0.0, L, elements + 1)
    pull = 1.0 / (1.0 / tension + way * friction * OFFSET / EI * nodes)
    arrays = cases.finger_arrays(scene, "finger", OFFSET * pull / EI, tensions=(tension, 0.0))
    bend = way * math.log(1.0 + way * friction * OFFSET / EI * tension * L) / friction
    return scene, arrays, pull, bend


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_pulled_and_released_tendons_are_those_of_the_free_rod(friction, way):
    tension = 20.0 if way > 0.0 else 5.0
    scene, arrays, pull, bend = free_rod(tension, friction, way)
    setup = scene.setups[0]
    shape = FingerShape(setup, arrays)
    cells = TendonFriction(setup, shape, way * np.ones(setup.friction_states))
    np.testing.assert_allclose(cells.shares(OFFSET, shape.joints), pull / tension, rtol=2e-4)
    # At the ends of cells the two tensions differ by what their mean leaves out, so in the middle of elements.
    middles = 0.5 * (shape.joints[1:] + shape.joints[:-1])
    moment = OFFSET / (1.0 / tension + way * friction * OFFSET / EI * middles)
    np.testing.assert_allclose(cells.moment(middles, np.array([tension, 0.0])), moment, rtol=5e-4)
    # The other tendon slides the other way, so that the product of both is the same all along.
    product = cells.shares(OFFSET, shape.joints) * cells.shares(-OFFSET, shape.joints)
    np.testing.assert_allclose(product, 1.0, rtol=1e-12)
    # A finger that bends the other way is its mirror image.
    mirrored = FingerShape(setup, {**arrays, "finger.q": -arrays["finger.q"]})
    other = TendonFriction(setup, mirrored, -cells.states)
    np.testing.assert_allclose(other.shares(-OFFSET, shape.joints), cells.shares(OFFSET, shape.joints), rtol=1e-12)
    # Wound up: the path and the elongation, the integral of T / EA = theta EI / (e EA).
    wound = WoundTendons(setup, shape, np.array([tension, 0.0]), cells).wound[0]
    assert wound == pytest.approx(bend * (OFFSET + EI / (OFFSET * AXIAL)) + tension / SERIES, rel=2e-4)
    if way > 0.0 and friction == 0.1:
        assert wound == pytest.approx(13.8255721e-3, rel=2e-4)


@pytest.mark.parametrize("arm", [OFFSET, -OFFSET])
def test_the_mean_tension_is_that_along_the_finger(arm):
    scene, arrays, _, _ = free_rod(20.0, 0.3, 1.0, elements=2)
    setup = scene.setups[0]
    cells, s = TendonFriction(setup, FingerShape(setup, arrays)), np.linspace(0.0, L, 20_001)
    shares = cells.shares(arm, 0.5 * (s[1:] + s[:-1]))
    assert shares.min() < 0.8 or shares.max() > 1.25
    assert cells.mean(arm) == pytest.approx(shares.mean(), rel=1e-5)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_tendons_slide_from_a_milliradian_of_bend_beyond_a_cell_on(side):
    """The turn beyond the middle of cells of a finger whose curvature falls from the base on: 1.5 mrad in all."""
    scene, arrays, _, _ = free_rod(1.0, 0.1, 1.0, elements=3)
    setup = scene.setups[0]
    arrays["finger.q"] = side * 3e-3 / L * np.array([1.0, 2 / 3, 1 / 3, 0.0])
    cells = TendonFriction(setup, FingerShape(setup, arrays))
    left = 1.0 - 0.5 * (cells.edges[1:] + cells.edges[:-1]) / L
    turns = 1.5e-3 * left**2
    assert turns.max() > 1e-3 > turns.min()
    slid = np.minimum(turns / 1e-3, 1.0)
    np.testing.assert_allclose(cells.pulled, side * 0.5 * slid * (3.0 - slid**2), rtol=1e-9)


LEFT, RADIUS = (20.0, 0.0), 0.008
COMPLIANCE = 1.0 / SERIES + L / AXIAL


def path_of(tensions):
    """Length by which the bend of a free finger draws in its left tendon [m]: it bends by (T1 - T2) e L / EI."""
    return OFFSET**2 * (tensions[0] - tensions[1]) * L / EI


def states_of(drive, tensions, rod=None):
    """States of the drives of a free finger without friction."""
    tendons = Tendons(offset=OFFSET, max_tension=60.0, drive=drive, **CABLE)
    rod = rod or Rod(length=L, linear_density=1e-12, bending_stiffness=EI)
    finger = cases.make_finger(rod=rod, tendons=tendons)
    scene, arrays = cases.apart(finger, {"finger": {"tensions": tensions}}, family="arc")
    return GraspResult(scene, GraspStatus.FEASIBLE, "", arrays).drives["finger"]


GEAR = {"backlash": 0.02, "gear_stiffness": 5.0}
STATES = [
    # Drive, tensions; cable wound up beside the path [m], what the drive takes beside its position.
    (LENGTH_DRIVE, LEFT, (COMPLIANCE * 20.0, 0.0), None),
    (LENGTH_DRIVE.replaced(slack=1e-3), LEFT, (COMPLIANCE * 20.0 + 1e-3, 1e-3), None),
    (LENGTH_DRIVE.replaced(pretension=5.0), (20.0, 4.0), (COMPLIANCE * 15.0, COMPLIANCE * (4.0 - 5.0)), None),
    (MOTOR, LEFT, (COMPLIANCE * 20.0, 0.0), lambda angle, torque: torque),
    (MOTOR.replaced(position_gain=0.5), LEFT, (COMPLIANCE * 20.0, 0.0), lambda angle, torque: angle + torque / 0.5),
    (MOTOR.replaced(**PULLEY), (20.0, 4.0), (COMPLIANCE * 18.0,), lambda angle, torque: torque),
    (MOTOR.replaced(**PULLEY), (4.0, 20.0), (-COMPLIANCE * 18.0,), lambda angle, torque: torque),
    (MOTOR.replaced(**PULLEY, **GEAR), (20.0, 4.0), (COMPLIANCE * 18.0,), lambda angle, torque: torque),
    (MOTOR.replaced(**PULLEY, **GEAR), (4.0, 20.0), (-COMPLIANCE * 18.0,), lambda angle, torque: torque),
]


@pytest.mark.parametrize(("drive", "tensions", "cable", "command"), STATES)
def test_drives_are_at_what_bend_and_tensions_ask_for(drive, tensions, cable, command):
    found, path = states_of(drive, tensions), path_of(tensions)
    pulls = (tensions[0] - tensions[1],) if len(cable) == 1 else tensions
    for state, own, pull, side in zip(found, cable, pulls, (1.0, -1.0), strict=False):
        wound = side * path + own
        if command is None:
            assert state.position == state.command == pytest.approx(wound, rel=1e-7)
            continue
        torque = RADIUS * pull
        angle = wound / RADIUS + (torque / 5.0 + math.copysign(0.01, torque) if drive.backlash else 0.0)
        reached = (state.position, state.torque, state.torque_to_reach, state.command)
        assert reached == pytest.approx((angle, torque, abs(torque) + 2e-3, command(angle, torque)), rel=1e-7)


def test_the_path_of_a_tendon_follows_stiffness_that_changes():
    """A free finger is bent by T e / B: B falls to a tenth, and jumps."""
    sections = (
        {"to": 0.6 * L, "bending_stiffness": (EI, 0.1 * EI), "linear_density": 1e-12},
        {"to": L, "bending_stiffness": 0.4 * EI, "linear_density": 1e-12},
    )
    tension, drive = 2.0, LENGTH_DRIVE
    left, _ = states_of(drive, (tension, 0.0), Rod(length=L, sections=sections))
    bend = tension * OFFSET * L / EI * (0.6 * math.log(10.0) / 0.9 + 0.4 / 0.4)
    assert left.position == pytest.approx(OFFSET * bend + COMPLIANCE * tension, rel=1e-7)


@pytest.mark.parametrize(("part", "taut"), [(0.999, False), (1.001, True)])
def test_a_tendon_is_taut_from_a_millionth_of_the_greatest_tension_on(part, taut):
    right = states_of(MOTOR, (20.0, part * 1e-6 * 60.0))[1]
    assert (right.torque > 0.0) is taut


def test_a_tendon_goes_slack_as_that_of_the_simulated_winch():
    onset = 20e-6
    length = np.linspace(-2.0, 2.0, 41) * onset
    exact = np.array([float(soft(x, onset)) for x in length])
    np.testing.assert_allclose(elongation(length, onset), exact, atol=1e-15)


# -- grasps -----------------------------------------------------------------------------------------------------------


def test_a_motor_for_each_tendon_holds_as_tensions_do_and_says_where_it_is():
    free = optimize_grasp(mug(None))
    found = optimize_grasp(mug(MOTOR))
    assert found.status is GraspStatus.OPTIMAL
    assert found.tension == pytest.approx(free.tension, rel=1e-7)
    left, right = found.drives["finger"]
    tension = found.fingers["finger"].tensions[0]
    turned = found.fingers["finger"].backbone[-1, 3] + math.pi / 2
    wound = OFFSET * turned + (1.0 / SERIES + L / AXIAL) * tension
    assert left.position == pytest.approx(wound / 0.008, rel=1e-6)
    assert right.position == pytest.approx(-OFFSET * turned / 0.008, rel=1e-6)
    assert left.torque == pytest.approx(0.008 * tension)
    assert left.command == pytest.approx(left.torque)
    assert left.torque_to_reach == pytest.approx(left.torque + 2e-3)


def test_a_motor_that_is_too_weak_is_the_reason():
    weak = MOTOR.replaced(torque_max=0.2)
    found = optimize_grasp(mug(weak), raise_on_failure=False)
    assert found.status is GraspStatus.INFEASIBLE
    reason = next(reason for reason in found.reasons if reason.name == "tension")
    # What the winch pulls against its own friction, and what the same finger takes with a motor that is strong enough.
    assert reason.limit == pytest.approx((0.2 - 2e-3) / 0.008)
    needed = optimize_grasp(mug(MOTOR)).fingers["finger"].tensions.max()
    assert reason.needed == pytest.approx(needed, rel=1e-3)
    ((key, torque),) = re.findall(r"([\w.]+) = ([\d.]+)", reason.repair)
    assert key == "finger.tendons.drive.torque_max"
    assert 1.009 * needed <= (float(torque) - 2e-3) / 0.008 <= 1.02 * needed


@pytest.mark.parametrize("pretension", [2.0, 25.0])
def test_tendons_of_one_pulley_go_together(pretension):
    """Both in tension: C (T1 + T2) = 2 C pretension, whatever the bend; else the second is slack."""
    drive = MOTOR.replaced(arrangement="one_pulley", pretension=pretension)
    found = optimize_grasp(mug(drive))
    assert found.certificate.passed
    first, second = found.fingers["finger"].tensions
    if first < 2.0 * pretension:
        assert first + second == pytest.approx(2.0 * pretension, rel=1e-6)
    else:
        assert second == pytest.approx(0.0, abs=1e-6)
    (state,) = found.drives["finger"]
    assert state.torque == pytest.approx(0.008 * (first - second), rel=1e-6)
    changed = {**found.arrays, "finger.tensions": found.arrays["finger.tensions"] + [0.1, 0.1]}
    assert "tendons of one pulley, finger" in {check.name for check in certify(found.scene, changed).failed}


@pytest.mark.deep
@pytest.mark.parametrize(
    "drive",
    [
        None,
        LENGTH_DRIVE,
        pytest.param(MOTOR, marks=pytest.mark.deep),
        pytest.param(MOTOR.replaced(**PULLEY), marks=pytest.mark.deep),
        pytest.param(LENGTH_DRIVE.replaced(**PULLEY), marks=pytest.mark.deep),
        MOTOR.replaced(position_gain=2.0),
    ],
)
def test_a_grasp_holds_whatever_the_friction_states(drive):
    scene = mug(drive, 0.1)
    found, pulled = optimize_grasp(scene), optimize_grasp(scene.replaced(friction_states="pulled"))
    assert found.status is GraspStatus.OPTIMAL
    assert found.robustness.robust.holds
    assert found.tension >= pulled.tension * (1.0 - 1e-6)
    # Code of another hand, from the capstan law, for the grasp and each posture of its friction states.
    for name, value in residuals(found.scene, found.arrays).items():
        assert value < LIMITS[name], name


@pytest.mark.deep
def test_tendons_that_slid_back_may_bend_a_finger_far():
    """Torque motors, friction 0.15: released, elements bend by more than pi, which no limit of the scene forbids."""
    drive = MOTOR.replaced(torque_max=0.56)
    found = optimize_grasp(mug(drive, 0.15))
    assert found.status is GraspStatus.OPTIMAL
    assert found.robustness.robust.holds
    held = {key.removeprefix("held."): value[1] for key, value in found.arrays.items() if key.startswith("held.")}
    assert (held["finger.friction_states"] == -1.0).all()
    shape = FingerShape(found.scene.setups[0], {**found.arrays, **held})
    assert np.abs(held["finger.lengths"][:, None] * shape.curvatures).max() > math.pi
    for name, value in residuals(found.scene, found.arrays).items():
        assert value < LIMITS[name], name


@pytest.mark.parametrize(
    ("drive", "friction"),
    [
        pytest.param(None, 0.0, marks=pytest.mark.deep),
        (LENGTH_DRIVE, 0.1),
        pytest.param(MOTOR.replaced(**PULLEY), 0.0, marks=pytest.mark.deep),
        (MOTOR.replaced(position_gain=2.0), 0.1),
    ],
)
def test_sensitivities_are_those_of_grasps_solved_anew(drive, friction):
    scene = mug(drive, friction, friction_states="pulled")
    found = {one.name: one.derivative for one in optimize_grasp(scene).sensitivity}

    def difference(change, step):
        ends = [optimize_grasp(scene.changed(change(h))).tension for h in (-step, step)]
        return (ends[1] - ends[0]) / (2.0 * step)

    base = scene.finger.base.position
    expected = {
        # The palm has the friction of contacts too, so that it keeps its own here.
        "mass of the object": difference(lambda h: {"object.mass": 0.3 + h}, 1e-4),
        "friction between fingers and object": difference(
            lambda h: {"contacts.friction": 0.5 + h, "supports.palm.friction": 0.5}, 1e-4
        ),
        "object along y": difference(lambda h: {"finger.base.position": [base[0], base[1] - h]}, 1e-5),
    }
    # The places at which the finger is looked at for clearance move with it, which its sensitivity leaves out: 1e-4
    # without drives and friction too, a little more or less by the machine's rounding.
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=3e-4), name


@pytest.mark.deep
def test_too_much_friction_of_tendons_is_reported_with_how_much_less_is_enough():
    """Torque motors, friction 0.2: released, no posture balances; what the reason names holds, half way back not."""
    drive = MOTOR.replaced(torque_max=0.8)
    tendons = mug(drive, 0.2).finger.tendons.replaced(max_tension=90.0)

    def found(friction):
        scene = mug(drive)
        finger = scene.finger.replaced(tendons=tendons.replaced(friction=friction))
        return optimize_grasp(scene.replaced(finger=finger), raise_on_failure=False)

    none = found(0.2)
    (reason,) = none.reasons
    assert (reason.key, reason.limit, none.solved) == ("tendons.friction", 0.2, False)
    assert "friction states of the tendons --" in none.violated[0]
    assert found(reason.needed).solved
    assert not found(0.5 * (0.2 + reason.needed)).solved
