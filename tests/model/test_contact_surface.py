"""Distances from objects against brute force, and points on walls against the support function."""

from __future__ import annotations

import math
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from continuum_grasp.model import Vec, nearest, surface_of
from continuum_grasp.scene import Box, Circle, Ellipse, Polygon, Stadium, Superellipse, SuperellipsePart, Union

KEYS = {"mass": 0.1, "position": (0.0, 0.0)}
CORNERS = ((0.0, 0.0), (0.08, 0.01), (0.05, 0.06), (0.01, 0.05))
MUG = Union(
    shape="union",
    center_of_mass=(0.0, 0.0),
    members=(
        {"shape": "circle", "diameter": 0.08},
        {
            "shape": "box",
            "width": 0.03,
            "height": 0.012,
            "corner_radius": 0.004,
            "position": (0.05, 0.0),
            "angle": 0.3,
        },
    ),
    **KEYS,
)
OBJECTS = {
    "disc": Circle(shape="circle", diameter=0.08, **KEYS),
    "box": Box(shape="box", width=0.08, height=0.05, **KEYS),
    "rounded box": Box(shape="box", width=0.08, height=0.05, corner_radius=0.01, **KEYS),
    "polygon": Polygon(shape="polygon", vertices=CORNERS, **KEYS),
    "rounded polygon": Polygon(shape="polygon", vertices=CORNERS, corner_radius=0.006, **KEYS),
    "stadium": Stadium(shape="stadium", length=0.05, radius=0.02, **KEYS),
    "slim ellipse": Ellipse(shape="ellipse", width=0.05, height=0.12, **KEYS),
    "ellipse": Ellipse(shape="ellipse", width=0.1, height=0.05, **KEYS),
    "superellipse 3": Superellipse(shape="superellipse", width=0.1, height=0.06, exponent=3.0, **KEYS),
    "superellipse 8": Superellipse(shape="superellipse", width=0.12, height=0.05, exponent=8.0, **KEYS),
    "mug": MUG,
}


def distance(body) -> ca.Function:
    at = ca.SX.sym("at", 2)
    found = nearest(body.parts, Vec(at[0], at[1]))
    return ca.Function("distance", [at], [found.distance, found.normal.column(), ca.gradient(found.distance, at)])


