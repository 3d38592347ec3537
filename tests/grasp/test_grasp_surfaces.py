"""Distances, normals and curvatures of surfaces, and depths in them; from inside: those of the certificate, one by one.

Distances, normals and curvatures of surfaces against dense samples of the outlines, made here; depths of fingers in
objects, walls, each other and themselves, against figures worked out by hand and shapely.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from continuum_grasp.grasp import certify
from continuum_grasp.grasp.judge.clearance import apart_from_itself
from continuum_grasp.grasp.judge.surfaces import PlacedObject, nearest, support_point
from continuum_grasp.scene import (
    Box,
    Circle,
    Ellipse,
    Line,
    OffsetPolygon,
    Polygon,
    Stadium,
    Superellipse,
    SuperellipsePart,
    Union,
)
from tests import certificate_cases as cases
from tests.grasp.test_grasp_curled import apart

AT = {"mass": 0.1, "position": (0.02, -0.01), "angle": 0.3}
CORNERS = ((0.0, 0.0), (0.06, 0.01), (0.05, 0.05), (0.01, 0.04))
SHAPES = {
    "circle": Circle(shape="circle", diameter=0.06, **AT),
    "ellipse": Ellipse(shape="ellipse", width=0.08, height=0.03, **AT),
    "superellipse 2.5": Superellipse(shape="superellipse", width=0.05, height=0.08, exponent=2.5, **AT),
    "superellipse 4": Superellipse(shape="superellipse", width=0.08, height=0.05, exponent=4.0, **AT),
    "superellipse 12": Superellipse(shape="superellipse", width=0.08, height=0.02, exponent=12.0, **AT),
    "blade": Ellipse(shape="ellipse", width=0.1, height=0.002, **AT),
    "turned blade": Union(
        shape="union",
        members=(
            {"shape": "ellipse", "width": 0.1, "height": 0.002, "position": (0.01, 0.0), "angle": 0.7},
            {"shape": "circle", "diameter": 0.05, "position": (0.03, 0.0)},
        ),
        center_of_mass=(0.0, 0.0),
        **AT,
    ),
    "flat superellipse": Superellipse(shape="superellipse", width=0.002, height=0.1, exponent=12.0, **AT),
    "box": Box(shape="box", width=0.07, height=0.04, **AT),
    "rounded box": Box(shape="box", width=0.07, height=0.04, corner_radius=0.008, **AT),
    "polygon": Polygon(shape="polygon", vertices=CORNERS, **AT),
    "stadium": Stadium(shape="stadium", length=0.05, radius=0.015, **AT),
    "rounded polygon": Polygon(shape="polygon", vertices=CORNERS[::-1], corner_radius=0.005, **AT),
}
SLOT = OffsetPolygon(((-0.02, 0.0), (0.03, 0.01)), 0.012)
PARTS = {name: shape.parts[0] for name, shape in SHAPES.items()} | {"slot": SLOT}


def outline(part, count=40_000):
    """Dense boundary points of a part (n, 2), from its definition."""
    if isinstance(part, SuperellipsePart):
        t = np.linspace(0, 2 * np.pi, count, endpoint=False)
        a, b = part.semi_axes
        polar = np.arctan2(b * np.sin(t), a * np.cos(t))
        c, s = np.cos(polar), np.sin(polar)
        r = (np.abs(c / a) ** part.exponent + np.abs(s / b) ** part.exponent) ** (-1 / part.exponent)
        turn = np.exp(1j * part.angle)
        z = (r * (c + 1j * s)) * turn + complex(*part.center)
        return np.column_stack([z.real, z.imag])
    core = [complex(*v) for v in part.vertices]
    pieces = []
    for k, v in enumerate(core):
        after = core[(k + 1) % len(core)]
        out = lambda a, b: np.angle((b - a) * -1j)  # noqa: E731
        low, turn = 0.0, 2 * np.pi
        if len(core) > 1:
            low = out(core[k - 1], v)
            turn = np.pi if len(core) == 2 else (out(v, after) - low) % (2 * np.pi)
        u = np.linspace(0, 1, count // (2 * len(core)))
        pieces.append(v + part.radius * np.exp(1j * (low + turn * u)))
        if len(core) > 1:
            pieces.append(v + u * (after - v) + part.radius * np.exp(1j * out(v, after)))
    z = np.concatenate(pieces)
    return np.column_stack([z.real, z.imag])


@pytest.mark.parametrize("part", PARTS.values(), ids=PARTS)
def test_distance_against_a_dense_outline(part):
    rng = np.random.default_rng(0)
    edge = outline(part)
    low, high = edge.min(axis=0), edge.max(axis=0)
    points = np.concatenate(
        [rng.uniform(low - 0.03, high + 0.03, (90, 2)), rng.uniform(low, high, (30, 2)), [[0.3, 1]]]
    )
    found = nearest(part, points)
    step = np.hypot(*np.diff(edge, axis=0).T).max()
    for point, distance, foot, normal in zip(points, found.distance, found.point, found.normal, strict=True):
        true = np.hypot(*(edge - point).T).min()
        off = edge - point
        winding = np.angle((off[:, 0] + 1j * off[:, 1]) / np.roll(off[:, 0] + 1j * off[:, 1], 1)).sum()
        sign = -1.0 if abs(winding) > np.pi else 1.0
        assert distance == pytest.approx(sign * true, abs=step**2 / max(true, step) + 1e-9)
        assert np.hypot(*(edge - foot).T).min() < step
        assert foot + distance * normal == pytest.approx(point, abs=1e-12)
        assert np.hypot(*normal) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("part", PARTS.values(), ids=PARTS)
def test_a_point_of_the_surface_is_its_own_nearest(part):
    edge = outline(part, 4000)[::7]
    found = nearest(part, edge)
    assert np.abs(found.distance).max() < 1e-12
    assert np.abs(found.point - edge).max() < 1e-9
    away = nearest(part, found.point + 0.2 * found.normal)
    assert np.abs(away.point - found.point).max() < 1e-9
    assert away.distance == pytest.approx(np.full(len(edge), 0.2), abs=1e-12)


@pytest.mark.parametrize("part", PARTS.values(), ids=PARTS)
def test_support_against_a_dense_outline(part):
    edge = outline(part)
    for angle in np.linspace(0, 2 * np.pi, 24, endpoint=False):
        way = np.array([math.cos(angle), math.sin(angle)])
        far = support_point(part, way)
        assert far @ way == pytest.approx((edge @ way).max(), abs=1e-8)
        assert abs(nearest(part, far[None]).distance[0]) < 1e-12


@pytest.mark.parametrize(
    "name", ["circle", "ellipse", "superellipse 2.5", "superellipse 4", "superellipse 12", "blade"]
)
def test_radius_of_curvature_against_differences(name):
    edge = outline(PARTS[name], 20_000)
    before, after = np.roll(edge, 1, axis=0), np.roll(edge, -1, axis=0)
    a, b, c = (np.hypot(*(p - q).T) for p, q in ((edge, before), (after, edge), (after, before)))
    u, v = edge - before, after - edge
    turned = np.abs(2 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]))
    radius = a * b * c / np.maximum(turned, 1e-300)  # of the circle through three points
    some = slice(37, None, 501)
    found = nearest(PARTS[name], edge[some]).radius
    bent = radius[some] < 10.0
    assert found[bent] == pytest.approx(radius[some][bent], rel=1e-3)


def test_flat_faces_and_corners_have_their_radii():
    part = PARTS["rounded box"]
    found = nearest(part, np.array([[0.0, 0.03], [0.05, 0.04], [0.05, 0.0]]))
    assert found.radius == pytest.approx([np.inf, 0.008, np.inf])
    assert nearest(PARTS["box"], np.array([[0.05, 0.04]])).radius[0] == 0.0


@pytest.mark.parametrize(
    ("name", "radius", "off"),
    # Of corners the centers are given, of smooth curves some places, which are this far apart [m].
    [
        ("box", 1e-3, 1e-9),
        ("rounded box", 0.0081, 1e-9),
        ("rounded polygon", 0.0051, 1e-9),
        ("stadium", 0.016, 1e-9),
        ("blade", 0.002, 5e-4),
        ("turned blade", 0.002, 5e-4),
        ("superellipse 12", 0.01, 2e-3),
        ("superellipse 4", 0.02, 4e-3),
        ("ellipse", 0.01, 4e-3),
    ],
)
def test_wherever_the_surface_is_sharp_a_place_is_given(name, radius, off):
    body = SHAPES[name]
    places, rounds = PlacedObject(body, np.array([0.4, -0.2, 1.1])).sharp_places(radius)
    # Back in the object's frame.
    c, s = math.cos(1.1), math.sin(1.1)
    places = (places - [0.4, -0.2]) @ np.array([[c, -s], [s, c]])
    edge = outline(PARTS[name], 8000)[::5]
    found = nearest(PARTS[name], edge + 0.2 * (edge - edge.mean(axis=0)))  # from outside, where corners are nearest
    sharp = found.point[found.radius < radius]
    assert 0 < len(sharp) < len(edge)
    away = np.abs(np.hypot(*(sharp[:, None] - places).transpose(2, 0, 1)) - rounds)
    assert away.min(axis=1).max() < off
    # All of them are on the surface or as far within as they are round.
    assert nearest(PARTS[name], places).distance == pytest.approx(-rounds, abs=1e-9)


def test_placed_object_and_union():
    members = (
        {"shape": "circle", "diameter": 0.05, "position": (0.0, 0.04)},
        {"shape": "box", "width": 0.06, "height": 0.03, "position": (0.0, 0.015), "angle": 0.2},
        {
            "shape": "superellipse",
            "width": 0.06,
            "height": 0.03,
            "exponent": 3.0,
            "position": (0.05, 0.0),
            "angle": 1.0,
        },
    )
    body = Union(shape="union", members=members, mass=0.1, position=(0.1, 0.2), angle=0.7, center_of_mass=(0.0, 0.03))
    placed = PlacedObject(body, body.pose)
    turn = np.exp(0.7j)
    com = complex(0.1, 0.2) + turn * 0.03j
    assert placed.com == pytest.approx([com.real, com.imag], abs=1e-15)
    zs = [turn * (outline(part) @ [1, 1j]) + 0.1 + 0.2j for part in body.parts]
    edges = [np.column_stack([z.real, z.imag]) for z in zs]
    rng = np.random.default_rng(1)
    points = rng.uniform([0.0, 0.15], [0.2, 0.35], (60, 2))
    distance = placed.distance(points)
    for point, value in zip(points, distance, strict=True):
        if value > 0:
            assert value == pytest.approx(min(np.hypot(*(e - point).T).min() for e in edges), abs=1e-6)
    parts = rng.integers(0, 3, 60)
    both = placed.nearest_of(points, [body.parts[k] for k in parts])
    for k in range(3):
        alone = placed.nearest(points[parts == k], body.parts[k])
        assert both.distance[parts == k] == pytest.approx(alone.distance, abs=1e-15)
        assert both.normal[parts == k] == pytest.approx(alone.normal, abs=1e-15)


def depths(scene, arrays):
    """Depths of the object and of fingers in others [m], by the name of the check."""
    return {check.name: check.value for check in certify(scene, arrays).checks}


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 4])
@pytest.mark.parametrize("lift", [-1e-3, -1e-5, 1e-3])
def test_an_object_across_a_finite_line(turn, lift):
    reach = 0.02 * (abs(np.cos(turn)) + abs(np.sin(turn)))
    body = Box(shape="box", width=0.04, height=0.04, mass=0.0, position=(0.011, reach + lift), angle=turn)
    line = Line(type="line", start=(-0.05, 0.0), end=(0.05, 0.0), touch="auto")
    finger = cases.make_finger((0.5, 0.5))
    found = depths(*cases.apart(finger, body=body, supports={"w": line}))
    depth = found["penetration of the object into a support, w"]
    if lift > 0.0 or turn == 0.0:
        assert depth == pytest.approx(-lift, abs=1e-7)
    else:
        # As deep as the line is in a corner, between its faces.
        assert 0.2 * -lift < depth <= -lift + 1e-7


def test_a_thin_object_between_two_samples_is_seen():
    """A needle's end and a wire, thinner than the samples are apart."""
    wire = Circle(shape="circle", diameter=2e-4, mass=0.0, position=(0.0, 0.1003))
    needle = Ellipse(shape="ellipse", width=0.1, height=0.001, mass=0.0, position=(0.05 - 1e-4, 0.1003))
    for body, exact in ((wire, 1e-4), (needle, 3.12e-5)):
        for aside, held in ((0.0, True), (-0.001, False)):
            finger = cases.make_finger((aside, 0.0), half=0.0)
            depth = depths(*cases.apart(finger, body=body))["penetration into the object, finger"]
            assert depth == pytest.approx(exact, rel=0.4) if held else depth < 0.0


