"""Maps of fingers, from inside: a single equilibrium of one has no door; the search shows grasps alone.

Rods are compared with an integration that knows their equations alone, distances with sampled outlines.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from grasp_scenes import SHAPES, make_scene
from scipy.integrate import solve_ivp

import continuum_grasp as cg
from continuum_grasp.core import Compiler
from continuum_grasp.grasp.finger_map import FingerMap, ObjectBalance, SceneMaps, places_of, rod, rough_distance
from continuum_grasp.grasp.object_supports import object_outlines
from continuum_grasp.grasp.rods.contact_sets import contact_sets
from continuum_grasp.model import surface_of
from tests.model.test_contact_surface import ANGLES, beyond_a_corner

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="the map is compiled")


def grasp_scene(name):
    return cg.load(f"configs/grasp/{name}.yaml")


def finger_of(scene):
    (setup,) = scene.setups
    on = frozenset(setup.switches)
    return rod.MapFinger(scene, setup, rod.ObjectTable(scene), setup.finger.base.pose, scene.object.pose, on)


def bent(seed, count):
    """Numbers of rods that bend towards the mug and end beside it."""
    rng = np.random.default_rng(seed)
    base = np.array([4.0, 0.0, 0.0, 3.0]) + 0.7 * rng.normal(size=(count, 4))
    return np.column_stack([base, rng.uniform(0.3, 0.5, count), rng.uniform(0.0, 3.0, count), rng.normal(size=count)])


def end_of(finger, z):
    """Place and angle of a tip, and the moment there, by an integration that knows the rod's equations alone."""
    start = np.array(finger.base) / [finger.length, finger.length, 1.0]
    center = complex(0.04, 0.0) / finger.length  # of the mug, a disc
    half = float(finger.setup.finger.profile.half_thickness(0.0)) / finger.length

    def slopes(_, state, force):
        _, _, angle, curvature = state
        tangent = complex(-math.sin(angle), math.cos(angle))
        return [tangent.real, tangent.imag, curvature, -(tangent.conjugate() * force).imag]

    force = complex(z[1], z[2])
    options = {"rtol": 1e-11, "atol": 1e-12, "args": (force,)}
    first = solve_ivp(slopes, (0.0, z[4]), [*start, z[0]], **options).y[:, -1]
    normal = complex(first[0], first[1]) - center
    normal /= abs(normal)
    force -= normal * complex(z[5], z[6])
    first[3] += half * z[6]
    last = solve_ivp(slopes, (z[4], 1.0), first, rtol=1e-11, atol=1e-12, args=(force,)).y[:, -1]
    normal = complex(last[0], last[1]) - center
    normal /= abs(normal)
    along = (force * normal.conjugate()).imag
    return last[0], last[1], last[3] - z[3] + half * along, (force * normal.conjugate()).real


def test_a_rod_is_the_solution_of_its_equations():
    finger = finger_of(grasp_scene("mug"))
    z = bent(0, 4)
    at = finger.traced(z)
    tip = [part.value[:, -1] for part in (*at.touches.place, at.touches.force[0])]
    found = np.stack([*tip[:2], at.conditions.value[:, 0] / rod.FORCE, tip[2]], axis=1)
    expected = np.array([end_of(finger, row) for row in z])
    assert found[:, :3] == pytest.approx(expected[:, :3], abs=4e-3)
    assert found[:, 3] == pytest.approx(expected[:, 3], abs=3e-2)


@pytest.mark.parametrize("curvature", [-2.0, 0.5, 3.0])
def test_a_rod_without_forces_is_an_arc(curvature):
    """To the remainder of the rule of Euler and Maclaurin."""
    finger = finger_of(grasp_scene("mug")).with_middles(0)
    place = finger.traced(np.array([[curvature, 0.0, 0.0, curvature]]), slopes=False).touches.place
    end = [float(part.value[0, -1]) for part in place]
    x, y, angle = finger.base
    turned = np.array([math.cos(angle + curvature) - math.cos(angle), math.sin(angle + curvature) - math.sin(angle)])
    remainder = 2.0 * abs(curvature) ** 3 / finger.sampling.steps**4 / 720.0
    assert end == pytest.approx(np.array([x, y]) / finger.length + turned / curvature, abs=remainder + 1e-12)


def test_rods_converge_with_the_square_of_the_step():
    finger = finger_of(grasp_scene("mug"))
    z, errors = bent(0, 4), []
    expected = np.array([end_of(finger, row)[:2] for row in z])
    for steps in (40, 80):
        finger.struct.steps = steps
        places = finger.traced(z, slopes=False).touches.place
        errors.append(np.abs(np.stack([part.value[:, -1] for part in places], axis=1) - expected).max())
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.4)


@pytest.mark.parametrize("name", ["mug", "spirob_cup"])
def test_slopes_are_those_of_differences(name):
    finger = finger_of(grasp_scene(name))
    z = bent(1, 3)
    at, step = finger.traced(z), 1e-6
    # Beyond the table of distances, which ends beside the object, they need only grow.
    near = np.abs(at.out[:, 7, 0]) < 0.3
    for k in range(finger.numbers):
        off = step * np.eye(finger.numbers)[k]
        change = finger.traced(z + off, slopes=False).out[..., 0] - finger.traced(z - off, slopes=False).out[..., 0]
        contact = slice(0, 7)
        assert at.out[near, contact, 1 + k] == pytest.approx(change[near, contact] / (2.0 * step), abs=1e-5)
        ends = slice(9, 11)  # the tip's place
        assert at.out[:, ends, 1 + k] == pytest.approx(change[:, ends] / (2.0 * step), abs=1e-4)


