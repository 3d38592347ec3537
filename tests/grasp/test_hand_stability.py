"""from inside: hands are tested from arrays made by hand: buckling loads, springs, and an independent chain."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import jv

from continuum_grasp.grasp import certify
from continuum_grasp.grasp.certificate.chain import LINKS, FingerChain
from continuum_grasp.grasp.certificate.space import CREEPS, SpatialStability
from continuum_grasp.grasp.hand.certificate import certify_hand
from continuum_grasp.grasp.hand.stability import (
    hand_response,
    hand_stability,
)
from continuum_grasp.scene import Circle, Rod, Tendons
from tests import certificate_cases as planar
from tests import hand_cases as cases
from tests.hand_cases import LENGTH, STIFFNESS

ROUND = {"shape": "round", "poissons_ratio": 0.3}
TORSION = STIFFNESS / 1.3
Y = np.array([0.0, 1.0, 0.0])


def hand_of(scene, arrays):
    return certify_hand(scene, arrays).hand


def critical(load, normal, section, links=LINKS, **more):
    """Factor on a load, or on the weight, at which a straight finger without object buckles."""

    def hessian(factor):
        values = {"gravity": tuple(factor * np.array(more["gravity"])), "density": more["density"]} if more else {}
        hand = hand_of(*cases.one_finger(factor * np.asarray(load), normal, section=section, half=1e-6, **values))
        return FingerChain(hand.fingers[0], hand.gravity, links).hessian()

    free = hessian(0.0)
    return -1.0 / eigh(hessian(1.0) - free, free, eigvals_only=True)[0]


# -- buckling ---------------------------------------------------------------------------------------------------------

PRANDTL = 2.0 * brentq(lambda x: jv(-0.25, x), 1.0, 3.0)
"""Of a cantilever under a dead force across its end: P L^2 = 4.013 sqrt(E I_l G J)."""


def test_prandtl_lateral_buckling_converges_with_the_square_of_the_links():
    assert abs(PRANDTL - 4.013) < 5e-4
    load = PRANDTL * math.sqrt(STIFFNESS * TORSION) / LENGTH**2
    errors = [critical((1, 0, 0), (1, 0, 0), ROUND, links) / load - 1.0 for links in (12, 24, 48)]
    assert abs(errors[1]) < 2e-3
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize(("width", "weaker"), [(4e-3, 1.0), (1e-3, 1.0), (0.5e-3, 0.25)])
def test_euler_buckling_is_in_the_weaker_plane(width, weaker):
    section = {"shape": "ellipse", "thickness": 1e-3, "width": width}
    load = math.pi**2 / 4 * weaker * STIFFNESS / LENGTH**2
    assert critical((0, -1, 0), (0, -1, 0), section) == pytest.approx(load, rel=2e-3)


@pytest.mark.parametrize("section", [ROUND, {"shape": "ellipse", "thickness": 1e-3, "width": 0.5e-3}])
def test_a_finger_buckles_under_its_own_weight(section):
    """A. G. Greenhill, 1881: w L^3 = 9 / 4 j^2 E I with j the first zero of the Bessel function of order -1/3."""
    weaker = 1.0 if section is ROUND else 0.25
    weight = 9 / 4 * brentq(lambda x: jv(-1 / 3, x), 1.0, 2.5) ** 2 * weaker * STIFFNESS / LENGTH**3
    found = critical((0, 0, 0), (0, -1, 0), section, gravity=-Y, density=1.0)
    assert found == pytest.approx(weight, rel=5e-3)


# -- stiffness against turns about the axis ---------------------------------------------------------------------------


@pytest.mark.parametrize("half", [1e-5, 0.006])
def test_straight_tips_are_springs_against_a_turn(half):
    """Each yields to the side by bending, and by its twist by the skin's arm."""
    radius = 0.03
    hand = hand_of(*cases.three_straight(1e-6, radius, half, ROUND))
    each = LENGTH**3 / 3 / STIFFNESS + half**2 * LENGTH / TORSION
    assert hand_response(hand).pose[5, 5] == pytest.approx(each / (3 * radius**2), rel=1e-3)


