"""Drives at rest: what limits say of tensions, what dry friction of a motor holds, gears with play, sheaths."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.simulation import equilibrium_under
from tests.simulation.test_winches import HOLDING, MOTOR, SERVO, model, scene
from tests.tendon_cases import LENGTH, OFFSET, ROD, STIFFNESS, bend
from tests.tendon_cases import model as tension_model

RADIUS = 0.008


@pytest.mark.parametrize("limit", [9.99, 10.01])
def test_an_equilibrium_says_which_limits_its_tensions_exceed(limit):
    """A tendon of 10 N by its length; the other one is let out."""
    wound = OFFSET**2 * LENGTH / STIFFNESS * 10.0 + (3e-5 + LENGTH / 1e4) * 10.0
    made = model(SERVO, max_tension=limit)
    found = equilibrium_under(made, [wound, -0.02], np.zeros(made.nw))
    assert found.tensions == pytest.approx([10.0, 0.0], abs=1e-6)
    over = [(each.kind, each.tendon, each.limit) for each in found.limits]
    assert over == [("max_tension", 1, 9.99)] * (limit < 10.0) + [("slack", 2, pytest.approx(1e-7 * limit))]
    assert found.limits[0].tension == pytest.approx([0.0, 10.0][limit < 10.0], abs=1e-6)
    assert ("tendon 1 exceeds max_tension = 9.99 N (10 N)" in found.warnings) == (limit < 10.0)
    assert "tendon 2 is slack: nothing pulls there" in found.warnings


@pytest.mark.parametrize(("drive", "scale"), [({}, 1.0), ({"position_gain": 0.4}, 0.4)])
def test_dry_friction_of_a_motor_holds_within_an_interval(drive, scale):
    """The tension is that of the bend, e T = EI bend / L; dry friction holds r T, more or less its own."""
    made = model({**HOLDING, **drive})
    angle = 0.8  # where the other tendon is well slack
    torque = RADIUS * STIFFNESS * angle / (OFFSET * LENGTH)
    elastic = OFFSET * angle + (3e-5 + LENGTH / 1e4) * (torque / RADIUS - 2.0)  # counted from the pretension
    turned = elastic / RADIUS if "position_gain" in drive else 0.0
    found = equilibrium_under(made, [turned + torque / scale], np.zeros(made.nw))
    assert bend(made, found.q) == pytest.approx(angle, rel=1e-9)
    assert found.commands == pytest.approx(turned + (torque + np.array([[-2e-3, 2e-3]])) / scale, rel=1e-9)


@pytest.mark.parametrize("share", [0.95, 1.5])
@pytest.mark.parametrize("end", [0, 1])
def test_a_motion_stays_within_the_interval_of_commands(share, end):
    """Beyond it the motor turns by the excess over what tendon and finger yield: r^2 / (C + e^2 L / EI) per angle."""
    drive = {**HOLDING, "presliding_angle": 1e-3, "viscous_friction": 1e-3}
    made = model(drive)
    middle = 0.05
    found = equilibrium_under(made, [middle], np.zeros(made.nw))
    given = middle + share * (found.commands[0, end] - middle)
    ramp = {"times": [0.0, 0.2], "values": [middle, given]}
    motion = cg.simulate(scene(drive, {"torques": [ramp]}, 1.0).replaced(initial={"pose": "equilibrium"}))
    turned = motion.x[:, 2 * motion.n]
    yields = (3e-5 + LENGTH / 1e4 + OFFSET**2 * LENGTH / STIFFNESS) / RADIUS**2
    beyond = (-1.0, 1.0)[end] * max(0.0, share - 1.0) * 2e-3 * yields
    # Dry friction builds up within the presliding angle, 1e-3 rad, and holds where the finger swung beyond its rest.
    assert turned[-1] - turned[0] == pytest.approx(beyond, abs=4e-3 if share > 1.0 else 1e-3)


def test_commands_that_nothing_holds_and_angles_without_bound():
    made = model({**HOLDING, "position_gain": 0.4})
    found = equilibrium_under(made, [30.0], np.zeros(made.nw))
    assert RADIUS * (found.tensions[0] - found.tensions[1]) == pytest.approx(0.2)
    assert found.commands[0, 1] == math.inf
    assert found.commands[0, 0] < 30.0
    assert equilibrium_under(model(SERVO), [1e-3, -0.01], [0.0, 0.0]).commands is None


@pytest.mark.parametrize(("elements", "sheath"), [(2, 0.0), (8, 0.0), (2, 1.5), (8, 1.5)])
def test_what_a_winch_winds_up_is_the_closed_form_of_the_tension_behind_the_sheath(elements, sheath):
    """It is bend (e + EI / (e EA)) + c0 T with or without a sheath; T exp(-friction sheath) reaches the finger."""
    base, mu = 20.0, 0.1
    arriving = base * math.exp(-mu * sheath)
    angle = math.log(1.0 + mu * OFFSET / STIFFNESS * arriving * LENGTH) / mu
    wound = angle * (OFFSET + STIFFNESS / (OFFSET * 1e4)) + 3e-5 * base
    made = model(SERVO, elements=elements, friction=mu, conduit_bend=sheath)
    found = equilibrium_under(made, [wound, -0.02], np.zeros(made.nw), reached_by="pulling")
    assert bend(made, found.q) == pytest.approx(angle, rel=5e-5)
    assert found.tensions == pytest.approx([base, 0.0], rel=5e-3)


GEAR = {"backlash": 0.1, "gear_stiffness": 20.0}


@pytest.mark.parametrize("arrangement", [{}, {"pretension": 0.0, "slack": 2e-3}, {"arrangement": "per_tendon"}])
@pytest.mark.parametrize("drive", [{}, {"position_gain": 0.4}, GEAR, GEAR | {"position_gain": 0.4}])
def test_a_motor_that_statics_calls_at_rest_stays(drive, arrangement):
    """Also where a tendon comes to be slack, about 4 N of the other one, and under more than its greatest torque."""
    if "arrangement" in arrangement and "backlash" in drive:
        return
    made = model({**MOTOR, **arrangement, **drive, "coulomb_friction": 0.0})
    servo, count = "position_gain" in drive, made.nu
    pulls = [-30.0, *np.linspace(-4.6, -3.4, 5), -0.3, 0.0, 0.05, *np.linspace(3.4, 4.6, 7), 30.0]
    for pull in [p for p in pulls if count == 1 or p >= 0.0]:
        first = RADIUS * pull * (16.0 if servo else 1.0)
        u = [first, *[0.25 * first] * (count - 1)]
        found = equilibrium_under(made, u, np.zeros(made.nw))
        drives = made.drives_at(found.q, u)
        moved = np.array(made.forward_dynamics([*found.q, *np.zeros(made.n), *drives], u, [0.0, 0.0], [])).ravel()
        missing = 2e-6 * moved[2 * made.n + 1 :: 2]
        if count == 1 or pull > 0.0:  # else nothing says where a slack tendon's motor is, nor that it stands
            assert np.abs(missing).max() < 7e-5


@pytest.mark.parametrize("torque", [-0.01, 0.0, 0.02])
def test_a_torque_alone_is_the_tension_of_its_one_tendon_which_never_pushes(torque):
    made = model({**MOTOR, "arrangement": "per_tendon", "coulomb_friction": 0.0})
    found = equilibrium_under(made, [torque, 0.02], np.zeros(made.nw))
    assert found.tensions == pytest.approx([max(torque, 0.0) / RADIUS, 0.02 / RADIUS], rel=1e-12)


def drum_of(motion):
    """Angle of the drum of a motion with a pretension of 2 N, by the tendon that pulls harder."""
    first, second = motion.tensions.T
    longer = (3e-5 + LENGTH / 1e4) * np.where(first > second, first - 2.0, 2.0 - second)
    return (OFFSET * np.array([bend(motion.model, q) for q in motion.q]) + longer) / RADIUS


def test_a_servo_crosses_the_play_before_the_finger_bends_back():
    """To and fro about the straight finger, which pulls both tendons alike: the drum lags by half the play each way."""
    drive = {**MOTOR, "backlash": 0.1, "gear_stiffness": 20.0, "position_gain": 2.0, "rate_gain": 0.05}
    drive["coulomb_friction"] = 0.0
    swing = {"times": [0.0, 1.0, 2.0, 3.0], "values": [0.0, 0.5, -0.5, 0.0]}
    motion = cg.simulate(scene(drive, {"angles": [swing]}, 3.0))
    twist = motion.x[:, 2 * motion.n] - drum_of(motion) - RADIUS * np.subtract(*motion.tensions.T) / 20.0
    assert twist[motion.t == 1.0][0] == pytest.approx(0.05, abs=1e-3)
    assert twist[motion.t == 2.0][0] == pytest.approx(-0.05, abs=1e-3)


@pytest.mark.parametrize("kind", ["tension", "lagged", "length"])
def test_inverse_dynamics_undoes_forward_dynamics_under_named_friction(kind):
    """Friction states z of a motion act by z (3 - z^2) / 2, which is what a history names."""
    if kind == "length":
        made, u = model(SERVO, friction=0.2), [0.012, -0.002]
    else:
        lag = {"time_constant": 0.02} if kind == "lagged" else {}
        made, u = tension_model(0.2, **lag), [12.0, 3.0]
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, qd = rng.normal(size=made.n) * 5.0, rng.normal(size=made.n) * 30.0
        z = rng.uniform(-1.0, 1.0, len(made.friction_names))
        x, w = [*q, *qd, *made.drives_at(q, u), *z], [0.3, -0.2]
        qdd = np.array(made.forward_dynamics(x, u, w, [])).ravel()[made.n : 2 * made.n]
        named = [*(1.5 * z - 0.5 * z**3), 0.0]
        missing = np.array(made.inverse_dynamics(q, qd, qdd, u, w, [], named))
        scale = np.abs(np.array(made.elastic(q, u, []))).max()
        assert np.abs(missing).max() < 1e-11 * scale
        # As pulled and as released: the same motion asks for different forces.
        ends = [made.inverse_dynamics(q, qd, qdd, u, w, [], [*np.full(len(z), way), 0.0]) for way in (1.0, -1.0)]
        assert np.abs(np.array(ends[0] - ends[1])).max() > 1e-3 * scale


def test_both_tendons_of_a_pulley_share_its_pretension():
    """What one is wound up the other is let out, so that the sum of the tensions stays: P + M / 2r and P - M / 2r."""
    made = model(MOTOR)
    found = equilibrium_under(made, [0.008], np.zeros(made.nw))
    assert found.tensions == pytest.approx([2.5, 1.5], rel=1e-9)
    assert found.limits == ()


def test_slack_is_wound_up_before_a_tendon_pulls():
    tension, slack = 10.0, 2e-3
    wound = OFFSET**2 * LENGTH / STIFFNESS * tension + (3e-5 + LENGTH / 1e4) * tension
    made = model({**SERVO, "slack": slack})
    assert equilibrium_under(made, [slack + wound, -0.02], [0.0, 0.0]).tensions == pytest.approx([10.0, 0.0], abs=1e-6)
    # The tendon comes into tension within 20 um of where it is just so.
    assert equilibrium_under(made, [slack - 3e-5, -0.02], [0.0, 0.0]).tensions == pytest.approx([0.0, 0.0], abs=1e-6)


def test_a_tendon_slides_by_its_own_elongation():
    """Wound up at v on a finger that stands still: (L - s) T' / EA at s, with T' = v / C."""
    tendon = {"offset": OFFSET, "max_tension": 60.0, "friction": 0.1, "drive": SERVO}
    cable = {"axial_stiffness": 1e4, "series_stiffness": 1 / 3e-5}
    made = cg.FingerModel(cg.Finger(rod=ROD, tendons=[{**tendon, **cable}]), family="clothoid", elements=2)
    yields, speed = 3e-5 + LENGTH / 1e4, 0.01
    x = [*np.zeros(2 * made.n), 20.0 * yields, speed, *np.zeros(4)]
    rates = np.array(made.forward_dynamics(x, [0.0], np.zeros(made.nw), [])).ravel()[-4:]
    places = LENGTH * (np.arange(4) + 0.5) / 4
    assert rates == pytest.approx((LENGTH - places) * speed / yields / 1e4 / 20e-6, rel=1e-3)
