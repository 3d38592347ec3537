"""The lower bound on the greatest normal force; from inside: contacts it counts on, and whether balance is ruled out.

The lower bound on the greatest normal force, against lines of algebra and linear programming over sampled places.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from grasp_scenes import finger_to, held_by_tips
from scipy.optimize import linprog

from continuum_grasp.grasp import least_normal_force_bound, optimize_grasp
from continuum_grasp.grasp.bound import _contacts, cannot_balance
from continuum_grasp.scene import (
    Circle,
    Palm,
)
from tests import certificate_cases as cases
from tests.grasp.test_grasp_limits import MASS, R, far

G, LENGTH, HALF, RADIUS = 9.81, 0.2, 0.006, 0.04


def star(angles, **more):
    """Fingers that point at the origin and touch a disc around it."""
    reach = RADIUS + HALF
    return {
        f"finger_{k}": finger_to((reach * math.cos(a), reach * math.sin(a)), a + math.pi, **more)
        for k, a in enumerate(angles)
    }


OUT = (0.0, 0.0, -G)


def scene_of(fingers, gravity, body=None, friction=0.5, **more):
    return held_by_tips(fingers, gravity, body, {"friction": friction}, objective="least_normal_force", **more)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_contacts_that_only_lift(count):
    """Friction of n contacts bears n mu N at most: N >= m g / (n mu)."""
    scene = scene_of(star([0.3 + math.tau * k / count for k in range(count)]), OUT)
    assert least_normal_force_bound(scene) == pytest.approx(0.3 * G / (count * 0.5), rel=2e-4)


@pytest.mark.parametrize(("own", "proven"), [((2.0, 2.9), True), ((2.0, 3.0), False), ((3.0, 2.0), False)])
def test_the_greatest_of_the_limits_counts(own, proven):
    """Of two contacts that lift, which press with 2.943 N or one of them with more."""
    fingers = star([0.0, math.pi])
    for finger, most in zip(fingers.values(), own, strict=True):
        finger["contacts"] = {"normal_force_max": most}
    assert cannot_balance(scene_of(fingers, OUT, upright=True)) is proven


@pytest.mark.parametrize(("part", "proven"), [(1.0 - 2e-4, True), (1.0, False)])
def test_the_limit_of_a_support_counts_too(part, proven):
    """A palm that bears m g, by the limit of all contacts, beside a finger whose own limit is far below."""
    palm = {"type": "palm", "point": (0.0, -RADIUS), "normal_angle": 0.5 * math.pi}
    fingers = {"finger": finger_to((0.5, 0.5), 0.0, contacts={"normal_force_max": 1.0})}
    gravity = [0.0, -G, 0.0]
    scene = scene_of(fingers, gravity, supports={"palm": palm}).changed({"contacts.normal_force_max": part * 0.3 * G})
    assert cannot_balance(scene) is proven


def test_each_contact_has_its_own_friction():
    """N (mu_1 + mu_2) >= m g."""
    fingers = star([0.0, math.pi])
    fingers["finger_0"]["contacts"] = {"friction": 0.9}
    assert least_normal_force_bound(scene_of(fingers, OUT, upright=True)) == pytest.approx(0.3 * G / 1.4, rel=2e-4)


@pytest.mark.parametrize("com", [(0.0, 0.0), (0.006, -0.003), (-0.008, 0.002)])
def test_contacts_at_single_places_bear_what_the_tilt_asks(com):
    """Three straight fingers that just end at a disc: lifts l with sum l = m g and sum l p = m g c, N >= |l| / mu."""
    angles = [0.3 + math.tau * k / 3 for k in range(3)]
    body = {"shape": "circle", "diameter": 2 * RADIUS, "center_of_mass": com}
    rows = [[1.0, RADIUS * math.cos(a), RADIUS * math.sin(a)] for a in angles]
    lifts = np.linalg.solve(np.transpose(rows), 0.3 * G * np.array([1.0, *com]))
    bound = least_normal_force_bound(scene_of(star(angles), OUT, body))
    assert bound == pytest.approx(np.abs(lifts).max() / 0.5, rel=6e-4)


@pytest.mark.parametrize("opening", [60.0, 140.0])
def test_a_groove_bears_what_a_finger_above_cannot(opening):
    """The straight finger just reaches the top of the disc: 2 N (sin b + mu cos b) = m g at the walls."""
    b = 0.5 * math.radians(opening)
    groove = {
        "type": "v_groove",
        "apex": (0.0, -RADIUS / math.sin(b)),
        "opening_angle": 2 * b,
        "axis_angle": 0.5 * math.pi,
    }
    gravity = [0.0, -G, 0.0]
    scene = scene_of(star([0.5 * math.pi]), gravity, supports={"groove": groove}, friction=0.2)
    expected = 0.3 * G / (2.0 * (math.sin(b) + 0.2 * math.cos(b)))
    assert least_normal_force_bound(scene) == pytest.approx(expected, rel=2e-4)


def test_a_free_angle_leaves_forces_alone():
    """Any normal: n contacts bear n sqrt(1 + mu^2) N in the plane."""
    body = {"shape": "box", "width": 0.08, "height": 0.06, "free": {"angle": [-0.5, 0.5]}}
    scene = scene_of(star([0.0, math.pi]), [0.0, -G, 0.0], body)
    assert least_normal_force_bound(scene) == pytest.approx(0.3 * G / (2.0 * math.hypot(1.0, 0.5)), rel=2e-4)


def test_what_cannot_be_balanced_has_no_bound():
    """A finger above and nothing below: no normal force is enough."""
    scene = scene_of(star([0.5 * math.pi]), [0.0, -G, 0.0])
    assert least_normal_force_bound(scene) == math.inf


def box_places(width, height, angle, count):
    """Points on a turned box's faces and their normals."""
    u = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    found = []
    for n, half, across in ((0.0, width, height), (1.0, height, width), (2.0, width, height), (3.0, height, width)):
        turn = np.exp(0.5j * math.pi * n)
        found += [(turn * (0.5 * half + 0.5j * across * v), 0.5 * math.pi * n) for v in (-1.0, *u, 1.0)]
    points, angles = (np.array(part) for part in zip(*found, strict=True))
    return points * np.exp(1j * angle), angles + angle


