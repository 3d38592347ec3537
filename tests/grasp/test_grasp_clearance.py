"""Dense clearances and the densely integrated rod, against figures worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.grasp.certificate.check import depth_in_object, depth_of_wall
from continuum_grasp.grasp.certificate.surfaces import PlacedObject
from continuum_grasp.rod.dense_rod import DenseRod
from continuum_grasp.scene.objects import Box
from continuum_grasp.scene.supports import Line
from tests import certificate_cases as cases


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


def test_dense_rod_against_a_circle():
    finger = cases.make_finger((0.1, 0.2), 0.0)
    rod = DenseRod(finger, np.array([0.0, 0.1, 0.3]))
    bent = np.full(rod.nodes.size, 5.0)

    def circle(s):
        return np.array([0.1, 0.2]) + np.stack([np.cos(5 * s) - 1, np.sin(5 * s)], axis=1) / 5

    assert np.abs(rod.edge_points(bent) - circle(rod.edges)).max() < 1e-15
    s = np.array([0.0, 0.0123, 0.1, 0.2777, 0.3])
    points, angles = rod.at(bent, s)
    assert np.abs(points - circle(s)).max() < 1e-15
    assert angles == pytest.approx(5 * s, abs=1e-14)  # rounding of a sum over all panels
    mean = np.array([0.1 * 0.3 + (np.sin(1.5) / 5 - 0.3) / 5, 0.2 * 0.3 + (1 - np.cos(1.5)) / 25])
    assert rod.first_moment(np.ones(rod.nodes.size), rod.angle(bent)) == pytest.approx(mean, abs=1e-15)
    several = rod.edge_points(np.stack([bent, 2 * bent]))
    assert np.array_equal(several[0], rod.edge_points(bent))
    assert np.array_equal(several[1], rod.edge_points(2 * bent))


def test_dense_rod_against_quadrature_for_clothoids():
    finger = cases.make_finger((0.1, 0.2), 0.4)
    lengths, ends = np.array([0.07, 0.13]), np.array([[2.0, 15.0], [15.0, -20.0]])
    s = np.linspace(0, 0.2, 23)
    exact = cases.bent((0.1, 0.2, 0.4), ends, lengths, s)
    rod = DenseRod(finger, np.array([0.0, 0.07, 0.2]))
    points, angles = rod.at(np.interp(rod.nodes, rod.joints, [2.0, 15.0, -20.0]), s)
    assert np.abs(points - exact[:, :2]).max() < 1e-14
    assert angles == pytest.approx(exact[:, 2], abs=1e-14)
