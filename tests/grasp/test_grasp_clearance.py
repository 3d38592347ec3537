"""Depths of fingers in objects, walls, each other and themselves, by hand; from inside: curves made here, in one body.

Depths of fingers in objects, walls, each other and themselves, against figures worked out by hand and shapely.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from continuum_grasp.grasp import certify
from continuum_grasp.grasp.certificate.check import depth_in_object, depth_in_wall, depth_of_wall, overlap, self_overlap
from continuum_grasp.grasp.certificate.surfaces import PlacedObject
from continuum_grasp.scene import Box, Circle, Ellipse, Line, Palm
from tests import certificate_cases as cases
from tests.grasp.test_grasp_curled import apart


def line_of_points(*corners, count=401):
    path = np.array(corners, dtype=float)
    s = np.linspace(0, len(path) - 1, count)
    return np.column_stack([np.interp(s, range(len(path)), column) for column in path.T])


def test_a_corner_between_two_samples_is_seen():
    """A straight backbone passes a sharp corner; the samples are farther apart than the corner reaches beyond it."""
    body = Box(shape="box", width=0.1, height=0.1, mass=0.1, position=(0.0, 0.0), angle=np.pi / 4)
    placed = PlacedObject(body, body.pose)
    corner = 0.05 * 2**0.5
    for thickness in (0.0, 1e-4, 5e-3):
        for depth in (-2e-5, 0.0, 1e-4, 2e-4):
            x = corner + thickness - depth
            points = line_of_points((x, -0.1003), (x, 0.1))
            found = depth_in_object(points, placed, thickness)
            within = max(depth - thickness, 0.0)  # of the backbone itself, whose distance is that from the faces
            assert found == pytest.approx(depth - within + within / 2**0.5, abs=1e-5)


def test_an_object_across_a_finite_line():
    wall = Line(type="line", start=(-0.05, 0.0), end=(0.05, 0.0)).walls("w")[0]
    for turn in (0.0, 0.3, np.pi / 4):
        for lift in (-1e-3, -1e-5, 1e-5, 1e-3):
            reach = 0.02 * (abs(np.cos(turn)) + abs(np.sin(turn)))
            values = {"mass": 0.1, "position": (0.011, reach + lift), "angle": turn}
            body = Box(shape="box", width=0.04, height=0.04, **values)
            assert depth_of_wall(PlacedObject(body, body.pose), wall) == pytest.approx(-lift, abs=1e-7)
    body = Box(shape="box", width=0.04, height=0.04, mass=0.1, position=(0.08, -0.01))
    assert depth_of_wall(PlacedObject(body, body.pose), wall) == pytest.approx(-0.01, abs=1e-9)


def test_a_thin_object_between_two_samples_is_seen():
    """A needle's end and a wire, thinner than the samples are apart."""
    wire = Circle(shape="circle", diameter=2e-4, mass=0.1, position=(0.0, 0.0))
    needle = Ellipse(shape="ellipse", width=0.1, height=0.001, mass=0.1, position=(0.05, 0.0))
    for body, exact in ((wire, 1e-4), (needle, 3.12e-5)):
        placed = PlacedObject(body, body.pose)
        points = line_of_points((1e-4, -0.1003), (1e-4, 0.1))
        if body is wire:
            points[:, 0] = 0.0
        assert depth_in_object(points, placed, 0.0) == pytest.approx(exact, rel=0.4)
        assert depth_in_object(points - [0.001, 0], placed, 0.0) < 0.0


