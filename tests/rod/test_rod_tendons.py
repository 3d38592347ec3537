"""The exact rod under tendons with friction that were pulled or let out, and under winches, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.rod import solve_elastica
from continuum_grasp.simulation import choose_fidelity, equilibrium
from tests.marks import few

LENGTH, STIFFNESS, OFFSET, AXIAL, SERIES, FRICTION = 0.18, 6.11e-3, 0.005, 1e4, 3e-5, 0.1
RATE = FRICTION * OFFSET / STIFFNESS
TENDON = {"offset": OFFSET, "max_tension": 60.0, "friction": FRICTION}
CABLE = {"axial_stiffness": AXIAL, "series_stiffness": 1.0 / SERIES}
REEL = {"kind": "length", "time_constant": 0.02}


def scene(tendons, actuation, *, reached_by="pulling", gravity=(0.0, 0.0), **fidelity):
    rod = {"length": LENGTH, "linear_density": 0.034, "bending_stiffness": STIFFNESS}
    listed = tendons if isinstance(tendons, list) else [tendons]
    frictional = any(one["friction"] for one in listed)
    return cg.Scene(
        finger={"rod": rod, "tendons": tendons},
        gravity=gravity,
        actuation=actuation,
        initial={"pose": "equilibrium", **({"reached_by": reached_by} if frictional else {})},
        fidelity=fidelity or {"family": "clothoid"},
    )


def tip(found) -> float:
    return float(found.angle(LENGTH))


def test_one_tendon_pulled_and_released():
    """1 / T grows along the rod, or falls, by friction e / EI per length; a sheath before it takes its share first."""
    pulled = tip(solve_elastica(scene([TENDON], {"tensions": [20.0]})))
    assert pulled == pytest.approx(math.log(1.0 + RATE * 20.0 * LENGTH) / FRICTION, abs=2e-6)
    released = tip(solve_elastica(scene([TENDON], {"tensions": [0.3]}, reached_by="releasing")))
    assert released == pytest.approx(-math.log(1.0 - RATE * 0.3 * LENGTH) / FRICTION, abs=2e-6)
    sheathed = tip(solve_elastica(scene([{**TENDON, "conduit_bend": 0.5}], {"tensions": [20.0]})))
    arriving = 20.0 * math.exp(-0.5 * FRICTION)
    assert sheathed == pytest.approx(math.log(1.0 + RATE * arriving * LENGTH) / FRICTION, abs=2e-6)


def test_two_tendons_of_which_one_is_paid_out():
    """T1 T2 is the same all along; at 20 and 6 N the bend is that of drives.md's closed form."""
    product, ratio = math.sqrt(120.0), math.log(20.0 / 6.0) / 2.0
    beyond = 2.0 * math.atanh(math.tanh(ratio / 2.0) * math.exp(-2.0 * product * RATE * LENGTH))
    found = tip(solve_elastica(scene(TENDON, {"tensions": [20.0, 6.0]})))
    assert found == pytest.approx((ratio - beyond) / FRICTION, abs=2e-6)


@pytest.mark.parametrize("friction", [0.0, FRICTION])
def test_cable_that_is_wound_up(friction):
    """It is bend (e + EI / (e EA)) + c0 T, whatever the friction; slack tendons do nothing."""
    lone = {**TENDON, **CABLE, "friction": friction, "drive": REEL}
    bend = math.log(1.0 + RATE * 20.0 * LENGTH) / FRICTION if friction else 20.0 * OFFSET * LENGTH / STIFFNESS
    wound = bend * (OFFSET + STIFFNESS / (OFFSET * AXIAL)) + SERIES * 20.0
    found = solve_elastica(scene([lone], {"lengths": [wound]}))
    assert tip(found) == pytest.approx(bend, abs=2e-6)
    (tension,) = found.equations.tensions(found.nodal_curvature)
    assert tension == pytest.approx(20.0, rel=1e-6)
    assert found.stable is (None if friction else True)
    slack = solve_elastica(scene([{**lone, "drive": {**REEL, "slack": 1e-3}}], {"lengths": [9e-4]}))
    assert abs(tip(slack)) < 1e-9


@pytest.mark.parametrize(
    ("tendons", "actuation"),
    [
        ({**TENDON, **CABLE, "drive": {**REEL, "pretension": 4.0}}, {"lengths": [8e-3, -7.6e-3]}),
        ({**TENDON, **CABLE, "drive": {**REEL, "arrangement": "one_pulley", "pretension": 4.0}}, {"lengths": [8e-3]}),
        (
            [
                {**TENDON, **CABLE, "offset": [0.005, 0.003], "drive": REEL},
                {**TENDON, **CABLE, "friction": 0.2, "to": 0.09, "drive": REEL},
            ],
            {"lengths": [3e-3, 3e-3]},
        ),
    ],
    ids=["two", "pulley", "that end"],
)
@pytest.mark.parametrize("reached_by", few(["pulling", "releasing"], 1))
def test_a_finger_of_many_elements_comes_to_the_rod(tendons, actuation, reached_by):
    """Under weight; errors fall with the square of the number of elements, arcs where the curvature jumps."""
    given = scene(tendons, actuation, reached_by=reached_by, gravity=(0.0, -9.81))
    family = "arc" if isinstance(tendons, list) else "clothoid"
    rod = solve_elastica(given)
    places = np.linspace(0.0, LENGTH, 31)
    errors = []
    for elements in (4, 12):
        fine = scene(tendons, actuation, reached_by=reached_by, gravity=(0.0, -9.81), family=family, elements=elements)
        found = equilibrium(fine)
        errors.append(np.abs(found.backbone(31) - rod.position(places)).max() / LENGTH)
    assert errors[1] < 2e-4
    assert errors[1] < 0.2 * errors[0]


@pytest.mark.parametrize("reached_by", ["pulling", "releasing"])
def test_a_model_is_chosen_by_tolerance(reached_by):
    reel = {**TENDON, **CABLE, "drive": {**REEL, "pretension": 2.0}}
    given = scene(reel, {"lengths": [6e-3, -5e-3]}, reached_by=reached_by, tolerance=0.01)
    chosen = choose_fidelity(given)
    rod, found = solve_elastica(given), equilibrium(chosen.scene)
    off = np.abs(found.backbone(31) - rod.position(np.linspace(0.0, LENGTH, 31))).max()
    assert off < 0.01 * LENGTH


def test_what_the_rod_does_not_have_is_refused():
    motor = {"kind": "motor", "arrangement": "one_pulley", "winch_radius": 0.008, "inertia": 2e-6, "torque_max": 0.2}
    pulley = scene({**TENDON, **CABLE, "drive": motor}, {"torques": [0.05]})
    with pytest.raises(InputError, match="one per tendon: give family and elements"):
        solve_elastica(pulley)
    given = scene([TENDON], {"tensions": [3.0]})
    known = given.initial.replaced(reached_by="state", friction_states=(0.0,))
    with pytest.raises(InputError, match="no friction cells"):
        solve_elastica(given.replaced(initial=known))
