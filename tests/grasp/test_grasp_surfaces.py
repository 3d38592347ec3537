"""Distances, normals and curvatures of surfaces; from inside: those of the certificate, point by point.

Distances, normals and curvatures of surfaces against dense samples of the outlines, made here.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from continuum_grasp.grasp.certificate.surfaces import PlacedObject, nearest, support_point
from continuum_grasp.scene import (
    Box,
    Circle,
    Ellipse,
    OffsetPolygon,
    Polygon,
    Stadium,
    Superellipse,
    SuperellipsePart,
    Union,
)

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
