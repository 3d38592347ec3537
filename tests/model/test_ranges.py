"""Default bending ranges: what real motions use of them, with few and with many elements."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.model import FingerModel, stumpff
from continuum_grasp.scene import BasePose, Damping, Finger, PointMass, Rod

ROD = Rod(length=0.6, linear_density=0.02, bending_stiffness=0.047)
CONE = {"to": 0.6, "thickness": [0.02, 0.005], "width": [0.02, 0.005]}


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_few_elements_have_a_third_of_a_turn_each(count):
    assert FingerModel(Finger(rod=ROD), elements=count).ranges == pytest.approx([2 * math.pi / 3] * count, rel=1e-15)


@pytest.mark.parametrize("count", [5, 16, 128])
def test_many_elements_share_twice_two_thirds_of_a_turn(count):
    ranges = FingerModel(Finger(rod=ROD), elements=count).ranges
    assert sum(ranges) == pytest.approx(math.radians(480.0), rel=1e-12)
    assert max(ranges) == pytest.approx(min(ranges), rel=1e-12)


def test_a_long_element_has_its_share_of_the_length():
    lengths = (0.3, *[0.3 / 7] * 7)
    assert FingerModel(Finger(rod=ROD), elements=lengths).ranges[0] == pytest.approx(2 * math.pi / 3, rel=1e-12)


def test_the_strain_limit_is_that_of_the_section_at_hand():
    rod = Rod.model_validate({"length": 0.6, "youngs_modulus": 2e6, "density": 1100.0, "sections": [CONE]})
    model = FingerModel(Finger(rod=rod, strain_limit=0.02), elements=8)
    ends = np.cumsum([0.0, *model.lengths])
    thinnest = 0.5 * (0.02 - 0.015 * ends[1:] / 0.6)  # at the end of each element
    assert np.array(model.ranges) == pytest.approx(0.02 / thinnest * np.array(model.lengths), rel=1e-9)


@pytest.mark.parametrize("count", [4, 16, 32])
@pytest.mark.parametrize("tapered", [False, True])
def test_motions_stay_within_them(count, tapered):
    """A finger that falls from level swings to two thirds of a turn, and uses what it does whatever its elements."""
    sections = {"length": 0.6, "youngs_modulus": 3e6, "density": 1100.0, "sections": [CONE]}
    rod = Rod.model_validate(sections) if tapered else ROD
    masses = () if tapered else (PointMass(at=0.6, mass=0.02),)
    damping = Damping(material=2e-3 * rod.stiffness)
    finger = Finger(rod=rod, damping=damping, masses=masses, base=BasePose(angle=-math.pi / 2))
    core = cg.compile(FingerModel(finger, family="clothoid", elements=count, tip_force=False))
    states = core.rollout(np.zeros(core.model.nx), 300, 2e-3, method="extrapolated_euler")
    shapes = states[:, : core.model.n]
    use, bend = (np.array(core.batch(name, shapes, None, None)) for name in ("range_use", "bending"))
    assert np.abs(bend.sum(axis=1)).max() > 1.2
    assert 0.2 < use.max() <= 1.0


@pytest.mark.parametrize("reach", [7.0, 20.0])
def test_clothoids_are_evaluated_beyond_one_turn(reach):
    """The kinetic energy of curvatures that change by half, of the ends of one rod: its own integral by 400 nodes."""
    model = FingerModel(Finger(rod=ROD), family="clothoid", elements=1, bending_range=reach, accuracy=1e-9)
    x, w = np.polynomial.legendre.leggauss(400)
    u, w = 0.5 * (x + 1.0), 0.5 * w
    q = np.array([0.5, 1.0]) * reach / 0.6
    angle, shapes = 0.6 * (q[0] * u + (q[1] - q[0]) * u**2 / 2), 0.6 * np.array([u - u**2 / 2, u**2 / 2])
    tangent = np.array([-np.sin(angle), np.cos(angle)])
    assert np.array(model.tip(q, [0.0] * model.nu, [])).ravel() == pytest.approx(0.6 * tangent @ w, abs=1e-9)
    normal = -np.array([np.cos(angle), np.sin(angle)])
    running = np.polynomial.legendre.legvander(x, 399)
    series = (2 * np.arange(400) + 1)[:, None] * running.T * w  # values to Legendre coefficients
    upto = np.array([[0.3 * np.polynomial.legendre.legval(x, np.polynomial.legendre.legint(series @ (n * s), lbnd=-1))
                      for n in normal] for s in shapes])  # fmt: skip
    mass = 0.02 * 0.6 * np.einsum("akm,bkm,m->ab", upto, upto, w)
    found = np.array(model.mass_matrix(q, [0.0] * model.nu, []))
    assert found == pytest.approx(mass, rel=1e-8)


@pytest.mark.parametrize("count", [1, 3, 8, 40])
@pytest.mark.parametrize("turns", [0.0, 0.2, -1.54, 3.0])
def test_ranges_count_from_the_shape_at_rest(count, turns):
    """At least half of a straight finger's range is left on both sides of the shape at rest, and none is wider."""
    rest = turns * 2.0 * math.pi / ROD.length
    fingers = Finger(rod=ROD), Finger(rod=ROD, rest_curvature=rest)
    straight, coiled = (np.array(FingerModel(finger, elements=count).ranges) for finger in fingers)
    bent = abs(rest) * ROD.length / count
    assert coiled == pytest.approx(straight if bent < 0.5 * straight[0] else bent + 0.5 * straight, rel=1e-12)