def test_pressing_tips_push_a_turn_on():
    """The force has its direction while its point moves on: k r^2 - N r each, as long as N is small."""
    radius, press = 0.03, 0.003
    hands = [hand_of(*cases.three_straight(n, radius, 1e-6, ROUND)) for n in (1e-6, press)]
    free, pressed = (1.0 / hand_response(hand).pose[5, 5] for hand in hands)
    assert pressed - free == pytest.approx(-3 * press * radius, rel=1e-3)


def test_what_presses_harder_than_its_springs_turns_about_the_axis():
    # From k r^2 = N r on, and a little before as the force also twists the fingers.
    stiff = 3 * STIFFNESS / LENGTH**3 * 0.03
    for part, stable in ((0.5, True), (1.1, False)):
        verdict = hand_stability(hand_of(*cases.three_straight(part * stiff, section=ROUND)))
        assert (verdict.eigenvalue > 0.0) is stable
    assert verdict.motion == "turns about the hand's axis"
    assert abs(verdict.mode[5]) > 0.9


def test_tensions_press_ends_that_are_held_as_a_moment_does_a_propped_beam():
    """All fingers alike: a moment M along a beam that is clamped and propped at its end presses there with 3 M / (2 L),
    and bends its middle outward by M L^2 / (32 EI) (superposition of a cantilever under a moment and under a force).
    """
    half = 1e-5
    scene, arrays = cases.three_straight(1e-6, half=half)
    response, fingers = hand_response(hand_of(scene, arrays), links=96), 3
    moments = np.tile([half, 0.0], fingers)  # of the tendons on the side to which fingers bend, per tension
    forces = response.forces_by_tension @ (moments > 0.0)
    outs = np.array([[math.cos(math.tau * k / 3), math.sin(math.tau * k / 3), 0.0] for k in range(fingers)])
    assert (forces * outs).sum(axis=1) == pytest.approx([1.5 * half / LENGTH] * fingers, rel=1e-3)
    for out, places, changes in zip(outs, response.places, response.places_by_tension, strict=True):
        middle = int(np.argmin(np.abs(places[:, 2] + 0.5 * LENGTH)))
        bulge = out @ (changes[middle] @ (moments > 0.0))
        assert bulge == pytest.approx(half * LENGTH**2 / (32.0 * STIFFNESS), rel=2e-3)


def test_tendon_friction_passes_on_the_share_of_a_capstan():
    """Along an arc that turns by a, the tension is T exp(-friction a s / L) inside, and rises as much outside."""
    turn, friction = 1.2, 0.3
    scene, arrays = cases.one_finger((0.0, 0.0, 0.0), (0, -1, 0), turn / LENGTH)
    scene = scene.changed({"hand.finger.tendons.friction": friction, "friction_states": "pulled"})
    (finger,) = hand_of(scene, arrays).fingers
    chain = FingerChain(finger, np.zeros(3), LINKS)
    (channel,) = finger.plane.finger.channels
    for arm in channel.arms:
        lost = math.copysign(friction * turn, arm)
        couples = np.linalg.norm(chain.pulled(channel, arm).reshape(-1, 3), axis=1)
        assert couples.mean() == pytest.approx(abs(arm) * (1.0 - math.exp(-lost)) / lost, rel=1e-4)


def test_a_response_balances_the_object():
    scene, arrays = independent(16, 1.0)
    response = hand_response(hand_of(scene, arrays))
    wrench = np.zeros((3, 6))
    wrench[:, :3] = np.eye(3)
    np.testing.assert_allclose(response.forces.sum(axis=0), wrench, atol=1e-9)
    np.testing.assert_allclose(response.forces_by_tension.sum(axis=0), 0.0, atol=1e-9)
    # Maxwell and Betti: what a wrench does to another's motion.
    np.testing.assert_allclose(response.pose, response.pose.T, atol=1e-9 * np.abs(response.pose).max())


