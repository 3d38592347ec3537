"""Proofs that a scene has no grasp, and overlaps at rest, from inside: no door leads here yet.

Truths are closed forms.
"""

from __future__ import annotations

import math

import pytest

import continuum_grasp as cg
from continuum_grasp.grasp.rods.proofs import overlaps_of, proof_of_none


def scene_named(path, **changes):
    return cg.load(f"configs/{path}.yaml").changed(changes)


@pytest.mark.parametrize(("turns", "meets"), [(0.9, False), (1.1, True)])
def test_a_ring_passes_through_itself_after_a_turn(turns, meets):
    """A thin finger that is bent to a circle at rest: its ends meet after one turn."""
    scene = scene_named("grasp/mug")
    length = scene.finger.rod.length
    half = 0.01 * length
    coiled = scene.changed({"finger.rest_curvature": turns * math.tau / length, "finger.half_thickness": half})
    assert any("itself" in text for text in overlaps_of(coiled)) is meets


@pytest.mark.parametrize(("share", "refuted"), [(0.999, True), (1.001, False)])
def test_contacts_of_a_hand_carry_no_more_than_their_cones_reach(share, refuted):
    """Three fingers with two contacts each: 6 N sqrt(1 + mu^2) is the greatest force in any direction."""
    scene = scene_named("hand/ball")
    mu = (1.0 - scene.contacts.reserve) * scene.contacts.friction
    switches = sum(switch != "off" for setup in scene.setups for switch in setup.switches.values())
    most = scene.weight / (switches * math.hypot(1.0, mu))
    assert bool(proof_of_none(scene.changed({"contacts.normal_force_max": share * most}))) is refuted


def test_an_object_beyond_the_length_of_a_finger_is_out_of_reach():
    scene = scene_named("grasp/pinch")
    assert not proof_of_none(scene)
    assert "out of reach" in proof_of_none(scene.changed({"object.position": (0.0, -0.5)}))


def test_cones_that_cannot_lift_are_a_proof():
    assert "no forces" in proof_of_none(scene_named("grasp/slippery_bottle"))
