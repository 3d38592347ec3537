"""Copies of a grasp that share its tensions, from inside: robust grasps and histories are made of them."""

from __future__ import annotations

from dataclasses import replace

import pytest

import continuum_grasp as cg
from continuum_grasp.grasp.rods.copies import RodCopies
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.grasp.rods.solving import rods_solver
from continuum_grasp.nlp import Budget


def test_copies_hold_each_object_with_the_tension_of_the_heaviest():
    """An object of 1.2 times the mass alone takes what copies of it and of lighter ones take."""
    search = RodSearch(cg.load("configs/grasp/mug_uncertain.yaml"), Budget())
    search.run()
    grasp = search.best
    numbers = grasp.problem.numbers

    def heavier(factor):
        own = replace(numbers, weight=factor * numbers.weight)
        return GraspRods(own, joints=grasp.start.joints, places=grasp.problem.places)

    def solved(*copies):
        problem = RodCopies(copies)
        start = problem.start(problem.joined([grasp.attempt.x] * len(copies)))
        attempt = rods_solver(100).solve(problem.nlp, start, Budget())
        return [copy.tension(x) for copy, x in zip(copies, problem.split(attempt.x), strict=True)]

    (alone,) = solved(heavier(1.2))
    assert alone > 1.02 * grasp.tension
    assert solved(heavier(1.0), heavier(1.1), heavier(1.2)) == pytest.approx([alone] * 3, rel=1e-6)