# -- palm and table ---------------------------------------------------------------------------------------------------

REACH = 0.25 * LENGTH
"""Shift of the object that counts as much as a turn by 1 rad."""
MASS = 0.1
SIDE, EDGE = 0.04, 0.004
CORNER = math.sqrt(2.0) * (0.5 * SIDE - EDGE) + EDGE
"""Height of a cube's center where it stands on an edge."""
ON_EDGE = {"shape": "box", "extents": (SIDE,) * 3, "edge_radius": EDGE, "rotation": (0.0, 0.25 * math.pi, 0.0)}


def toppling(height, radius):
    """Eigenvalue of a body that rolls over, its center at a height above a surface of a radius [N m]."""
    return MASS * 9.81 * (radius - height) / (1.0 + (height / REACH) ** 2)


def test_a_ball_rolls_on_a_table_and_nothing_resists():
    ball = {"shape": "sphere", "diameter": 0.05, "position": (0.0, 0.0, 0.1)}
    certificate = certify_hand(*cases.resting(ball, [(0.0, 0.0, 0.0)], MASS))
    assert certificate.passed, certificate
    verdict = certificate.stability
    assert verdict.stiffness == pytest.approx(0.0, abs=1e-9)
    assert not verdict.stable


@pytest.mark.parametrize("extents", [(0.04, 0.04, 0.1), (0.05, 0.03, 0.06)])
def test_an_egg_on_its_pole_topples_about_its_longer_side(extents):
    """Radii of curvature at the pole are a^2 / c and b^2 / c, of which the lesser one holds up less."""
    a, b, c = (0.5 * extent for extent in extents)
    egg = {"shape": "ellipsoid", "extents": extents, "position": (0.0, 0.0, 0.1)}
    verdict = certify_hand(*cases.resting(egg, [(0.0, 0.0, 0.0)], MASS)).stability
    assert verdict.stiffness == pytest.approx(toppling(c, min(a, b) ** 2 / c), rel=1e-4)
    if b < a:
        assert verdict.motion == "tilts about x"


def test_a_box_on_an_edge_topples_over_it_and_one_on_its_face_does_not():
    on_edge = cases.resting({**ON_EDGE, "position": (0.0, 0.0, 0.1)}, [(0, y, 0) for y in (-0.016, 0.016)], MASS)
    certificate = certify_hand(*on_edge)
    assert certificate.passed, certificate
    assert certificate.stability.stiffness == pytest.approx(toppling(CORNER, EDGE), rel=1e-4)
    assert certificate.stability.motion == "tilts about y"
    flat = {**ON_EDGE, "rotation": (0.0, 0.0, 0.3), "position": (0.0, 0.0, 0.1)}
    scene, arrays = cases.resting(flat, np.zeros((4, 3)), MASS)
    arrays["contact_positions"] = np.array([contact.position for contact in scene.support_contacts])
    certificate = certify_hand(scene, arrays)
    assert certificate.passed, certificate
    assert certificate.stability.stable
    assert np.abs(hand_response(certificate.hand).pose).max() < 1e-9


def test_a_finger_holds_a_box_on_its_edge():
    """An inverted pendulum on a spring: k (2 c)^2 - m g (c - r), with the end stuck to the opposite edge."""
    base = ((0.0, 0.0, 2.0 * CORNER + 1e-6 + LENGTH), (0, 0, -1), (1, 0, 0))
    touch = ("finger.tip", (0, 0, 2.0 * CORNER), (0, 0, 1), (0, 0, 1e-6), LENGTH, 0.0)
    points = [(0, y, 0) for y in (-0.016, 0.016)]
    scene, arrays = cases.resting({**ON_EDGE, "position": (0.0, 0.0, 0.1)}, points, MASS, [touch], base, half=1e-6)
    response = hand_response(hand_of(scene, arrays))
    spring = 3.0 * STIFFNESS / LENGTH**3 * (2.0 * CORNER) ** 2
    assert response.pose[4, 4] == pytest.approx(1.0 / (spring - MASS * 9.81 * (CORNER - EDGE)), rel=3e-3)
    assert response.forces[:, :, 2].sum(axis=0) == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)


