"""Default bending ranges: what real motions use of them, with few and with many elements."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.model import FingerModel
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