def test_a_model_that_reaches_further_has_the_same_coordinates():
    model = FingerModel(Finger(rod=ROD), family="clothoid", elements=2, accuracy=1e-12)
    wide = model.reaching([12.0, 0.1])
    assert wide.ranges == (12.0, model.ranges[1])
    assert wide.q_names == model.q_names
    at, u = [2.0, -3.0, 1.0], [0.0] * model.nu
    assert np.array(wide.mass_matrix(at, u, [])) == pytest.approx(np.array(model.mass_matrix(at, u, [])), rel=1e-10)


@pytest.mark.parametrize("reach", [6.2, 6.4, 15.0, 40.0])
def test_stumpff_functions_are_exact_over_many_turns(reach):
    """c_k by numpy's own quadrature: the integral of (1 - v)^(k-1) cos(v theta) / (k-1)! over [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(60)
    v, w = 0.5 * (x + 1.0), 0.5 * w
    for angle in np.linspace(-reach, reach, 7):
        found = [float(c) for c in stumpff(float(angle), angle_range=reach)]
        truth = [math.cos(angle)] + [
            float(w @ ((1.0 - v) ** (k - 1) * np.cos(v * angle))) / math.factorial(k - 1) for k in range(1, 8)
        ]
        assert found == pytest.approx(truth, abs=1e-13)


def test_the_range_of_a_winch_ends_before_its_tendon_turns_inside_out():
    """A stated one is refused there; a finger that is bent so far at rest, too."""
    drive = {"kind": "length", "time_constant": 0.05}
    tendons = {"offset": 0.1, "max_tension": 10.0, "axial_stiffness": 1e4, "series_stiffness": 1e4, "drive": drive}
    finger = Finger.model_validate({"rod": ROD, "tendons": tendons})
    (reach, _) = FingerModel(finger, elements=2).ranges
    assert reach == pytest.approx(2 * math.pi / 3)
    short = Finger.model_validate({"rod": ROD, "tendons": {**tendons, "offset": 0.2}})
    assert FingerModel(short, elements=2).ranges[0] == pytest.approx(0.9 * 0.3 / 0.2)
    with pytest.raises(InputError, match=r"may bend by 1\.6 rad"):
        FingerModel(short, elements=2, bending_range=1.6)
    with pytest.raises(InputError, match=r"is bent at rest by 1\.8 rad"):
        FingerModel(short.replaced(rest_curvature=6.0), elements=2)
