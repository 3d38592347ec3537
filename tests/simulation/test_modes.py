"""Natural frequencies, damping ratios and mode shapes against closed forms and an independent Ritz method."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy import linalg, special

from continuum_grasp.simulation import equilibrium, modes
from tests.closed_forms.rods import beam_pulsations, roots
from tests.rods import HANGING, NITINOL, UNIT, UPRIGHT, force, order, rod_scene, without_compiler  # noqa: F401

pytestmark = pytest.mark.usefixtures("without_compiler")

FREE = (0.0, 0.0)


def ritz(mass_ratio: float, gravity: float, terms: int = 10) -> np.ndarray:
    """Angular frequencies about the straight unit rod with tip mass under gravity along it (positive: it hangs).

    Small deflections: int w''^2 / 2 + int N w'^2 / 2 with the tension N of the weight below.
    """
    basis = [Polynomial([0.0, 0.0, 1.0]) * Polynomial(special.sh_legendre(k).coef[::-1]) for k in range(terms)]
    tension = gravity * Polynomial([1.0 + mass_ratio, -1.0])

    def integral(f: Polynomial) -> float:
        whole = f.integ()
        return whole(1.0) - whole(0.0)

    stiffness = [[integral(a.deriv(2) * b.deriv(2) + tension * a.deriv() * b.deriv()) for a in basis] for b in basis]
    mass = [[integral(a * b) + mass_ratio * a(1.0) * b(1.0) for a in basis] for b in basis]
    return np.sqrt(linalg.eigvalsh(stiffness, mass))


def pulsations(scene) -> np.ndarray:
    """Angular frequencies that the package finds [rad/s]."""
    return 2.0 * math.pi * modes(scene).frequencies_hz


@pytest.mark.parametrize(
    ("family", "elements", "first", "second"),
    [
        ("arc", 2, "5.08", "70.6"),
        ("clothoid", 1, "0.475", "58"),
        ("matched_clothoid", 2, "0.170", "1.11"),
        ("arc", 3, "2.20", "18.2"),
        ("clothoid", 2, "0.062", "0.97"),
        ("matched_clothoid", 3, "0.028", "0.92"),
        ("arc", 8, "0.30", "2.2"),
    ],
)
def test_clamped_free_frequencies_have_the_errors_of_the_table(family, elements, first, second):
    found = pulsations(rod_scene(UNIT, family, elements, gravity=FREE))
    errors = 100.0 * (found[:2] / beam_pulsations(2) - 1.0)
    for error, printed in zip(errors, (first, second), strict=True):
        digits = len(printed.partition(".")[2])
        # One unit of the last digit: the table cuts 5.085 to 5.08.
        assert error == pytest.approx(float(printed), abs=10.0**-digits)


@pytest.mark.parametrize(("family", "highest"), [("matched_clothoid", 22.3), ("arc", 37.6)])
def test_the_highest_frequency_of_two_unknowns(family, highest):
    assert pulsations(rod_scene(UNIT, family, 2, gravity=FREE))[-1] == pytest.approx(highest, abs=0.05)


@pytest.mark.parametrize("mass_ratio", [0.1, 1.0, 10.0, 100.0])
def test_a_tip_mass_lowers_the_frequencies_as_the_rods_equation_says(mass_ratio):
    expected = beam_pulsations(3, mass_ratio)
    found = pulsations(rod_scene(UNIT, "clothoid", 8, gravity=FREE, tip_mass=mass_ratio))
    assert found[:3] / expected - 1.0 == pytest.approx([0.0, 0.0, 0.0], abs=2e-3)
    assert found[0] / expected[0] - 1.0 == pytest.approx(0.0, abs=5e-6)
    two = pulsations(rod_scene(UNIT, "matched_clothoid", 2, gravity=FREE, tip_mass=mass_ratio))
    assert two[0] == pytest.approx(expected[0], rel=2e-3)


def test_the_two_independent_truths_agree():
    for mass_ratio in (0.0, 1.0):
        assert ritz(mass_ratio, 0.0)[:2] == pytest.approx(beam_pulsations(2, mass_ratio), rel=1e-7)


@pytest.mark.parametrize("mass_ratio", [0.0, 2.0])
def test_hanging_raises_and_standing_lowers_the_frequencies(mass_ratio):
    gravity = 0.6
    found = {}
    for name, angle in (("hanging", HANGING), ("standing", UPRIGHT)):
        scene = rod_scene(UNIT, "clothoid", 8, angle=angle, gravity=(0.0, -gravity), tip_mass=mass_ratio)
        found[name] = pulsations(scene)[:2]
        truth = ritz(mass_ratio, gravity if name == "hanging" else -gravity)[:2]
        assert found[name] / truth - 1.0 == pytest.approx([0.0, 0.0], abs=2e-4)
        assert found[name][0] / truth[0] - 1.0 == pytest.approx(0.0, abs=1e-5)
    free = beam_pulsations(2, mass_ratio)
    assert np.all(found["standing"] < free)
    assert np.all(free < found["hanging"])


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
@pytest.mark.parametrize("elements", [2, (0.5, 0.2, 0.3)], ids=["2", "unequal"])
def test_material_damping_gives_its_ratio(family, elements):
    """Kelvin-Voigt damping is proportional to the stiffness: zeta = eta omega / 2 E I, with the tip mass too."""
    damping = {"damping": {"material": 0.013}}
    found = modes(
        rod_scene({**UNIT, "bending_stiffness": 1.7}, family, elements, gravity=FREE, tip_mass=0.4, finger=damping)
    )
    expected = 0.013 * 2.0 * math.pi * found.frequencies_hz / (2.0 * 1.7)
    assert found.damping_ratios == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_modes_are_orthogonal_and_normalized(family):
    """About a bent equilibrium, where mass and stiffness are full."""
    scene = rod_scene(NITINOL, family, 3, tip_mass=0.02, loads=[force(0.6, (0.1, 0.4))])
    found = modes(scene, points=31)
    at = found.equilibrium
    mass = np.array(at.model.mass_matrix(at.q, at.u, at.p))
    stiffness = np.array(at.model.statics(at.q, at.u, at.w, at.p)[1])
    v = found.coordinates
    assert v @ mass @ v.T == pytest.approx(np.eye(at.model.n), abs=1e-11)
    expected = np.diag((2.0 * math.pi * found.frequencies_hz) ** 2)
    assert v @ stiffness @ v.T == pytest.approx(expected, abs=1e-9 * expected.max())
    assert np.all(np.diff(found.frequencies_hz) > 0.0)
    assert found.backbone.shape == (31, 2)
    assert found.shapes.shape == (at.model.n, 31, 2)
    assert np.linalg.norm(found.shapes, axis=2).max(axis=1) == pytest.approx(np.ones(at.model.n))
    assert found.backbone[-1] == pytest.approx(at.tip, abs=1e-14)


def test_mode_shapes_are_those_of_the_beam():
    """The beam's are cosh - cos - sigma (sinh - sin), up to size and sign."""
    found = modes(rod_scene(UNIT, "clothoid", 8, gravity=FREE), points=41)
    s = np.linspace(0.0, 1.0, 41)
    for shape, k in zip(found.shapes, np.sqrt(beam_pulsations(2)), strict=False):
        sigma = (math.cosh(k) + math.cos(k)) / (math.sinh(k) + math.sin(k))
        beam = np.cosh(k * s) - np.cos(k * s) - sigma * (np.sinh(k * s) - np.sin(k * s))
        assert np.abs(shape[:, 0]).max() < 1e-12
        assert shape[:, 1] * np.sign(shape[-1, 1]) == pytest.approx(beam / beam[-1], abs=2e-3)


