"""from inside: shapes at rest, of which no door tells so far. Fingers at rest in the way: closed forms and openings."""

from __future__ import annotations

import math
import re
import warnings

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp import GraspStatus, optimize_grasp
from continuum_grasp.grasp.at_rest import overlaps_at_rest
from tests import certificate_cases as planar
from tests import hand_cases as cases
from tests.commands import ROOT, run

RADIUS = 0.03


def one_straight(center, **more):
    """A straight finger from the origin along y, and a ball."""
    ball = {"shape": "sphere", "diameter": 2 * RADIUS, "mass": 0.05, "position": tuple(map(float, center))}
    return cases.make_scene({"finger": ((0, 0, 0), (0, 1, 0), (-1, 0, 0))}, ball, **more)


@pytest.mark.parametrize("seed", range(6))
def test_depth_of_a_straight_finger_in_a_ball(seed):
    """Radius and half thickness less the distance of the center from the segment, clamped to its ends."""
    draw = np.random.default_rng(seed)
    center = np.array([draw.uniform(-0.06, 0.06), draw.uniform(0.05, 0.14), draw.uniform(-0.03, 0.03)])
    nearest = np.clip(center[1], 0.0, cases.LENGTH)
    depth = RADIUS + cases.HALF - np.linalg.norm(center - [0.0, nearest, 0.0])
    found = overlaps_at_rest(one_straight(center))
    if depth <= 1e-3 * cases.LENGTH:
        assert not found
        return
    (overlap,) = found
    assert (overlap.finger, overlap.body) == ("finger", "object")
    assert overlap.depth == pytest.approx(depth, abs=1e-5)
    assert overlap.station == pytest.approx(nearest, abs=cases.LENGTH / 200)
    assert "through the object" in str(overlap)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("body", "depth"),
    [
        ({"shape": "sphere", "diameter": 0.06}, 0.03),
        ({"shape": "ellipsoid", "extents": [0.04, 0.06, 0.05]}, 0.02),
        ({"shape": "cylinder", "diameter": 0.06, "height": 0.08, "edge_radius": 0.003}, 0.03),
        ({"shape": "cylinder", "diameter": 0.06, "height": 0.03, "edge_radius": 0.003}, 0.015),
        ({"shape": "box", "extents": [0.04, 0.06, 0.05], "edge_radius": 0.003}, 0.02),
        ({"shape": "box", "extents": [0.05, 0.05, 0.05], "edge_radius": 0.003}, 0.025),
        ({"shape": "superquadric", "extents": [0.06, 0.06, 0.06], "exponents": [2.0, 2.0]}, 0.03),
    ],
)
def test_depth_of_a_finger_through_the_center(body, depth, turned):
    """The center of a body is as deep as its thinnest half; there the direction to the surface is not unique."""
    ball = one_straight((0.0, 0.06, 0.0))
    rotation = [0.5 * math.pi, 0.0, 0.0] if turned else [0.0, 0.0, 0.0]
    scene = ball.changed({"object": body | {"mass": 0.05, "position": [0.0, 0.06, 0.0], "rotation": rotation}})
    (overlap,) = overlaps_at_rest(scene)
    assert overlap.depth == pytest.approx(depth + cases.HALF, rel=1e-3)


@pytest.mark.parametrize("curvature", [-6.0, 9.0])
def test_depth_of_a_finger_that_is_an_arc_at_rest_in_a_disc(curvature):
    """A planar finger of rest curvature k is a circle about (-1 / k, 0); a disc sits on it half way."""
    half_angle = 0.5 * curvature * planar.LENGTH
    on = np.array([-(1.0 - math.cos(half_angle)), math.sin(half_angle)]) / curvature
    out = np.array([math.cos(half_angle), math.sin(half_angle)]) * math.copysign(1.0, curvature)
    finger = planar.make_finger(rest_curvature=curvature)
    disc = planar.Circle(shape="circle", diameter=0.04, mass=0.1, position=tuple((on + 0.02 * out).tolist()))
    (overlap,) = overlaps_at_rest(planar.make_scene(finger, disc))
    assert overlap.depth == pytest.approx(planar.HALF, abs=1e-5)
    assert overlap.station == pytest.approx(0.5 * planar.LENGTH, rel=0.02)


@pytest.mark.parametrize("height", [0.04, 0.2])
def test_a_table_in_the_way(height):
    """A finger along y, and a table across it whose normal points back; the base's own support does not count."""
    table = {"point": (0.0, height, 0.0), "normal": (0.0, -1.0, 0.0), "touch": "off"}
    found = [each for each in overlaps_at_rest(one_straight((0.06, 0.0, 0.0), table=table)) if each.body == "table"]
    assert [each.depth for each in found] == pytest.approx(
        [cases.LENGTH + cases.HALF - height] if height < cases.LENGTH else [], abs=1e-6
    )


