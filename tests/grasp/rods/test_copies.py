"""Copies of a grasp that share its tensions, and grasps that hold for all errors; from inside: no door leads here yet.

Truths are the certificate of rods at scenes in error, which shares nothing with the problem; the search of such scenes
alone; closed forms of pinched boxes; and images.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.rods.copies import RodCopies, RodCopy, held_tensions
from continuum_grasp.grasp.rods.hand_search import HandRodSearch
from continuum_grasp.grasp.rods.optimize import optimize_grasp
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.robust import (
    RobustSearch,
    RodResponder,
    error_space,
    robustness_of,
    share_held,
    trials_of,
)
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.solving import rods_solver
from continuum_grasp.grasp.values import GraspStatus
from continuum_grasp.nlp import Budget

MUG = {"position": 0.002, "radius": 0.05, "friction": 0.2, "mass": 0.1}


@cache
def searched(name):
    search = RodSearch(cg.load(f"configs/grasp/{name}.yaml").replaced(stability="ignore"), Budget())
    search.run()
    return search


@cache
def robust_mug():
    robust = RobustSearch(searched("mug_uncertain"), MUG)
    robust.run()
    return robust.best


def test_copies_hold_each_object_with_the_tension_of_the_heaviest():
    """An object of 1.2 times the mass alone takes what copies of it and of lighter ones take."""
    grasp = searched("mug_uncertain").best
    numbers = grasp.problem.numbers

    def heavier(factor):
        own = replace(numbers, weight=factor * numbers.weight)
        return GraspRods(own, joints=grasp.start.joints, places=grasp.problem.places)

    def solved(first, *others):
        copies = [RodCopy(other, tuple(held_tensions(first, other))) for other in others]
        problem = RodCopies(first, copies)
        start = problem.start(problem.joined([grasp.attempt.x] * (1 + len(others))))
        attempt = rods_solver(100).solve(problem.nlp, start, Budget())
        return [part.problem.tension(x) for part, x in zip(problem.included, problem.split(attempt.x), strict=True)]

    (alone,) = solved(heavier(1.2))
    assert alone > 1.02 * grasp.tension
    assert solved(heavier(1.0), heavier(1.1), heavier(1.2)) == pytest.approx([alone] * 3, rel=1e-6)


def test_each_copy_passes_a_certificate_of_the_scene_in_error():
    robust = robust_mug()
    assert robust.grasp.tension > searched("mug_uncertain").best.tension
    assert len(robust.copies) >= 2
    for error, copy in zip(robust.active, robust.copies, strict=True):
        assert copy.tension == pytest.approx(robust.grasp.tension, rel=1e-7)
        certificate = certify_held(robust.errors.scene_with(error), held_rods(copy))
        assert certificate.passed, certificate.worst


def test_less_tension_slips_at_a_corner_and_as_much_holds_at_all():
    robust = robust_mug()
    assert all(response.margin >= -1e-6 for response in robust.responses)
    grasp = robust.grasp
    x = grasp.attempt.x.copy()
    at = np.concatenate([part.pulls for part in grasp.problem.parts])
    (least,) = {pull.least for finger in grasp.problem.numbers.fingers for pull in finger.section.pulls}
    x[at] = np.maximum(0.99 * (x[at] + least) - least, 0.0)
    weaker = error_space(robust.errors.scene, replace(grasp, attempt=replace(grasp.attempt, x=x)), MUG)
    responder = RodResponder(weaker, 24, Budget())
    assert min(responder.to(corner).margin for corner in weaker.corners) < -1e-4


def test_a_mug_needs_the_tension_of_its_worst_corner_alone():
    """Errors share nothing but tensions, so that the worst corner, searched as a scene of its own, needs as much."""
    robust = robust_mug()
    scene = robust.errors.scene_with(robust.worst.error).changed({"objective": "least_tension", "object.free": None})
    search = RodSearch(scene, Budget())
    search.run()
    assert search.best.tension == pytest.approx(robust.grasp.tension, rel=1e-4)


def test_drawn_errors_hold_with_the_robust_grasp_and_fail_with_the_nominal_one():
    robust = robust_mug()
    errors = robust.errors.drawn(12, 1)
    assert trials_of(robust, errors, 24, Budget()).held == 12
    nominal = error_space(robust.errors.scene, searched("mug_uncertain").best, MUG)
    responder = RodResponder(nominal, 24, Budget())
    assert not all(responder.to(error).holds for error in errors)


SQUEEZE = {"friction": 0.2, "mass": 0.1}


def test_opposed_contacts_press_as_the_worst_friction_and_mass_ask():
    """Two tips on opposite faces of a box whose weight friction carries: 1.1 / 0.8 of the force."""
    search = RodSearch(
        cg.load("configs/grasp/pinch_above.yaml").changed(
            {"upright": True, "objective": "least_tension", "stability": "ignore"}
        ),
        Budget(),
    )
    search.run()
    robust = RobustSearch(search, SQUEEZE)
    robust.run()
    forces = [
        [float(grasp.attempt.x[held[0]]) for held in grasp.problem.contacts.values()]
        for grasp in (search.best, robust.best.grasp)
    ]
    assert forces[1] == pytest.approx([1.1 / 0.8 * force for force in forces[0]], rel=1e-4)
    found = robustness_of(search, robust, 6, 0)
    assert found.robust.held == 6
    # Without errors the cones are at their edge: friction alone leaves 1 - 1 / 0.8, mass alone 1 - 1.1.
    assert found.nominal.alone == pytest.approx({"friction": -0.25, "mass": -0.1}, abs=1e-3)


def test_bounds_that_cannot_be_borne_come_with_the_share_that_can():
    """1 / (1 - 0.4 s) of the least normal force is at most 1.25 of it for s up to 0.5."""
    scene = cg.load("configs/grasp/pinch_above.yaml").changed(
        {"upright": True, "objective": "least_tension", "stability": "ignore"}
    )
    search = RodSearch(scene, Budget())
    search.run()
    least = search.best.problem.numbers.fingers[0].force * max(
        float(search.best.attempt.x[held[0]]) for held in search.best.problem.contacts.values()
    )
    tight = RodSearch(scene.changed({"contacts.normal_force_max": 1.25 * least}), Budget())
    tight.run()
    assert 0.5 - 1 / 16 <= share_held(tight, {"friction": 0.4}) <= 0.5


def test_a_tip_lands_beside_its_place_on_an_object_that_lies_elsewhere():
    """Flat faces: along them the tips are where they were in the world. Across them, the fingers push the box back."""
    grasp = searched("pinch").best
    errors = error_space(searched("pinch").scene, grasp, {"position": 0.002})
    response = RodResponder(errors, 24, Budget()).to(np.array([0.001, 0.002, *np.zeros(5)]))
    problem, x = response.copy.problem, response.attempt.x
    pose = x[problem.pose] * [problem.numbers.size, problem.numbers.size, 1.0]
    assert pose == pytest.approx([0.0, 0.002, 0.0], abs=1e-8)
    for part, first in zip(problem.parts, grasp.problem.parts, strict=True):
        assert x[part.nodes[-1][:2]] == pytest.approx(grasp.attempt.x[first.nodes[-1][:2]], abs=1e-7)


@pytest.mark.deep
def test_a_hand_holds_a_ball_in_error():
    """Tips land beside their places, so that the ball turns a little; nothing else holds its angle."""
    scene = cg.load("configs/hand/ball.yaml")
    search = HandRodSearch(scene, Budget.of(scene.solver))
    search.run()
    robust = RobustSearch(search, {"friction": 0.1, "mass": 0.1, "position": 0.002})
    robust.run()
    assert robust.best.grasp.tension > 1.02 * search.best.tension
    for copy in robust.best.copies:
        assert np.abs(copy.attempt.x[copy.problem.pose][3:]).max() < 0.05


@pytest.mark.deep
def test_a_robust_result_has_trials_of_both_grasps_or_the_share_that_holds():
    scene = cg.load("configs/grasp/mug_uncertain.yaml").changed({"robust.draws": 8})
    found = optimize_grasp(scene)
    assert found.status is GraspStatus.OPTIMAL
    assert "49.09 N of total tension whatever the errors within robust; 39.74 N without errors" in found.message
    assert found.certificate.passed
    assert found.tension == pytest.approx(found.robustness.robust.tension, rel=1e-6)
    assert (found.robustness.robust.held, found.robustness.nominal.held < 8) == (8, True)
    weaker = scene.changed({"robust.friction": 0.45, "finger.tendons.max_tension": 45.0})
    none = optimize_grasp(weaker, raise_on_failure=False)
    assert none.status is GraspStatus.INFEASIBLE
    (reason,) = none.reasons
    less = scene.robust.replaced(
        **{key: reason.needed * getattr(weaker.robust, key) for key in ("position", "radius", "friction", "mass")}
    )
    assert optimize_grasp(weaker.replaced(robust=less)).robustness.robust.holds
