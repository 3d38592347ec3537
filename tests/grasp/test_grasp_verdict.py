"""Verdicts on grasps that are unstable, that no tendon holds, or that two limits at once are in the way of."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from grasp_scenes import INTO_PLANE, make_scene, repaired
from shapely import Polygon
from shapely.affinity import rotate

import continuum_grasp as cg
from benchmarks.grasp_images import drawn, scene_of
from benchmarks.grasp_oracle import scenes
from continuum_grasp.base import InputError, SolverError
from continuum_grasp.grasp import GraspResult, GraspStatus, certify, optimize_grasp
from continuum_grasp.scene import Rod
from tests import certificate_cases as cases

EULER = math.pi**2 * cases.STIFFNESS / (4 * cases.LENGTH**2)
"""Load at which a column buckles whose end is free [N]."""


def solved(scene, **options):
    return optimize_grasp(scene, raise_on_failure=False, **options)


@pytest.mark.parametrize("load", [0.5, pytest.param(5.0, marks=pytest.mark.deep)])
def test_a_disc_on_two_upright_fingers_is_steady_below_their_euler_load(load):
    """Straight fingers carry it from below without tension: beyond the Euler load no grasp near these is stable."""
    scene, exact = cases.two_fingers_below(mass=2 * load * EULER / 9.81, half=0.0)
    result = solved(scene)
    assert (result.solved, result.verified) == (load < 1.0, True)
    assert result.tension == pytest.approx(0.0, abs=1e-6 * cases.STIFFNESS / (cases.LENGTH * cases.OFFSET))
    if load < 1.0:
        assert max(np.abs(finger.q).max() for finger in result.fingers.values()) * cases.LENGTH < 1e-3
        assert result.arrays["contact_forces"] == pytest.approx(exact["contact_forces"], rel=1e-5, abs=1e-7)
    if load < 1.0:
        assert result.status is GraspStatus.OPTIMAL
        assert result.table().startswith("optimal: held with ")
        return
    assert (result.status, result.answer) == (GraspStatus.UNSTABLE, "unstable_grasp")
    assert result.table().startswith("UNSTABLE: in balance")
    assert "any small push drives the object away" in result.message
    assert "held" not in result.message
    with pytest.raises(InputError, match="status unstable"):
        result.quality  # noqa: B018
    with pytest.raises(SolverError) as caught:
        optimize_grasp(scene)
    assert caught.value.status == "unstable"
    allowed = solved(scene.changed({"stability": "ignore"}))
    assert (allowed.solved, allowed.answer) == (True, "grasp")
    assert "Unstable: a small push opens this grasp. (`stability: ignore` accepts it.)" in allowed.message
    assert any("unstable" in warning for warning in allowed.warnings)


def test_bases_that_overlap_are_refused():
    with pytest.raises(InputError, match=r"overlap: allow"):
        cg.load("configs/grasp/pinch.yaml").changed({"fingers.right.base.position": [-0.055, 0.12]})


def test_an_object_that_the_base_presses_alone_is_warned_of():
    def warnings(scene, arrays):
        result = GraspResult(scene, GraspStatus.OPTIMAL, "held", arrays, certify(scene, arrays))
        return [text for text in result.warnings if "hardly pull" in text]

    assert warnings(*cases.disc_in_groove())  # a straight finger without tension
    assert not warnings(*cases.wrapped_disc())


def test_a_limit_just_above_what_a_verified_grasp_takes_is_enough():
    scene = scenes.scene_of("one", 23)
    held = solved(scene)
    limit = (1.0 + 5e-4) * float(held.arrays["finger.tensions"].max())
    edge = solved(scene.changed({"finger.tendons.max_tension": limit}))
    assert edge.solved
    assert edge.tension <= 1.001 * held.tension


@pytest.mark.deep
def test_two_limits_at_once_are_needed_together():
    """Typed in, both hold the object, and neither does without the other."""
    scene = scenes.scene_of("one", 9)
    result = solved(scene)
    assert result.status is GraspStatus.NOT_SOLVED
    assert result.message.startswith("two limits at once: ")
    pair = result.reasons[0]
    assert len(pair.also) == 1
    assert solved(repaired(scene, pair.repair)).solved
    for half in pair.repair.split(" together with "):
        assert not solved(repaired(scene, half)).solved


@pytest.mark.parametrize(("seed", "held"), [(50, True)])
def test_advice_has_the_place_at_which_an_object_touches_its_support(seed, held):
    """A rounded polygon that ends short of the palm is on it where the advice says, and the palm holds."""
    scene = scene_of(drawn("one", seed), 4)
    result, body = solved(scene), scene.object
    assert not result.solved
    said = re.search(r"from palm, .* touches at object.position = \[(.*), (.*)\]\.", result.advice)
    x, y = map(float, said.groups())
    solid = rotate(Polygon(body.vertices), body.angle, origin=(0.0, 0.0), use_radians=True)
    solid = solid.buffer(-body.corner_radius, join_style="mitre").buffer(body.corner_radius, quad_segs=10_000)
    assert (x, y) == (pytest.approx(-solid.bounds[0], abs=1e-9), body.position[1])
    moved = solved(scene.changed({"object.position": [x, y]}))
    assert "from palm" not in moved.advice
    assert moved.status is (GraspStatus.OPTIMAL if held else GraspStatus.NOT_SOLVED)
    assert "palm" in moved.contact_names


@pytest.mark.deep
def test_a_rod_that_may_not_bend_enough_is_said_with_the_strain():
    """Strain of the outermost fiber where the finger of the repaired scene is bent most."""
    rod = Rod(length=0.18, linear_density=0.034, bending_stiffness=6.11e-3, diameter=0.0012)
    tight = make_scene("arc", INTO_PLANE, finger={"rod": rod, "strain_limit": 0.014}, stability="ignore")
    result = solved(tight)
    assert result.reasons[0].name == "strain"
    needed = result.reasons[0].needed
    held = solved(tight.changed({"finger.strain_limit": needed}))
    s, _, _, angle = held.fingers["finger"].backbone.T
    bends = np.abs(np.diff(angle) / np.diff(s))
    assert held.solved
    assert bends.max() * 0.0006 == pytest.approx(needed, rel=0.02)
    assert not solved(tight.changed({"finger.strain_limit": 0.97 * needed})).solved
