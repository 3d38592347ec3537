"""Hands that are pushed or turned, by closed forms, at constant tensions: stiffness of the object, and stability."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from continuum_grasp.grasp import certify
from tests import hand_cases as cases
from tests.hand_cases import LENGTH, STIFFNESS
from tests.marks import but

ROUND = {"shape": "round", "poissons_ratio": 0.3}
TORSION = STIFFNESS / 1.3


def compliance(scene, arrays):
    """Motion (6, 6) of the object per wrench: shifts and turns per force and moment."""
    return np.linalg.inv(certify(scene, arrays).pushed.stiffness)


# -- stiffness against turns about the axis ---------------------------------------------------------------------------


@pytest.mark.parametrize("half", [1e-5, 0.006])
def test_straight_tips_are_springs_against_a_turn(half):
    """Each yields to the side by bending, and by its twist by the skin's arm."""
    radius = 0.03
    each = LENGTH**3 / 3 / STIFFNESS + half**2 * LENGTH / TORSION
    found = compliance(*cases.three_straight(1e-5, radius, half, ROUND))
    assert found[5, 5] == pytest.approx(each / (3 * radius**2), rel=2e-3)


def around(press, radius=0.025, half=1e-5, section=ROUND):
    """Three straight fingers that point to the center of a ball and press on its equator."""
    bases, touches = {}, []
    for k in range(3):
        out = np.array([math.cos(math.tau * k / 3), math.sin(math.tau * k / 3), 0.0])
        bases[f"finger_{k + 1}"] = ((radius + half + LENGTH) * out, -out, (0.0, 0.0, 1.0))
        touches.append((f"finger_{k + 1}.tip", radius * out, out, press * out, LENGTH, 0.0))
    ball = {"shape": "sphere", "diameter": 2 * radius, "mass": 0.0, "position": (0.0, 0.0, 0.0)}
    scene = cases.make_scene(bases, ball, section=section, half=half)
    return scene, cases.stored(scene, touches)


def tilting(stiffness, radius):
    """Press of each finger at which they turn the ball: a column under N yields to the side by (tan(z) / z - 1) L / N
    per force, z^2 = N L^2 / (E I), and the force does N r per turn: k r^2 = N r.
    """
    z = brentq(lambda z: math.tan(z) - z * (1.0 + radius / LENGTH), 1e-3, 0.5 * math.pi - 1e-9)
    return z**2 * stiffness / LENGTH**2


@pytest.mark.parametrize("radius", but([0.025], [0.005, 0.025]))
@pytest.mark.parametrize("width", [0.5e-3, 1e-3, 3e-3])
def test_what_presses_harder_than_its_springs_turns(radius, width):
    """About the axis where fingers are stiff to the side, else about a line across it."""
    section = {"shape": "ellipse", "thickness": 1e-3, "width": width}
    load = tilting(min(1.0, (width / 1e-3) ** 2) * STIFFNESS, radius)
    for share, stable in ((0.98, True), (1.02, False)):
        certificate = certify(*around(share * load, radius, section=section))
        assert certificate.passed, certificate.worst
        assert certificate.stable is stable
        assert (certificate.push > 0.0) is stable


def test_the_answer_to_wrenches_is_symmetric():
    """Maxwell and Betti: what a wrench does to another's motion."""
    certificate = certify(*around(0.05))
    wrench, _ = certificate.pushed._resisted
    assert wrench == pytest.approx(wrench.T, abs=1e-4 * np.abs(wrench).max())


# -- palm and table ---------------------------------------------------------------------------------------------------

MASS = 0.1
SIDE, EDGE = 0.04, 0.004
CORNER = math.sqrt(2.0) * (0.5 * SIDE - EDGE) + EDGE
"""Height of a cube's center where it stands on an edge."""
ON_EDGE = {"shape": "box", "extents": (SIDE,) * 3, "edge_radius": EDGE, "rotation": (0.0, 0.25 * math.pi, 0.0)}


def test_a_ball_rolls_on_a_table_and_nothing_resists():
    ball = {"shape": "sphere", "diameter": 0.05, "position": (0.0, 0.0, 0.1)}
    certificate = certify(*cases.resting(ball, [(0.0, 0.0, 0.0)], MASS))
    assert certificate.passed, certificate.worst
    assert not certificate.stable
    assert certificate.push == 0.0


@pytest.mark.parametrize("extents", [(0.04, 0.04, 0.1), (0.05, 0.03, 0.06)])
def test_an_egg_on_its_pole_topples(extents):
    egg = {"shape": "ellipsoid", "extents": extents, "position": (0.0, 0.0, 0.1)}
    assert not certify(*cases.resting(egg, [(0.0, 0.0, 0.0)], MASS)).stable


def test_a_box_on_an_edge_topples_over_it_and_one_on_its_face_does_not():
    on_edge = cases.resting({**ON_EDGE, "position": (0.0, 0.0, 0.1)}, [(0, y, 0) for y in (-0.016, 0.016)], MASS)
    certificate = certify(*on_edge)
    assert certificate.passed, certificate.worst
    assert not certificate.stable
    flat = {**ON_EDGE, "rotation": (0.0, 0.0, 0.3), "position": (0.0, 0.0, 0.1)}
    scene, arrays = cases.resting(flat, np.zeros((4, 3)), MASS)
    arrays["contact_positions"] = np.array([contact.position for contact in scene.support_contacts])
    certificate = certify(scene, arrays)
    assert certificate.passed, certificate.worst
    assert certificate.stable


# -- two ends ---------------------------------------------------------------------------------------------------------


def test_what_no_contact_holds_is_not_stable():
    certificate = certify(*cases.squeezed_box(0.0, 0.0))
    assert not certificate.stable
    assert certificate.push == 0.0


def test_a_box_between_two_ends_turns_about_the_line_between_them():
    """Two points leave that turn, which nothing resists."""
    assert not certify(*cases.squeezed_box(0.01, 0.0)).stable


def test_torsional_friction_holds_a_box_by_the_twist_of_both_fingers():
    """About the line between the ends it turns by a moment per 2 G J / L."""
    scene, arrays = cases.twisted_box(0.0, 0.01, 0.0, torsional_friction=0.01)
    ratio = 4.0
    torsion = 4 * ratio**2 / (1 + ratio**2) / (2 * 1.35) * STIFFNESS
    assert certify(scene, arrays).stable
    assert compliance(scene, arrays)[3, 3] == pytest.approx(LENGTH / (2.0 * torsion), rel=2e-3)


@pytest.mark.parametrize("width", but([4e-3], [0.5e-3, 4e-3]))
def test_a_finger_that_touches_nothing_buckles_alone(width):
    """A finger that stands on its base, 1.2 times as heavy as its weaker plane bears; the others lean on each other."""
    section = {"shape": "ellipse", "thickness": 1e-3, "width": width}
    weaker = min(1.0, (width / 1e-3) ** 2) * STIFFNESS
    other = {"free": ((0.08, 0.0, 0.0), (0, 0, -1), (0, 1, 0))}
    for share, stable in ((0.8, True), (1.2, False)):
        values = {"gravity": (0.0, 0.0, share * 7.837 * weaker / LENGTH**3), "density": 1.0}
        assert certify(*cases.three_straight(1e-3, 0.03, 1e-3, section, other, **values)).stable is stable
