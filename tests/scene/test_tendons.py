"""Tendons in a list: which share a shape of the moment, their law, and what is refused."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import approx_fprime

import continuum_grasp as cg
from continuum_grasp.base import InputError

LENGTH = 0.25
ROD = cg.Rod(length=LENGTH, linear_density=0.1, bending_stiffness=1e-2)
CONE = cg.Rod(length=LENGTH, youngs_modulus=2e6, density=1100.0, sections=[{"to": LENGTH, "diameter": [0.02, 0.005]}])


def finger(*tendons, rod=ROD, **keys):
    return cg.Finger(rod=rod, tendons=[{"max_tension": 20.0, **one} for one in tendons], **keys)


def moments(finger, tensions, s):
    """Bending moment of some tensions [N] at positions [m], by the channels."""
    return sum(np.dot(channel.arms, tensions) * channel.shape(s) for channel in finger.channels)


def test_a_pair_is_two_tendons_of_one_shape():
    pair = cg.Finger(rod=ROD, tendons={"offset": 0.01, "min_tension": 1.0, "max_tension": 20.0, "friction": 0.1})
    alike = finger(
        {"offset": 0.01, "min_tension": 1.0, "friction": 0.1}, {"offset": -0.01, "min_tension": 1.0, "friction": 0.1}
    )
    assert pair.tendon_list == alike.tendon_list
    assert pair.channels == alike.channels
    assert [channel.arms for channel in pair.channels] == [(0.01, -0.01)]
    assert [one[1:] for one in pair.inputs] == [(f"tension_{k}", "N", 1.0, 20.0) for k in (1, 2)]
    assert pair.has_tendon_friction


def test_tendons_that_run_alike_share_a_channel():
    some = finger(
        {"offset": 0.008, "to": 0.15},
        {"offset": [-0.009, -0.003]},
        {"offset": -0.004, "to": 0.15},
        {"offset": [0.006, 0.002]},
        {"offset": 0.008},
    )
    assert [[bool(arm) for arm in channel.arms] for channel in some.channels] == [
        [True, False, True, False, False],
        [False, True, False, True, False],
        [False, False, False, False, True],
    ]
    assert [channel.to for channel in some.channels] == [0.15, LENGTH, LENGTH]
    tensions, s = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([0.0, 0.1, 0.15, 0.2, LENGTH])
    up_to, cosine = s <= 0.15, lambda slope: 1 / math.sqrt(1 + slope**2)
    expected = (0.008 - 0.012) * up_to + 0.04
    expected = expected - 2 * (0.009 - 0.006 * s / LENGTH) * cosine(0.006 / LENGTH)
    expected = expected + 4 * (0.006 - 0.004 * s / LENGTH) * cosine(0.004 / LENGTH)
    assert moments(some, tensions, s) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("offset", [(0.02, 0.005), (-0.01, -0.012), (0.003, 0.01)])
def test_the_moment_is_the_work_of_shortening_the_tendon(offset):
    """-d(length)/d(curvature) of a tendon that is inclined, for a small curvature, on 20 pieces of the finger."""
    edges, slope = np.linspace(0.0, LENGTH, 21), (offset[1] - offset[0]) / LENGTH

    def length(curvatures):
        def element(s):
            k = curvatures[min(int(s / LENGTH * 20), 19)]
            return math.hypot(1.0 - (offset[0] + slope * s) * k, slope)

        return sum(quad(element, a, b, epsabs=1e-14)[0] for a, b in pairwise(edges))

    work = -approx_fprime(np.zeros(20), length, 1e-4) / np.diff(edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    # at no curvature the law is exact; the difference quotient is not
    assert moments(finger({"offset": list(offset)}), [1.0], middle) == pytest.approx(work, abs=1e-7)


def test_changes_of_every_tendon():
    listed = finger({"offset": 0.01}, {"offset": -0.01, "to": 0.1})
    pair = cg.Finger(rod=ROD, tendons={"offset": 0.01, "max_tension": 20.0})
    for some in (listed, pair):
        changed = some.with_tendons(time_constant=0.1, max_tension=5.0)
        assert {t.time_constant for t in changed.tendon_list} == {0.1}
        assert [(one.least, one.most) for one in changed.pulls] == [(0.0, 5.0)] * 2
        assert [channel.time_constant for channel in changed.channels] == [0.1] * len(some.channels)
    assert cg.Finger(rod=ROD).with_tendons(friction=1.0) == cg.Finger(rod=ROD)


REFUSED = {
    "in the backbone": (lambda: finger({"offset": 0.0}), "Finger: tendons[0].offset: offset = 0.0 m at the base"),
    "no tendon": (lambda: finger(), "Finger: tendons: too short: expected at least 1"),
    "wider than long": (
        lambda: finger({"offset": -0.3}),
        "Finger: tendons[0].offset: tendons[0].offset = 0.3 m is not",
    ),
    "beyond the tip": (lambda: finger({"offset": 0.01, "to": 0.26}), "tendons[0].to: 0.26 m is beyond"),
    "steep": (lambda: finger({"offset": [0.04, 0.005], "to": 0.1}), "tendons[0].offset changes by 0.35 per length"),
    "of different drives": (
        lambda: finger({"offset": 0.01, "time_constant": 0.1}, {"offset": -0.005, "time_constant": 0.2}),
        "Finger: tendons[0].time_constant: must be that of tendons that run alike",
    ),
    "of different orders": (
        lambda: finger(
            {"offset": 0.01, "time_constant": 0.1, "drive_order": 1}, {"offset": -0.01, "to": 0.1, "time_constant": 0.1}
        ),
        "Finger: tendons[0].drive_order: must be that of all tendons",
    ),
    "an order without a lag": (
        lambda: finger({"offset": 0.01, "drive_order": 1}),
        "tendons[0].drive_order: has no effect without a lag",
    ),
    "outside of a cone": (
        lambda: finger({"offset": 0.004}, rod=CONE),
        "Finger: tendons[0].offset: 0.004 m at 0.25 m along the finger is more than half its",
    ),
    "a sheath without friction": (
        lambda: finger({"offset": 0.01, "conduit_bend": 1.0}),
        "tendons[0].conduit_bend: needs friction",
    ),
    "limits": (lambda: finger({"offset": 0.1, "min_tension": 20.0}), "tendons[0].min_tension: min_tension = 20 N is"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_tendon_is_refused(name):
    make, words = REFUSED[name]
    with pytest.raises(InputError) as caught:
        make()
    assert words in str(caught.value)


def test_tendons_within_a_graded_finger_or_on_guides_are_fine():
    inside = finger({"offset": [0.009, 0.002]}, {"offset": -0.005, "to": 0.15}, rod=CONE)
    assert len(inside.channels) == 2
    assert len(finger({"offset": 0.01}, rod=CONE, half_thickness=0.012).channels) == 1


def test_a_tension_per_tendon():
    three = finger({"offset": 0.01}, {"offset": -0.01}, {"offset": 0.01, "to": 0.1})
    keys = {"finger": three, "gravity": (0.0, 0.0)}
    assert len(cg.Scene(**keys, actuation={"tensions": [0.0, 1.0, 2.0]}).actuation.tensions) == 3
    with pytest.raises(InputError, match=r"actuation.tensions: expected 3 tensions, got 2 numbers"):
        cg.Scene(**keys, actuation={"tensions": [0.0, 1.0]})
    with pytest.raises(InputError, match=r"actuation.tensions\[1\]: actuation.tensions\[1\] = 21 is outside"):
        cg.Scene(**keys, actuation={"tensions": [0.0, 21.0, 0.0]})


def test_presliding_is_a_share_of_the_offset_where_it_is_left_open():
    for offset, slides in ((0.005, 20e-6), ((0.005, 0.010), 40e-6), (8e-5, 3.2e-7)):
        (tendon,) = finger({"offset": offset, "friction": 0.1}).tendon_list
        assert tendon.presliding_length == pytest.approx(slides, rel=1e-14)


def test_the_range_of_presliding_goes_with_the_finger():
    """From 20 nm at 0.25 mm to 0.8 mm at 10 m of length; a number in other units is more than tendons slide."""
    rough = {"friction": 0.1, "offset": 0.004 * LENGTH}
    for scale in (1e-3, 1.0, 40.0):
        rod = cg.Rod(length=scale * LENGTH, linear_density=0.1, bending_stiffness=1e-2)
        sized = rough | {"offset": 0.004 * rod.length, "presliding": 8e-5 * rod.length}
        assert finger(sized, rod=rod).tendon_list[0].presliding == 8e-5 * rod.length
    with pytest.raises(InputError, match=r"tendons\[0\]\.presliding is 20 m, more than the tendon slides \(0\.001 m\)"):
        finger(rough | {"presliding": 20.0})


def test_the_range_of_relaxation_goes_with_the_finger():
    """What relaxes within a thousandth of sqrt(m L^3 / E I) only damps, with share * E I * time [N m2 s]."""
    natural_time = math.sqrt(0.1 * LENGTH * LENGTH**3 / 1e-2)
    for share, taken in ((1.1e-3, True), (0.9e-3, False)):
        damping = {"relaxation": [{"share": 0.5, "time": share * natural_time}]}
        if taken:
            assert cg.Finger(rod=ROD, damping=damping).damping.relaxation[0].time == share * natural_time
        else:
            viscous = f"{0.5 * 1e-2 * share * natural_time:.3g}"
            with pytest.raises(InputError, match=rf"damping\.relaxation\[0\]\.time .* add {viscous} N m2 s"):
                cg.Finger(rod=ROD, damping=damping)
