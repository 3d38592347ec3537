"""Depths of fingers in objects and walls, by hand; from inside: the depth of one curve in one body.

Depths of fingers in objects and walls, of these in each other, against figures worked out by hand.
"""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.grasp.certificate.check import depth_in_object, depth_in_wall, depth_of_wall
from continuum_grasp.grasp.certificate.surfaces import PlacedObject
from continuum_grasp.scene import Box, Circle, Ellipse, Line, Palm


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
