"""Grasps whose forces follow from a line of algebra, to 1e-6.

The objective is the least greatest normal force unless something else is said. Fingers may move their bases, so that
they bend as their loads ask and the object alone decides the forces.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from grasp_scenes import finger_to, held_by_tips, loose

from continuum_grasp.grasp import GraspStatus, least_normal_force_bound, optimize_grasp
from continuum_grasp.scene import Box, Circle, Palm, Polygon, VGroove

G = 9.81
LENGTH, HALF, MASS, FRICTION = 0.2, 0.006, 0.3, 0.5
WEIGHT = MASS * G
OUT = (0.0, 0.0, -G)
WEIGHTLESS = (0.0, 0.0, 0.0)
LOOSE = 0.02


def planar(x, y):
    """Gravity of 9.81 m/s2 in a direction of the plane."""
    return (G * x, G * y, 0.0)


def finger(tip, towards, half=HALF, stiffness=0.05, free=LOOSE):
    """A finger that, straight, ends with the center of its round tip at ``tip``, pointing at the angle ``towards``."""
    made = finger_to(tip, towards, LENGTH, half, stiffness)
    return loose(made, free) if free else made


def solve(fingers, body, gravity, supports=None, friction=FRICTION, reserve=0.0, push=None, **more):
    """The grasp by the tips of these fingers."""
    named = dict(zip(("one", "two", "three"), fingers, strict=False))
    contacts = {"friction": friction, "reserve": reserve, "push": push}
    # Forms are of the least forces, which bear no push.
    more = {"objective": "least_normal_force", "supports": supports or {}, "stability": "ignore", **more}
    return optimize_grasp(held_by_tips(named, gravity, body.model_dump(), contacts, **more), raise_on_failure=False)


def normal_forces(result):
    """Normal forces of a verified grasp by contact; one that small pushes would end has them, too."""
    assert result.solved or result.status is GraspStatus.UNSTABLE, result.message
    assert result.certificate.passed
    return {c.name: c.normal_force for c in result.contacts}


def disc(radius=0.04, mass=MASS):
    """A disc about the origin."""
    return Circle(shape="circle", diameter=2 * radius, mass=mass, position=(0.0, 0.0))


BLOCK = Box(shape="box", width=0.3, height=0.08, mass=MASS, position=(0.0, 0.0))
"""So wide that no tip reaches its corners."""
CEILING = {"palm": Palm(point=(0.0, 0.04), normal_angle=-0.5 * math.pi)}
"""Touches the disc, or a box of its height, from above."""


# -- squeezes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "reserve"), [(disc(), 0.0), (BLOCK, 0.0), (disc(), 0.2)], ids=["disc", "block", "reserve"]
)
def test_squeeze_against_a_palm_out_of_the_plane(body, reserve):
    """Tip below, palm above, weight across: N is the same at both, mu N + mu N = m g, so N = m g / (2 mu), where no
    part of the cones stays free.
    """
    result = solve([finger((0.0, -0.04 - HALF), 0.5 * math.pi)], body, OUT, CEILING, reserve=reserve)
    assert normal_forces(result)["one.tip"] == pytest.approx(WEIGHT / (2 * FRICTION * (1 - reserve)), rel=1e-6)
    assert result.quality.friction_margin == pytest.approx(reserve, abs=1e-6)


def test_squeeze_against_a_palm_in_the_plane():
    """Tip below a block, palm above, weight along x: N is the same at both, friction of each m g / 2 <= mu N:
    N = m g / (2 mu).
    """
    result = solve([finger((0.0, -0.04 - HALF), 0.5 * math.pi)], BLOCK, planar(1.0, 0.0), CEILING)
    found = normal_forces(result)
    assert found["one.tip"] == pytest.approx(WEIGHT / (2 * FRICTION), rel=1e-6)
    assert found["palm.1"] + found["palm.2"] == pytest.approx(WEIGHT / (2 * FRICTION), rel=1e-6)


@pytest.mark.parametrize("slant", [0.4, 1.2, 2.6, -1.0])
def test_squeeze_against_a_palm_of_a_hand_that_is_slanted(slant):
    """Tip below, palm above, weight across, in and out of the plane: N = m g / (2 mu), half at each contact."""
    gravity = (G * math.sin(slant), 0.0, -G * math.cos(slant))
    result = solve([finger((0.0, -0.04 - HALF), 0.5 * math.pi)], disc(), gravity, CEILING)
    assert normal_forces(result)["one.tip"] == pytest.approx(WEIGHT / (2 * FRICTION), rel=1e-6)
    for contact in result.contacts:
        assert contact.lift == pytest.approx(0.5 * WEIGHT * math.cos(slant), rel=1e-5)
    # Elsewhere on the disc less might do: the bound counts all places.
    assert 0.9 * WEIGHT / (2 * FRICTION) < least_normal_force_bound(result.scene) <= WEIGHT / (2 * FRICTION)


@pytest.mark.deep
@pytest.mark.parametrize("reserve", [0.0, 0.2])
def test_too_slippery_a_squeeze_names_the_coefficient(reserve):
    """With N <= N_max the coefficient, less the reserve, must be m g / (2 N_max) at least."""
    most = 100.0
    needed = 50 * G / (2 * most) / (1 - reserve)
    box = Box(shape="box", width=0.08, height=0.08, mass=50.0, position=(0.0, 0.0))
    tips = [finger((-0.04 - HALF, 0.0), 0.0), finger((0.04 + HALF, 0.0), math.pi)]
    result = solve(tips, box, OUT, friction=0.9 * needed, reserve=reserve)
    assert result.status is GraspStatus.INFEASIBLE
    found = {r.name: r.needed for r in result.reasons}
    assert found["friction"] == pytest.approx(needed, rel=1e-3)
    assert found["mass"] == pytest.approx(0.9 * 50.0, rel=1e-3)


# -- three contacts ------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_three_tips_without_friction():
    """On the faces of a triangle that stands on its corner: those at -30 and -150 degrees carry 2 N sin 30 = m g, the
    one on top nothing. Stable it is only where that one presses, too.
    """
    half = 0.15
    corners = ((0.0, -2 * half / math.sqrt(3.0)), (half, half / math.sqrt(3.0)), (-half, half / math.sqrt(3.0)))
    body = Polygon(shape="polygon", vertices=corners, mass=MASS, position=(0.0, 0.0))
    angles, reach = [(0.5 + 2.0 * k / 3.0) * math.pi for k in range(3)], half / math.sqrt(3.0) + HALF
    fingers = [finger((reach * math.cos(a), reach * math.sin(a)), a + math.pi) for a in angles]
    result = solve(fingers, body, planar(0.0, -1.0), friction=0.0, stability="ignore")
    found = normal_forces(result)
    assert found["two.tip"] == pytest.approx(WEIGHT, rel=1e-6)
    assert found["three.tip"] == pytest.approx(WEIGHT, rel=1e-6)
    assert found["one.tip"] == pytest.approx(0.0, abs=1e-6 * WEIGHT)


# -- grooves and wedges --------------------------------------------------------------------------------------


@pytest.mark.parametrize("opening", [60.0, 90.0, 140.0])
@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_a_disc_in_a_groove(opening, friction):
    """Walls at half the opening b to the axis: 2 N (sin b + mu cos b) = m g, friction upwards at both; the tip that
    touches from above presses with nothing.
    """
    b = 0.5 * math.radians(opening)
    groove = VGroove(
        type="v_groove",
        apex=(0.0, -0.04 / math.sin(b)),
        opening_angle=2 * b,
        axis_angle=0.5 * math.pi,
        touch="on",
    )
    above = finger((0.0, 0.04 + HALF), -0.5 * math.pi)
    found = normal_forces(solve([above], disc(), planar(0.0, -1.0), {"groove": groove}, friction=friction))
    expected = WEIGHT / (2.0 * (math.sin(b) + friction * math.cos(b)))
    assert found["groove.left"] == pytest.approx(expected, rel=1e-6)
    assert found["groove.right"] == pytest.approx(expected, rel=1e-6)
    assert found["one.tip"] == pytest.approx(0.0, abs=1e-6 * WEIGHT)


def wedge(half_angle, mass=MASS):
    """A triangle whose faces lean to the y axis by half its angle, narrow side up, and fingers at their middles."""
    high = 0.4
    wide = high * math.tan(half_angle)
    body = Polygon(shape="polygon", vertices=((-wide, 0.0), (wide, 0.0), (0.0, high)), mass=mass, position=(0.0, 0.0))
    x, y = 0.5 * wide + HALF * math.cos(half_angle), 0.5 * high + HALF * math.sin(half_angle)
    return [finger((-x, y), 0.0), finger((x, y), math.pi)], body


@pytest.mark.deep
@pytest.mark.parametrize("degrees", [5.0, 15.0])
@pytest.mark.parametrize("down", [-1.0, 1.0])
def test_a_wedge_between_two_tips(degrees, down):
    """Faces that lean by b push along the axis with 2 N sin b, friction with 2 mu N cos b at most. Weight towards the
    narrow side: N = m g / (2 (sin b + mu cos b)); towards the wide side: N = m g / (2 (mu cos b - sin b)).
    """
    b = math.radians(degrees)
    found = normal_forces(solve(*wedge(b), planar(0.0, down)))
    expected = WEIGHT / (2.0 * (FRICTION * math.cos(b) + down * math.sin(b)))
    assert max(found.values()) == pytest.approx(expected, rel=1e-6)
    assert min(found.values()) == pytest.approx(expected, rel=1e-6)


@pytest.mark.deep
def test_a_wedge_that_slips_out_names_the_coefficient():
    """Without weight nothing is needed; with it, towards the wide side, at least mu > tan b, and with N <= 100 N
    mu = tan b + m g / (2 * 100 N cos b).
    """
    b = math.radians(20.0)
    result = solve(*wedge(b), planar(0.0, -1.0), friction=0.3)
    assert result.status is GraspStatus.INFEASIBLE
    needed = next(r.needed for r in result.reasons if r.name == "friction")
    assert needed == pytest.approx(math.tan(b) + WEIGHT / (200.0 * math.cos(b)), rel=1e-3)


# -- straight fingers ----------------------------------------------------------------------------------------


def test_a_weightless_touch_takes_the_bend_alone():
    """No weight and no push, so no forces: the least tension bends the finger until it touches, T e = E I kappa, one
    circular arc; from the base, a circle of that curvature meets the grown disc from outside.
    """
    stiffness, radius = 0.01, 0.03
    one = finger((0.0, 0.0), 0.5 * math.pi, HALF, stiffness, free=0.0)
    one["base"] = {"position": (0.0, 0.0), "angle": 0.0}
    body = Circle(shape="circle", diameter=2 * radius, mass=MASS, position=(-0.06, 0.215))
    result = solve([one], body, WEIGHTLESS, push=0.0, objective="least_tension")
    # Nothing presses, so that nothing steadies the object either.
    assert result.verified, result.message
    kappa = result.tension * 0.005 / stiffness
    bend = kappa * LENGTH
    tip = np.array([-(1 - math.cos(bend)), math.sin(bend)]) / kappa
    assert math.dist(tip, body.position) == pytest.approx(radius + HALF, rel=1e-6)
