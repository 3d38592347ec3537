"""Natural frequencies of the exact rod against beam theory."""

from __future__ import annotations

import math

import numpy as np
import pytest

from continuum_grasp.rod import natural_frequencies, solve_elastica
from tests.closed_forms.rods import beam_pulsations, roots
from tests.rods import UNIT, UPRIGHT, force, rod_scene

FREE = (0.0, 0.0)


def exact(scene, count=2):
    return natural_frequencies(scene.finger, solve_elastica(scene), count)


@pytest.mark.parametrize("mass", [0.0, 0.1, 1.0, 100.0])
def test_the_straight_rod_is_the_beam(mass):
    scene = rod_scene(UNIT, gravity=FREE, tip_mass=mass)
    assert exact(scene, 3) == pytest.approx(beam_pulsations(3, mass) / (2.0 * math.pi), rel=1e-9)


def test_a_mass_inside_counts_with_the_square_of_the_mode():
    """Rayleigh: to first order in the mass, its kinetic energy in the unchanged mode lowers the frequency."""
    bare = exact(rod_scene(UNIT, gravity=FREE), 1)[0]
    b = math.sqrt(2.0 * math.pi * bare)
    sigma = (math.cosh(b) + math.cos(b)) / (math.sinh(b) + math.sin(b))

    def mode(s: float) -> float:
        return math.cosh(b * s) - math.cos(b * s) - sigma * (math.sinh(b * s) - math.sin(b * s))

    mass, at = 1e-5, 0.6
    scene = rod_scene(UNIT, gravity=FREE, finger={"masses": [{"at": at, "mass": mass}]})
    # The mode is normalized: the integral of its square over the unit rod is one.
    assert (exact(scene, 1)[0] / bare - 1.0) / mass == pytest.approx(-0.5 * mode(at) ** 2, rel=1e-4)


def test_a_body_at_the_tip_is_that_of_beam_theory():
    """Its center of mass ahead of the tip: shear force and moment there are those that accelerate it."""
    mass, inertia, ahead = 0.3, 0.02, 0.15

    def characteristic(omega: float) -> float:
        b = math.sqrt(omega)
        s, c, sh, ch = math.sin(b), math.cos(b), math.sinh(b), math.cosh(b)
        shapes = [(ch - c, sh + s, ch + c, sh - s), (sh - s, ch - c, sh + s, ch + c)]
        rows = []
        for w, slope, bend, shear in shapes:
            moved, moment = w + ahead * b * slope, (inertia + mass * ahead**2) * b * slope + mass * ahead * w
            rows.append([b**2 * bend - omega**2 * moment, b**3 * shear + omega**2 * mass * moved])
        return float(np.linalg.det(rows))

    body = {"mass": mass, "rotary_inertia": inertia, "center_of_mass": [0.0, ahead]}
    found = exact(rod_scene(UNIT, "clothoid", gravity=FREE, finger={"tip_body": body}), 3)
    assert 2.0 * math.pi * found == pytest.approx(roots(characteristic, 0.5, 40.0)[:3], rel=1e-9)


def test_an_unstable_pose_has_a_frequency_of_zero():
    column = rod_scene(UNIT, angle=UPRIGHT, gravity=FREE, loads=[force(1.0, (0.0, -2.6))])
    standing = natural_frequencies(column.finger, solve_elastica(column, stable=False))
    assert standing[0] == 0.0
    assert standing[1] > 0.0
