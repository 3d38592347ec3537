"""Drives of grasps of rods, from inside: no door leads to them yet.

Truths are closed forms of cables, the certificate, which follows the shape by itself, and torques just below and above.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.judge.check import Requirement
from continuum_grasp.grasp.judge.drives import WoundCables
from continuum_grasp.grasp.rods.hand_search import HandRodSearch
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.nlp import Budget
from tests.marks import few

L, OFFSET, SERIES, AXIAL, RADIUS = 0.18, 0.005, 1.0 / 3e-5, 1e4, 0.008
COMPLIANCE = 1.0 / SERIES + L / AXIAL
WINCH = {"kind": "length", "time_constant": 0.02}
MOTOR = {"kind": "motor", "winch_radius": RADIUS, "inertia": 2e-6, "coulomb_friction": 2e-3, "torque_max": 0.5}
SERVO = {**MOTOR, "position_gain": 0.5}


def mug(drive, friction=0.0, **changes):
    """The mug of the shipped scene, held by a finger with drives."""
    scene = cg.load("configs/grasp/mug.yaml", ["contacts.reserve=0"])
    cable = {"axial_stiffness": AXIAL, "series_stiffness": SERIES}
    tendons = {"offset": OFFSET, "max_tension": 70.0, "friction": friction, "drive": drive, **cable}
    fidelity = scene.fidelity.replaced(family="clothoid")
    finger = scene.finger.replaced(tendons=tendons)
    return scene.replaced(finger=finger, fidelity=fidelity, friction_states="pulled", **changes)


@cache
def _found(key):
    drive, friction = key
    return found(mug(dict(drive), friction))


def found(scene, search=RodSearch):
    search = search(scene, Budget())
    search.run()
    return search


def of_mug(drive, friction=0.0):
    return _found((tuple(drive.items()), friction))


def states(grasp, index=0):
    """Drives of a finger: load [N], cable wound up and command [m] of each; tensions [N] and turn of the tip [rad]."""
    problem, x = grasp.problem, grasp.attempt.x
    finger, part = problem.numbers.fingers[index], problem.parts[index]
    unit = finger.section.pulls[0].unit
    drives = [
        (unit * x[drive.load][0], finger.length * x[drive.wound][0], finger.length * x[drive.command])
        for drive in problem.drives[index]
    ]
    turn = x[part.nodes[-1][2]] - x[part.nodes[0][2]]
    return drives, finger.tensions(x[part.pulls]), turn


@pytest.mark.parametrize(
    "drive", [WINCH, MOTOR, SERVO, {**WINCH, "slack": 1e-3}], ids=["winch", "motor", "servo", "slack"]
)
def test_a_drive_winds_up_what_the_bend_draws_in_and_the_cable_yields(drive):
    """Of tendons at constant distance the path is the distance times the turn of the tip."""
    drives, tensions, turn = states(of_mug(drive).best)
    slack = drive.get("slack", 0.0)
    (load, wound, command), (_, other, _) = drives
    assert load == pytest.approx(tensions[0], rel=1e-9)
    assert wound == pytest.approx(OFFSET * turn + COMPLIANCE * tensions[0] + slack, rel=1e-9)
    # A tendon that does not pull is let out until it is slack: by what makes it so, 0.4 N.
    onset = cg.load("configs/grasp/mug.yaml").finger.rod.stiffness / (L * OFFSET) / 16.0 * COMPLIANCE
    assert other == pytest.approx(-OFFSET * turn + slack - onset, rel=1e-6)
    if drive is not MOTOR:
        yields = RADIUS**2 / 0.5 if "position_gain" in drive else 0.0
        assert command == pytest.approx(wound + yields * load, rel=1e-9)


@pytest.mark.parametrize("pretension", [2.0, 25.0])
def test_tendons_of_one_pulley_go_together(pretension):
    """Both in tension: C (T1 + T2) = 2 C pretension, whatever the bend; else the second is slack."""
    search = of_mug({**MOTOR, "arrangement": "one_pulley", "pretension": pretension})
    ((load, _, _),), (left, right), _ = states(search.best)
    assert load == pytest.approx(left - right, rel=1e-6)
    if pretension > 20.0:
        assert left + right == pytest.approx(2.0 * pretension, rel=1e-6)
    else:
        assert right == pytest.approx(0.0, abs=1e-6)
    assert certify_held(search.scene, held_rods(search.best)).passed


def test_a_pulley_in_a_hand_holds_both_tendons_in_tension():
    cable = {"axial_stiffness": 1e4, "series_stiffness": 3e4}
    drive = {**WINCH, "arrangement": "one_pulley", "pretension": 5.0}
    tendons = {"offset": 6e-3, "max_tension": 60.0, "drive": drive, **cable}
    search = found(cg.load("configs/hand/ball.yaml").changed({"hand.finger.tendons": tendons}), HandRodSearch)
    for index in range(3):
        _, tensions, _ = states(search.best, index)
        assert tensions.sum() == pytest.approx(10.0, rel=1e-6)
    assert certify_held(search.scene, held_rods(search.best)).passed


@pytest.mark.parametrize(("share", "holds"), [(1.001, True), (0.999, False)])
def test_a_motor_on_a_pulley_pulls_no_more_than_the_difference_of_the_tensions(share, holds):
    """With a slack antagonist, the least tension is the least difference."""
    pulley = {**MOTOR, "arrangement": "one_pulley", "pretension": 2.0}
    ((load, _, _),), _, _ = states(of_mug(pulley).best)
    torque = share * load * RADIUS + 2e-3
    scene = mug({**pulley, "torque_max": torque})
    assert (found(scene).best is not None) is holds
    # The certificate measures the torque of the grasp that was found without the limit.
    certificate = certify_held(scene, held_rods(of_mug(pulley).best))
    assert certificate.of(Requirement.TORQUE, "finger").passed is holds
    assert {check.requirement for check in certificate.failed} <= {Requirement.TORQUE}


@pytest.mark.parametrize("changed", [(0.1, 0.1), (0.0, 0.1), (-0.1, 0.0)])
def test_the_certificate_measures_tendons_that_do_not_go_together(changed):
    """By the cable that is missing: of equal tensions more on both sides twice C times them."""
    search = of_mug({**MOTOR, "arrangement": "one_pulley", "pretension": 25.0})
    held = held_rods(search.best)
    finger = held.fingers[0]
    more = replace(held, fingers=(replace(finger, tensions=finger.tensions + np.array(changed)),))
    certificate = certify_held(search.scene, more)
    assert certificate.of(Requirement.DRIVE, "finger").value == pytest.approx(COMPLIANCE * abs(sum(changed)), rel=1e-2)


@pytest.mark.parametrize("friction", few([0.0, 0.1, 0.3], 2))
def test_the_certificate_follows_the_cables_to_the_same_places(friction):
    """Paths and elongations with friction, by integrals along a rod that it integrates anew."""
    grasp = of_mug(SERVO, friction).best
    scene = mug(SERVO, friction)
    rod = certify_held(scene, held_rods(grasp)).rods[0]
    setup = scene.setups[0]
    drives, tensions, _ = states(grasp)
    cables = WoundCables(setup, setup.drive, rod, tensions)
    assert cables.held == pytest.approx([drive[2][0] for drive in drives], abs=1e-5 * L)
    assert np.abs(cables.misfit(cables.held)).max() < 1e-9 * L


@pytest.mark.deep
@pytest.mark.parametrize("gravity", [(0.0, -9.81, 0.0), (4.0, -3.0, 0.0)])
def test_a_body_at_the_tip_weighs_at_its_center(gravity):
    """The certificate adds its weight as a force beside the line. No door lets such a finger through yet."""
    scene = cg.load("configs/grasp/preshaped.yaml").replaced(friction_states="pulled", gravity=gravity)
    tendons = scene.finger.tendons.replaced(friction=0.0)
    bodies = [{"mass": 0.02, "center_of_mass": (across, 0.01)} for across in (0.0, 0.03)]
    tensions = []
    for body in bodies:
        finger = scene.finger.replaced(tendons=tendons, tip_body=body)
        loaded = scene.model_copy(update={"finger": finger})
        loaded.__dict__.pop("setups", None)
        search = found(loaded)
        tensions.append(search.best.tension)
        certificate = certify_held(loaded, held_rods(search.best))
        assert certificate.passed, certificate.worst
    assert abs(tensions[1] - tensions[0]) > 1e-3 * tensions[0]