def nearest_on(outline: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Nearest point of a closed polygon (count, 2)."""
    best, found = math.inf, outline[0]
    for a, b in pairwise([*outline, outline[0]]):
        share = np.clip((point - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0.0, 1.0)
        candidate = a + share * (b - a)
        if np.hypot(*(point - candidate)) < best:
            best, found = float(np.hypot(*(point - candidate))), candidate
    return found


def nearest_on_superellipse(part, point: np.ndarray) -> np.ndarray:
    """By scipy, over the angle of the direction from the center."""

    def place(turn: float) -> np.ndarray:
        c, s = math.cos(turn), math.sin(turn)
        size = (abs(c) ** part.exponent + abs(s) ** part.exponent) ** (-1.0 / part.exponent)
        return size * np.array([part.semi_axes[0] * c, part.semi_axes[1] * s])

    turns = np.linspace(0.0, math.tau, 721)
    start = turns[np.argmin([np.hypot(*(point - place(t))) for t in turns])]

    def lean(turn: float) -> float:
        return float((point - place(turn)) @ (place(turn + 1e-5) - place(turn - 1e-5)))

    return place(brentq(lean, start - 0.01, start + 0.01, xtol=1e-14))


def turned(v: np.ndarray) -> np.ndarray:
    return np.array([-v[1], v[0]])


def truth(body, point: np.ndarray) -> tuple[float, np.ndarray]:
    """Signed distance and normal, by the nearest of the parts."""
    answers = []
    for part in body.parts:
        if isinstance(part, SuperellipsePart):
            (a, b), p = part.semi_axes, part.exponent
            there, inside = nearest_on_superellipse(part, point), abs(point[0] / a) ** p + abs(point[1] / b) ** p < 1.0
            size = np.hypot(*(point - there)) * (-1.0 if inside else 1.0)
            answers.append((size, (point - there) / size))
            continue
        core = np.array(part.vertices)
        there = nearest_on(core, point) if len(core) > 1 else core[0]
        edges = [] if len(core) == 1 else list(pairwise([*core, core[0]]))
        inside = bool(edges) and all((b - a) @ turned(point - a) < 0.0 for a, b in edges)
        size = np.hypot(*(point - there)) * (-1.0 if inside else 1.0)
        answers.append((size - part.radius, (point - there) / size))
    return min(answers, key=lambda answer: answer[0])


@pytest.mark.parametrize("name", OBJECTS)
def test_distance_and_normal_are_those_of_the_nearest_point(name):
    """As near as half thicknesses go, and pressed in by up to 2 mm."""
    function, rng = distance(OBJECTS[name]), np.random.default_rng(0)
    tried = 0
    while tried < 60:
        point = rng.uniform([-0.08, -0.06], [0.11, 0.09])
        expected, normal = truth(OBJECTS[name], point)
        if not -0.002 < expected < 0.012:
            continue
        found, direction, slope = (np.array(v).ravel() for v in function(point))
        assert found[0] == pytest.approx(expected, abs=2e-9)
        assert direction == pytest.approx(normal, abs=1e-5)
        assert slope == pytest.approx(direction, abs=5e-6)
        tried += 1


def beyond_a_corner(angle_deg):
    """A polygon with an acute corner, points whose nearest place it is, and their offsets from it."""
    rng, half = np.random.default_rng(0), 0.5 * math.radians(angle_deg)
    ends = 0.06 * np.exp(1j * np.array([math.pi - half, math.pi + half]))
    core = (0.035 - 0.0135j) + np.exp(2.1j) * np.array([0.0, *ends])
    off = 10.0 ** rng.uniform(-5.0, -1.0, 300) * np.exp(1j * rng.uniform(-1.0, 1.0, 300) * (0.499 * math.pi - half))
    points = core[0] + np.exp(2.1j) * off
    return Polygon(shape="polygon", vertices=tuple((z.real, z.imag) for z in core), **KEYS), points, off


ANGLES = [0.5, 3.0, 20.0, 80.0]


@pytest.mark.parametrize("angle_deg", ANGLES)
def test_whatever_lies_beyond_an_acute_corner_is_outside(angle_deg):
    """Only the corner is near it, though it lies behind one of the faces there: as of the thin parts of outlines."""
    body, points, off = beyond_a_corner(angle_deg)
    function, outline = distance(body), surface_of(body.parts[0]).outline(body.parts[0])
    assert outline.distance(points) == pytest.approx(np.abs(off), rel=1e-10)
    for point, away in zip(points[::10], off[::10], strict=True):
        found, normal, _ = (np.array(v).ravel() for v in function([point.real, point.imag]))
        assert found[0] == pytest.approx(abs(away), rel=1e-10)
        assert complex(*normal) == pytest.approx(np.exp(2.1j) * away / abs(away), abs=1e-9)


def test_at_the_end_of_a_face_a_contact_is_on_the_face_along_which_it_can_slide():
    part = OBJECTS["box"].parts[0]
    surface = surface_of(part)
    for corner in part.vertices[2:]:
        found = surface.near(part, corner, 0.5 * math.pi, 0.005)
        assert (found.lower, found.upper, found.curvature) == ((0.0,), (1.0,), 0.0)


@pytest.mark.parametrize("name", OBJECTS)
def test_nothing_far_away_is_taken_to_touch(name):
    function, rng = distance(OBJECTS[name]), np.random.default_rng(1)
    for _ in range(200):
        turn, size = rng.uniform(0.0, math.tau), rng.uniform(0.11, 1.0)
        assert float(function([size * math.cos(turn), size * math.sin(turn)])[0]) > 0.1 * (size - 0.09)


@pytest.mark.parametrize("name", [name for name in OBJECTS if name != "mug"])
def test_one_of_the_lowest_points_reaches_as_far_as_the_support_function(name):
    part = OBJECTS[name].parts[0]
    for turn in np.linspace(0.0, math.tau, 41):
        way = Vec(math.cos(turn), math.sin(turn))
        reaches = [float(ca.DM(way.dot(at))) for at in surface_of(part).lowest_points(part, way)]
        assert max(reaches) == pytest.approx(part.support(turn), abs=1e-9)


@pytest.mark.parametrize("place", [(0.0, 0.025), (0.04, 0.01), (0.04, 0.025), (0.0, 0.0)])
def test_points_on_faces_corners_and_axes_of_a_box_give_finite_slopes(place):
    values = [np.array(v).ravel() for v in distance(OBJECTS["box"])(place)]
    assert all(np.all(np.isfinite(v)) for v in values)
    assert values[0][0] == pytest.approx(-0.025 if place == (0.0, 0.0) else 0.0, abs=1e-11)
