"""Shapes of a given curvature against those of a circle."""

from __future__ import annotations

import cmath

import numpy as np
import pytest

from continuum_grasp.rod.dense_rod import DenseRod
from continuum_grasp.scene import Finger
from tests.finger_cases import ROD

LENGTH, CURVATURE, DENSITY = 0.6, 3.0, 0.7
START, ANGLE = complex(0.1, -0.2), 0.4


def test_places_and_the_first_moment_of_a_circle():
    rod = DenseRod(Finger(rod=ROD), np.array([0.0, 0.25, LENGTH]), base=(START.real, START.imag, ANGLE))
    curvature = np.full(rod.nodes.shape, CURVATURE)
    circle = [START + (cmath.rect(1.0, ANGLE + CURVATURE * s) - cmath.rect(1.0, ANGLE)) / CURVATURE for s in rod.edges]
    assert rod.edge_points(curvature) == pytest.approx(np.array([[z.real, z.imag] for z in circle]), abs=1e-14)
    chord = (cmath.rect(1.0, CURVATURE * LENGTH) - 1.0) / (1j * CURVATURE)
    moment = DENSITY * (LENGTH * START + (chord - LENGTH) * cmath.rect(1.0, ANGLE) / CURVATURE)
    found = rod.first_moment(np.full(rod.nodes.shape, DENSITY), rod.angle(curvature))
    assert found == pytest.approx([moment.real, moment.imag], abs=1e-14)