# -- an independent chain ---------------------------------------------------------------------------------------------

CENTERED = [
    ((-6.730591834054, -0.201598319201, 6.278126157994, 13.432083838067, 20.976316500769), 21.567249955356),
    0.2,
    [((0.0, 1.3625, -0.654), (0.0, 1.0, 0.0), (0.0, 0.035, -0.115223477103), 0.0)],
]
"""Three tips on an upright cylinder of 70 mm and 200 g, by an independent program with contacts in space: curvatures of
each finger at nodes [1/m] and its tension, the mass; of the first contact force, normal, place and displacement."""
ASIDE = [
    [
        ((-3.415458254554, 0.288708269137, 4.003103947925, 7.935192747813, 12.098932171274), 12.467975080434273),
        ((-1.545776614561, 1.406834012994, 4.415311620328, 7.583543868024, 10.876434924885), 11.16140885927342),
        ((-2.584389633873, 0.800788787162, 4.221960853546, 7.838189031196, 11.635800333653), 11.968366128011487),
    ],
    0.1,
    [
        (
            (-0.052910302422, 0.755719433271, -0.36351364395),
            (-0.058765564133, 0.998271810917, 0.0),
            (-5.679474380871e-05, 3.793951336785e-02, -1.179970771883e-01),
            0.00040938812860554993,
        ),
        (
            (-0.494955275616, -0.331586861443, -0.285668536719),
            (-0.841598954621, -0.54010295276, 0.0),
            (-0.0274559634, -0.015903603339, -0.117108931981),
            0.0003266032059755227,
        ),
        (
            (0.547865578036, -0.424132571828, -0.331817819331),
            (0.808202951765, -0.588904057346, 0.0),
            (0.0302871033, -0.017611641999, -0.117603290561),
            -0.0007440041121634784,
        ),
    ],
]
"""The same with 100 g, 2 and 3 mm off the axis: fingers are displaced to the side by up to 0.7 mm."""
CHAIN = [(1, 0.0, -0.119643), (4, 0.0, -0.048113), (16, 0.0, 0.054536), (16, 1.0, 0.086019)]
"""E I_l / E I, whether aside, least eigenvalue [N m]: rigid links, finite rotations at hinges, derivatives by CasADi,
extrapolated from 24, 48 and 96 links. Grasps that it found hold or turn away in MuJoCo as it says."""


def turned(vector, k):
    """A vector of the first finger's side, at that of another."""
    c, s = math.cos(math.tau * k / 3), math.sin(math.tau * k / 3)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])


def independent(ratio, aside=0.0):
    shapes, mass, found = ASIDE if aside else CENTERED
    if not aside:
        (load, normal, place, w), shapes = found[0], [shapes] * 3
        found = [(turned(load, k), turned(normal, k), turned(place, k), w) for k in range(3)]
    bases, touches, fingers = {}, [], {}
    for k, ((nodes, tension), (load, normal, place, w)) in enumerate(zip(shapes, found, strict=True)):
        name, out = f"finger_{k + 1}", turned((0.0, 1.0, 0.0), k)
        bases[name] = (0.055 * out, (0, 0, -1), -out)
        touches.append((f"{name}.tip", place, normal, load, LENGTH, w))
        fingers[name] = {"q": nodes, "tensions": (tension, 0.0)}
    tube = {"shape": "cylinder", "diameter": 0.07, "height": 0.1, "edge_radius": 0.004, "mass": mass}
    section = {"shape": "ellipse", "thickness": 1e-3, "width": math.sqrt(ratio) * 1e-3, "poissons_ratio": 0.3}
    scene = cases.make_scene(
        bases,
        {**tube, "position": (0.002 * aside, 0.003 * aside, -0.1)},
        {"friction": 0.6, "reserve": 0.2},
        section,
        (0.0, 0.0, -9.81),
        fidelity={"family": "clothoid", "elements": 4},
    )
    return scene, cases.stored(scene, touches, **fingers)


