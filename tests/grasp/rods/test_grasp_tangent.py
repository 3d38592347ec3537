"""Small motions of grasps of exact rods, from inside: no door leads to tangents of a problem.

Truths are closed forms of a grip between parallel fingers, the certificate, which integrates rods anew and takes
differences, images of scenes, and the response of elements.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from benchmarks.grasp_images import STRONGER, drawn, mirrored, moved, scaled, scene_of
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.rods import motion
from continuum_grasp.grasp.rods.answers import BornePush
from continuum_grasp.grasp.rods.hand_search import HandRodSearch
from continuum_grasp.grasp.rods.motion import TendonBehavior
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.tangent import GraspTangent
from continuum_grasp.grasp.rods.verdict import verdict_of
from continuum_grasp.grasp.values import GraspStatus
from continuum_grasp.nlp import Budget
from tests.marks import few

LENGTH, BENDING, HALF, MASS, FRICTION = 0.1, 2e-2, 0.004, 1e-3, 0.8
WORST = math.hypot(1.0 - FRICTION * 1.5 * HALF / LENGTH, FRICTION)
"""Greatest sin(a) + mu cos(a) - mu k sin(a)."""
PLANE = [0, 1, 5]


def grip(**changes):
    """A disc that weighs next to nothing, between the tips of two parallel fingers, which are straight there."""
    finger = {
        "rod": {"length": LENGTH, "bending_stiffness": BENDING, "linear_density": 1e-9},
        "half_thickness": HALF,
        "tendons": {"offset": 0.004, "max_tension": 40.0},
    }
    bases = {name: {"position": [side * (0.03 + HALF), 0.0], "angle": 0.0} for name, side in BOTH.items()}
    scene = {
        "schema_version": 1,
        "fingers": {name: {**finger, "base": base} for name, base in bases.items()},
        "object": {"shape": "circle", "diameter": 0.06, "mass": MASS, "position": [0.0, LENGTH]},
        "contacts": {"friction": FRICTION, "normal_force_max": 5.0, "middle": "off", "tip": "on"},
        "gravity": [0.0, -9.81, 0.0],
        "stability": "ignore",
    }
    return cg.GraspScene.model_validate(scene).changed(changes)


BOTH = {"left": -1.0, "right": 1.0}


def searched(scene, most=6):
    search = (RodSearch if isinstance(scene, cg.GraspScene) else HandRodSearch)(scene, Budget())
    search.run(most)
    return search


@cache
def shipped(path):
    return searched(cg.load(f"configs/{path}.yaml"))


def tangent_of(search, tendons=TendonBehavior.CONSTANT):
    return GraspTangent(search.best.problem, search.best.attempt.x, tendons)


def stiffness(tangent, own):
    response = tangent.response
    return np.linalg.inv(np.concatenate([response.shift, response.turn])[own][:, own])


# -- closed forms --------------------------------------------------------------------------------------------------


def test_parallel_fingers_resist_a_shift_as_two_cantilevers():
    """Each with 3 E I / L^3; they hold the disc with a hundredth of the force that would bend them by their length."""
    response = tangent_of(searched(grip(), 1)).response
    assert response.shift[0, 0] == pytest.approx(LENGTH**3 / (6.0 * BENDING), rel=0.01)


@pytest.mark.parametrize("push", [2e-3, 2e-2])
def test_parallel_fingers_press_as_much_as_a_push_asks_for(push):
    """Each finger takes half of a push at an angle a; friction at the skin bends it by h f, which adds k f to N, with
    k = 3 h / (2 L). A contact bears it if W / 2 + p sin(a) / 2 is at most mu (N - p cos(a) / 2 + k p sin(a) / 2).
    """
    best = searched(grip(**{"contacts.push": push}), 1).best
    problem, x = best.problem, best.attempt.x
    pressing = [problem.numbers.force * problem.numbers.unit(name) * x[at[0]] for name, at in problem.contacts.items()]
    wanted = 0.5 * (MASS * 9.81 + push * WORST) / FRICTION
    assert pressing == pytest.approx([wanted] * 2, rel=1e-3)


def test_a_reserve_of_friction_bears_a_push():
    """With a reserve r, mu (1 - r) N = W / 2: the push has all of mu."""
    tangent = tangent_of(searched(grip(**{"contacts.reserve": 0.2}), 1))
    weight = MASS * 9.81
    assert tangent.push == pytest.approx(weight * (1.0 / 0.8 - 1.0) / WORST, rel=2e-3)


def test_without_a_margin_any_push_slips():
    assert tangent_of(searched(grip(), 1)).push == pytest.approx(0.0, abs=1e-6)


# -- the certificate, which shares nothing --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path",
    few(["grasp/mug", "grasp/pinch", "grasp/groove", "grasp/mug_hanging", "grasp/table_peg", "grasp/wrap"], 3),
)
def test_tangents_are_differences_of_rods_integrated_anew(path):
    """Middle contacts that roll where friction makes curvatures jump, tips, flat faces, a palm, a groove, a peg."""
    search = shipped(path)
    tangent, certificate = tangent_of(search), certify_held(search.scene, held_rods(search.best))
    expected = certificate.pushed.stiffness
    assert stiffness(tangent, PLANE) == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())
    assert tangent.stable == certificate.pushed.stable
    least = {name: push for name, push in certificate.pushes.items() if push < 10.0}
    assert {name: tangent.pushes[name] for name in least} == pytest.approx(least, rel=2e-3, abs=1e-6)


@pytest.mark.deep
@pytest.mark.parametrize("path", ["hand/ball", "hand/pinch", "hand/palm", "hand/table"])
def test_tangents_of_hands_are_differences_of_rods_integrated_anew(path):
    """With torsional friction (pinch), and on one, and on four, contacts of a support."""
    search = shipped(path)
    tangent, certificate = tangent_of(search), certify_held(search.scene, held_rods(search.best))
    expected = certificate.pushed.stiffness
    assert stiffness(tangent, list(range(6))) == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())
    assert certificate.push == pytest.approx(tangent.push, rel=2e-3)


@pytest.mark.deep
def test_grasps_that_turn_away_have_a_motion_that_lowers_the_energy():
    """Random ones: the certificate finds the stiffness of the object alone, at constant tensions."""
    for kind, seed in (("two", 6), ("one", 7)):
        search = searched(scene_of(drawn(kind, seed), 8).replaced(stability="ignore"))
        stable = certify_held(search.scene, held_rods(search.best)).pushed.stable
        assert tangent_of(search).stable == stable == (kind == "one")


@pytest.mark.deep
def test_a_scene_and_its_image_are_as_stable():
    data = drawn("one", 5)
    own, other = (
        tangent_of(searched(scene_of(each, 8).replaced(stability="ignore")))
        for each in (data, mirrored(moved(scaled(data))))
    )
    assert other.eigenvalue == pytest.approx(own.eigenvalue, rel=1e-4)
    assert {name: push / STRONGER for name, push in other.pushes.items()} == pytest.approx(
        own.pushes, rel=1e-3, abs=1e-6
    )


# -- answers as blocks ----------------------------------------------------------------------------------------------


def test_derivatives_of_answers_are_differences_of_rows():
    best = shipped("grasp/pinch").best
    problem = GraspRods(best.problem.numbers, joints=best.start.joints)
    BornePush(problem, 0.2)
    x = problem.named(best.problem, best.attempt.x)
    problem.fill(x)
    functions, p = problem.nlp.functions, problem.parameters
    random, h = np.random.default_rng(1), 1e-6
    low, high = problem.limits
    way, forces = random.normal(size=x.size) * (low < high), random.normal(size=problem.count)
    (before, first), (after, last) = (functions["jac_g"](x + sign * h * way, p) for sign in (-1.0, 1.0))
    slopes = np.array(functions["jac_g"](x, p)[1] @ way).ravel()
    assert np.array(after - before).ravel() / (2.0 * h) == pytest.approx(slopes, abs=1e-5 * np.abs(slopes).max())
    upper = np.array(ca.DM(functions["hess_lag"](x, p, 0.0, forces)))
    turned = (np.triu(upper) + np.triu(upper, 1).T) @ way
    bent = np.array((last - first).T @ forces).ravel() / (2.0 * h)
    # Tables of flat faces: their fourth derivatives do not count.
    assert bent == pytest.approx(turned, abs=0.05 * np.abs(turned).max())


@pytest.mark.deep
def test_the_greatest_push_is_that_of_many_elements():
    """The present search finds 1.19065 N with three elements of a pinch, whose fingers are nearly arcs."""
    search = searched(cg.load("configs/grasp/pinch.yaml").changed({"objective": "greatest_push"}))
    assert certify_held(search.scene, held_rods(search.best)).push == pytest.approx(1.19065, rel=1e-4)


def test_the_certificate_says_what_is_missing_of_a_push():
    scene = cg.load("configs/grasp/mug.yaml")
    held = held_rods(shipped("grasp/mug").best)
    assert certify_held(scene.changed({"contacts.push": 0.8}), held).passed
    failed = certify_held(scene.changed({"contacts.push": 1.0}), held).failed
    assert [str(check).partition(":")[0] for check in failed] == ["missing of a push in every direction"]


def test_what_contacts_give_does_not_matter(monkeypatch):
    best = shipped("grasp/mug").best
    own = GraspTangent(best.problem, best.attempt.x).push
    monkeypatch.setattr(motion, "COMPLIANCE", 10.0 * motion.COMPLIANCE)
    assert GraspTangent(best.problem, best.attempt.x).push == pytest.approx(own, rel=1e-4)


@pytest.mark.deep
def test_an_object_without_load_bears_a_tenth_of_the_greatest_push():
    """The present search finds 35.98 N, against 0.172 of 1.72 N."""
    search = searched(cg.load("configs/grasp/pinch.yaml").changed({"gravity": [0.0, 0.0, 0.0]}))
    assert search.best.tension == pytest.approx(35.98, rel=1e-3)
    assert certify_held(search.scene, held_rods(search.best)).push == pytest.approx(0.1717, rel=1e-3)


@pytest.mark.deep
@pytest.mark.parametrize(
    ("name", "factor"),
    [("mug_robust", 1.62), ("table_peg", 0.50), ("mug_steady", 2.43), ("box_edge", 1.17)],
    ids=["locked", "peg", "anew", "corner"],
)
def test_resisted_disturbances_are_at_least_those_of_elements(name, factor):
    """The present search resists 2.43 times the disturbances of mug_steady, with a friction margin of 0.10."""
    best = searched(cg.load(f"configs/grasp/{name}.yaml")).best
    assert best.attempt.x[best.problem.at["factor"]][0] > factor


@pytest.mark.deep
def test_a_grasp_that_turns_away_is_steadied():
    """With 4 % more tension than without; the certificate finds the object stable, too."""
    scene = scene_of(drawn("one", 4), 8)
    without = searched(scene.replaced(stability="ignore"))
    assert not tangent_of(without).stable
    search = searched(scene.replaced(stability="require"))
    verdict = verdict_of(search)
    assert verdict.status in (GraspStatus.OPTIMAL, GraspStatus.FEASIBLE)
    assert verdict.certificate.pushed.stable
    assert verdict.best.tension == pytest.approx(1.04 * without.best.tension, rel=0.02)


@pytest.mark.deep
def test_stability_asks_for_a_small_push():
    """A tenth of a meter per second squared, where the scene states no push; at margin zero any push slips."""
    search = searched(cg.load("configs/grasp/pinch.yaml"))
    verdict = verdict_of(search)
    assert verdict.certificate.push == pytest.approx(0.1 * search.scene.object.mass, rel=1e-3)
    assert 75.925 < verdict.best.tension < 1.01 * 75.925