@pytest.mark.parametrize("seed", [0, 4, 8, 10])
def test_linear_programming_over_sampled_places(seed):
    """Mixtures of forces at places on a box that the fingers reach: any sample is an upper bound of what is bounded."""
    random = np.random.default_rng(seed)
    width, height, turn = random.uniform(0.05, 0.09), random.uniform(0.03, 0.08), random.uniform(-1.0, 1.0)
    down, friction = random.uniform(-math.pi, math.pi), random.uniform(0.2, 0.8)
    body = {"shape": "box", "width": width, "height": height, "angle": turn, "center_of_mass": (0.01, -0.004)}
    angles = random.uniform(-1.0, 1.0, 2) + np.array([down, down + 2.0])
    reach = 0.05
    fingers = {
        f"finger_{k}": finger_to((reach * math.cos(a), reach * math.sin(a)), a + math.pi) for k, a in enumerate(angles)
    }
    gravity = [G * math.cos(down), G * math.sin(down), 0.0]
    scene = scene_of(fingers, gravity, body, friction)
    points, normals = box_places(width, height, turn, 2000)
    # Corners touch with any normal between those of their faces.
    corners = [0.5 * width + 0.5j * height, -0.5 * width + 0.5j * height]
    corners += [-z for z in corners]
    between = np.linspace(0.0, 0.5 * math.pi, 200)
    for z, first in zip(corners, (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi), strict=True):
        points = np.append(points, np.full(200, z * np.exp(1j * turn)))
        normals = np.append(normals, first + turn + between)
    com = (0.01 - 0.004j) * np.exp(1j * turn)
    columns, owners = [], []
    for k, finger in enumerate(fingers.values()):
        # The line of the finger is half a thickness away from what it touches.
        near = np.abs(points + HALF * np.exp(1j * normals) - complex(*finger["base"]["position"])) <= LENGTH
        for sign in (-1.0, 1.0):
            force = np.exp(1j * normals[near]) * (1.0 + 1j * sign * friction)
            moment = (np.conj(points[near] - com) * force).imag / 0.05
            columns.append(np.stack([force.real, force.imag, moment]))
            owners += [k] * int(near.sum())
    effect = np.concatenate(columns, axis=1)
    budget = np.array([[float(owner == k) for owner in owners] + [-1.0] for k in (0, 1)])
    found = linprog(
        np.append(np.zeros(len(owners)), 1.0),
        A_ub=budget,
        b_ub=np.zeros(2),
        A_eq=np.column_stack([effect, np.zeros(3)]),
        b_eq=[0.3 * G * math.cos(down), 0.3 * G * math.sin(down), 0.0],
        method="highs",
    )
    bound = least_normal_force_bound(scene)
    if found.status == 2:
        assert bound > 1e3 * 0.3 * G
        return
    assert found.status == 0
    assert bound <= found.x[-1] * (1.0 + 1e-9)
    assert bound >= found.x[-1] * (1.0 - 1.5e-3)