@pytest.mark.parametrize("load", [5.0, 10.0, 15.0])
def test_frequencies_under_a_following_load(load):
    """Beck's column, stable up to 20.05: the first frequency rises with the load, the second falls."""

    def missing(pulsation: float) -> float:
        root = math.hypot(0.5 * load, pulsation)
        a, b = math.sqrt(root + 0.5 * load), math.sqrt(root - 0.5 * load)
        waves = load * pulsation * math.sin(a) * math.sinh(b)
        return load**2 + 2.0 * pulsation**2 * (1.0 + math.cos(a) * math.cosh(b)) + waves

    truth = roots(missing, 1.0, 25.0)
    scene = rod_scene(UNIT, "clothoid", 8, angle=UPRIGHT, gravity=FREE, loads=[force(1.0, (0.0, -load), follows=True)])
    found = modes(scene)
    assert found.stable
    assert 2.0 * math.pi * found.frequencies_hz[:2] == pytest.approx(truth, rel=1e-3)


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_about_an_unstable_equilibrium_one_frequency_is_zero(family):
    damping = {"damping": {"material": 0.01}}
    scene = rod_scene(UNIT, family, 2, angle=UPRIGHT, gravity=(0.0, -10.0), finger=damping)
    standing = modes(scene, about=equilibrium(scene, stable=False))
    assert not standing.stable
    assert standing.frequencies_hz[0] == 0.0
    assert math.isnan(standing.damping_ratios[0])
    assert np.all(standing.frequencies_hz[1:] > 0.0)
    assert np.all(standing.damping_ratios[1:] > 0.0)
    leaning = modes(scene)
    assert leaning.stable
    assert np.all(leaning.frequencies_hz > 0.0)
    assert abs(leaning.backbone[-1, 0]) > 0.1
