"""The scan finds every posture that touches a disc; from inside: all its postures, of which a result shows one.

The scan finds every posture that touches a disc: brute force over dense grids, by closed forms and by sums.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from grasp_scenes import UPRIGHT, make_scene

from continuum_grasp.grasp.starts.candidates import first_joint
from continuum_grasp.grasp.starts.scan import touching
from continuum_grasp.grasp.starts.scan.task import ALLOWED, make_task, obstruction
from continuum_grasp.grasp.starts.scan.two_arcs import scanned_arcs
from continuum_grasp.scene import Circle, load
from tests.grasp.test_grasp_starts import finger_at, scene_of

LENGTH, HALF = 0.18, 0.006  # of the finger [m]


def task_of(family, middle, diameter=0.08, **more):
    """A finger, the center of a disc, and how far from there its tip touches, per length."""
    disc = Circle(shape="circle", diameter=diameter, mass=0.3, position=(0.04, 0.0))
    scene = make_scene(family, UPRIGHT, object=disc, **more)
    setup = scene.setups[0]
    on = {setup.tip_name, *(setup.middle_names if middle else ())}
    base = (*setup.finger.base.position, setup.finger.base.angle)
    task = make_task(scene, setup, base, scene.object.pose, 1, on)
    return task, complex(task.frame.point(0j)), (0.5 * diameter + HALF) / LENGTH


def crossings(gap, normal, facing):
    """Where neighbors (P, G) along an axis are on either side of the disc and the front of the tip touches, with a
    little to spare: rows and columns.
    """
    ahead = np.cos(normal - facing - 0.5 * math.pi) <= 0.0
    return np.nonzero((gap[:, :-1] * gap[:, 1:] < 0.0) & ahead[:, :-1] & ahead[:, 1:])


def ends_of(point, turn, rest, first, last, steps=48):
    """Tips (P, G) of curves on from points by the midpoint rule, and the angles there."""
    s = (np.arange(steps) + 0.5) / steps
    ell, first = rest[:, None], first[:, None]
    angle = turn[:, None, None] + ell[..., None] * (first[..., None] * (s - 0.5 * s**2) + 0.5 * last[..., None] * s**2)
    return point[:, None] + ell * (1j * np.exp(1j * angle)).mean(axis=2), turn[:, None] + 0.5 * ell * (first + last)


@pytest.mark.parametrize(("diameter", "base_y"), [(0.08, -0.09), (0.08, -0.055), (0.03, -0.055), (0.02, -0.04)])
def test_every_end_curvature_whose_tip_touches_is_found(diameter, base_y):
    """Also two that lie between two lines of the scan."""
    task, center, reach = task_of("matched_clothoid", True, diameter, base_y=base_y)
    first = touching.scanned(replace(task, tip=False))
    rest = 1.0 - first.joint
    # What follows begins with the curvature so far, and bends by a turn at most.
    first = first.take(np.abs(first.ends[:, 1]) * rest < 6.28)
    rest, found = 1.0 - first.joint, touching.onwards(task, first)[0]
    # Up to the curvatures that the scan states: a turn over what is left, at most 25 per length.
    most = np.minimum(6.283 / rest, 25.0)
    dense = np.linspace(-1.0, 1.0, 1601) * most[:, None]
    tips, facing = ends_of(first.point, first.turn, rest, first.ends[:, 1], dense)
    row, column = crossings(np.abs(tips - center) - reach, np.angle(tips - center), facing)
    for i, k in zip(row, column, strict=True):
        mine = np.abs(found.joint - first.joint[i]) + np.abs(found.ends[:, 1] - first.ends[i, 1]) < 1e-9
        last = found.ends[mine, 3]
        assert (np.abs(last - dense[i, k]) < 2.0 * most[i] / 800).any(), (i, k)
    assert np.abs(found.ends[:, 3]).max() <= 25.0
    # What is found touches, by the same sums with more places.
    there, _ = ends_of(found.point, found.turn, 1.0 - found.joint, found.ends[:, 1], found.ends[:, 3:], 2000)
    assert np.abs(np.abs(there[:, 0] - center) - reach).max() < 1e-6


def test_postures_of_fingers_that_taper_are_as_thick_as_between_their_contacts():
    scene = load("configs/grasp/spirob_cup.yaml")
    setup = scene.setups[0]
    on = {setup.tip_name, *setup.middle_names}
    task = make_task(scene, setup, (0.0, 0.0, 0.0), scene.object.pose, 1, on)
    thick = setup.finger.profile.half_thickness
    length = setup.finger.rod.length
    assert thick(0.9 * length) < task.half * length < thick(0.6 * length) < thick(0.0)


def test_every_pair_of_arcs_whose_tip_touches_is_found():
    task, center, reach = task_of("arc", False)
    found = scanned_arcs(task)
    bends = found.ends[:, [0, 2]] * 0.5
    rng = np.random.default_rng(1)
    lines = rng.uniform(-1.0, 1.0, 12) * task.bending_range
    dense = np.linspace(-1.0, 1.0, 4000) * task.bending_range
    one, two = np.broadcast_to(lines[:, None], (12, 4000)), np.broadcast_to(dense, (12, 4000))
    tips, facing = arcs(one, two)
    within = np.maximum(np.abs(one), np.abs(two)) * 2.0 <= task.limits.max()
    row, column = crossings(np.abs(tips - center) - reach, np.angle(tips - center), facing)
    for i, k in zip(row, column, strict=True):
        if within[i, k]:
            away = np.abs(bends - [lines[i], dense[k]]).max(axis=1)
            assert away.min() < 0.063, (i, k)  # the lines of the grid are so far apart
    there, _ = arcs(*bends.T)
    assert np.abs(np.abs(there - center) - reach).max() < 1e-8


def arcs(one, two):
    """Tips of two arcs of half the length by their bends, and the angles there."""
    z = (np.exp(1j * one) - 1.0) / one * 0.5 + np.exp(1j * one) * (np.exp(1j * two) - 1.0) / two * 0.5
    return z, one + two


SEEDS = (4, 12, 19, 43)
"""Arcs along faces and round corners, which no grid of bends comes near to."""


def polygons(seed):
    """A polygon round the origin and a finger of two arcs that looks at it from anywhere; its half thickness."""
    rng = np.random.default_rng(seed)
    radius, half = rng.uniform(0.01, 0.06), float(rng.choice([0.0, 0.002, 0.005]))
    angles = np.cumsum(rng.dirichlet(np.full(5, 4.0))) * math.tau
    vertices = [(radius * math.cos(a), radius * math.sin(a)) for a in angles.tolist()]
    away, turn = rng.uniform(radius + 0.01, 0.15), rng.uniform(0.0, math.tau)
    base = away * math.cos(turn), away * math.sin(turn), rng.uniform(0.0, math.tau)
    return scene_of(
        {"shape": "polygon", "vertices": vertices},
        {"f": finger_at(*base, half=half)},
        fidelity={"family": "arc", "elements": 2, "bending_range": 6.0},
    )


def clearances(corners, bends, length):
    """Least distance of arcs from a polygon, where along them it is, and whether the polygon is on their left there."""
    s = np.linspace(0.0, length, 601)
    points = (np.exp(1j * bends[:, None] * s) - 1.0) / bends[:, None]
    edges = np.roll(corners, -1) - corners
    off = points[..., None] - corners
    share = np.clip((off * edges.conj()).real / np.abs(edges) ** 2, 0.0, 1.0)
    gap = np.abs(off - share * edges).min(axis=2)
    rows, nearest = np.arange(len(bends)), gap.argmin(axis=1)
    onwards = 1j * np.exp(1j * bends * s[nearest])
    left = ((corners.mean() - points[rows, nearest]) * onwards.conj()).imag > 0.0
    return gap[rows, nearest], s[nearest], left


@pytest.mark.parametrize("seed", SEEDS)
def test_every_arc_that_first_touches_a_polygon_is_found(seed):
    """Along faces and round corners."""
    scene = polygons(seed)
    (setup,) = scene.setups
    base = (*setup.finger.base.position, setup.finger.base.angle)
    task = make_task(scene, setup, base, scene.object.pose, 1, {"f.middle"})
    corners = task.frame.point(np.array([complex(*v) for v in scene.object.vertices]))
    low, high = task.bounds
    bends = np.linspace(-6.0, 6.0, 500)
    gap, at, left = clearances(corners, bends, high)
    inside = left & (at > low + 0.01) & (at < high - 0.01)
    passed = np.flatnonzero(((gap[:-1] - task.half) * (gap[1:] - task.half) < 0.0) & inside[:-1] & inside[1:])
    found = first_joint(task)
    assert len(passed)
    for k in passed:
        assert np.abs(found.curvatures[:, 0] - bends[k]).min() < 0.03


def test_depths_are_those_of_finely_sampled_curves():
    """To half of what a start may be too deep."""
    task, center, reach = task_of("matched_clothoid", True)
    task, rng = replace(task, walls=()), np.random.default_rng(4)
    bends = rng.uniform(-8.0, 8.0, (200, 2))
    knots = np.tile([0.0, 1.0], (200, 1))
    found = obstruction(task, knots, bends, np.full((200, 1), 0.5))
    s = (np.arange(4000) + 0.5) / 4000
    steps = 1j * np.exp(1j * (bends[:, :1] * s + 0.5 * np.diff(bends, axis=1) * s**2)) / 4000
    depth = reach - np.abs(np.cumsum(steps, axis=1) - center).min(axis=1)
    near = np.abs(depth) < 0.1
    assert near.sum() > 40
    assert np.abs(found - depth)[near].max() < 0.5 * ALLOWED