# -- places of a contact ----------------------------------------------------------------------------------------------


def most_work(y, points, angles, com, size, friction):
    """The most y . s of forces with N = 1 in the cones at points with normals: its parts are those of a circle."""
    nothing = np.zeros(len(points))
    arms = np.stack([(points - com).real / size, (points - com).imag / size, nothing], axis=1)
    normals = np.stack([np.cos(angles), np.sin(angles), nothing], axis=1)
    out = np.broadcast_to([0.0, 0.0, 1.0], normals.shape)

    def of(force):
        return force @ y[:3] + np.cross(arms, force) @ y[3:]

    return of(normals) + friction * np.hypot(of(np.cross(out, normals)), of(out))


def ellipse_places(width, height, count):
    t = np.linspace(0.0, math.tau, count, endpoint=False)
    points = 0.5 * width * np.cos(t) + 0.5j * height * np.sin(t)
    return points, np.angle(height * np.cos(t) + 1j * width * np.sin(t))


def rounded_box_places(width, height, radius, count):
    points, normals = [], []
    for k, corner in enumerate((1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j)):
        center = (0.5 * width - radius) * corner.real + 1j * (0.5 * height - radius) * corner.imag
        turn = np.linspace(0.5 * math.pi * k, 0.5 * math.pi * (k + 1), count)
        points.append(center + radius * np.exp(1j * turn))
        normals.append(turn)
    points.append(np.concatenate([np.linspace(a[-1], b[0], count) for a, b in pairwise([*points, points[0]])]))
    normals.append(np.repeat(0.5 * math.pi * np.arange(1, 5), count))
    return np.concatenate(points), np.concatenate(normals)


SHAPES = [
    ({"shape": "ellipse", "width": 0.09, "height": 0.04}, ellipse_places(0.09, 0.04, 100_000)),
    (
        {"shape": "box", "width": 0.08, "height": 0.05, "corner_radius": 0.01},
        rounded_box_places(0.08, 0.05, 0.01, 9000),
    ),
]


@pytest.mark.parametrize(("body", "places"), SHAPES, ids=["ellipse", "box"])
@pytest.mark.parametrize("seed", range(4))
def test_the_work_of_a_contact_is_bounded_closely_from_above(body, places, seed):
    """At any multipliers, over places within reach of a finger; the bound is rigorous only if it is never below."""
    random = np.random.default_rng(seed)
    com = complex(*random.uniform(-0.01, 0.01, 2))
    away, ahead = random.uniform(0.19, 0.215), random.uniform(-math.pi, math.pi)
    base = away * np.exp(1j * ahead)
    fingers = {"finger": finger_to((0.0, 0.0), 0.0, base={"position": (base.real, base.imag)})}
    friction = random.uniform(0.1, 1.0)
    scene = scene_of(fingers, OUT, {**body, "center_of_mass": (com.real, com.imag)}, friction)
    (contact,) = _contacts(scene)
    points, normals = places
    near = np.abs(points + HALF * np.exp(1j * normals) - base) <= LENGTH
    assert 0.05 < near.mean() < 0.95
    for used in ("110000", "000001", "000110", "001110", "111111"):
        y = random.normal(size=6) * [float(digit) for digit in used]
        exact = most_work(y, points[near], normals[near], com, scene.object.size, friction).max()
        assert max(exact, 0.0) <= contact.most(y)[0] <= max(exact, 0.0) + 5e-4 * np.abs(y).sum()


def test_the_work_of_a_contact_with_any_normal_is_exact():
    body = {"shape": "box", "width": 0.08, "height": 0.06, "free": {"angle": [-0.5, 0.5]}}
    contact = _contacts(scene_of(star([0.0]), OUT, body, 0.7))[0]
    random, normals = np.random.default_rng(0), np.linspace(0.0, math.tau, 20_000)
    for y in random.normal(size=(20, 6)) * [1, 1, 1, 0, 0, 0] * random.choice([0.1, 1.0, 10.0], (20, 6)):
        exact = most_work(y, np.zeros(normals.size), normals, 0.0, 1.0, 0.7).max()
        assert contact.most(y)[0] == pytest.approx(exact, rel=1e-6)


