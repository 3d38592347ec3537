"""Modes of fingers on winches: held, with tendons that stick, and with motors that turn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import linalg

import continuum_grasp as cg
from continuum_grasp.simulation import modes
from tests.closed_forms.rods import roots
from tests.tendon_cases import LENGTH, OFFSET, ROD, STIFFNESS
from tests.truth.differences import differences

DENSITY, TIP = ROD["linear_density"], 0.002
AXIAL, SERIES = 1e4, 1 / 3e-5
CABLE = 1.0 / (1.0 / SERIES + LENGTH / AXIAL)
RADIUS, INERTIA, PULL, PLAY, GEAR = 0.008, 2e-6, 5.0, 0.01, 20.0
SERVO = {"kind": "length", "time_constant": 0.02, "pretension": PULL}
MOTOR = {
    "kind": "motor",
    "arrangement": "one_pulley",
    "pretension": PULL,
    "winch_radius": RADIUS,
    "inertia": INERTIA,
    "coulomb_friction": 2e-3,
    "torque_max": 0.2,
}


def scene(drive, actuation, *, family="clothoid", elements=8, **tendons):
    own = {"offset": OFFSET, "max_tension": 60.0, "axial_stiffness": AXIAL, "series_stiffness": SERIES, **tendons}
    finger = {"rod": ROD, "masses": [{"at": LENGTH, "mass": TIP}]}
    if drive is not None:
        finger["tendons"] = {**own, "drive": drive}
    initial = {"pose": "equilibrium", **({"reached_by": "pulling"} if tendons.get("friction") else {})}
    return cg.Scene(
        finger=finger,
        actuation=actuation,
        initial=initial,
        gravity=(0.0, 0.0),
        fidelity={"family": family, "elements": elements, "bending_range": 2.0 if elements == 1 else 1.0},
    )


def beam(spring: float, count: int) -> np.ndarray:
    """Frequencies [Hz] of a clamped beam with a mass at its tip, whose angle a spring [N m/rad] holds."""

    def missing(k: float) -> float:
        c, s, ch, sh = math.cos(k), math.sin(k), math.cosh(k), math.sinh(k)
        held, mass = spring * LENGTH / STIFFNESS / k, TIP / (DENSITY * LENGTH) * k
        # Of ch - cos and sh - sin along the beam: the balances of moment and of force at the tip.
        moment = (ch + c + held * (sh + s), sh + s + held * (ch - c))
        force = (sh - s + mass * (ch - c), ch + c + mass * (sh - s))
        return (moment[0] * force[1] - moment[1] * force[0]) / ch**2

    return (
        roots(missing, 0.5, 3.5 * count + 2.0)[:count] ** 2
        * math.sqrt(STIFFNESS / DENSITY)
        / LENGTH**2
        / (2.0 * math.pi)
    )


@pytest.mark.parametrize(("pretension", "taut"), [(PULL, 2), (0.0, 0)])
def test_held_winches_are_a_spring_at_the_tips_angle(pretension, taut):
    """Of e^2 k per taut tendon; slack ones add nothing."""
    drive = {"kind": "length", "time_constant": 0.02}
    drive |= {"pretension": pretension} if taut else {"slack": 1e-3}
    found = modes(scene(drive, {"lengths": [0.0, 0.0]}))
    assert found.frequencies_hz[:3] == pytest.approx(beam(taut * OFFSET**2 * CABLE, 3), rel=1e-3)
    assert found.stuck_frequencies_hz is None
    assert found.free_frequencies_hz is None


@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_tendons_that_stick_are_glued_reinforcement(friction):
    """E I + 2 E A e^2 along the whole finger: all frequencies are higher by one factor."""
    found = modes(scene(SERVO, {"lengths": [0.0, 0.0]}, friction=friction))
    bare = modes(scene(None, None)).frequencies_hz
    factor = math.sqrt(1.0 + 2.0 * AXIAL * OFFSET**2 / STIFFNESS)
    assert found.stuck_frequencies_hz == pytest.approx(factor * bare, rel=1e-9)
    assert found.frequencies_hz[:3] == pytest.approx(beam(2.0 * OFFSET**2 * CABLE, 3), rel=1e-3)


@pytest.mark.parametrize("kind", ["torque", "servo", "play"])
def test_motors_that_turn_are_modes_of_their_own(kind):
    """One arc and a pulley: two equations of motion; behind the play of a gear, with its stiffness between them."""
    own, actuation, servo, gear = {}, {"torques": [0.01]}, 0.0, math.inf
    if kind == "servo":
        own, actuation, servo = {"position_gain": 2.0, "rate_gain": 0.01}, {"angles": [0.05]}, 2.0
    if kind == "play":
        own, gear = {"backlash": PLAY, "gear_stiffness": GEAR}, GEAR
    found = modes(scene({**MOTOR, **own}, actuation, family="arc", elements=1))
    about = found.equilibrium
    mass = float(about.model.mass_matrix(about.q, about.u, about.p))
    assert about.q[0] > 0.01
    # Stiffness of both cables at the drum, in series with the gear.
    drum = 2.0 * CABLE * RADIUS**2
    spring = drum if gear == math.inf else drum * gear / (drum + gear)
    across = OFFSET / RADIUS
    stiffness = [[STIFFNESS / LENGTH + spring * across**2, -spring * across], [-spring * across, spring + servo]]
    free = np.sqrt(linalg.eigvalsh(stiffness, np.diag([mass, INERTIA]))) / (2.0 * math.pi)
    assert found.free_frequencies_hz == pytest.approx(free, rel=1e-6)
    assert found.frequencies_hz == pytest.approx([math.sqrt(stiffness[0][0] / mass) / (2.0 * math.pi)], rel=1e-6)


def test_tendons_without_friction_slide_where_others_stick():
    """One arc: E I / L, and E A e^2 / L of a tendon that sticks, e^2 k of one that does not, none of a slack one."""
    own = {"offset": OFFSET, "max_tension": 60.0, "axial_stiffness": AXIAL, "series_stiffness": SERIES}
    glued, sliding = AXIAL * OFFSET**2 / LENGTH, CABLE * OFFSET**2
    for pulls, added in (((PULL, PULL), glued + sliding), ((PULL, 0.0), glued), ((0.0, PULL), sliding)):
        start = [{"pretension": pull} if pull else {"slack": 1e-3} for pull in pulls]
        tendons = [
            {**own, "friction": 0.2, "drive": {"kind": "length", "time_constant": 0.02, **start[0]}},
            {**own, "offset": -OFFSET, "drive": {"kind": "length", "time_constant": 0.02, **start[1]}},
        ]
        asked = scene(SERVO, {"lengths": [0.0, 0.0]}, family="arc", elements=1, friction=0.2)
        found = modes(asked.changed({"finger.tendons": tendons}))
        about = found.equilibrium
        mass = float(about.model.mass_matrix(about.q, about.u, about.p))
        true = math.sqrt((STIFFNESS / LENGTH + added) / mass) / (2.0 * math.pi)
        assert found.stuck_frequencies_hz == pytest.approx([true], rel=1e-3)


def test_tendons_that_stick_are_as_stiff_as_their_distance_squared():
    """One arc between tapered tendons: E A times the integral of the squared distance over the length's square."""
    own = {"max_tension": 60.0, "axial_stiffness": AXIAL, "series_stiffness": SERIES, "friction": 0.2, "drive": SERVO}
    tapered = [{**own, "offset": [side * 0.006, side * 0.003]} for side in (1.0, -1.0)]
    asked = scene(SERVO, {"lengths": [0.0, 0.0]}, family="arc", elements=1, friction=0.2)
    found = modes(asked.changed({"finger.tendons": tapered}))
    about = found.equilibrium
    mass = float(about.model.mass_matrix(about.q, about.u, about.p))
    square = (0.006**2 + 0.006 * 0.003 + 0.003**2) / 3.0
    true = math.sqrt((STIFFNESS + 2.0 * AXIAL * square) / LENGTH / mass) / (2.0 * math.pi)
    # They are at an angle to the backbone, whose cosine is 1.4e-4 less than one.
    assert found.stuck_frequencies_hz == pytest.approx([true], rel=2e-4)