@pytest.mark.parametrize(("thickness", "depth"), [(1e-4, 2e-5), (5e-3, 0.0), (5e-3, 1e-4), (5e-3, -1e-4)])
def test_a_corner_between_two_samples_is_seen(thickness, depth):
    """A straight finger passes a sharp corner; samples are farther apart than the corner reaches beyond it."""
    body = Box(shape="box", width=0.1, height=0.1, mass=0.0, position=(0.0, 0.1003), angle=np.pi / 4)
    finger = cases.make_finger((0.05 * 2**0.5 + thickness - depth, 0.0), half=thickness)
    found = depths(*cases.apart(finger, body=body))["penetration into the object, finger"]
    assert found == pytest.approx(depth, abs=1e-8)


def rod(curvatures, half):
    """A finger of length 1 whose curvature is linear between values at even places, as the check sees it."""
    s = np.linspace(0.0, 1.0, 801)
    curvature = np.interp(s, np.linspace(0.0, 1.0, len(curvatures)), curvatures)
    angles = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(s))])
    middle = 0.5 * (angles[1:] + angles[:-1])
    points = np.concatenate([[0.0], np.cumsum(np.exp(1j * middle) * np.diff(s))])
    points = np.stack([points.real, points.imag], axis=1)
    along = np.stack([np.cos(angles), np.sin(angles), np.zeros(s.size)], axis=1)
    axes = np.stack([along, along, along], axis=2)
    flat = np.column_stack([points, np.zeros(s.size)])
    return SimpleNamespace(
        points=flat,
        angles=angles,
        s=s,
        half=np.full(s.size, half),
        step=float(np.diff(s).max()),
        places=SimpleNamespace(axes=axes),
        rod=SimpleNamespace(length=1.0),
    )


