"""Sections of a finger without elements: pieces and polynomials of its curves, pulls, the curvature under a moment."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from continuum_grasp.model import Memory, Section
from tests.rod_stages import LENGTH, OFFSET, PAIR, ROD, STIFFNESS, finger

CONE = {"length": LENGTH, "youngs_modulus": 1e9, "density": 1100.0, "diameter": [0.012, 0.004]}
KNOTS = np.linspace(0.0, LENGTH, 12)
SAMPLES = {
    "length": LENGTH,
    "samples": {
        "at": KNOTS.tolist(),
        "bending_stiffness": (0.05 * np.exp(-8.0 * KNOTS) * (1.0 + 0.2 * np.sin(90.0 * KNOTS))).tolist(),
        "linear_density": (0.1 * np.exp(-4.0 * KNOTS)).tolist(),
        "rest_curvature": (3.0 * np.sin(20.0 * KNOTS)).tolist(),
        "thickness": (0.02 - 0.05 * KNOTS).tolist(),
    },
}
NOTCHED = {
    "length": LENGTH,
    "sections": [
        {"to": 0.06, "bending_stiffness": 0.05, "linear_density": 0.1},
        {"to": 0.07, "bending_stiffness": [0.02, 0.01], "linear_density": 0.3, "rest_curvature": 9.0},
        {"to": LENGTH, "bending_stiffness": 0.05, "linear_density": [0.1, 0.05]},
    ],
}
SPIRAL = {
    "length": LENGTH,
    "youngs_modulus": 3e7,
    "density": 1100.0,
    "spirob": {"base_thickness": 0.024, "tip_thickness": 0.008, "width": 0.02, "units": 20, "core": 0.3},
}
TAPERED = [{"offset": [0.005, 0.002], "max_tension": 60.0}, {"offset": [-0.005, -0.002], "max_tension": 60.0}]
FINGERS = {
    "cone": {"rod": CONE, "tendons": TAPERED},
    "samples": {"rod": SAMPLES},
    "notched": {"rod": NOTCHED, "tendons": [{"offset": 0.004, "max_tension": 9.0, "to": 0.11}]},
    "spiral": {"rod": SPIRAL, "tendons": TAPERED, "stops": {"stiffness_ratio": 20.0}},
    "softening": {"softening": {"curvature": [4.0, 9.0], "stiffness_ratio": 0.3}, "rest_curvature": 2.0},
}


def places(section, count=23):
    """Places inside the pieces, with their pieces."""
    for piece, (a, b) in enumerate(pairwise(section.places)):
        yield from ((s, piece) for s in a + (b - a) * (np.arange(count) + 0.5) / count)


@pytest.mark.parametrize("name", list(FINGERS))
def test_polynomials_on_pieces_are_the_curves_of_the_finger(name):
    of = finger(**FINGERS[name])
    section, profile = Section.of(of), of.profile
    s = ca.SX.sym("s")
    numbers = ca.SX.sym("numbers", section.form.size)
    place = section.form.at(s, numbers)
    own = [value for of_law in place.own for value in of_law]
    values = ca.Function("at", [s, numbers], [ca.vertcat(place.stiffness, place.rest, *place.shapes, *own)])
    curves = [
        lambda at: profile.bending_stiffness(at) / section.stiffness,
        lambda at: profile.rest_curvature(at) * LENGTH,
        *(channel.shape for channel in of.channels),
    ]
    if name == "spiral":
        curves.append(lambda at: of.stop_curvature(at) * LENGTH)
    if name == "softening":
        curves.append(lambda at: (4.0 + 5.0 * at / LENGTH) * LENGTH)
    for at, piece in places(section):
        expected = np.array([float(curve(at * LENGTH)) for curve in curves])
        assert np.array(values(at, section.numbers(piece))).ravel() == pytest.approx(
            expected, abs=2e-5 * expected.max()
        )
        half = np.polyval(section.half_thickness(piece)[::-1], at - section.places[piece]) * LENGTH
        assert half == pytest.approx(float(profile.half_thickness(at * LENGTH)), rel=2e-5)


def test_a_taper_is_one_piece_and_exact():
    section = Section.of(finger(**FINGERS["cone"]))
    assert section.places == (0.0, 1.0)
    stiffness, *_ = section.pieces[0].polynomials
    assert stiffness == pytest.approx((np.polynomial.Polynomial([1.0, -2.0 / 3.0]) ** 4).coef, abs=1e-12)


def test_pieces_end_where_curves_jump_and_where_masses_are():
    tendons = [{"offset": 0.004, "max_tension": 9.0, "to": 0.11}]
    masses = [{"at": 0.16, "mass": 0.01}, {"at": LENGTH, "mass": 0.02}]
    of = finger(
        rod=NOTCHED,
        tendons=tendons,
        masses=masses,
        pressure=[{"area": 1e-4, "offset": 0.006, "start": 0.03, "max_pressure": 1e5}],
    )
    section = Section.of(of)
    assert np.array(section.places) * LENGTH == pytest.approx([0.0, 0.03, 0.06, 0.07, 0.11, 0.16, LENGTH], abs=1e-12)
    assert [section.piece_at(s) for s in (0.0, 0.14, 0.16, 0.3, 0.31, 1.0)] == [0, 0, 1, 1, 2, 5]


def test_mass_is_counted_from_the_base():
    masses = [{"at": 0.16, "mass": 0.01}, {"at": LENGTH, "mass": 0.02}]
    of = finger(rod=NOTCHED, masses=masses)
    section = Section.of(of)
    unit = section.force  # of a mass, per m/s2
    spread = 0.1 * 0.06 + 0.3 * 0.01
    for at, expected in (
        (0.03, 0.003),
        (0.07 - 1e-12, spread),
        (0.16 - 1e-12, spread + 0.5 * (0.1 + 0.1 - 0.05 * 9 / 13) * 0.09),
    ):
        piece = section.piece_at(at / LENGTH)
        assert section.form.at(at / LENGTH, section.numbers(piece)).mass * unit == pytest.approx(expected, rel=1e-9)
    last = section.form.at(1.0, section.numbers(len(section.pieces) - 1)).mass
    assert last * unit == pytest.approx(spread + 0.075 * 0.13 + 0.01, rel=1e-9)
    assert (section.mass * unit, section.tip_mass * unit) == pytest.approx(
        (spread + 0.075 * 0.13 + 0.03, 0.02), rel=1e-9
    )


def test_pulls_are_tensions_and_pressures_by_their_moments():
    chamber = {"area": 8e-5, "offset": 0.006, "min_pressure": -2e4, "max_pressure": 1e5, "start": 0.05}
    of = finger(tendons={**PAIR, "min_tension": 2.0}, pressure=[chamber])
    section = Section.of(of)
    left, right, air = section.pulls
    moment = STIFFNESS / LENGTH
    assert [pull.side for pull in section.pulls] == [1.0, -1.0, -1.0]
    assert left.value(np.array([0.0, left.most])) == pytest.approx([2.0, 60.0])
    assert right.value(1.0) * OFFSET == pytest.approx(2.0 * OFFSET + moment)
    assert air.value(np.array([0.0, air.most])) == pytest.approx([-2e4, 1e5])
    numbers = section.numbers(1)
    place = section.form.at(0.5, numbers)
    load = section.form.load(place, 0.3, [1.0, 0.2, 0.1], [], numbers)
    tensions = left.value(1.0) - right.value(0.2)
    assert load * moment == pytest.approx(0.3 * moment + tensions * OFFSET - air.value(0.1) * 8e-5 * 0.006)
    # Before the chamber begins it does not bend.
    assert section.form.load(section.form.at(0.1, section.numbers(0)), 0.0, [0, 0, 9.0], [], section.numbers(0)) == 0.0


def test_fingers_that_differ_by_numbers_have_the_same_form():
    branch = {"stiffness": 0.02, "moment": 0.03}
    soft = {"softening": {"curvature": 4.0, "stiffness_ratio": 0.3}, "damping": {"dry_friction": [branch]}}
    other = {
        "rod": {**ROD, "bending_stiffness": 0.7, "length": 0.5},
        "tendons": {"offset": 0.01, "max_tension": 9.0, "min_tension": 1.0},
        "softening": {"curvature": 7.0, "stiffness_ratio": 0.6, "rounding": 0.5},
        "damping": {"dry_friction": [{"stiffness": 0.01, "moment": 0.07}], "friction_cells": 3},
    }
    first, second = Section.of(finger(**soft)), Section.of(finger(**other))
    assert first.key == second.key
    assert first.form == second.form
    assert hash(first.form) == hash(second.form)
    third = Section.of(finger(tendons={**PAIR, "friction": 0.1}, **soft))
    assert third.key != first.key
    fewer = Section.of(finger(softening=soft["softening"]))
    assert fewer.key != first.key


def test_similar_fingers_have_the_same_numbers():
    """Twice as long, eight times as stiff, with the same density, and all moments four times as large."""
    by = {"length": 2.0, "bending_stiffness": 8.0, "curvature": 0.5, "stiffness": 8.0, "moment": 4.0}
    by |= {"offset": 2.0, "presliding": 2.0, "rest_curvature": 0.5, "min_tension": 2.0, "max_tension": 2.0}

    def scaled(value, key=""):
        if isinstance(value, dict):
            return {name: scaled(entry, name) for name, entry in value.items()}
        return [scaled(entry) for entry in value] if isinstance(value, list) else value * by.get(key, 1.0)

    keys = {
        "rod": ROD,
        "tendons": {**PAIR, "min_tension": 2.0, "friction": 0.2, "presliding": 1e-4, "conduit_bend": 1.0},
        "rest_curvature": 3.0,
        "stops": {"curvature": 9.0, "stiffness_ratio": 30.0},
        "softening": {"curvature": 4.0, "stiffness_ratio": 0.3, "rounding": 0.2},
        "damping": {"dry_friction": [{"stiffness": 0.02, "moment": 0.03}]},
    }
    first, second = Section.of(finger(**keys)), Section.of(finger(**scaled(keys)))
    assert second.numbers(0) == pytest.approx(first.numbers(0), rel=1e-12)
    assert second.pulls[0].most == pytest.approx(first.pulls[0].most)


# -- the curvature under a moment --------------------------------------------------------------------------------------


def resisting(keys, k):
    """Moment [N m] against a curvature [1/m] above the one at rest, by the formulas of the documentation."""
    moment, rest = STIFFNESS * k, keys.get("rest_curvature", 0.0)
    for key, change in (("softening", -1.0), ("stops", -1.0)):
        if key not in keys:
            continue
        law = keys[key]
        signs = {"both": (1, -1), "left": (1,), "right": (-1,)}[law.get("side", "both")]
        width = (0.005 if key == "stops" else law["rounding"]) * law["curvature"]
        for sign in signs:
            y = sign * (k + rest if key == "stops" else k) - law["curvature"]
            root = np.hypot(y, width)
            moment += sign * STIFFNESS * (law["stiffness_ratio"] + change) * (0.5 * (y + root)) ** 2 / root
    for branch in keys.get("damping", {}).get("dry_friction", ()):
        moment += branch["moment"] * np.clip(branch["stiffness"] / branch["moment"] * k, -1.0, 1.0)
    return moment


def laws(rng):
    """Laws of a finger at random, hard ones among them."""
    keys = {}
    if rng.random() < 0.6:
        ratio, width = 10.0 ** rng.uniform(-2.0, -0.1), 10.0 ** rng.uniform(-3.0, 0.3)
        keys["softening"] = {"curvature": rng.uniform(1.0, 20.0), "stiffness_ratio": ratio, "rounding": width}
    if rng.random() < 0.6 or not keys:
        side, ratio = str(rng.choice(["both", "left", "right"])), 10.0 ** rng.uniform(0.1, 3.0)
        keys["stops"] = {"curvature": rng.uniform(1.0, 40.0), "stiffness_ratio": ratio, "side": side}
        keys["rest_curvature"] = rng.uniform(-0.9, 0.9) * keys["stops"]["curvature"]
    if rng.random() < 0.5:
        sizes = zip(10.0 ** rng.uniform(-3.0, -1.0, 3), rng.uniform(0.005, 0.5, 3), strict=True)
        keys["damping"] = {"dry_friction": [{"stiffness": k, "moment": m} for k, m in sizes]}
    return keys


def curvature(section):
    """Curvature above rest by a moment, in units of the finger."""
    moment = ca.SX.sym("moment")
    numbers = section.numbers(0)
    history = section.pulled
    bend, total = section.form.curvature(0.5, moment, [0.0, 0.0], [], numbers, history)
    first = ca.gradient(bend, moment)
    second = ca.gradient(first, moment)
    return ca.Function("bend", [moment], [bend, first, second, total])


@pytest.mark.parametrize("seed", range(12))
def test_the_curvature_resists_the_moment(seed):
    """By Brent's method on formulas that are written again, with slopes by differences."""
    rng = np.random.default_rng(seed)
    keys = laws(rng)
    section = Section.of(finger(**keys), rounding=0.0)
    bent = curvature(section)
    for moment in rng.uniform(-1.0, 1.0, 12) * 10.0 ** rng.uniform(-1.0, 1.0):
        bend, slope, _, total = (float(each) for each in bent(moment / section.moment))
        exact = brentq(lambda k, m=moment: resisting(keys, k) - m, -1e5, 1e5, xtol=1e-13, rtol=1e-14)
        assert bend / LENGTH == pytest.approx(exact, rel=1e-8, abs=1e-9)
        assert total / LENGTH == pytest.approx(exact + keys.get("rest_curvature", 0.0), rel=1e-8, abs=1e-8)
        step = 1e-6 * max(abs(exact), 1e-3)
        before, after = (side * (resisting(keys, exact + side * step) - moment) / step for side in (-1.0, 1.0))
        if abs(before - after) < 1e-3 * abs(after):  # at no corner
            assert STIFFNESS / slope == pytest.approx(0.5 * (before + after), rel=1e-3)


