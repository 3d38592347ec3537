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
from continuum_grasp.grasp.judge.certificate import certify_rods
from continuum_grasp.grasp.rods.copies import RodCopies, RodCopy, held_tensions
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.robust import RobustSearch, RodResponder, error_space, trials_of
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.solving import rods_solver
from continuum_grasp.nlp import Budget

MUG = {"position": 0.002, "radius": 0.05, "friction": 0.2, "mass": 0.1}


@cache
def searched(name):
    search = RodSearch(cg.load(f"configs/grasp/{name}.yaml"), Budget())
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
        certificate = certify_rods(robust.errors.scene_with(error), held_rods(copy))
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
