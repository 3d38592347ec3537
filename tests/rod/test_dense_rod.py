"""Shapes of a given curvature against those of circles, and of clothoids by quadrature."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.rod import DenseRod
from tests import certificate_cases as cases


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