def test_its_second_derivative_is_that_of_the_implicit_function():
    """For a moment m of the curvature it is -m'' / m'^3, here by differences."""
    keys = {
        "softening": {"curvature": 6.0, "stiffness_ratio": 0.2, "rounding": 1.0},
        "stops": {"curvature": 9.0, "stiffness_ratio": 5.0, "side": "left"},
    }
    section = Section.of(finger(**keys))
    bent = curvature(section)
    for k in (-8.0, -3.0, 1.0, 5.0, 8.0):
        step = 1e-3
        low, mid, high = (resisting(keys, k + j * step) for j in (-1, 0, 1))
        first, second = (high - low) / (2 * step), (high - 2 * mid + low) / step**2
        _, slope, curved, _ = (float(each) for each in bent(mid / section.moment))
        assert slope / STIFFNESS == pytest.approx(1.0 / first, rel=1e-5)
        assert curved / LENGTH / section.moment**2 == pytest.approx(-second / first**3, rel=1e-4)


def test_friction_states_of_a_history_hold_the_section():
    """Constant directions are constant moments; a state that moves on slides where its way exceeds one."""
    stiffness, limit = 0.02, 0.03
    of = finger(damping={"dry_friction": [{"stiffness": stiffness, "moment": limit}]})
    section = Section.of(of, rounding=0.0)
    for h, z, bend in ((0.0, 0.5, 3.0), (0.0, -1.0, 2.0), (1.0, 0.25, 1.2), (1.0, -0.5, 4.0)):
        moment = STIFFNESS * bend + limit * np.clip(z + h * stiffness / limit * bend, -1.0, 1.0)
        found, _ = section.form.curvature(0.3, moment / section.moment, [0.0, 0.0], [], section.numbers(0), [h, z])
        assert float(ca.DM(found)) / LENGTH == pytest.approx(bend, rel=1e-10)


