"""The exact rod where it is not uniform: Bessel functions, transfer matrices, quadrature, and its own invariances."""

from __future__ import annotations

import itertools
import math

import pytest
from scipy import integrate

from continuum_grasp.rod import natural_frequencies, solve_elastica
from continuum_grasp.scene.profile import Channel, Curve
from tests.closed_forms.graded import pointed_frequencies, tapered_frequencies
from tests.graded_rods import RODS, cut, graded_scene, taper
from tests.rods import HORIZONTAL, UNIT, force, rod_scene

NONE = (0.0, 0.0)
TENDONS = {"tendons": {"offset": 0.01, "max_tension": 100.0}}


def exact(scene, count=2):
    return 2.0 * math.pi * natural_frequencies(scene.finger, solve_elastica(scene), count)


def test_the_closed_forms_are_the_published_ones():
    assert pointed_frequencies(1) == pytest.approx([5.31509942, 15.20716796, 30.01980915], rel=1e-8)
    assert pointed_frequencies(2) == pytest.approx([8.71925886, 21.14566239, 38.45377123], rel=1e-8)
    # Mabie and Rogers 1972 measure by thickness and stiffness of the tip.
    assert 4.0 * tapered_frequencies(2, 0.25, 3) == pytest.approx([23.29, 73.9, 165.0], rel=2e-3)
    assert tapered_frequencies(1, 1e-6, 3) == pytest.approx(pointed_frequencies(1), rel=3e-6)


@pytest.mark.parametrize("name", RODS)
def test_a_straight_rod_has_the_frequencies_of_beam_theory(name):
    assert exact(graded_scene(RODS[name], gravity=NONE)) == pytest.approx(RODS[name].frequencies, rel=1e-9)


def test_a_thin_tip_is_resolved():
    assert exact(graded_scene(taper(2, 0.01), gravity=NONE)) == pytest.approx(tapered_frequencies(2, 0.01), rel=1e-8)


def bent(curvature, s):
    """Tip of a rod along +X by adaptive quadrature of angle and tangent; breaks of the curvature in ``s``."""

    def rate(at, state):
        return [curvature(at), math.cos(state[0]), math.sin(state[0])]

    state = [0.0, 0.0, 0.0]
    for a, b in itertools.pairwise(s):
        inside = integrate.solve_ivp(rate, (a, b), state, "DOP853", rtol=1e-13, atol=1e-14, max_step=0.02)
        state = inside.y[:, -1]
    return state


@pytest.mark.parametrize("end", [1.0, 0.6])
def test_a_tendon_alone_bends_by_its_moment_over_the_stiffness(end):
    shape = Curve((0.0, 1.0), ((1.0, -0.75),)) if end == 1.0 else Curve((0.0, end, 1.0), ((1.0, -0.5), (0.0,)))
    channel = Channel(shape, end, (0.01, -0.01))
    actuation = {"tensions": [21.0, 1.0]}
    scene = graded_scene(RODS["cone 0.25"], gravity=NONE, finger=TENDONS, actuation=actuation, channels=[channel])
    found = solve_elastica(scene)
    slope = 0.75 if end == 1.0 else 0.5
    turn, x, y = bent(lambda s: 0.2 * (1.0 - slope * s) / (1.0 - 0.75 * s) ** 4 * (s < end), [0.0, end])
    x, y = x + (1.0 - end) * math.cos(turn), y + (1.0 - end) * math.sin(turn)
    if end == 1.0:
        assert turn == pytest.approx(2.0, rel=1e-12)  # taper.md A7, in closed form
    assert float(found.angle(1.0)) - HORIZONTAL == pytest.approx(turn, abs=1e-11)
    assert found.tip == pytest.approx([x, y], abs=1e-10)


def test_a_couple_inside_bends_up_to_its_place():
    scene = graded_scene(RODS["step"], gravity=NONE, loads=[{"kind": "moment", "at": 0.7, "moment": 0.2}])
    turn, x, y = bent(lambda s: 0.2 if s < 0.4 else 2.0, [0.0, 0.4, 0.7])
    found = solve_elastica(scene)
    assert found.tip == pytest.approx([x + 0.3 * math.cos(turn), y + 0.3 * math.sin(turn)], abs=1e-11)


LOADED = {
    "loads": [force(1.0, (0.2, -1.0)), {"kind": "moment", "at": 0.3, "moment": 0.4}],
    "gravity": (0.3, -2.0),
    "tip_mass": 0.2,
    "finger": {**TENDONS, "rest_curvature": {"breaks": [0.5], "values": [0.5, -1.5]}},
    "actuation": {"tensions": [30.0, 5.0]},
}


@pytest.mark.parametrize("pieces", [2, 3, 7])
def test_cutting_a_rod_into_equal_pieces_changes_nothing(pieces):
    whole = rod_scene(UNIT, **LOADED)
    rest, channels = whole.finger.profile.rest_curvature, whole.finger.channels
    parts = graded_scene(cut(pieces), rest=rest, channels=channels, **LOADED)
    one, other = solve_elastica(whole), solve_elastica(parts)
    assert other.tip == pytest.approx(one.tip, abs=1e-14)
    assert (other.energy, other.margin) == pytest.approx((one.energy, one.margin), rel=1e-13)
    ours, theirs = (natural_frequencies(s.finger, e, 3) for s, e in ((whole, one), (parts, other)))
    assert theirs == pytest.approx(ours, rel=1e-12)
