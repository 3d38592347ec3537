"""Repairs of scenes without a grasp, from inside: no door leads to the search of rods yet.

Truths are searches of the changed scenes, which share no start with the repairs, mirror images, statics, and the
independent certificate.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.rods.hand_search import HandRodSearch
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.repairs import LeastRepairs, changes_by, reason_of
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import HandScene
from tests.marks import few

CASES = {
    "slippery": ("grasp/slippery_bottle", {}),
    "weak": ("grasp/mug", {"finger.tendons.max_tension": 30.0}),
    "low": ("grasp/pinch", {"object.position": (0.0, -0.03)}),
    "heavy ball": ("hand/ball", {"object.mass": 2.5}),
}


def scene_named(name):
    path, changes = CASES[name]
    return cg.load(f"configs/{path}.yaml").changed(changes)


def searched(scene):
    search = (HandRodSearch if isinstance(scene, HandScene) else RodSearch)(scene, Budget())
    search.run()
    return search


@cache
def repairs_of(name):
    search = searched(scene_named(name))
    assert search.best is None
    return {" and ".join(limit.name for limit in one.limits): one for one in LeastRepairs(search).found()}


def changed(scene, repair, share):
    """The scene with a share of a repair."""
    amounts = [share * amount for amount in repair.amounts]
    return scene.changed(changes_by(scene, repair.limits, amounts, repair.widened))


@pytest.mark.parametrize("name", few(["slippery", "weak", "low"], 1))
def test_amounts_are_least_by_searches_of_the_changed_scenes(name):
    scene = scene_named(name)
    for repair in repairs_of(name).values():
        assert searched(scene.changed(repair.changes)).best is not None
        assert searched(changed(scene, repair, 0.97)).best is None


@pytest.mark.parametrize("name", few(list(CASES), 1))
def test_repaired_scenes_pass_the_independent_certificate(name):
    scene = scene_named(name)
    assert repairs_of(name)
    for repair in repairs_of(name).values():
        certificate = certify_held(scene.changed(repair.changes), held_rods(repair.grasp))
        assert certificate.passed, (repair.changes, certificate.worst)


def test_two_tips_carry_what_friction_can():
    """Friction of both at the greatest normal force carries the weight: 2 mu N = m g."""
    scene = scene_named("slippery")
    needed = scene.object.mass * 9.81 / (2.0 * scene.contacts.normal_force_max)
    found = repairs_of("slippery")
    assert found["friction"].changes["contacts.friction"] == pytest.approx(needed, rel=2e-3)
    held = 2.0 * scene.contacts.friction * scene.contacts.normal_force_max / 9.81
    assert found["mass"].changes["object.mass"] == pytest.approx(held, rel=2e-3)


@pytest.mark.deep
def test_friction_that_few_surfaces_have_comes_last():
    scene = scene_named("weak")
    *others, last = (reason_of(scene, repair) for repair in repairs_of("weak").values())
    assert last.name == "friction"
    assert last.needed > 1.0
    assert "unusual" in last.text
    assert all("unusual" not in reason.text for reason in others)


@pytest.mark.deep
def test_a_mirrored_scene_has_mirrored_repairs():
    """A box that is too low and off the middle, and its image."""
    scene = scene_named("low").changed({"object.position": (0.002, -0.03)})
    image = scene.changed({"object.position": (-0.002, -0.03)})
    found = [{one.limits: one for one in LeastRepairs(searched(each)).found()} for each in (scene, image)]
    assert found[0].keys() == found[1].keys()
    for limits, repair in found[0].items():
        other = found[1][limits]
        assert other.amounts == pytest.approx(repair.amounts, rel=1e-3)
        if "object.position" in repair.changes:
            mirrored = np.array(other.changes["object.position"]) * [-1.0, 1.0]
            assert mirrored == pytest.approx(np.array(repair.changes["object.position"]), abs=1e-5)


@pytest.mark.deep
def test_contacts_that_the_search_may_choose_are_a_reason():
    """The fingers of a pinch touch with their tips; asked for middle contacts, they hold nothing."""
    scene = cg.load("configs/grasp/pinch.yaml").changed({"contacts.middle": "on"})
    search = searched(scene)
    assert search.best is None
    repair = LeastRepairs(search).found()[0]
    assert repair.changes == {"contacts.middle": "auto"}
    assert searched(scene.changed(repair.changes)).best is not None