@pytest.mark.parametrize(("ratio", "aside", "least"), CHAIN)
def test_the_least_eigenvalue_is_that_of_an_independent_chain(ratio, aside, least):
    scene, arrays = independent(ratio, aside)
    certificate = certify_hand(scene, arrays)
    # That program leaves out what forces in the plane do to a finger that is displaced from it.
    assert certificate.passed is (aside == 0.0), certificate
    found = certificate.stability
    assert found.stiffness == pytest.approx(least, rel=2e-3)
    assert found.eigenvalue == pytest.approx(found.stiffness / (STIFFNESS / LENGTH), rel=1e-12)
    assert found.stable is (least > 0.0)
    assert certificate.acceptable is (found.stable and certificate.passed)
    if least < 0.0:
        assert found.motion == "turns about the hand's axis"
        assert certify_hand(scene.replaced(stability="ignore"), arrays).acceptable


def test_the_margin_is_two_tenths():
    for part, word in ((1.001, "stable"), (0.999, "creeps"), (-0.001, "unstable")):
        verdict = SpatialStability(part * 0.2, part * 0.01, "")
        assert verdict.word == word
        assert verdict.stable is (word == "stable")
    assert CREEPS == 0.2


def test_what_no_contact_holds_is_not_stable():
    scene, arrays = cases.squeezed_box(0.0, 0.0)
    assert not certify_hand(scene, arrays).stability.stable


def test_a_box_between_two_ends_turns_about_the_line_between_them():
    """Two points leave that turn, which nothing resists."""
    verdict = certify_hand(*cases.squeezed_box(0.01, 0.0)).stability
    assert verdict.eigenvalue == pytest.approx(0.0, abs=1e-6)
    assert not verdict.stable
    assert verdict.motion == "tilts about x"
    assert abs(verdict.mode[3]) == pytest.approx(1.0, abs=1e-3)


