"""How a grasp gives way: closed forms of beam columns, and nonlinear equilibria solved by scipy."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from grasp_elastica import Hand, designed, disturbed, stored
from scipy.optimize import brentq

from continuum_grasp.grasp import Quality, Resistance
from continuum_grasp.scene import Box, Circle, Ellipse, OffsetPolygon, Palm, Point, Rod, Tendons
from tests import certificate_cases as cases

LENGTH, STIFFNESS, RADIUS = cases.LENGTH, cases.STIFFNESS, 0.04
DISC = Circle(shape="circle", diameter=2 * RADIUS, mass=0.3, position=(0.0, 0.0))
WRENCHES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, RADIUS))


# -- two straight fingers: beam columns ----------------------------------------------------------------------------


def axial_pinch(push, friction=0.5, lift=0.0, gravity=None, **tendons):
    """Two thin straight fingers that press on a disc from both sides, along their axes."""
    limits = Tendons(offset=cases.OFFSET, **{"max_tension": 60.0, **tendons})
    fingers = {
        name: cases.make_finger((side * (RADIUS + LENGTH), 0.0), side * math.pi / 2, 0.0, tendons=limits)
        for name, side in (("a", -1.0), ("b", 1.0))
    }
    contacts = {"friction": friction, "normal_force_max": 30.0}
    scene = cases.make_scene(fingers, DISC, contacts, gravity or cases.WEIGHTLESS, family="clothoid")
    places = [
        ("a.tip", (-RADIUS, 0.0), cases.LEFT, (push, 0.0, lift), LENGTH, 0),
        ("b.tip", (RADIUS, 0.0), cases.RIGHT, (push, 0.0, lift), LENGTH, 0),
    ]
    both = {"tensions": (limits.min_tension, limits.min_tension)}
    return scene, cases.stored(scene, {"a": both, "b": both}, places)


def column(push):
    """Force per deflection of the tip of a clamped column under a dead axial push [N/m]."""
    k = math.sqrt(push / STIFFNESS)
    return push / (math.tan(k * LENGTH) / k - LENGTH)


def test_the_grasp_buckles_where_the_closed_form_says():
    critical = brentq(lambda push: column(push) * RADIUS - push, 0.01, 0.4)
    assert Quality(*axial_pinch(critical * 0.9999)).response.stable("retensioned")
    assert not Quality(*axial_pinch(critical * 1.0001)).response.stable("retensioned")
    assert Quality(*axial_pinch(critical * 1.0001)).response.stable("locked")
    held = Resistance.of(Quality(*axial_pinch(critical * 1.01)).response)
    assert not held.stable
    assert held.least == 0.0
    assert set(held.limiting) == {("unstable",)}


@pytest.mark.parametrize("tendons", ["locked", "retensioned"])
def test_resisted_forces_of_the_axial_pinch(tendons):
    push, mu = 0.08, 0.5
    held = Resistance.of(
        Quality(*axial_pinch(push, mu)).response, wrenches=WRENCHES, tendons=tendons, displacement_limit=math.inf
    )
    assert held.factors[0] == pytest.approx(2 * push, rel=1e-6)
    assert held.limiting[0] == ("a.tip parts",)
    assert held.factors[1] == pytest.approx(2 * mu * push, rel=1e-6)
    assert held.limiting[1] == ("a.tip slips", "b.tip slips")


@pytest.mark.parametrize("tendons", ["locked", "retensioned"])
def test_what_the_weight_takes_of_the_cone_out_of_the_plane(tendons):
    push, mu, lift = 0.08, 0.5, 0.03
    scene, arrays = axial_pinch(push, mu, lift, cases.INTO_PLANE)
    held = Resistance.of(
        Quality(scene, arrays).response, wrenches=WRENCHES, tendons=tendons, displacement_limit=math.inf
    )
    assert held.factors[0] == pytest.approx(2 * (push - lift / mu), rel=1e-6)
    assert held.factors[1] == pytest.approx(2 * math.sqrt((mu * push) ** 2 - lift**2), rel=1e-6)


@pytest.mark.parametrize(("friction", "given", "limit"), [(0.5, {"displacement_limit": 1e-3}, 1e-3), (50.0, {}, 0.1)])
def test_the_give_limits_what_the_first_order_may_say(friction, given, limit):
    response = Quality(*axial_pinch(0.08, friction)).response
    held = Resistance.of(response, wrenches=WRENCHES, tendons="locked", **given)
    moved = held.factors[1] * (response.to_wrenches("locked").pose @ WRENCHES[1])
    assert moved[1] == pytest.approx(limit * RADIUS, rel=1e-9)
    assert held.limiting[1] == ("the object moves",)


def test_the_polygon_holds_the_single_forces():
    scene, arrays = axial_pinch(0.08)
    polygon = Quality(scene, arrays).resistance_polygon
    along = Resistance.of(
        Quality(scene, arrays).response, wrenches=[(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)]
    )
    np.testing.assert_allclose(np.hypot(*polygon[[0, 9, 18]].T), along.factors, rtol=1e-9)


# -- against nonlinear equilibria ----------------------------------------------------------------------------------


@cache
def held_disc(kind):
    weighed = {"gravity": (0.0, -9.81), "density": 0.034}
    if kind == "wall":
        hand = Hand(wall=True, weight=(0.0, -3.0), **weighed)
        return hand, designed(hand, 1.2, 1.5, [-math.pi / 2 - 0.6], [-12.0]), ("a",)
    hand = Hand(weight=(0.0, -1.0), **weighed)
    return hand, designed(hand, 2.8, 2.0, [0.3, -0.3], [-12.0, 12.0], friction=0.4), ("a", "b")


def stored_scene(hand, state, names, friction=0.6):
    rod = Rod(length=hand.length, linear_density=hand.density, bending_stiffness=hand.stiffness)
    fingers = {n: cases.make_finger(b[:2], b[2], hand.half, rod=rod) for n, b in zip(names, state.bases, strict=True)}
    scene = cases.make_scene(
        fingers,
        DISC.replaced(mass=-hand.weight[1] / 9.81),
        {"friction": friction, "normal_force_max": 30.0},
        (*hand.gravity, 0.0),
        supports={"floor": Palm(point=(0.0, -hand.radius), normal_angle=math.pi / 2)} if hand.wall else {},
    )
    return scene, stored(hand, state, names, 241)


def all_forces(hand, state):
    return np.concatenate([state.forces, [state.wall]]) if hand.wall else state.forces


@pytest.mark.parametrize("kind", ["wall", "pinch"])
@pytest.mark.parametrize("tendons", ["retensioned", "locked"])
def test_small_disturbances_of_a_nonlinear_equilibrium(kind, tendons):
    hand, state, names = held_disc(kind)
    change = Quality(*stored_scene(hand, state, names)).response.to_wrenches(tendons)
    retained = {"differences": state.differences} if tendons == "retensioned" else {"tips": state.tips}
    step = 1e-4
    for k, wrench in enumerate(np.array(WRENCHES)):
        after, before = (disturbed(hand, state, sign * step * wrench, **retained) for sign in (1, -1))
        size = 2 * step * np.abs(wrench).max()
        truth = (all_forces(hand, after) - all_forces(hand, before)) / size
        np.testing.assert_allclose(change.forces[:, :, k], truth, atol=1e-3 * np.abs(truth).max())
        scale = np.array([hand.radius, hand.radius, 1.0])
        moved = (after.pose - before.pose) / size
        np.testing.assert_allclose(
            change.pose[:, k] / scale, moved / scale, atol=1e-3 * np.abs(moved / scale).max() + 1e-6
        )
        pulled = (after.differences - before.differences) / size
        np.testing.assert_allclose(change.differences[:, k], pulled, atol=1e-3 * np.abs(pulled).max() + 1e-5)


@pytest.mark.parametrize("kind", ["wall", "pinch"])
def test_a_change_of_tension(kind):
    hand, state, names = held_disc(kind)
    change = Quality(*stored_scene(hand, state, names)).response.to_tensions()
    for k in range(len(names)):
        step = 1e-3 * np.eye(len(names))[k]
        after, before = (disturbed(hand, state, differences=state.differences + s * step) for s in (1, -1))
        truth = (all_forces(hand, after) - all_forces(hand, before)) / 2e-3
        np.testing.assert_allclose(change.forces[:, :, k], truth, atol=5e-4 * np.abs(truth).max())


def test_a_contact_slips_where_the_nonlinear_equilibrium_says():
    hand, state, names = held_disc("wall")
    mu = 0.19
    held = Resistance.of(
        Quality(*stored_scene(hand, state, names, mu)).response,
        wrenches=(*WRENCHES, (-1.0, 0.0, 0.0)),
        tendons="locked",
    )
    assert held.limiting == (("a.tip slips",), ("floor slips",), ("a.tip slips",), ("a.tip slips",))

    def margin(wrench, factor):
        after = disturbed(hand, state, factor * wrench, tips=state.tips)
        return min(mu - abs(after.forces[0, 1]) / after.forces[0, 0], mu - abs(after.wall[1]) / after.wall[0])

    for wrench, factor in zip(held.wrenches, held.factors, strict=True):
        assert margin(wrench, 0.97 * factor) > 0.0 > margin(wrench, 1.03 * factor)


def test_retensioning_can_be_followed():
    """At nine tenths of what is claimed some tension keeps the nonlinear grasp from slipping; none did where locked."""
    hand, state, names = held_disc("wall")
    mu = 0.19
    scene, arrays = stored_scene(hand, state, names, mu)
    wrench = (-1.0, 0.0, 0.0)
    locked = Resistance.of(Quality(scene, arrays).response, wrenches=[wrench], tendons="locked")
    free = Resistance.of(Quality(scene, arrays).response, wrenches=[wrench], tendons="retensioned")
    assert free.least > 10 * locked.least

    def margin(change):
        after = disturbed(hand, state, 0.9 * free.least * np.array(wrench), differences=state.differences + change)
        return min(mu - abs(after.forces[0, 1]) / after.forces[0, 0], mu - abs(after.wall[1]) / after.wall[0])

    assert margin(0.0) < 0.0 < max(margin(change) for change in (5.0, 10.0, 15.0, 20.0))


# -- contacts of other kinds ---------------------------------------------------------------------------------------


def test_two_ends_of_a_face_on_a_wall_share_alike():
    """A box on the floor, a finger's tip on top: the floor takes a push down; its two ends share it."""
    scene = cases.make_scene(
        cases.make_finger((-LENGTH, 0.056), -math.pi / 2),
        Box(shape="box", width=0.08, height=0.05, mass=0.3, position=(0.0, 0.025)),
        {"normal_force_max": 30.0},
        cases.PLANAR,
        supports={"floor": Palm(point=(0.0, 0.0), normal_angle=math.pi / 2)},
    )
    contacts = [
        ("finger.tip", (0.0, 0.05), cases.UP, (1.0, 0.0, 0.0), LENGTH, 0),
        ("floor.1", (-0.04, 0.0), cases.DOWN, (2.0, 0.0, 0.0), cases.NONE, 0),
        ("floor.2", (0.04, 0.0), cases.DOWN, (2.0, 0.0, 0.0), cases.NONE, 0),
    ]
    arrays = cases.stored(scene, {"finger": {}}, contacts)
    change = Quality(scene, arrays).response.to_wrenches("retensioned")
    np.testing.assert_allclose(change.forces[:, 0, 1], [0.0, -0.5, -0.5], atol=1e-6)
    np.testing.assert_allclose(change.forces[1:, 1, 0], [0.5, 0.5], atol=1e-4)
    np.testing.assert_allclose(change.forces[1:, 0, 2], [1 / 0.08, -1 / 0.08], atol=1e-3)
    for tendons in ("locked", "retensioned"):
        held = Resistance.of(
            Quality(scene, arrays).response, wrenches=[(0.0, -1.0, 0.0), (0.0, 1.0, 0.0)], tendons=tendons
        )
        assert held.factors[0] == pytest.approx(56.0, rel=1e-5)
        assert held.factors[1] >= 4.0 * (1 - 1e-6)  # a finger that pulls down harder holds more


