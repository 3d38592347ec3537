"""Proofs that a scene has no grasp, and overlaps at rest, as results say them: truths are closed forms."""

from __future__ import annotations

import math
import re

import pytest

import continuum_grasp as cg
from continuum_grasp.grasp import GraspStatus


def scene_named(path, **changes):
    return cg.load(f"configs/{path}.yaml").changed(changes)


def solved(scene):
    return cg.optimize_grasp(scene.replaced(solver={"effort": "quick"}), raise_on_failure=False)


@pytest.mark.parametrize(("turns", "meets"), [(0.9, False), (1.1, True)])
def test_a_ring_passes_through_itself_after_a_turn(turns, meets):
    """A thin finger that is bent to a circle at rest: its ends meet after one turn; the object is far away."""
    scene = scene_named("grasp/mug", **{"object.position": (0.5, 0.0), "supports.palm.touch": "off"})
    length = scene.finger.rod.length
    bent = {"finger.rest_curvature": turns * math.tau / length, "finger.half_thickness": 0.01 * length}
    bent["finger.tendons.offset"] = 0.009 * length
    assert ("finger at rest passes through itself" in solved(scene.changed(bent)).message) is meets


def test_a_scene_that_holds_says_what_is_in_the_way_at_rest():
    """A peg 7 mm beside the line of a straight finger, of which half thickness and radius take more."""
    scene = scene_named("grasp/pinch")
    x, y = scene.setups[0].finger.base.position
    post = {"type": "point", "position": (x - 0.007, y - 0.05), "radius": 0.002, "touch": "off"}
    half = scene.setups[0].finger.thickness_radius
    depth = 1e3 * (half + 0.002 - 0.007)
    found = solved(scene.changed({"supports": {"post": post}}))
    (said,) = re.findall(r"left at rest passes through post: ([\d.]+) mm deep", found.message)
    # By chords of the finger, which the deepest place lies between.
    assert float(said) == pytest.approx(depth, rel=2e-3)


@pytest.mark.parametrize(("share", "refuted"), [(0.999, True), (1.001, False)])
def test_contacts_of_a_hand_carry_no_more_than_their_cones_reach(share, refuted):
    """Three fingers with two contacts each: 6 N sqrt(1 + mu^2) is the greatest force in any direction."""
    scene = scene_named("hand/ball", **{"stability": "ignore", "solver.max_total_iterations": 1})
    mu = (1.0 - scene.contacts.reserve) * scene.contacts.friction
    switches = sum(switch != "off" for setup in scene.setups for switch in setup.switches.values())
    most = scene.weight / (switches * math.hypot(1.0, mu))
    found = solved(scene.changed({"contacts.normal_force_max": share * most}))
    assert (found.status is GraspStatus.INFEASIBLE) is refuted


def test_an_object_beyond_the_length_of_a_finger_is_out_of_reach():
    scene = scene_named("grasp/pinch", **{"object.position": (0.0, -0.5)})
    found = solved(scene)
    assert found.status is GraspStatus.INFEASIBLE
    assert "out of reach" in found.message
    assert found.statistics["total_iterations"] == 0
    (reason,) = found.reasons
    assert reason.needed < reason.limit


def test_cones_that_cannot_lift_are_a_proof():
    found = solved(scene_named("grasp/slippery_bottle"))
    assert found.status is GraspStatus.INFEASIBLE
    assert "no forces at any place of the object balance its weight" in found.message
    assert found.reasons
