"""Curves and distances, compiled and not, by closed forms and one by the other; from inside: both ways are called."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from grasp_scenes import SHAPES, make_scene
from numpy.testing import assert_allclose

from continuum_grasp.grasp.starts import curves
from continuum_grasp.grasp.starts.curves import rough_distance, sample
from continuum_grasp.grasp.starts.supports import object_outlines
from continuum_grasp.model import surface_of
from tests.model.test_contact_surface import ANGLES, beyond_a_corner


def without(monkeypatch):
    monkeypatch.setattr(curves, "_library", lambda: None)


@pytest.fixture(params=["compiled", "not compiled"])
def way(request, monkeypatch):
    """Each way to compute; the compiled one where there is a compiler."""
    if request.param == "not compiled":
        without(monkeypatch)
    elif curves._library() is None:
        pytest.skip("no C compiler")
    return request.param


def outlines_of(shape):
    return object_outlines(make_scene(object={**SHAPES[shape], "mass": 0.3, "position": (0.1, 0.0)}))


def test_points_of_arcs_are_those_of_circles(way):
    # Two arcs that meet at 0.4, whose curvature steps there, as two knots at one place.
    one, two = np.array([2.0, -3.0]), np.array([-1.5, 4.0])
    knots = np.array([[0.0, 0.4, 0.4, 1.0]] * 2)
    at = np.tile(np.linspace(0.0, 1.0, 101), (2, 1))
    found = sample(knots, np.stack([one, one, two, two], axis=1), at)
    for k in range(2):
        bent, more = np.minimum(at[k], 0.4) * one[k], np.maximum(at[k] - 0.4, 0.0) * two[k]
        first = (np.exp(1j * bent) - 1.0) / one[k]
        second = np.exp(1j * 0.4 * one[k]) * (np.exp(1j * more) - 1.0) / two[k]
        assert_allclose(found[k], first + second, atol=1e-8)


@pytest.mark.parametrize("shape", ["circle", "polygon"])
def test_distances_are_those_of_sampled_outlines(way, shape):
    points = np.random.default_rng(1).uniform(-0.15, 0.15, (60, 2)) @ [1.0, 1j]
    if shape == "circle":
        outline = 0.04 * np.exp(1j * np.linspace(0.0, math.tau, 20001))
    else:
        corners = np.array([complex(*v) for v in SHAPES["polygon"]["vertices"]])
        edges = pairwise([*corners, corners[0]])
        outline = np.concatenate([a + (b - a) * np.linspace(0.0, 1.0, 4001) for a, b in edges])
    brute = np.abs(points[:, None] - outline).min(axis=1)
    assert_allclose(np.abs(rough_distance(outlines_of(shape), points)), brute, atol=2e-5)
    assert rough_distance(outlines_of(shape), np.zeros(1, complex))[0] < 0.0


@pytest.mark.parametrize("angle_deg", ANGLES)
def test_whatever_lies_beyond_an_acute_corner_is_outside(way, angle_deg):
    body, points, off = beyond_a_corner(angle_deg)
    outlines = tuple(surface_of(part).outline(part) for part in body.parts)
    assert_allclose(rough_distance(outlines, points), np.abs(off), rtol=1e-10)


def test_a_process_that_had_no_compiler_for_a_while_has_one_again(monkeypatch):
    if curves._library() is None:
        pytest.skip("no C compiler")
    with monkeypatch.context() as without_compiler:
        without_compiler.setenv("CC", "")
        assert curves._library() is None
    assert curves._library() is not None


@pytest.mark.parametrize("shape", SHAPES)
def test_compiled_distances_are_those_of_numpy(monkeypatch, shape):
    if curves._library() is None:
        pytest.skip("no C compiler")
    points = np.random.default_rng(2).uniform(-0.2, 0.2, (300, 2)) @ [1.0, 1j]
    compiled = rough_distance(outlines_of(shape), points)
    without(monkeypatch)
    assert_allclose(compiled, rough_distance(outlines_of(shape), points), atol=1e-14)
