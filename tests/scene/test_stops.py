"""Stops, a body at the tip, and couples that are inputs: what they are, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.scene import SpiRob

LENGTH = 0.25
ROD = cg.Rod(length=LENGTH, linear_density=0.1, bending_stiffness=1e-2)
SPIRAL = {"base_thickness": 0.04, "tip_thickness": 0.005, "units": 24, "core": 0.12}
SPIROB = cg.Rod(length=LENGTH, youngs_modulus=2e6, density=1100.0, spirob=SPIRAL)


def test_stops_along_the_finger():
    finger = cg.Finger(rod=ROD, stops={"curvature": [20.0, "0.06 1/mm"], "stiffness_ratio": 50.0, "side": "left"})
    assert finger.stop_curvature([0.0, 0.5 * LENGTH, LENGTH]) == pytest.approx([20.0, 40.0, 60.0])
    assert finger.stops.signs == (1.0,)
    assert finger.free_tip_reasons == ("stops",)
    assert cg.Finger(rod=ROD).stop_curvature is None


def test_a_spirob_stops_where_it_is_the_spiral():
    """Curved as its stops allow, the straightened line is a logarithmic spiral: its radius falls by exp(-b angle)."""
    finger = cg.Finger(rod=SPIROB, stops={"stiffness_ratio": 50.0})
    b, s = SpiRob(**SPIRAL).growth(LENGTH), np.linspace(0.0, LENGTH, 2001)
    thickness = 0.04 - 0.14 * s
    curvature = finger.stop_curvature(s)
    exact = 2 * math.tanh(math.pi * b) / (math.sqrt(1 + b * b) * thickness)
    assert np.abs(curvature / exact - 1).max() < 1e-6
    # of a spiral: distance from the pole 1 / (k sqrt(1 + b^2)), angle the integral of k
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(s))])
    assert np.log(curvature[0] / curvature) == pytest.approx(-b * angle, abs=1e-5)


def test_stops_beside_a_rest_curvature():
    inside = {"breaks": [0.1], "values": [10.0, -30.0]}
    stops = {"curvature": 20.0, "stiffness_ratio": 50.0}
    cg.Finger(rod=ROD, rest_curvature=inside, stops={**stops, "side": "left"})
    with pytest.raises(InputError, match=r"stops: at 0.1 m along the finger they touch from -20 1/m on, .* of -30 1/m"):
        cg.Finger(rod=ROD, rest_curvature=inside, stops=stops)


REFUSED = {
    "no curvature": ({"rod": ROD, "stops": {"stiffness_ratio": 50.0}}, "stops.curvature is needed"),
    "two curvatures": (
        {"rod": SPIROB, "stops": {"stiffness_ratio": 50.0, "curvature": 20.0}},
        "Finger: stops.curvature: follows from the gaps",
    ),
    "no stop": (
        {"rod": ROD, "stops": {"stiffness_ratio": 1.0, "curvature": 20.0}},
        "stops.stiffness_ratio: out of range",
    ),
    "a body of nothing": ({"rod": ROD, "tip_body": {"mass": 0.0}}, "Finger: tip_body.mass: out of range"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused(name):
    keys, words = REFUSED[name]
    with pytest.raises(InputError) as caught:
        cg.Finger(**keys)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "what"),
    [
        ({"stops": {"curvature": 20.0, "stiffness_ratio": 50.0}}, "stops"),
        ({"tendons": [{"offset": 0.01, "max_tension": 1.0, "friction": 0.1}]}, "tendon friction"),
    ],
)
def test_a_matched_tip_carries_neither_stops_nor_friction(keys, what):
    with pytest.raises(InputError) as caught:
        cg.Scene(finger=cg.Finger(rod=ROD, **keys), gravity=(0.0, 0.0), fidelity={"family": "matched_clothoid"})
    assert str(caught.value).startswith(f"Scene: fidelity.family: matched_clothoid cannot carry {what} (the moment")
    assert str(caught.value).endswith(": use clothoid or arc")


def test_a_couple_that_holds_is_no_input():
    keys = {"finger": cg.Finger(rod=ROD), "gravity": (0.0, 0.0)}
    couple = {"kind": "moment", "at": 0.1, "moment": 0.01, "input": True}
    assert cg.Scene(**keys, loads=[couple]).loads[0].input
    with pytest.raises(InputError, match=r"held_by\[0\].input: has no effect"):
        cg.Scene(**keys, initial={"pose": "equilibrium", "held_by": [couple]})


def test_a_spirob_that_curls_up_at_once_meets_its_stops_before_its_bending_range():
    """Three elements bend by up to 8.8 rad each, and their stops hold them; two would bend beyond what is evaluated."""
    tendon = {"offset": [0.016, 0.002], "max_tension": 20.0}
    finger = cg.Finger(rod=SPIROB, stops={"stiffness_ratio": 500.0}, tendons=[tendon], damping={"material": 5e-4})
    pull = {"times": [0.0, 0.1, 0.15, 0.17], "values": [0.0, 8.0, 8.0, 0.0]}  # and lets go
    scene = cg.Scene(
        finger=finger,
        gravity=(0.0, 0.0),
        actuation={"tensions": [pull]},
        fidelity={"elements": 3},
        initial={"pose": "straight"},
        time={"duration": 0.3, "step": 0.002, "method": "rk4"},
    )
    with pytest.raises(cg.NumericalError, match=r"element 2 is about to bend beyond 40 rad.*take more elements"):
        cg.simulate(scene.changed({"fidelity.elements": 2}))
    motion = cg.simulate(scene)
    assert motion.status == "finished"
    turn = motion.core.batch("bending", motion.q, motion.acting, None)
    assert np.asarray(turn).sum(axis=1).max() > 2.0 * math.pi