def test_torsional_friction_holds_a_box_by_the_twist_of_both_fingers():
    """About the line between the ends it turns by a moment per 2 G J / L."""
    scene, arrays = cases.twisted_box(0.0, 0.01, 0.0, torsional_friction=0.01)
    certificate = certify_hand(scene, arrays)
    ratio = 4.0
    torsion = 4 * ratio**2 / (1 + ratio**2) / (2 * 1.35) * STIFFNESS
    response = certificate.response
    assert response.pose[3, 3] == pytest.approx(LENGTH / (2.0 * torsion), rel=1e-3)
    # Both bear half of a moment about the line, each about the normal that points to it.
    assert response.moments[:, 3] == pytest.approx([-0.5, 0.5], rel=1e-6)
    assert certificate.stability.motion != "tilts about x"
    promised = certificate.promised([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    assert promised == pytest.approx(2.0 * 0.01 * 0.01, rel=1e-6)


def test_torsional_friction_counts_where_it_bears_a_turn_by_a_degree():
    """Nothing but the friction of both ends resists; after a degree it is as good as a stiffness that it divides."""
    press = 0.01
    points = certify_hand(*cases.squeezed_box(press, 0.0)).stability
    most = certify_hand(*cases.twisted_box(0.0, press, 0.0, torsional_friction=0.018)).stability
    assert most.motion != "tilts about x"
    needed = min(CREEPS, most.eigenvalue) * STIFFNESS / LENGTH * math.radians(1.0) / (2.0 * press)
    assert needed < 0.017
    for part in (1e-4, 0.99):
        verdict = certify_hand(*cases.twisted_box(0.0, press, 0.0, torsional_friction=part * needed)).stability
        assert verdict.motion == points.motion == "tilts about x"
        assert verdict.eigenvalue == pytest.approx(points.eigenvalue, abs=1e-9)
    verdict = certify_hand(*cases.twisted_box(0.0, press, 0.0, torsional_friction=1.01 * needed)).stability
    assert verdict.motion == most.motion
    assert verdict.eigenvalue == pytest.approx(most.eigenvalue, rel=1e-9)


@pytest.mark.parametrize(("width", "motion"), [(0.5e-3, "swings sideways"), (4e-3, "bends in its plane")])
def test_a_finger_that_touches_nothing_buckles_alone(width, motion):
    """A finger that stands on its base, 1.2 times as heavy as its weaker plane bears; the others lean on each other."""
    section = {"shape": "ellipse", "thickness": 1e-3, "width": width}
    weaker = min(1.0, (width / 1e-3) ** 2) * STIFFNESS
    other = {"free": ((0.08, 0.0, 0.0), (0, 0, -1), (0, 1, 0))}
    values = {"gravity": (0.0, 0.0, 1.2 * 7.837 * weaker / LENGTH**3), "density": 1.0}
    verdict = certify_hand(*cases.three_straight(1e-3, 0.03, 1e-3, section, other, **values)).stability
    assert verdict.eigenvalue < 0.0
    assert verdict.motion == f"free {motion}"


# -- the hand of a planar scene ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("curvature", [0.0, 4.0])
def test_a_hand_in_one_plane_is_as_stable_as_the_planar_scene(curvature):
    """Three fingers bend in the plane of a disc and press on it with their ends; a cylinder is that disc in space."""
    section = {"shape": "ellipse", "thickness": 1e-3, "width": 0.7e-3, "poissons_ratio": 0.3}
    radius, half = 0.03, cases.HALF
    family = {"family": "clothoid", "elements": 2}
    bases, fingers, values, touches, contacts = {}, {}, {}, [], []
    for k, (place, angle, press) in enumerate([(0.2, 2.2, 0.12), (2.4, 4.1, 0.1), (4.3, 5.6, 0.14)]):
        name, out = f"finger_{k + 1}", np.array([math.cos(place), math.sin(place)])
        along, toward = np.array([-math.sin(angle), math.cos(angle)]), -np.array([math.cos(angle), math.sin(angle)])
        ((dx, dy, _),) = planar.bent((0.0, 0.0, angle), [(curvature, curvature)], [LENGTH], [LENGTH])
        base, load = (radius + half) * out - [dx, dy], press * out + 0.02 * np.array([-out[1], out[0]])
        bases[name] = tuple((*vector, 0.0) for vector in (base, along, toward))
        values[name] = {"q": [curvature] * 3, "tip": curvature}
        tendons = Tendons(offset=cases.OFFSET, max_tension=60.0)
        rod = Rod(length=LENGTH, bending_stiffness=STIFFNESS, linear_density=1e-12)
        fingers[name] = planar.make_finger(base, angle, half, rod=rod, tendons=tendons, section=section)
        spot, normal = (*(radius * out), 0.0), (*out, 0.0)
        touches.append((f"{name}.tip", spot, normal, (*load, 0.0), LENGTH, 0.0))
        contacts.append((f"{name}.tip", radius * out, out, (press, 0.02, 0.0), LENGTH, 0))
    tube = {"shape": "cylinder", "diameter": 2 * radius, "height": 0.04, "edge_radius": 0.004, "mass": 0.0}
    scene = cases.make_scene(bases, {**tube, "position": (0.0, 0.0, 0.0)}, section=section, fidelity=family)
    hand = hand_stability(hand_of(scene, cases.stored(scene, touches, **values)))
    disc = Circle(shape="circle", diameter=2 * radius, mass=0.0, position=(0.0, 0.0))
    flat = planar.make_scene(fingers, disc, family="clothoid")
    found = certify(flat, planar.stored(flat, values, contacts)).stability
    assert found.in_space.stiffness == pytest.approx(hand.stiffness, rel=1e-9)
    assert abs(found.in_space.mode @ hand.mode) == pytest.approx(hand.mode @ hand.mode, rel=1e-6)
