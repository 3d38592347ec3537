"""Graded rods: their curves against closed forms, and what is refused."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.scene import SpiRob

LENGTH, MODULUS, DENSITY = 0.25, 2e6, 1100.0
MATERIAL = {"length": LENGTH, "youngs_modulus": MODULUS, "density": DENSITY}
SPIRAL = {"base_thickness": 0.04, "tip_thickness": 0.005, "units": 24, "core": 0.12}
SOFT = "youngs_modulus: 1e6\n    density: 1e3\n    "
PLAIN = "bending_stiffness: 1, linear_density: 1"
HEAD = "schema_version: 1\ngravity: [0, 0]\nfinger:\n  rod:\n    length: 0.25\n"


def sections(*parts, **rod):
    return cg.Rod(**{**MATERIAL, **rod}, sections=parts)


def along(first, last):
    return lambda s: first + (last - first) * np.asarray(s) / LENGTH


def test_a_cone_has_the_stiffness_and_mass_of_its_sections():
    rod, s = sections({"to": LENGTH, "diameter": [0.02, 0.005]}), np.linspace(0.0, LENGTH, 7)
    d, profile = along(0.02, 0.005)(s), rod.profile
    assert profile.bending_stiffness(s) == pytest.approx(MODULUS * math.pi * d**4 / 64, rel=1e-13)
    assert profile.linear_density(s) == pytest.approx(DENSITY * math.pi * d**2 / 4, rel=1e-13)
    assert profile.rotary_inertia(s) == pytest.approx(DENSITY * math.pi * d**4 / 64, rel=1e-13)
    assert profile.half_thickness(s) == pytest.approx(d / 2, rel=1e-13)
    # a truncated cone: pi L (R^2 + R r + r^2) / 3
    assert rod.mass == pytest.approx(DENSITY * math.pi * LENGTH * (0.01**2 + 0.01 * 0.0025 + 0.0025**2) / 3, rel=1e-13)


def test_a_rectangle_of_a_graded_material():
    part = {"to": LENGTH, "thickness": [0.02, 0.01], "width": [0.03, 0.01], "youngs_modulus": [1e6, 3e6]}
    rod, s = sections(part, youngs_modulus=None), np.linspace(0.0, LENGTH, 7)
    h, w, modulus = along(0.02, 0.01)(s), along(0.03, 0.01)(s), along(1e6, 3e6)(s)
    assert rod.profile.bending_stiffness(s) == pytest.approx(modulus * w * h**3 / 12, rel=1e-13)
    assert rod.profile.rotary_inertia(s) == pytest.approx(DENSITY * w * h**3 / 12, rel=1e-13)


def test_sections_jump():
    rod = sections(
        {"to": 0.1, "diameter": 0.02},
        {"to": LENGTH, "bending_stiffness": 1e-3, "linear_density": 0.1, "thickness": 0.01, "rest_curvature": [1, 4]},
    )
    stiffness, rest = rod.profile.bending_stiffness, rod.profile.rest_curvature
    assert stiffness.jumps == (0.1,)
    assert stiffness([0.1, 0.2]) == pytest.approx([MODULUS * math.pi * 0.02**4 / 64, 1e-3])
    assert float(stiffness(0.1, tip_side=True)) == 1e-3
    assert rest([0.05, 0.1, 0.175, LENGTH]) == pytest.approx([0.0, 0.0, 2.5, 4.0])
    assert rod.profile.rotary_inertia(0.2) == 0.0
    finger = cg.Finger(rod=rod, strain_limit=0.05)
    assert finger.curvature_limit_at([0.05, 0.1, 0.2]) == pytest.approx([5.0, 5.0, 10.0])
    assert finger.curvature_limit == pytest.approx(5.0)


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_equal_sections_are_a_uniform_rod(count):
    rod = sections(*({"to": LENGTH * (k + 1) / count, "diameter": 0.01} for k in range(count)))
    uniform = cg.Rod(**MATERIAL, diameter=0.01)
    assert rod.profile.uniform
    assert rod.profile.breaks == ()
    for of in ("stiffness", "mass_per_length", "inertia_per_length", "mass"):
        assert getattr(rod, of) == pytest.approx(getattr(uniform, of), rel=1e-14)


def test_a_rod_of_one_section_may_be_a_rectangle_and_taper():
    shape = {"thickness": (0.012, 0.004), "width": 0.02}
    rod, section = cg.Rod(**MATERIAL, **shape), sections({"to": LENGTH, **shape})
    assert (rod.graded, rod.parted, rod.profile) == (True, False, section.profile)
    strip = cg.Rod(**MATERIAL, thickness=0.001, width=0.02)
    assert (strip.graded, strip.stiffness) == (False, pytest.approx(MODULUS * 0.02 * 0.001**3 / 12, rel=1e-14))


def test_samples_are_monotone_cubics_of_logarithms():
    at, stiffness = [0.0, 0.05, 0.06, 0.2, LENGTH], [2e-3, 1e-3, 1e-6, 0.9e-6, 2e-5]
    mass, rest, thick = [0.3, 0.2, 1e-3, 1e-3, 1e-2], [0.0, 5.0, -5.0, 0.0, 0.0], [0.02, 0.02, 0.01, 0.01, 0.012]
    given = {"bending_stiffness": stiffness, "linear_density": mass, "rest_curvature": rest, "thickness": thick}
    rod = cg.Rod(length=LENGTH, samples={"at": at, **given})
    s, profile = np.linspace(0.0, LENGTH, 501), rod.profile
    found = profile.bending_stiffness(s)
    assert profile.bending_stiffness(at) == pytest.approx(stiffness, rel=1e-12)
    assert found == pytest.approx(np.exp(PchipInterpolator(at, np.log(stiffness))(s)), rel=1e-12)
    assert 0.9e-6 * (1 - 1e-12) <= found.min() <= found.max() <= 2e-3 * (1 + 1e-12)
    assert profile.rest_curvature(s) == pytest.approx(PchipInterpolator(at, rest)(s), abs=1e-12)
    assert profile.half_thickness(at) == pytest.approx(0.5 * np.array(thick), rel=1e-12)
    pieces = (quad(lambda s: float(profile.linear_density(s)), a, b, epsabs=0)[0] for a, b in pairwise(at))
    assert rod.mass == pytest.approx(sum(pieces), rel=1e-9)


def test_a_spirob_is_a_straightened_spiral():
    """Its gaps closed, it is the spiral again: neighboring turns touch all along, and angles and lengths agree."""
    rod = cg.Rod(**MATERIAL, spirob=SPIRAL)
    spiral, s = SpiRob(**SPIRAL), np.linspace(0.0, LENGTH, 5)
    h, b = along(0.04, 0.005)(s), spiral.growth(LENGTH)
    # central line r = c exp(b t): its length from the apex is r sqrt(1 + b^2) / b
    apex = LENGTH * 0.04 / 0.035 - s
    radius = b * apex / math.sqrt(1 + b * b)
    # the inner boundary is the outer one of the turn within
    assert radius - h / 2 == pytest.approx((radius + h / 2) * math.exp(-2 * math.pi * b), rel=1e-12)
    turn = math.log(8.0) / b
    assert spiral.unit_angle(LENGTH) * 24 == pytest.approx(turn, rel=1e-12)
    curvature = 1 / (radius * math.sqrt(1 + b * b))
    assert curvature == pytest.approx(2 * math.tanh(math.pi * b) / (math.sqrt(1 + b * b) * h), rel=1e-12)
    edges = np.array(spiral.edges(LENGTH))
    assert edges[[0, -1]].tolist() == [0.0, LENGTH]
    # units are similar: each is shorter than the one before by the same factor
    assert np.diff(edges)[1:] / np.diff(edges)[:-1] == pytest.approx(8 ** (-1 / 24), rel=1e-9)
    # the layer bends, the whole body is moved
    assert rod.profile.bending_stiffness(s) == pytest.approx(MODULUS * h * (0.12 * h) ** 3 / 12, rel=1e-12)
    assert rod.profile.linear_density(s) == pytest.approx(DENSITY * h**2, rel=1e-12)
    assert rod.profile.half_depth(s) == pytest.approx(0.06 * h, rel=1e-12)
    assert rod.profile.half_thickness(s) == pytest.approx(0.5 * h, rel=1e-12)


def test_a_finger_gives_what_the_rod_leaves_open():
    rod = sections({"to": LENGTH, "diameter": 0.01})
    finger = cg.Finger(rod=rod, rest_curvature={"breaks": [0.1], "values": [1.0, 2.0]}, half_thickness=0.008)
    assert finger.profile.rest_curvature([0.05, 0.2]).tolist() == [1.0, 2.0]
    assert finger.profile.half_thickness(0.2) == 0.008
    assert finger.thickness_radius == 0.008


WRONG = {
    "a section that is no shape": (
        "sections: [{to: 0.25, thickness: 0.01}]",
        "6:16: finger.rod.sections[0]: a section needs thickness and width",
    ),
    "two shapes": (
        "sections: [{to: 0.25, thickness: 0.01, width: 1, diameter: 0.01}]",
        "finger.rod.sections[0].thickness: is not allowed in a round",
    ),
    "half a stiffness": (
        "sections: [{to: 0.25, bending_stiffness: 1}]",
        "sections[0].bending_stiffness: bending_stiffness needs linear_density",
    ),
    "a width of nothing": (
        "sections: [{to: 0.25, PLAIN, width: 1}]",
        "sections[0].width: has no effect",
    ),
    "no stiffness": (
        "sections: [{to: 0.25, bending_stiffness: [1, 0], linear_density: 1}]",
        "sections[0].bending_stiffness[1]: out of range: expected a number greater than 0",
    ),
    "no material": (
        "sections: [{to: 0.25, diameter: 0.01}]",
        "finger.rod.sections[0]: sections[0] needs youngs_modulus",
    ),
    "a material of nothing": (
        "youngs_modulus: 1e6\n    sections: [{to: 0.25, PLAIN}]",
        "6:21: finger.rod.youngs_modulus: no section needs it as one number",
    ),
    "a material that changes along every section": (
        "youngs_modulus: [1e6, 2e6]\n    density: 1e3\n    sections: [{to: 0.25, diameter: 0.01}]",
        "6:21: finger.rod.youngs_modulus: no section needs it as one number",
    ),
    "an end before the tip": (
        "sections: [{to: 0.2, diameter: 0.01}]",
        "6:21: finger.rod.sections[0].to: sections[0].to = 0.2 m: the last section must end at the length of 0.25 m",
    ),
    "jumps on each other": (
        "SOFT sections: [{to: 0.1, diameter: 0.01}, {to: 0.1000001, diameter: 0.02}, {to: 0.25, diameter: 0.01}]",
        "finger.rod.sections[1]: 0.1 m and 0.1000001 m are closer than 1e-06 of the length",
    ),
    "sections backwards": (
        "SOFT sections: [{to: 0.1, diameter: 0.01}, {to: 0.05, diameter: 0.02}, {to: 0.25, diameter: 0.01}]",
        "finger.rod.sections[1].to: sections[1].to = 0.05 m is not beyond 0.1 m",
    ),
    "a point": (
        "SOFT sections: [{to: 0.25, diameter: [0.02, 1e-6]}]",
        "finger.rod.sections[0]: a thickness of 1e-06 m is less than 0.001 of the base's",
    ),
    "stiffness of a point": (
        "sections: [{to: 0.25, bending_stiffness: [1, 1e-13], linear_density: 1}]",
        "sections[0]: a bending stiffness of 1e-13 N m2",
    ),
    "a block": (
        "SOFT sections: [{to: 0.25, diameter: 0.1}]",
        "a thickness of 0.1 m is more than a third of the length",
    ),
    "thickness of one alone": (
        "sections: [{to: 0.1, PLAIN}, {to: 0.25, PLAIN, thickness: 0.01}]",
        "finger.rod.sections[0]: sections[0] needs a thickness",
    ),
    "beside a uniform rod": (
        "diameter: 0.01\n    sections: [{to: 0.25, PLAIN}]",
        "6:15: finger.rod.diameter: works only for a rod of one section",
    ),
    "samples that do not increase": (
        "samples: {at: [0, 0.2, 0.1, 0.25], bending_stiffness: [1, 1, 1, 1], linear_density: [1, 1, 1, 1]}",
        "finger.rod.samples.at: at must increase",
    ),
    "one sample": (
        "samples: {at: [0], bending_stiffness: [1], linear_density: [1]}",
        "finger.rod.samples.at: too short: expected at least 2",
    ),
    "samples that begin late": (
        "samples: {at: [0.1, 0.25], bending_stiffness: [1, 1], linear_density: [1, 1]}",
        "6:20: finger.rod.samples.at[0]: at[0] = 0.1 m: the first sample must be at 0",
    ),
    "samples that end early": (
        "samples: {at: [0, 0.2], bending_stiffness: [1, 1], linear_density: [1, 1]}",
        "finger.rod.samples.at: the last, 0.2 m, must be the length",
    ),
    "samples that miss": (
        "samples: {at: [0, 0.25], bending_stiffness: [1], linear_density: [1, 1]}",
        "finger.rod.samples.bending_stiffness: bending_stiffness must have one entry per position (2), got 1",
    ),
    "a material beside samples": (
        "density: 1e3\n    samples: {at: [0, 0.25], bending_stiffness: [1, 1], linear_density: [1, 1]}",
        "finger.rod.density: samples have their own",
    ),
    "two kinds": (
        "sections: [{to: 0.25, PLAIN}]\n    samples: {at: [0, 1], bending_stiffness: [1, 1], linear_density: [1, 1]}",
        "7:14: finger.rod.samples: sections are given: give one of both",
    ),
    "a spiral of nothing": (
        "spirob: {base_thickness: 0.04, tip_thickness: 0.005, units: 24, core: 0.1}",
        "finger.rod.spirob: spirob needs youngs_modulus and density of the rod",
    ),
    "a spiral that widens": (
        "spirob: {base_thickness: 0.004, tip_thickness: 0.005, units: 24, core: 0.1}",
        "finger.rod.spirob.tip_thickness: tip_thickness = 0.005 m is not below",
    ),
    "few units": (
        "SOFT spirob: {base_thickness: 0.04, tip_thickness: 0.005, units: 3, core: 0.1}",
        "finger.rod.spirob.units: spirob.units = 3: each would turn by 255 degrees; use more units",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_rod_is_refused_at_its_place(name, tmp_path, monkeypatch):
    text, words = WRONG[name]
    monkeypatch.chdir(tmp_path)
    text = text.replace("SOFT ", SOFT).replace("PLAIN", PLAIN)
    (tmp_path / "scene.yaml").write_text(f"{HEAD}    {text}\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        cg.load("scene.yaml")
    assert words in str(caught.value)
    assert caught.value.line in (6, 7, 8)