def test_friction_of_a_bent_finger_acts_on_as_it_did():
    """Against differences of the equations of motion, whose friction states are those under which they balance."""
    asked = scene(SERVO, {"lengths": [0.006, -0.004]}, elements=2, friction=0.3)
    between = {"pose": "equilibrium", "reached_by": "state", "friction_states": [0.5, -0.3, 0.8, 0.1]}
    for one in (asked, asked.changed({"initial": between})):
        found = modes(one)
        about = found.equilibrium
        model, n = about.model, about.model.n
        ways = np.array(about.friction_states)
        # The states whose cubic these are: the least root of each.
        states = [min(np.roots([-0.5, 0.0, 1.5, -way]).real, key=abs) for way in ways]
        x = np.concatenate([about.q, np.zeros(n), np.array(model.drives_at(about.q, about.u, ways)).ravel(), states])

        def force(q, x=x, model=model, n=n, about=about):
            rates = np.array(model.forward_dynamics(np.concatenate([q, x[n:]]), about.u, about.w, about.p)).ravel()
            return np.array(model.mass_matrix(q, about.u, about.p)) @ rates[n : 2 * n]

        assert np.abs(force(about.q)).max() < 1e-6
        stiffness = -differences(force, about.q, 1e-4)
        mass = np.array(model.mass_matrix(about.q, about.u, about.p))
        true = np.sqrt(linalg.eigvals(stiffness, mass).real) / (2.0 * math.pi)
        assert found.frequencies_hz == pytest.approx(np.sort(true), rel=1e-4)
