"""Contact by motor angle and torque alone, on a chain of guides that is not the detector's model."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.control import ContactDetector, Estimator, ResidualContact
from continuum_grasp.control.estimation.free_finger import FreeFinger
from tests.contact_cases import (
    EXACT,
    LENGTH,
    NOISE,
    OFFSET,
    RADIUS,
    STEP,
    STIFFNESS,
    PairPlant,
    pair_scene,
    plant,
    scene,
    trial,
    wander,
)
from tests.marks import few
from tests.truth.tendon import HingedFinger


@lru_cache
def detector(friction=0.1, **detection) -> ContactDetector:
    return ContactDetector(scene(friction, detection=detection))


@pytest.mark.parametrize(("at", "gain"), [(0, 4.0), (1, 14.4)])
def test_its_gains_are_those_of_a_finger_whose_winch_is_locked(at, gain):
    """Without friction, bent by 1.3 rad: by a chain at rest, and the trial's 14.4 and 4.0 N/N."""
    own = ContactDetector(scene(0.0, detection=EXACT))
    wound = 0.00695
    own.reset([wound])
    feels = own.step([wound / RADIUS, 0.0])
    assert -feels.gain[0, at] == pytest.approx(gain, rel=0.03)
    if at == 1:
        chain, tensions = HingedFinger(LENGTH, STIFFNESS, OFFSET, 0.0, sides=(1.0,), hinges=60), []
        for k in range(1, 21):
            chain.move([("length", wound * k / 20)])
        for force in (-0.001, 0.001):
            chain.move([("length", wound)], (-force * math.cos(chain.angle), -force * math.sin(chain.angle)))
            tensions.append(chain.tensions[0])
        assert feels.gain[0, at] == pytest.approx((tensions[1] - tensions[0]) / 0.002, rel=5e-3)


@pytest.mark.parametrize("curvature", [1e-6, 1.3 / LENGTH])
def test_a_tendon_that_sticks_feels_no_more_than_balances_a_force_at_the_base(curvature):
    """Per force across the end of an arc, on which it has a lever sin(k s) / k; to the tendon's side it slackens it."""
    finger = FreeFinger(scene(0.0), (), (0.5 * LENGTH, LENGTH))
    state = np.repeat([curvature, 0.0], [finger.n, finger.size - finger.n])
    most = np.array(finger.gain(state, [0.0, 0.0], finger.nominal)[1])
    assert most[0] == pytest.approx(-np.sin(curvature * np.array(finger.places)) / curvature / OFFSET)


@pytest.mark.parametrize(("friction", "half"), [(0.05, 0.27), (0.1, 0.55), (0.2, 1.10), (0.3, 1.65)])
def test_an_unknown_history_is_the_loop_of_the_tension(friction, half):
    """Half the width of the loop in the tension at 1.3 rad [N]; after it was slack, it is known."""
    own = ContactDetector(scene(friction, detection=EXACT | {"history_known": False}))
    at = 0.00695
    own.reset([at])
    torque = 0.0

    def moved(shares):
        nonlocal torque
        for share in shares:
            feels = own.step([share * at / RADIUS, torque])
            torque -= 0.2 * RADIUS * feels.residual[0]  # as much as the free finger pulls
        return feels

    feels = moved([1.0] * 100)
    bare = own.settings["noise"][0] + own.settings["dry"][0]
    assert np.ptp(feels.bounds) / 2.0 - bare == pytest.approx(half, rel=0.06)
    # What is slack forgets, and is known when it is pulled again.
    feels = moved([*np.linspace(1.0, -0.05, 800), *np.linspace(-0.05, 1.0, 800), *[1.0] * 100])
    assert np.ptp(feels.bounds) / 2.0 - bare < 0.02


@pytest.mark.parametrize("pushed", [None, 10])
@pytest.mark.parametrize("back", few([False, True], 1))
@pytest.mark.parametrize("speed", [1.0, -1.0])
def test_a_push_is_detected_early(pushed, back, speed):
    """At the tip and in the middle, helping the bend and opposing it, after pulling and after releasing: at most 50 ms
    after three times the threshold.
    """
    place = 1 if pushed is None else 0
    rows = trial(
        detector(coulomb_friction=0.0, bending_stiffness=0.02, tendon_friction=0.1),
        plant(0.1, pushed=pushed),
        back=back,
        speed=speed * (1.0 if place else 3.0),
    )
    before = [feels for _, force, feels in rows if force == 0.0]
    assert all(feels.contact is ResidualContact.FREE for feels in before)
    threshold = before[-1].threshold[place]
    detected = next(t for t, force, feels in rows if force != 0.0 and feels.detected)
    assert detected <= next(t for t, force, _ in rows if abs(force) > 3.0 * threshold) + 0.05
    # Where it is cannot be seen; how strong, within an interval for each place.
    strong = [(force, feels) for _, force, feels in rows if threshold < abs(force) < 3.0 * threshold]
    assert all(feels.place is None for _, feels in strong)
    assert all(feels.forces[place, 0] - 0.005 < force < feels.forces[place, 1] + 0.005 for force, feels in strong)


@pytest.mark.deep
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_blow_is_detected_in_time(way):
    """Three times the threshold at once, and as the loop of friction is widest: within 50 ms."""
    own = detector(0.3, coulomb_friction=0.1, bending_stiffness=0.02, tendon_friction=0.1)
    calm = trial(own, plant(0.3), back=True, at=9.0)
    threshold = next(feels for t, _, feels in calm if t > 0.795).threshold[1]
    rows = trial(own, plant(0.3), back=True, jump=3.0 * way * threshold)
    assert next(t for t, force, feels in rows if force and feels.detected) <= 0.8 + 0.05