def test_a_rounded_clip_is_odd_bounded_and_sharp_in_the_limit():
    ways = np.linspace(-3.0, 3.0, 61)
    sharp = np.clip(ways, -1.0, 1.0)

    def rounded(width):
        memory = Memory(1.0, 1.0, rounding=width)
        return np.array([float(memory.ways([0.0], lambda w=w: [w])[0]) for w in ways])

    assert rounded(0.0) == pytest.approx(sharp, abs=0.0)
    for width in (0.3, 0.03):
        values = rounded(width)
        assert values == pytest.approx(-values[::-1], abs=1e-15)
        assert np.all(np.diff(values) > 0.0)
        assert np.all(np.abs(values) < 1.0)
        assert np.abs(values - sharp).max() == pytest.approx(1.0 - 0.5 * (np.hypot(2.0, width) - width))


def test_at_rest_a_rod_keeps_its_length_and_carries_the_body_at_its_tip():
    assert Section.of(finger(gyration_radius=0.001)) == Section.of(finger())
    body = {"mass": 0.01, "rotary_inertia": 1e-4, "center_of_mass": [0.02, 0.03]}
    plain, loaded = Section.of(finger()), Section.of(finger(tip_body=body))
    assert (loaded.mass - plain.mass) * plain.force == pytest.approx(0.01)
    assert np.array(loaded.tip_arms) * plain.moment == pytest.approx([0.01 * 0.02, 0.01 * 0.03])


def test_the_path_of_a_tendon_at_rest_is_that_of_the_rest_curvature():
    """Winches need the length that the unloaded shape draws in: its integral, per offset."""
    drive = {"kind": "length", "time_constant": 0.05}
    tendons = [{**tendon, "axial_stiffness": 1e4, "series_stiffness": 3e4, "drive": drive} for tendon in TAPERED]
    rest = {"breaks": [0.07], "values": [4.0, -2.0]}
    section = Section.of(finger(tendons=tendons, rest_curvature=rest))
    s = (np.arange(200000) + 0.5) / 200000 * LENGTH
    expected = np.mean((1.0 - 0.6 * s / LENGTH) * np.where(s < 0.07, 4.0, -2.0)) * LENGTH
    assert section.form.sliding_names == ("slide_1",)
    assert section.rest_slides == pytest.approx([expected], abs=1e-4)
