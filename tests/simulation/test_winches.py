"""Winches and motors: closed forms of what they wind up, energy, slack and taut, stiff cables, what is refused."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.scene import Tendons
from continuum_grasp.simulation import equilibrium_under
from tests import control_cases
from tests.tendon_cases import CABLE, LENGTH, OFFSET, PASSIVE

SERVO = {"kind": "length", "time_constant": 0.02}
MOTOR = {
    "kind": "motor",
    "arrangement": "one_pulley",
    "pretension": 2.0,
    "winch_radius": 0.008,
    "inertia": 2e-6,
    "viscous_friction": 1e-5,
    "coulomb_friction": 2e-3,
    "torque_max": 0.2,
}
HOLDING = {**MOTOR, "presliding_angle": 0.005}


def finger(drive, **tendons):
    return cg.Finger(**PASSIVE, tendons={**CABLE, "drive": drive, **tendons})


def model(drive, *, elements=2, **tendons):
    return cg.FingerModel(
        finger(drive, **tendons), family="clothoid", elements=elements, gravity=(0, 0), bending_range=2.0
    )


def scene(drive, actuation, duration=0.8, *, tendons=None, **time):
    own = finger(drive, **(tendons or {}))
    timing = {"duration": duration, "step": 2e-3, **time}
    return cg.Scene(finger=own, actuation=actuation, time=timing, gravity=[0.0, 0.0], fidelity={"family": "clothoid"})


def pulled(model, found, u):
    """Tensions at rest."""
    x = [*found.q, *np.zeros(model.n), *model.drives_at(found.q, u, found.friction_states), *found.friction_states]
    return np.array(model.tensions()(x, u, [])[0]).ravel()


@pytest.mark.parametrize(("at", "gain"), [(LENGTH, 18.0), (LENGTH / 2, 4.5)])
def test_a_locked_winch_on_a_stiff_cable_feels_a_force_across(at, gain):
    """The tension grows by F x^2 / (2 e L) on the straight finger."""
    own = finger(SERVO, axial_stiffness=1e7, series_stiffness=1e9)
    load = {"kind": "force", "at": at, "force": [0.0, 0.0]}
    made = cg.FingerModel(
        own, family="clothoid", elements=4, gravity=(0, 0), loads=[cg.scene.ForceLoad(**load)], tip_force=False
    )
    u = [1e-4, -0.01]
    tensions = [pulled(made, equilibrium_under(made, u, [force, 0.0]), u)[0] for force in (0.0, 0.01)]
    assert np.diff(tensions)[0] / 0.01 == pytest.approx(gain, rel=1e-2)


@pytest.mark.parametrize(
    "drive", [MOTOR, HOLDING, {**MOTOR, "arrangement": "per_tendon"}, {**MOTOR, "slack": 1e-3, "pretension": 0.0}]
)
def test_energy_balances(drive):
    """Kinetic, elastic and cable energy grow by the power of the motors less friction and damping."""
    made = model(drive)
    eq = made._equations
    rate = made.forward_dynamics(eq.x, eq.u, eq.w, eq.p)
    slopes = ca.gradient(eq.kinetic_energy + eq.potential_energy, eq.x)
    damped = ca.dot(ca.vertcat(*eq.damping), eq.qd)
    balance = ca.Function(
        "balance", [eq.x, eq.u, eq.w], [ca.dot(slopes, rate), damped, ca.sum1(ca.fabs(slopes * rate))]
    )
    rng, winches = np.random.default_rng(1), made.structure.winches
    rod = made.finger.rod
    # Its length in the natural time, per 6,000 and on a drum of 8 mm.
    slow = LENGTH / math.sqrt(rod.mass * LENGTH**3 / rod.stiffness) / 6000.0 / 0.008
    size = np.concatenate(
        [np.full(made.n, 8.0), np.full(made.n, 50.0)] + [[1.0, 5.0, 1.0][: w.states] for w in winches]
    )
    for _ in range(300):
        x, u = rng.normal(size=made.nx) * size, rng.uniform(-0.2, 0.2, made.nu)
        gained, damping, scale = (float(v) for v in balance(x, u, np.zeros(made.nw)))
        power, at = -damping, 2 * made.n
        for winch, torque in zip(winches, u, strict=True):
            speed = x[at + 1]
            way = speed / np.hypot(speed, slow)
            if winch.states == 3:
                y = np.clip(x[at + 2], -1.0, 1.0)
                way = 1.5 * y - 0.5 * y**3
            power += (torque - 1e-5 * speed - 2e-3 * way) * speed
            at += winch.states
        assert gained == pytest.approx(power, abs=2e-13 * scale)


def test_a_servo_neither_overshoots_nor_exceeds_its_rate():
    for reach in (0.001, 0.02):
        drive = {**SERVO, "rate_max": 0.1, "slack": 0.05}
        rise = {"times": [0.0, 1e-3], "values": [0.0, reach], "interpolation": "linear"}
        motion = cg.simulate(scene(drive, {"lengths": [rise, 0.0]}))
        y, v = motion.x[:, 2 * motion.n], motion.x[:, 2 * motion.n + 1]
        assert y.max() <= reach * (1 + 1e-6)
        assert y[-1] == pytest.approx(reach, rel=1e-4)
        assert v.max() <= 0.1 * (1 + 1e-9)


PULL = {"times": [0.0, 0.2, 0.4], "values": [0.0, 0.01, 0.0]}


def test_slack_forgets_and_comes_taut_again():
    """Wound up and let out beyond slack, with friction: tensions never push, and nothing is left of them."""
    motion = cg.simulate(
        scene(
            {**SERVO, "slack": 1e-3},
            {"lengths": [{"times": [0.0, 0.2, 0.4, 0.7], "values": [0.0, 0.01, -0.002, 0.01]}, -0.01]},
            1.2,
            tendons={"friction": 0.2},
        )
    )
    assert motion.tensions.min() > -1e-12
    first = motion.tensions[:, 0]
    assert np.ptp(first[(motion.t > 0.405) & (motion.t < 0.43)]) < 1e-9
    assert first[-1] > 1.0
    # Slack as events: from when what is wound up is let out beyond the path that the bend leaves, until it pulls.
    events = [each for each in motion.slack if each.tendon == 1 and each.begins > 0.0]
    assert len(events) == 1
    assert np.all(first[(motion.t >= events[0].begins) & (motion.t < events[0].ends)] < 1e-6)
    assert 0.3 < events[0].begins < 0.4 < events[0].ends < 0.7
    assert f"tendon 1 goes slack at t = {events[0].begins:g} s" in " ".join(motion.warnings)
    assert motion.slack[-1].tendon == 2
    assert motion.slack[-1].ends == np.inf


def test_a_winch_that_pulls_too_hard_is_reported():
    motion = cg.simulate(scene(SERVO, {"lengths": [PULL, -0.01]}, 0.3, tendons={"max_tension": 5.0}))
    first = motion.t[np.argmax(motion.tensions[:, 0] > 5.0)]
    assert f"tendon 1 exceeds max_tension = 5 N at t = {first:g} s" in " ".join(motion.warnings)


def test_mirrored_windings_move_mirrored():
    ends = []
    for lengths in ([PULL, -0.01], [-0.01, PULL]):
        motion = cg.simulate(scene(SERVO, {"lengths": lengths}, 0.5, tendons={"friction": 0.15}))
        ends.append(motion.q[-1])
    assert ends[0] == pytest.approx(-ends[1], abs=1e-7)


@pytest.mark.deep
@pytest.mark.parametrize("cable", [1e4, 1e5])
@pytest.mark.parametrize("friction", [0.0, 0.15])
def test_implicit_steps_of_milliseconds_follow_stiff_cables(cable, friction):
    def motion(**time):
        stiff = {"axial_stiffness": 1e5, "series_stiffness": cable, "friction": friction}
        drive = {**SERVO, "rate_max": 0.1}
        return cg.simulate(scene(drive, {"lengths": [PULL, -0.011]}, 0.5, tendons=stiff, **time))

    exact = motion(step=1e-3, method="reference").tip
    for step, error in ((1e-3, 5e-5), (5e-3, 2e-3)):
        found = motion(step=step, method="rodas").tip
        assert found == pytest.approx(exact[:: round(step / 1e-3)], abs=error * LENGTH)


@pytest.mark.deep
def test_dry_friction_with_a_memory_holds_a_load_without_current():
    """What is wound up stays where it is when the torque ceases; by the velocity alone it creeps."""
    worm = {"coulomb_friction": 0.05, "viscous_friction": 1e-3, "pretension": 0.5}
    torque = {"times": [0.0, 0.2, 0.4], "values": [0.0, 0.1, 0.0]}
    crept = []
    for drive in ({**HOLDING, **worm}, {**MOTOR, **worm}):
        motion = cg.simulate(scene(drive, {"torques": [torque]}, 3.0))
        angle = motion.x[:, 2 * motion.n]
        assert angle[-1] > 0.3
        crept.append(angle[motion.t == 2.0][0] - angle[-1])
    assert abs(crept[0]) < 1e-6
    assert crept[1] > 1e-3


@pytest.mark.parametrize(
    "drive", [SERVO, {**SERVO, "rate_max": 0.1}, MOTOR, {**MOTOR, "arrangement": "per_tendon"}, HOLDING]
)
def test_drives_cost_what_they_are_worth(drive):
    """Friction with one and with two cells per element, over commanded tensions that lag and have no friction."""
    lagged = {"offset": OFFSET, "max_tension": 60.0, "time_constant": 0.02}
    free = cg.FingerModel(cg.Finger(**PASSIVE, tendons=lagged), family="clothoid", elements=2).instructions

    def cost(**tendons):
        return cg.FingerModel(finger(drive, **tendons), family="clothoid", elements=2).instructions - free

    assert cost() <= 75
    assert cost(friction=0.1, friction_cells=1) <= 200
    assert cost(friction=0.1) <= 340


REFUSED = {
    "no axial stiffness": ({"axial_stiffness": None}, "drive: needs axial_stiffness"),
    "no series stiffness": ({"series_stiffness": None}, "drive: needs series_stiffness"),
    "least tension": ({"min_tension": 1.0}, "min_tension: must be zero"),
    "lag of tensions": ({"time_constant": 0.02}, "time_constant: works only for commanded tensions"),
    "rate of a motor": ({"drive": {**MOTOR, "rate_max": 0.1}}, "rate_max"),
    "torque by a current": (
        {"drive": {**MOTOR, "torque_constant": 0.02}},
        "unknown key; write 'torques, which are cur",
    ),
    "taut and slack": ({"drive": {**SERVO, "slack": 1e-3, "pretension": 1.0}}, "exclude each other"),
    "no drive": ({"drive": None}, "give a drive"),
    "tensions by a drive": ({"drive": {"kind": "tension", "time_constant": 0.02}}, "time_constant of the tendons"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_go_together_is_refused(name):
    changes, message = REFUSED[name]
    with pytest.raises(InputError, match=message):
        cg.Finger(**PASSIVE, tendons={**CABLE, "drive": SERVO, **changes})


def test_a_pulley_needs_tendons_that_go_together():
    tendons = [{**CABLE, "drive": MOTOR}, {**CABLE, "offset": -0.004, "drive": MOTOR}]
    with pytest.raises(InputError, match="equal distances"):
        cg.Finger(**PASSIVE, tendons=tendons)


def test_commands_are_those_of_the_drive():
    for actuation, message in (
        ({"tensions": [1.0, 1.0]}, "lengths with drive.kind"),
        ({"torques": [0.3]}, "torque_max"),
    ):
        with pytest.raises(InputError, match=message):
            scene(MOTOR, actuation)


def test_a_matched_tip_and_too_much_bend_are_refused():
    with pytest.raises(InputError, match=r"matched_clothoid cannot carry tendons with drive\.kind: motor"):
        cg.FingerModel(finger(MOTOR), family="matched_clothoid", elements=2)
    with pytest.raises(InputError, match="within the tendons' offset"):
        cg.FingerModel(finger(MOTOR, offset=0.1), family="clothoid", elements=2, bending_range=2.0)


@pytest.mark.parametrize("angle", [0.05, 0.9, -0.9, 30.0])
@pytest.mark.parametrize("arrangement", [{}, {"pretension": 0.0, "slack": 2e-3}])
def test_a_position_servo_at_rest_stays_there(angle, arrangement):
    """Its torque, which may be all that it has, is what the tensions exert on the drum."""
    made = model({**MOTOR, **arrangement, "position_gain": 0.4, "coulomb_friction": 0.0})
    found = equilibrium_under(made, [angle], np.zeros(made.nw))
    states = made.drives_at(found.q, [angle])
    first, second = pulled(made, found, [angle])
    assert 0.008 * (first - second) == pytest.approx(np.clip(0.4 * (angle - states[0]), -0.2, 0.2), abs=1e-9)
    rates = made.forward_dynamics([*found.q, *np.zeros(made.n), *states], [angle], [0.0, 0.0], [])
    assert np.abs(np.array(rates)).max() < 2e-4


@pytest.mark.parametrize("size", [1.0, 2.0**-6, 2.0**4])
def test_a_tendon_begins_to_pull_within_a_share_of_what_bends_its_finger_by_one_radian(size):
    """Just straight it has 3/16 of the onset, which is a sixteenth of E I / (L e): of a finger of any size."""
    rod = cg.Finger(**PASSIVE).rod
    length, offset = LENGTH * size, OFFSET * size
    small = rod.replaced(length=length)
    cable = {"axial_stiffness": CABLE["axial_stiffness"], "series_stiffness": CABLE["series_stiffness"] / size}
    own = cg.Finger(rod=small, tendons=Tendons(offset=offset, max_tension=60.0, drive=SERVO, **cable))
    made = cg.FingerModel(own, family="clothoid", elements=2, gravity=(0, 0))
    tension = np.array(made.tensions()(np.zeros(made.nx), np.zeros(made.nu), [])[0]).ravel()
    assert tension == pytest.approx([3.0 / 256.0 * rod.stiffness / (length * offset)] * 2, rel=1e-9)
    wound = np.zeros(made.nx)
    compliance = 1.0 / cable["series_stiffness"] + length / cable["axial_stiffness"]
    wound[2 * made.n] = -0.9999 * compliance * rod.stiffness / (length * offset) / 16.0
    least = np.array(made.tensions()(wound, np.zeros(made.nu), [])[0]).ravel()[0]
    assert 0.0 < least < 1e-9 * rod.stiffness / (length * offset)


@pytest.mark.parametrize("step", [1e-3, 5e-3])
def test_long_steps_follow_a_drum_through_the_play_of_its_gear(step):
    """To and fro: implicit steps that do not resolve how a motor meets the flank run away from 5 ms on."""
    tendons = {**control_cases.CABLE, "friction": 0.0, "drive": control_cases.DRIVES["geared"][0]}
    given = cg.Scene(
        finger=control_cases.HAND.replaced(tendons=Tendons(**tendons)),
        actuation={"torques": [{"times": [0.0, 0.3, 0.6], "values": [0.0, 0.06, -0.06]}]},
        time={"duration": 0.6, "step": step, "method": "rodas"},
        gravity=[0.0, 0.0],
        fidelity={"family": "clothoid", "elements": 2},
    )
    fine = given.changed({"time.step": 5e-4, "time.method": "rk4"})
    found, truth = (cg.simulate(each).tip[-1] for each in (given, fine))
    assert np.linalg.norm(found - truth) < 1e-6


@pytest.mark.parametrize("step", [1e-3, 1e-2])
@pytest.mark.parametrize(
    ("drive", "input_"),
    [(SERVO, {"lengths": [PULL, 0.0]}), (HOLDING, {"torques": [{"times": [0.0, 0.05], "values": [0.0, 0.06]}]})],
)
def test_steps_that_are_implicit_in_the_finger_alone_are_as_short_as_drives_need(drive, input_, step):
    """Twice the length is stable too, so that the error can be estimated; longer ones have run away."""
    given = scene(drive, input_, 0.1, tendons={"friction": 0.1}, step=step, method="extrapolated_euler")
    found, truth = cg.simulate(given), cg.simulate(given.changed({"time.method": "rk4", "time.step": 1e-3}))
    off = np.abs(found.tip - truth.tip[:: round(step / 1e-3)]).max() / LENGTH
    assert off <= found.time_error <= 5e-3


def test_tensions_that_are_inputs_are_no_function_of_the_model():
    commanded = cg.FingerModel(cg.Finger(**PASSIVE, tendons={"offset": OFFSET, "max_tension": 60.0}))
    for asked in (commanded.tensions, commanded.tensions_at_rest):
        with pytest.raises(cg.InputError, match="are its inputs"):
            asked()