def test_the_work_of_a_support_is_exact_and_never_negative():
    palm = {"palm": {"type": "palm", "point": (0.0, -RADIUS), "normal_angle": 0.5 * math.pi}}
    contact = _contacts(scene_of(star([0.0]), OUT, friction=0.7, supports=palm))[-1]
    place, normal, random = np.array([-1j * RADIUS]), np.array([-0.5 * math.pi]), np.random.default_rng(0)
    for y in random.normal(size=(20, 6)):
        exact = most_work(y, place, normal, 0.0, RADIUS, 0.7).item()
        assert contact.most(y)[0] == pytest.approx(max(exact, 0.0), rel=1e-12)


@pytest.mark.parametrize(
    ("body", "count"),
    [({"shape": "circle", "diameter": 0.04}, 1), ({"shape": "box", "width": 0.04, "height": 0.04}, 2)],
)
def test_an_object_that_may_turn_bears_on_one_point_of_a_wall_or_on_both_ends_of_a_face(body, count):
    """And on a finger, which then may touch it with any normal."""
    palm = {"type": "palm", "point": (0.0, -0.02), "normal_angle": 0.5 * math.pi}
    fingers, down = {"finger": finger_to((0.9, 0.9), 0.0)}, [0.0, -G, 0.0]
    scene = scene_of(fingers, down, {**body, "free": {"angle": (-0.5, 0.5)}}, friction=0.0, supports={"palm": palm})
    assert least_normal_force_bound(scene) == pytest.approx(0.3 * G / (count + 1), rel=3e-4)


TAPER = {"to": LENGTH, "bending_stiffness": 0.4, "linear_density": 1e-9, "thickness": (0.012, 0.04)}
REACHES = [
    ({}, {}, LENGTH + HALF),
    ({"base_free": {"x": 0.01}}, {}, LENGTH + HALF + 0.01),
    ({}, {"free": {"x": (-0.01, 0.0)}}, LENGTH + HALF + 0.01),
    ({"base_free": {"x": 0.01}}, {"free": {"x": (-0.01, 0.0)}}, LENGTH + HALF + 0.02),
    ({"half_thickness": None, "rod": {"length": LENGTH, "sections": [TAPER]}}, {}, LENGTH + 0.02),
    ({"contacts": {"tip": "off", "middle": "auto", "middle_range": (0.05, 0.15)}}, {}, 0.15 + HALF),
]


@pytest.mark.parametrize(("finger", "body", "reach"), REACHES)
def test_fingers_count_up_to_where_they_reach(finger, body, reach):
    """Two contacts that lift share the weight; one alone, where the other finger just ends short, pushes."""
    for part, holds in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
        x, y = ((RADIUS + part * reach) * way for way in (math.cos(2.0), math.sin(2.0)))  # between two samples
        own = {**finger, "base": {"position": (x, y), "angle": 0.0}}
        if "base_free" in own:
            own["base_free"] = {"x": (x, x + own["base_free"]["x"])}
        fingers = star([2.0 - math.pi]) | {"other": finger_to((0.0, 0.0), 0.0, **own)}
        scene = scene_of(fingers, OUT, {"shape": "circle", "diameter": 2 * RADIUS, **body}, upright=True)
        bound = least_normal_force_bound(scene)
        assert bound == pytest.approx(0.3 * G / (2 * 0.5), rel=3e-4) if holds else bound > 10 * 0.3 * G


@pytest.mark.deep
@pytest.mark.parametrize("angles", [[0.0, math.pi], [0.3, 0.3 + math.pi]])
def test_no_grasp_needs_less(angles):
    """What the search finds is verified by code of its own, and never below the bound."""
    result = optimize_grasp(scene_of(star(angles), OUT, friction=0.8, upright=True), raise_on_failure=False)
    assert result.solved
    greatest = max(contact.normal_force for contact in result.contacts)
    assert greatest >= least_normal_force_bound(result.scene) * (1.0 - 1e-6)


def test_the_bound_proves_from_a_ten_thousandth_above_the_limit_on():
    """A palm alone bears the weight: m g is the least normal force there is."""
    disc = Circle(shape="circle", diameter=2 * R, mass=MASS, position=(9.0, R))
    scene, _ = far(disc, {"rest": Palm(point=(9.0, 0.0), normal_angle=0.5 * math.pi)}, gravity=cases.PLANAR)
    for part in (0.999, 1.001):
        most = 9.81 * MASS / (1.0 + part * 1e-4)
        assert cannot_balance(scene.changed({"contacts.normal_force_max": most})) is (part > 1.0)