@pytest.mark.parametrize(
    ("config", "changes", "place"),
    [
        ("simulate/hold_mug", ["object.position=[0.1, -0.055]"], "object"),
        ("hand/egg", ["object.position=[45 mm, 0, -90 mm]"], "egg.yaml:15:3: object"),
        ("mpc/turn_bar", ["object.position=[0, 0.1]"], "turn_bar.yaml:11:3: object"),
        ("plan/close_on_mug", ["grasp.object.position=[0.1, -0.055]"], "mug.yaml:10:3: grasp.object"),
        ("mission/mug", ["grasp.finger.base.position=[0, -0.03]"], "mug_robust.yaml:11:3: grasp.object"),
        ("sweep/mug_size_friction", ["set={finger.base.position: [0, -0.03]}"], "friction.yaml:5:1: scene.object"),
    ],
)
def test_validate_names_what_stands_in_the_way(config, changes, place):
    """Each kind of scene, with the line of its object; without the change all of them are clear."""
    file = ROOT / f"configs/{config}.yaml"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert run("validate", file).exit_code == 0
    doubt = rf"{re.escape(place)} is in the way: finger(_1)? at rest passes through the object"
    with pytest.warns(match=doubt):
        assert run("validate", file, *(f"--set={change}" for change in changes)).exit_code == 0
    assert run("validate", "--strict", file, *(f"--set={change}" for change in changes)).exit_code == 2


def in_the_way(**changes):
    """Three straight fingers that point inward, whose ends are in a ball between their bases."""
    bases = {}
    for k in range(3):
        c, s = math.cos(math.tau * k / 3), math.sin(math.tau * k / 3)
        bases[f"f{k}"] = {
            "position": [0.11 * c, 0.11 * s, 0.05],
            "direction": [-c, -s, -0.2],
            "bends_toward": [0.3 * c, 0.3 * s, -1.0],
        }
    ball = {"shape": "sphere", "diameter": 0.06, "mass": 0.07, "position": [0.0, 0.002, 0.0]}
    hand = cg.load(ROOT / "configs/hand/ball.yaml")
    return hand.changed({"hand.ring": None, "hand.bases": bases, "object": ball, **changes})


@pytest.mark.deep
def test_fingers_in_the_way_are_named_with_what_opens_them():
    """Opened by that difference of tensions alone, arcs of curvature T e / E I clear the ball; by a tenth less not."""
    scene = in_the_way()
    assert [overlap.finger for overlap in overlaps_at_rest(scene)] == ["f0", "f1", "f2"]
    found = optimize_grasp(scene)
    assert "f0 and f1 and f2 pass through the object at rest" in found.message
    pull = float(found.message.split("open f0 by ")[1].split(" N on the bending")[0])
    for tension, clear in ((pull, True), (pull - 60.0 / 48.0, False)):
        k = tension * 0.006 / 0.006
        s = np.linspace(0.0, 0.12, 2001)
        along, across = np.sin(k * s) / k, (1.0 - np.cos(k * s)) / k
        forward = np.array([-1.0, 0.0, -0.2]) / math.hypot(1.0, 0.2)
        toward = np.array([0.3, 0.0, -1.0]) - forward * (forward @ [0.3, 0.0, -1.0])
        toward /= np.linalg.norm(toward)
        line = np.array([0.11, 0.0, 0.05]) + along[:, None] * forward + across[:, None] * toward
        gap = np.linalg.norm(line - scene.object.position, axis=1).min() - 0.03 - 0.006
        assert bool(gap > -1e-3 * 0.12) is clear


@pytest.mark.deep
def test_fingers_that_no_tendon_opens_hold_nothing():
    """Tendons that only bend the other way cannot take the fingers off the ball's lower half."""
    found = optimize_grasp(in_the_way(**{"hand.finger.tendons_used": "right"}), raise_on_failure=False)
    assert found.status is GraspStatus.NOT_SOLVED
    assert "pass through the object at rest" in found.message


def from_below(effort):
    """Three straight fingers upward around a ball, of which a normal search solves the seventh start."""
    bases = {}
    for k in range(3):
        c, s = math.cos(math.tau * k / 3), math.sin(math.tau * k / 3)
        bases[f"f{k}"] = {"position": [0.045 * c, 0.045 * s, 0.0], "direction": [0, 0, 1], "bends_toward": [-c, -s, 0]}
    ball = {"shape": "sphere", "diameter": 0.06, "mass": 0.07, "position": [0.002, 0.001, 0.09]}
    hand = cg.load(ROOT / "configs/hand/ball.yaml")
    return hand.changed({"hand.ring": None, "hand.bases": bases, "object": ball, "solver.effort": effort})


@pytest.mark.deep
def test_a_normal_search_tries_more_before_it_fails():
    assert optimize_grasp(from_below("normal")).tension == pytest.approx(26.69, rel=1e-3)


@pytest.mark.deep
def test_a_quick_search_proves_nothing():
    found = optimize_grasp(from_below("quick"), raise_on_failure=False)
    assert found.status is GraspStatus.NOT_SOLVED
    assert found.reasons
    assert "nearest to one" in found.message
    assert "solver.effort: thorough" in found.message