@pytest.mark.parametrize("name", ["mug", "spirob_cup"])
def test_rods_side_by_side_are_those_one_by_one(name):
    """Of thirteen some have neighbors, and the last ones are no full block."""
    finger = finger_of(grasp_scene(name))
    z = bent(2, 13)
    alone = finger.traced(z, slopes=False).out[..., 0]
    together = finger.touches(z).out[..., 0]
    assert together == pytest.approx(alone[:, : together.shape[1]], abs=1e-10)


def test_samples_touch_as_they_should():
    finger = finger_of(grasp_scene("oval_flask"))
    samples = FingerMap.of(finger).samples
    assert len(samples) > 100
    assert np.abs(samples.touches.gap.value).max() < 2e-3
    assert np.abs(samples.touches.lean.value[:, 0]).max() < 5e-3
    assert np.abs(samples.conditions.value[:, 0]).max() < 2e-3


def balance_of(scene):
    """Balance of a scene with all contacts, and the maps of its fingers."""
    (mode, *_) = contact_sets(scene)
    pose, bases = places_of(scene, mode)[0]
    held = SceneMaps(scene)
    maps = [held.map_of(setup.name, base, pose, mode) for setup, base in zip(scene.setups, bases, strict=True)]
    return ObjectBalance(scene, mode, [one.finger for one in maps], pose), maps


def wrench_of(contacts, center):
    """Force and moment about a center of forces (normal, friction) at points with normals, all complex."""
    forces = [normal * complex(*force) for _, normal, force in contacts]
    moment = sum(((p - center).conjugate() * f).imag for (p, _, _), f in zip(contacts, forces, strict=True))
    return sum(forces), moment


@pytest.mark.parametrize("name", ["mug", "pinch"])
def test_settled_combinations_hold_the_weight_within_their_cones(name):
    scene = grasp_scene(name)
    held, maps = balance_of(scene)
    settled = held.settle(held.candidates(maps))
    (row, *_) = settled.holding(scene.object.size)
    best = settled.x[row : row + 1]
    traced = held.traced(best, slopes=False)
    normal, friction = (force[0] for force in held.forces(best, traced))
    contacts, borne = [], list(zip(normal, friction, strict=True))
    for at in traced:
        on, length = at.finger.middles + at.finger.tip, at.finger.length
        parts = [part.value[0, :on] for part in (*at.touches.skin, *at.touches.normal)]
        for x, y, nx, ny in zip(*parts, strict=True):
            contacts.append((length * complex(x, y), complex(nx, ny), borne[len(contacts)]))
    for start in held.supports.values():
        turn = complex(math.cos(held.pose[2]), math.sin(held.pose[2]))
        normal_there = turn * complex(math.cos(start.normal_angle), math.sin(start.normal_angle))
        point = complex(*held.pose[:2]) + turn * complex(*start.point)
        contacts.append((point, normal_there, borne[len(contacts)]))
    force, moment = wrench_of(contacts, complex(*scene.object.pose[:2]))
    weight = scene.object.mass * complex(*scene.gravity[:2])
    # Contacts' forces act on fingers and supports.
    assert force == pytest.approx(weight, abs=1e-3 * held.force)
    assert moment == pytest.approx(0.0, abs=1e-3 * held.force * scene.object.size)
    assert (np.abs(friction) <= scene.contacts.friction * normal + 1e-3 * held.force).all()
    assert normal.min() > 0.0


# -- distances ---------------------------------------------------------------------------------------------------


def outlines_of(shape):
    return object_outlines(make_scene(object={**SHAPES[shape], "mass": 0.3, "position": (0.1, 0.0)}))


@pytest.mark.parametrize("shape", ["circle", "polygon"])
def test_distances_are_those_of_sampled_outlines(shape):
    points = np.random.default_rng(1).uniform(-0.15, 0.15, (60, 2)) @ [1.0, 1j]
    if shape == "circle":
        outline = 0.04 * np.exp(1j * np.linspace(0.0, math.tau, 20001))
    else:
        corners = np.array([complex(*v) for v in SHAPES["polygon"]["vertices"]])
        edges = pairwise([*corners, corners[0]])
        outline = np.concatenate([a + (b - a) * np.linspace(0.0, 1.0, 4001) for a, b in edges])
    brute = np.abs(points[:, None] - outline).min(axis=1)
    assert np.abs(rough_distance(outlines_of(shape), points)) == pytest.approx(brute, abs=2e-5)
    assert rough_distance(outlines_of(shape), np.zeros(1, complex))[0] < 0.0


@pytest.mark.parametrize("angle_deg", ANGLES)
def test_points_beyond_an_acute_corner_are_outside(angle_deg):
    body, points, off = beyond_a_corner(angle_deg)
    outlines = tuple(surface_of(part).outline(part) for part in body.parts)
    assert rough_distance(outlines, points) == pytest.approx(np.abs(off), rel=1e-10)


@pytest.mark.parametrize("shape", SHAPES)
def test_compiled_distances_are_those_of_numpy(monkeypatch, shape):
    points = np.random.default_rng(2).uniform(-0.2, 0.2, (300, 2)) @ [1.0, 1j]
    compiled = rough_distance(outlines_of(shape), points)
    monkeypatch.setenv("CC", "")
    assert Compiler.find() is None
    assert compiled == pytest.approx(rough_distance(outlines_of(shape), points), abs=1e-14)


def test_a_scene_without_a_compiler_has_starts_that_nearly_touch(monkeypatch):
    with monkeypatch.context() as without:
        without.setenv("CC", "")
        grasp = cg.optimize_grasp(grasp_scene("mug_arcs"), raise_on_failure=False)
    assert grasp.solved
    assert grasp.tension == pytest.approx(cg.optimize_grasp(grasp_scene("mug_arcs")).tension, rel=1e-3)