def test_curvatures_of_surfaces():
    disc, box = (
        OffsetPolygon(((0.0, 0.0),), 0.04),
        OffsetPolygon(((-0.03, -0.02), (0.03, -0.02), (0.03, 0.02), (-0.03, 0.02)), 0.005),
    )
    ellipse = Ellipse(shape="ellipse", width=0.1, height=0.06, mass=0.1, position=(0.0, 0.0)).parts[0]
    tilted = ellipse.placed((0.01, 0.02), 0.7)
    assert disc.curvature(np.array([0.04, 0.0]), 1e-6 * 0.04) == pytest.approx(25.0)
    assert box.curvature(np.array([0.01, 0.025]), 1e-6 * 0.04) == 0.0
    assert box.curvature(np.array([0.03, 0.02]) + 0.005 / math.sqrt(2), 1e-6 * 0.04) == pytest.approx(200.0)
    assert ellipse.curvature(np.array([0.05, 0.0]), 1e-6 * 0.05) == pytest.approx(0.05 / 0.03**2)
    end = np.array([0.01 + 0.05 * math.cos(0.7), 0.02 + 0.05 * math.sin(0.7)])
    assert tilted.curvature(end, 1e-6 * 0.05) == pytest.approx(0.05 / 0.03**2)
    sharp = OffsetPolygon(((0.0, 0.0), (0.04, 0.0), (0.0, 0.04)))
    assert sharp.curvature(np.array([0.04, 0.0]), 1e-6 * 0.04) == math.inf


def test_a_disc_between_pegs_and_a_wrapping_finger_resists_all_disturbances():
    """A finger with a tangent middle contact."""
    scene = cases.make_scene(
        cases.make_finger((-0.10, 0.046), -math.pi / 2),
        DISC.replaced(mass=0.1),
        {"normal_force_max": 30.0, "middle": "on", "tip": "off"},
        family="clothoid",
        supports={name: Point(type="point", position=(x, -0.05)) for name, x in (("p", -0.03), ("q", 0.03))},
    )
    contacts = [
        ("finger.middle", (0.0, 0.04), cases.UP, (1.0, 0.0, 0.0), 0.10, 0),
        ("p", (-0.024, -0.032), (-0.6, -0.8), (0.625, 0.0, 0.0), cases.NONE, 0),
        ("q", (0.024, -0.032), (0.6, -0.8), (0.625, 0.0, 0.0), cases.NONE, 0),
    ]
    bent = {"q": (0.0, -1 / 0.06, 0.0), "lengths": (0.10, LENGTH - 0.10), "tensions": (0.0, 5.0)}
    arrays = cases.stored(scene, {"finger": bent}, contacts)
    assert Quality(scene, arrays).resistance.least > 0.0
