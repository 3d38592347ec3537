"""Grasps of rods at scenes nearby, from inside: designs have no door to them yet.

Truths are differences of grasps that are solved anew, and a closed form of the tension per offset of the tendons.
"""

from __future__ import annotations

from functools import cache

import pytest

import continuum_grasp as cg
from continuum_grasp.grasp import RodsFollower, Stencil
from tests.marks import few

MUG = "configs/grasp/mug.yaml"
WAYS = {
    "offset": ("finger.tendons.offset", 0.005, 0.003, {}),
    "size of the object": ("object.diameter", 0.08, 0.01, {"object.position[0]": 0.5}),
    "stiffness": ("finger.rod.bending_stiffness", 0.0061, 0.009, {}),
    "base": ("finger.base.position[1]", -0.055, 0.02, {}),
}


@cache
def searched(scene, **changes):
    return RodsFollower.searched(cg.load(scene).changed(changes))[0]


def along(scene, key, value, width, follow):
    """The scene at a distance from here, per width."""

    def there(t):
        other = value + width * t
        return scene.changed({key: other, **{name: times * other for name, times in follow.items()}})

    return there


@pytest.mark.parametrize("name", few(WAYS, 2))
def test_derivatives_are_those_of_grasps_solved_anew(name):
    """Of the aim of the scene, and of the greatest mass that is held."""
    grasp = searched(MUG)
    key, *rest = WAYS[name]
    way = along(grasp.scene, key, *rest)
    for here in (grasp, grasp.follower.heaviest(grasp, grasp.scene)):
        _, slopes = here.slopes(Stencil.of(way))
        ends = [here.follower.at(way(h), here).quantities for h in (-1e-3, 1e-3)]
        for quantity, slope in slopes.items():
            assert slope == pytest.approx((ends[1][quantity] - ends[0][quantity]) / 2e-3, rel=1e-4, abs=1e-6), quantity


def test_the_tension_per_offset_is_known_in_closed_form():
    """The moment (T1 - T2) e of a grasp does not depend on e, and T2 is at its least: d(T1 + T2)/de = -(T1 - T2)/e."""
    grasp = searched(MUG)
    key, *rest = WAYS["offset"]
    _, slopes = grasp.slopes(Stencil.of(along(grasp.scene, key, *rest)))
    left = grasp.quantities["tension_max"]
    right = grasp.quantities["tension"] - left
    assert slopes["tension"] / rest[1] == pytest.approx(-(left - right) / 0.005, rel=1e-5)


def test_the_payload_is_where_grasps_end():
    grasp = searched(MUG)
    payload = grasp.follower.heaviest(grasp, grasp.scene).quantities["payload"]
    assert payload > grasp.scene.object.mass
    assert RodsFollower.searched(grasp.scene.changed({"object.mass": 0.999 * payload}))
    assert not RodsFollower.searched(grasp.scene.changed({"object.mass": 1.01 * payload}))


@pytest.mark.deep
def test_neighbors_that_agree_lead_to_what_a_full_search_finds():
    """Of two diameters and two friction coefficients; the last scene has two neighbors, and needs no map of fingers."""

    def scene(diameter, friction):
        changes = {"object.diameter": diameter, "object.position[0]": diameter / 2.0, "contacts.friction": friction}
        return cg.load(MUG).changed(changes)

    neighbors = [RodsFollower.searched(scene(*at))[0] for at in ((0.078, 0.55), (0.08, 0.5))]
    here = scene(0.08, 0.55)
    iterations = []
    found = RodsFollower.searched(here, iterations.append, neighbors)
    assert found[0].quantities["tension"] == pytest.approx(
        RodsFollower.searched(here)[0].quantities["tension"], rel=1e-5
    )
    assert len(found) == len(iterations) == 2
