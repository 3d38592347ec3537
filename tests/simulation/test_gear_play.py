"""Gears with play: a drum without inertia is where gear and tendons balance."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from tests.simulation.test_winches import HOLDING, MOTOR, model, scene
from tests.tendon_cases import LENGTH, OFFSET, STIFFNESS, bend
from tests.truth.geared_chain import drum_angle

RADIUS = 0.008
PLAIN = {**MOTOR, "coulomb_friction": 0.0}
SLACK = {**PLAIN, "pretension": 0.0, "slack": 1e-3}
CASES = [
    # drive, gear stiffness [N m/rad], play [rad], elements, tendons
    (PLAIN, 20.0, 0.02, 2, {}),
    (PLAIN, 2000.0, 0.001, 4, {}),
    (HOLDING, 20.0, 0.05, 2, {"friction": 0.2}),
    (SLACK, 20.0, 0.1, 2, {}),
    (SLACK, 0.5, 0.02, 4, {"friction": 0.3, "conduit_bend": 1.0}),
    ({**HOLDING, "pretension": 0.2}, 200.0, 0.05, 2, {"friction": 0.1}),
]


def geared(drive, stiffness, play):
    return {**drive, "gear_stiffness": stiffness, "backlash": play}


def states(made, count, seed):
    """Random states of a pulley, about the corners of its play and of both tendons too."""
    rng, n, found = np.random.default_rng(seed), made.n, []
    for k in range(count):
        q = rng.normal(size=n) * 4.0
        path = OFFSET * bend(made, q) / RADIUS
        phi = path + rng.normal() * (0.003 if k % 2 else 0.15)
        drive = [phi, rng.normal() * 3.0, *rng.uniform(-1.2, 1.2, made.structure.winches[0].states - 2)]
        found.append([*q, *rng.normal(size=n) * 30.0, *drive, *rng.uniform(-1.2, 1.2, len(made.friction_names))])
    return np.array(found)


@pytest.mark.parametrize(("drive", "stiffness", "play", "elements", "tendons"), CASES)
def test_it_moves_as_a_finger_whose_drum_turns_where_gear_and_tendons_balance(
    drive, stiffness, play, elements, tendons
):
    """The drum of a finger without play, found by bracketing; rates of friction by differences of where that is."""
    made = model(geared(drive, stiffness, play), elements=elements, **tendons)
    plain = model(drive, elements=elements, **tendons)
    assert made.x_names == plain.x_names
    at, n, u, w = 2 * made.n, made.n, [0.03], np.zeros(made.nw)

    def on(x, drum, rate=0.0):
        return np.array([*x[:at], drum, rate, *x[at + 2 :]])

    def tensions(x, drum):
        return np.array(plain.tensions()(on(x, drum), u, [])[0]).ravel()

    def balanced(x):
        return drum_angle(x[at], play, stiffness, lambda drum: RADIUS * float(np.subtract(*tensions(x, drum))))

    for x in states(made, 16, 3):
        drum = balanced(x)
        pulls = tensions(x, drum)
        assert np.array(made.tensions()(x, u, [])[0]).ravel() == pytest.approx(pulls, abs=2e-5)
        rates = np.array(made.forward_dynamics(x, u, w, [])).ravel()
        # Compliances change with the friction states, which the rate of a tension leaves out.
        moved = np.array([*rates[:n], *np.zeros(n), *rates[at : at + 1], *np.zeros(made.nx - at - 1)])
        turning = (balanced(x + 1e-6 * moved) - balanced(x - 1e-6 * moved)) / 2e-6
        true = np.array(plain.forward_dynamics(on(x, drum, turning), u, w, [])).ravel()
        same = [*range(2 * n), *range(at + 2 + ("presliding_angle" in drive), made.nx)]
        if pulls.max() < 1e-9:  # where no tendon pulls, nothing says where the drum is, and nothing asks
            same = list(range(2 * n))
        scale = np.abs(true[same]).max()
        assert rates[same] == pytest.approx(true[same], abs=2e-5 * scale)
        slowed = plain.forward_dynamics(on(x, drum, x[at + 1]), u, w, [])  # friction of the motor, by its own rate
        assert rates[at + 1] == pytest.approx(float(slowed[at + 1]), abs=0.3)  # 6e-7 N m


@pytest.mark.parametrize(("stiffness", "play"), [(20.0, 0.02), (2000.0, 0.001), (0.5, 0.05)])
@pytest.mark.parametrize("drive", [PLAIN, SLACK])
def test_it_neither_makes_nor_takes_energy(drive, stiffness, play):
    """Turning the motor does the work that it feels; so do all bends: energy changes by friction and torque alone."""
    made = model(geared(drive, stiffness, play))
    eq = made._equations
    rate = made.forward_dynamics(eq.x, eq.u, eq.w, eq.p)
    slopes = ca.gradient(eq.kinetic_energy + eq.potential_energy, eq.x)
    damped = ca.dot(ca.vertcat(*eq.damping), eq.qd)
    tested = ca.Function("tested", [eq.x, eq.u, eq.w], [ca.dot(slopes, rate), damped, ca.sum1(ca.fabs(slopes * rate))])
    at, missing = 2 * made.n, []
    for x in states(made, 300, 5):
        gained, lost, scale = (float(v) for v in tested(x, [0.05], np.zeros(made.nw)))
        missing.append(abs(gained + lost - (0.05 - 1e-5 * x[at + 1]) * x[at + 1]) / scale)
    assert np.median(missing) < 1e-13
    assert max(missing) < 1e-5  # in the corners the root is one of three steps


def test_the_mirror_image_moves_alike():
    made = model(geared(HOLDING, 20.0, 0.05), friction=0.2)
    for x in states(made, 20, 7):
        one, other = (
            np.array(made.forward_dynamics(side * x, [side * 0.05], [side * 0.1, 0.2], [])).ravel() for side in (1, -1)
        )
        assert one == pytest.approx(-other, abs=1e-9 * np.abs(one).max())


def test_a_stiffer_gear_approaches_one_that_does_not_yield():
    """The finger is behind by half the play, and by the torque per stiffness, as far as servo and cables let it."""
    ends = {}
    drive = {**HOLDING, "position_gain": 2.0, "rate_gain": 0.01, "pretension": 6.0}
    ramp = {"times": [0.0, 0.3], "values": [0.0, 0.9]}
    for stiffness in (None, 20.0, 2000.0):
        own = drive if stiffness is None else geared(drive, stiffness, 1e-3)
        motion = cg.simulate(scene(own, {"angles": [ramp]}, 0.6, tendons={"friction": 0.1}))
        ends[stiffness] = motion
    first, second = (ends[None].tensions[-1, k] for k in (0, 1))
    compliance = 3e-5 + LENGTH / 1e4
    for stiffness, motion in ends.items():
        if stiffness is None:
            continue
        behind = 0.5e-3 + RADIUS * (first - second) / stiffness
        gear = 2.0 * RADIUS**2 / compliance
        bends = STIFFNESS / LENGTH * (RADIUS / OFFSET) ** 2
        share = 1.0 / (1.0 + bends / gear + bends / 2.0) * RADIUS / OFFSET
        lost = bend(motion.model, ends[None].q[-1]) - bend(motion.model, motion.q[-1])
        assert lost == pytest.approx(share * behind, rel=0.2), stiffness
