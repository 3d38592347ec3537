"""The inner loops of the scan, compiled and not; from inside: each loop is called alone, with and without its C.

The inner loops of the scan, compiled and not: closed forms, conditions of optimality, and one by the other.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from grasp_scenes import SHAPES, UPRIGHT, make_scene
from numpy.testing import assert_allclose

from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.starts.scan import kernel
from continuum_grasp.grasp.starts.scan.curves import sample
from continuum_grasp.grasp.starts.scan.kernel import within_bounds
from continuum_grasp.grasp.starts.scan.task import make_task
from continuum_grasp.grasp.starts.starts import basin_starts


def without(monkeypatch):
    monkeypatch.setattr(kernel, "library", lambda: None)


@pytest.fixture(params=["compiled", "not compiled"])
def way(request, monkeypatch):
    """Each way to compute; the compiled one where there is a compiler."""
    if request.param == "not compiled":
        without(monkeypatch)
    elif kernel.library() is None:
        pytest.skip("no C compiler")
    return request.param


@pytest.mark.parametrize(("rows", "columns"), [(6, 5), (7, 26), (9, 74)])
def test_least_squares_within_bounds_are_optimal(way, rows, columns):
    # Half of the systems have a range of 1e6 in their columns, as tensions beside normal forces do.
    rng = np.random.default_rng(rows)
    across = rng.normal(size=(40, columns, rows)) * 10.0 ** rng.uniform(-6.0, 0.0, (40, columns, 1))
    across[20:] = rng.normal(size=(20, columns, rows))
    goal, weight, enough = rng.normal(size=(40, rows)), rng.uniform(1e-8, 1e-4, columns), 1e-10
    x = within_bounds(across, goal, weight, enough)
    assert (x >= 0.0).all()
    assert (x <= 1.0).all()
    left = np.einsum("bnm,bn->bm", across, x) - goal
    slope = np.einsum("bnm,bm->bn", across, left) + weight
    # The gap between the primal and the dual problem bounds how far the value is from the least.
    gap = (np.maximum(slope, 0.0) * x + np.maximum(-slope, 0.0) * (1.0 - x)).sum(axis=1)
    assert gap.max() < 20.0 * columns * enough


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
    task = task_of(scene_with(shape))
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (60, 2)) @ [1.0, 1j]
    if shape == "circle":
        outline = 0.04 * np.exp(1j * np.linspace(0.0, math.tau, 20001))
    else:
        corners = np.array([complex(*v) for v in SHAPES["polygon"]["vertices"]])
        edges = pairwise([*corners, corners[0]])
        outline = np.concatenate([a + (b - a) * np.linspace(0.0, 1.0, 4001) for a, b in edges])
    placed = task.frame.point(outline)
    brute = np.abs(points[:, None] - placed).min(axis=1)
    assert_allclose(np.abs(task.rough_distance(points)), brute, atol=1e-4)
    assert task.rough_distance(np.array([task.frame.point(0j)]))[0] < 0.0


def test_a_process_that_had_no_compiler_for_a_while_has_one_again(monkeypatch):
    if kernel.library() is None:
        pytest.skip("no C compiler")
    with monkeypatch.context() as without_compiler:
        without_compiler.setenv("CC", "")
        assert kernel.library() is None
    assert kernel.library() is not None


@pytest.mark.parametrize("shape", SHAPES)
def test_compiled_distances_are_those_of_numpy(monkeypatch, shape):
    if kernel.library() is None:
        pytest.skip("no C compiler")
    task = task_of(scene_with(shape, angle=0.4))
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (300, 2)) @ [1.0, 1j]
    compiled = task.rough_distance(points)
    without(monkeypatch)
    assert_allclose(compiled, task.rough_distance(points), atol=1e-13)


@pytest.mark.parametrize(("family", "middle"), [("arc", "off"), ("clothoid", "on")])
def test_basins_are_the_same_without_a_compiler(monkeypatch, family, middle):
    if kernel.library() is None:
        pytest.skip("no C compiler")
    contacts = {"friction": 0.6, "normal_force_max": 30.0, "middle": middle, "tip": "on"}
    scene = make_scene(object=scene_with("superellipse").object, family=family, contacts=contacts, gravity=UPRIGHT)

    def numbers():
        starts, basins = basin_starts(scene, contact_modes(scene)[0])
        assert starts
        return [basins.places, basins.postures, *(start.estimate for start in starts)]

    # The compiled one ends where tensions are exact to 5e-5 of their limits.
    compiled = numbers()
    without(monkeypatch)
    assert compiled == pytest.approx(numbers(), rel=1e-4, nan_ok=True)


def scene_with(shape, angle=0.0):
    # Turned objects stay clear of the palm.
    return make_scene(
        object={**SHAPES[shape], "mass": 0.3, "position": (0.04 + 0.02 * bool(angle), 0.0), "angle": angle}
    )


def task_of(scene):
    setup = scene.setups[0]
    base = (*setup.finger.base.position, setup.finger.base.angle)
    return make_task(scene, setup, base, scene.object.pose, 1, set())
