"""Scenes with supports, free poses, pegs and stations as rods, from inside: no door leads to the search of rods yet.

Truths are the independent certificate, differences, the same scene with more freedom, and geometry by hand.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp.body.bodies import body_of
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.rods.planar_numbers import planar_numbers, planar_table
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.nlp import Budget
from tests.marks import few


def scene_named(name, **changes):
    return cg.load(f"configs/grasp/{name}.yaml").changed(changes)


def found(scene):
    search = RodSearch(scene, Budget())
    search.run()
    return search.best


def certified(scene):
    grasp = found(scene)
    certificate = certify_held(scene, held_rods(grasp))
    assert certificate.passed, certificate.worst
    return grasp


@pytest.mark.parametrize("name", few(["gear", "mug_hanging", "bottle_picture", "scissors_handle", "mug_steady"], 1))
def test_grasps_pass_the_independent_certificate(name):
    """Teeth, pegs in the way, drawn outlines and objects that slide along a palm."""
    certified(scene_named(name))


@pytest.mark.deep
def test_a_base_that_may_move_takes_less_tension():
    scene = scene_named("free_base")
    fixed = found(scene.changed({"finger.base_free": None}))
    assert certified(scene).tension < fixed.tension


@pytest.mark.deep
def test_stations_take_no_more_tension_than_one_contact():
    scene = scene_named("mug_wrapped")
    grasp = certified(scene)
    assert sum("station" in name for name in grasp.start.on) >= 2
    assert grasp.tension < found(scene_named("mug")).tension


@pytest.mark.deep
def test_a_finger_keeps_clear_of_a_peg_in_its_way():
    """A peg where the finger of the mug would be: it goes around it, with more tension."""
    scene = scene_named("mug")
    grasp = found(scene)
    part = grasp.problem.parts[0]
    at = 0.18 * grasp.attempt.x[part.nodes[len(part.nodes) // 3]][:2]
    peg = {"type": "point", "position": (float(at[0]), float(at[1])), "radius": 0.002, "touch": "off"}
    blocked = scene.changed({"supports.post": peg})
    around = found(blocked)
    assert around is None or certify_held(blocked, held_rods(around)).passed
    gap = certify_held(blocked, held_rods(grasp))
    assert not gap.passed


def numbers_of(scene, on):
    bases = tuple(setup.finger.base.pose for setup in scene.setups)
    return planar_numbers(scene, frozenset(on), (scene.object.pose, bases), 1.0, planar_table(scene))


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_gaps_of_supports_are_those_of_the_body(turn):
    """Of an ellipse that a palm touches with its side: by its support function, at other poses to the third order."""
    scene = scene_named("egg")
    numbers = numbers_of(scene, {"palm"})
    (palm,) = numbers.supports
    size, half = scene.object.size, np.array([0.0225, 0.029])
    for angle in (0.0, 1e-3 * (1.0 + turn)):
        pose = numbers.pose + np.array([turn * 0.1, 0.05, angle])
        reach = math.hypot(half[0] * math.cos(angle), half[1] * math.sin(angle))
        assert palm.gap(numbers, pose) * size == pytest.approx(pose[0] * size - reach, abs=1e-9)


def test_rows_of_supports_are_their_gaps_and_forces():
    """Kinds of blocks in CasADi against the same geometry in NumPy, and the distance of the exact body."""
    scene = scene_named("table_peg")
    numbers = numbers_of(scene, {"table", "peg"})
    pose = numbers.pose + np.array([1e-3, 2e-3, 0.05])
    for support in numbers.supports:
        kind, data = support.gap_block(numbers)
        cells = numbers.table.coefficients
        (gap,) = kind.value(pose, np.array(data), cells)
        assert gap == pytest.approx(support.gap(numbers, pose), abs=1e-9)
        place, normal = support.touched(numbers, pose)
        kind, data = support.force_block(numbers)
        held = np.array([2.0, 0.3, -0.1, 0.0])
        rows = kind.value(np.concatenate([held, pose]), np.array(data), cells)
        along = np.cross(support.across, normal)
        force = 2.0 * normal + 0.3 * along / np.linalg.norm(along) - 0.1 * np.cross(normal, along)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        center = np.array([*pose[:2], 0.0]) + np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ numbers.center
        assert rows[:3] == pytest.approx(-force, abs=1e-9)
        assert rows[3:] == pytest.approx(-np.cross(place - center, force), abs=1e-9)
    peg = next(support for support in numbers.supports if support.name == "peg")
    local = numbers.in_object(peg.position, pose) * numbers.size
    exact = body_of(scene.object).distance(local[None])[0] / numbers.size - peg.radius
    assert peg.gap(numbers, pose) == pytest.approx(exact, abs=1e-4)