def test_a_finger_that_comes_out_of_a_wall():
    wall = Line(type="line", start=(0.3, 0.0), end=(-0.3, 0.0)).walls("w")[0]
    palm = Palm(point=(0.0, 0.0), normal_angle=-np.pi / 2).walls("p")[0]
    out = line_of_points((0, 0.01), (0, -0.05), (0.05, -0.05))
    for thickness in (0.004, 0.0):
        assert depth_in_wall(out, palm, thickness, 100) <= 0.0
    assert depth_in_wall(line_of_points((0, 0.01), (0.01, 0.02), (0.05, -0.05)), palm, 0.004, 300) == pytest.approx(
        0.01
    )
    back = line_of_points((0, 0.0), (0, -0.05), (0.05, -0.001))
    assert depth_in_wall(back, palm, 0.004, 100) == pytest.approx(0.003)
    assert depth_in_wall(back, wall, 0.004, 100) == pytest.approx(0.003)
    beside = line_of_points((0, -0.05), (0.1, -0.002), (0.2, -0.05))
    assert depth_in_wall(beside, palm, 0.004, 400) == pytest.approx(0.002)  # its base is free: all of it must be
    through = line_of_points((0.0, -0.05), (0.1, 0.05), (0.11, 0.05))
    assert depth_in_wall(through, wall, 0.0, 5) == pytest.approx(0.05)
    past = line_of_points((0.31, -0.05), (0.31, 0.05))
    assert depth_in_wall(past, wall, 0.004, 5) == pytest.approx(-0.006, abs=1e-6)


def rod(curvatures, half):
    """A finger of length 1 whose curvature is linear between values at even places, as the check sees it."""
    s = np.linspace(0.0, 1.0, 801)
    curvature = np.interp(s, np.linspace(0.0, 1.0, len(curvatures)), curvatures)
    angles = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(s))])
    middle = 0.5 * (angles[1:] + angles[:-1])
    points = np.concatenate([[0.0], np.cumsum(np.exp(1j * middle) * np.diff(s))])
    points = np.stack([points.real, points.imag], axis=1)
    edges = SimpleNamespace(edges=s)
    return SimpleNamespace(points=points, angles=angles, rod=edges, thickness=np.full(s.size, half), length=1.0)


def test_a_circle_that_is_all_but_closed_or_passed_again():
    half, turns = 0.004, 0.99
    ends = 2.0 * np.sin(np.pi * (1.0 - turns)) / (2.0 * np.pi * turns)
    assert -self_overlap(rod([2.0 * np.pi * turns] * 2, half)) == pytest.approx(ends - 2.0 * half, rel=1e-3)
    assert self_overlap(rod([2.0 * np.pi * 1.2] * 2, half)) > 1.999 * half


def test_a_finger_that_turns_by_less_than_half_a_circle_cannot_reach_itself():
    assert self_overlap(rod([3.0, 3.0], 0.05)) < 0.0
    assert self_overlap(rod([0.0, 0.0], 0.05)) < 0.0


def test_depth_agrees_with_distances_of_random_fingers():
    """With a finger mirrored and thicker ones; those that cross are deeper than they are thick."""
    rng, crossed = np.random.default_rng(5), 0
    for _ in range(25):
        curvatures, half = rng.normal(6.0, 7.0, 4), rng.uniform(0.002, 0.02)
        finger = rod(curvatures, half)
        if np.abs(np.diff(finger.angles)).sum() < np.pi:
            continue
        found, least = self_overlap(finger), apart(finger.points, half)
        assert self_overlap(rod(-curvatures, half)) == pytest.approx(found, abs=1e-9)
        if shapely.LineString(finger.points).is_simple:
            assert found == pytest.approx(2.0 * half - least, abs=1e-4)
        else:
            crossed += 1
            assert found > 2.0 * half - 1e-9
    assert crossed > 3


@pytest.mark.parametrize("half", [0.0, 0.006])
@pytest.mark.parametrize("lean", [0.2, -0.2, 0.02])
def test_fingers_that_cross_overlap_by_as_much_as_they_reach_beyond(half, lean):
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
    expected = 2 * half + (apart if crosses else -min(apart, 2 * aside))
    certificate = certify(*cases.apart(fingers))
    assert overlap(*certificate.grasp.fingers) == pytest.approx(expected, abs=2e-6)
    assert certificate.overlap == pytest.approx(max(expected, 0.0), abs=2e-6)