@pytest.mark.deep
@pytest.mark.parametrize("arrangement", ["one_pulley", "per_tendon"])
def test_two_tendons_raise_no_alarm_at_the_ends_of_all_errors(arrangement):
    """Under gravity with a payload, on motors whose commands are held; what is small on a pulley is the difference."""
    own = ContactDetector(pair_scene(arrangement, detection={"payload": 0.002}))
    for stiffness, factor, payload in ((0.8, 0.5, 0.002), (1.2, 0.5, 0.002), (1.2, 1.5, 0.0)):
        given = {"stiffness": stiffness, "friction_factor": factor, "dry": 0.7, "payload": payload}
        reports = wander(own, PairPlant(arrangement, 0.1, **given), 320, np.random.default_rng(0))
        assert {feels.contact for feels in reports} == {ResidualContact.FREE}


IDENTIFIED = {"bending_stiffness": 0.02, "tendon_friction": 0.1, "coulomb_friction": 0.1, "tension": 0.03}
WRONG = {"stiffness": 1.2, "friction_factor": 0.5, "dry": 0.7}


@pytest.mark.parametrize(
    ("arrangement", "at", "place", "detection", "wrong"),
    [
        ("one_pulley", LENGTH, 1, IDENTIFIED, {}),
        ("one_pulley", 0.5 * LENGTH, 0, IDENTIFIED, {}),
        ("per_tendon", LENGTH, 1, IDENTIFIED, {}),
        ("per_tendon", 0.5 * LENGTH, 0, IDENTIFIED, {}),
        # Errors at their ends: the residual is most of the way to one bound before the push.
        ("one_pulley", LENGTH, 1, {"payload": 0.002}, WRONG),
    ],
)
def test_two_tendons_feel_a_push_beyond_the_threshold(arrangement, at, place, detection, wrong):
    """At 1.6 times the threshold, within 25 ms for the filter, both ways; the force is in its interval then."""
    own = ContactDetector(pair_scene(arrangement, detection=detection))
    rate = 1.0 if place else 3.0
    for way in (1.0, -1.0):
        force = {"times": (0.0, 0.8, 1.2), "values": ((0.0, 0.0), (0.0, 0.0), (-0.4 * way * rate, 0.0))}
        load = {"kind": "force", "at": at, "follows": True, "force": {**force, "interpolation": "linear"}}
        driven, rng, threshold = PairPlant(arrangement, 0.1, loads=[load], **wrong), np.random.default_rng(1), 0.0
        own.reset()
        for k in range(1, 241):
            driven.advance(min(2.0 * k * driven.period, 0.8))
            feels, pushed = own.step(driven.readings(rng)), max(0.0, k * driven.period - 0.8) * rate
            if not pushed:
                assert feels.contact is ResidualContact.FREE
                threshold = float(feels.threshold[place])
            elif feels.detected:
                break
        assert pushed < 1.6 * threshold + 0.025 * rate
        assert feels.forces[place, 0] - 0.01 < way * pushed < feels.forces[place, 1] + 0.01


def test_without_a_reading_it_stays_as_it_is():
    own = detector()
    own.reset()
    own.step([0.0, 0.0])
    saved = own.save_state()
    assert own.step([math.nan, 0.0]).contact is ResidualContact.MISSING
    assert own.save_state() == saved


def test_a_history_without_lengths_is_that_of_the_start():
    own, states = detector(), {}
    for reached_by in ("pulling", "releasing"):
        own.reset(own.model.lengths, reached_by=reached_by)
        states[reached_by] = own.save_state()
        own.reset(reached_by=reached_by)
        assert own.save_state() == states[reached_by]
    assert states["pulling"] != states["releasing"]
    assert own.model.lengths == pytest.approx([0.0], abs=1e-5)  # of a straight finger


def test_torque_and_servo_agree():
    torque = ContactDetector(scene(measured={"angle": STEP, "torque": NOISE}))
    servo = ContactDetector(scene(measured={"angle": STEP}))
    for each in (torque, servo):
        each.reset([0.0], reached_by="pulling")
    angle, command = 0.0, 0.0
    for k in range(60):
        before, angle, command = angle, 0.01 * k, 0.01 * k + 0.03
        wanted = 0.8 * (command - angle) - 2.5e-3 * (angle - before) / 0.005
        feels = [torque.step([angle, wanted]), servo.step([angle], [command])]
    assert [each.residual[0] for each in feels] == pytest.approx([feels[0].residual[0]] * 2, abs=1e-9)


def test_the_estimator_reports_it_along():
    own = Estimator(scene())
    names = own.measurement_names
    assert names == ("motor_angle_1 [rad]", "motor_torque_1 [N m]")
    found = own.step([0.0, 0.0], [0.02])
    assert found.contact.contact is ResidualContact.FREE
    saved = own.save_state()
    first = own.step([0.01, 0.02], [0.02])
    own.restore(saved)
    again = own.step([0.01, 0.02], [0.02])
    assert first.contact.residual == again.contact.residual
    assert first.z.tolist() == again.z.tolist()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"measured": {"tip": 1e-3, "torque": 1e-4}}, "or estimator.measured.angle"),
        (
            {"measured": {"angle": 1e-3, "length": 1e-5}},
            "estimator.measured.length: needs finger.tendons.drive.kind: length",
        ),
        ({"measured": {"angle": 1e-3}, "delay": 0.005}, "needs estimator.measured.torque"),
        ({"detection": {"places": (0.3,)}}, "beyond the finger"),
    ],
)
def test_what_shows_no_contact_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        scene(**changes)