def self_overlap(finger):
    """Depth of a finger in itself."""
    return -apart_from_itself(finger)


def test_a_circle_that_is_all_but_closed_or_passed_again():
    half, turns = 0.004, 0.99
    ends = 2.0 * np.sin(np.pi * (1.0 - turns)) / (2.0 * np.pi * turns)
    assert -self_overlap(rod([2.0 * np.pi * turns] * 2, half)) == pytest.approx(ends - 2.0 * half, rel=1e-3)
    assert self_overlap(rod([2.0 * np.pi * 1.2] * 2, half)) > 1.999 * half


def test_a_finger_that_turns_by_less_than_half_a_circle_cannot_reach_itself():
    assert self_overlap(rod([3.0, 3.0], 0.05)) < 0.0
    assert self_overlap(rod([0.0, 0.0], 0.05)) < 0.0


def test_depth_agrees_with_distances_of_random_fingers():
    """With a finger mirrored and thicker ones; those that cross are as deep as they are thick."""
    rng, crossed = np.random.default_rng(5), 0
    for _ in range(25):
        curvatures, half = rng.normal(6.0, 7.0, 4), rng.uniform(0.002, 0.02)
        finger = rod(curvatures, half)
        if np.abs(np.diff(finger.angles)).sum() < np.pi:
            continue
        found, least = self_overlap(finger), apart(finger.points[:, :2], half)
        assert self_overlap(rod(-curvatures, half)) == pytest.approx(found, abs=1e-9)
        if shapely.LineString(finger.points[:, :2]).is_simple:
            assert found == pytest.approx(2.0 * half - least, abs=1e-4)
        else:
            crossed += 1
            assert found == pytest.approx(2.0 * half, abs=1e-9)
    assert crossed > 3


@pytest.mark.parametrize("half", [0.0, 0.006])
@pytest.mark.parametrize("lean", [0.2, -0.2, 0.02])
def test_fingers_that_cross_overlap_by_both_half_thicknesses(half, lean):
    """Straight ones, that cross where they turn towards each other: lines in closed form."""
    aside = 0.03
    fingers = {
        "left": cases.make_finger((-aside, 0.0), -lean, half),
        "right": cases.make_finger((aside, 0.0), lean, half),
    }
    tip = np.array([-aside + cases.LENGTH * np.sin(lean), cases.LENGTH * np.cos(lean)])
    along = np.array([-np.sin(lean), np.cos(lean)])  # of the other
    off = tip - [aside, 0.0]
    apart = float(np.hypot(*(off - np.clip(off @ along, 0.0, cases.LENGTH) * along)))
    crosses = tip[0] > 0.0
    expected = 2 * half - (0.0 if crosses else min(apart, 2 * aside))
    certificate = certify(*cases.apart(fingers))
    assert certificate["overlap of fingers, left, right"].value == pytest.approx(expected, abs=1e-5)
