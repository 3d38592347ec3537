"""Grasps of rods that hold whatever the friction states become, from inside: no door leads to them yet.

Truths are histories drawn and turned one by one, images of a scene, closed forms, and the certificate's own postures.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp.judge.certificate import certify_held
from continuum_grasp.grasp.judge.postures import HistoryPostures
from continuum_grasp.grasp.judge.stage import GraspStage
from continuum_grasp.grasp.rods.clearance import places_of_nodes
from continuum_grasp.grasp.rods.record import held_rods
from continuum_grasp.grasp.rods.robust import RobustSearch, RodResponder
from continuum_grasp.grasp.rods.search import RodSearch
from continuum_grasp.nlp import Budget
from tests.marks import few


@cache
def held(name, stages=12):
    return search_of(cg.load(f"configs/grasp/{name}.yaml"), stages)


def search_of(scene, stages=12):
    search = RodSearch(scene, Budget(), stages)
    search.run()
    robust = RobustSearch(search, {})
    robust.run()
    return search, robust.best


def responder(search, robust):
    return RodResponder(robust.errors, search.stages, Budget())


def row(robust, states):
    """An error of friction states alone."""
    return np.concatenate([np.zeros(len(robust.errors.columns)), np.ravel(states)])


@pytest.mark.deep
@pytest.mark.parametrize("name", few(["mug_motor", "mug_sticking", "preshaped"], 1))
def test_no_history_that_is_drawn_or_turned_is_worse(name):
    """At tensions, or at angles of servos, that a search of the worst histories has found."""
    search, robust = held(name)
    assert robust.holds
    assert robust.grasp.tension > search.best.tension
    respond = responder(search, robust)
    size, random = robust.errors.histories.size, np.random.default_rng(1)
    (worst,) = robust.active[:1]
    turned = [np.where(np.arange(size) == k, -1.0, 1.0) * robust.errors.states(worst) for k in range(0, size, 3)]
    drawn = [np.clip(random.uniform(-2.0, 2.0, size), -1.0, 1.0) for _ in range(4)]
    margins = [respond.to(row(robust, states)).margin for states in (*turned, *drawn)]
    assert min(margins) > -1e-6
    # The worst history is worth no margin at all, and its neighbors little.
    assert respond.to(worst).margin == pytest.approx(0.0, abs=1e-6)
    assert min(margins) < 0.05


@pytest.mark.deep
def test_less_tension_does_not_bear_the_worst_history():
    search, robust = held("mug_sticking")
    (worst,) = robust.active[:1]
    grasp = robust.grasp
    x = grasp.attempt.x.copy()
    for part in grasp.problem.parts:
        x[part.pulls] *= 0.999
    respond = responder(search, robust)
    respond._x = x
    assert respond.to(worst).margin < -1e-4


def test_directions_that_are_given_reach_their_bounds():
    """A tendon that slides all along obeys the capstan law also where its direction is given: exp(-mu bend)."""
    search, robust = held("mug_motor")
    respond = responder(search, robust)
    for sign in (1.0, -1.0):
        response = respond.to(row(robust, sign * np.ones(robust.errors.histories.size)))
        problem, x = response.copy.problem, response.attempt.x
        part = problem.parts[0]
        loss = x[part.sliding(len(part.nodes) - 1)[0]]
        turn = x[part.nodes[-1][2]] - x[part.nodes[0][2]]
        # The rod bends one way all along, but for a rounding of 1 mrad.
        assert loss == pytest.approx(sign * 0.1 * turn, rel=2e-3)


@pytest.mark.deep
def test_twice_the_stages_find_nearly_the_same_tension():
    """Worst histories turn next to a contact, in a stage that is half as long then."""
    few_stages, more = (search_of(cg.load("configs/grasp/mug_sticking.yaml"), n)[1] for n in (24, 48))
    assert more.grasp.tension == pytest.approx(few_stages.grasp.tension, rel=0.015)


@pytest.mark.deep
@pytest.mark.parametrize("name", ["mug_motor", "mug_sticking"])
def test_the_image_of_a_scene_has_the_opposite_history(name):
    """On the other side of a mug, the other tendon pulls."""
    _, own = held(name)
    scene = cg.load(f"configs/grasp/{name}.yaml")
    x, y = scene.finger.base.position
    _, image = search_of(scene.changed({"finger.base.position": (x, -y)}))
    assert image.grasp.tension == pytest.approx(own.grasp.tension, rel=1e-4)
    ours, theirs = ({tuple(row[row != 0.0]) for row in np.sign(each.active)} for each in (own, image))
    assert ours == {tuple(-np.array(row)) for row in theirs}


@pytest.mark.deep
def test_the_certificate_finds_the_same_postures():
    """Its rods are integrated from the base, and its reserve is a force, not a share: the greatest one is no less."""
    search, robust = held("mug_sticking", 24)
    scene, grasp = search.scene, robust.grasp
    record = held_rods(grasp)
    rods = list(certify_held(scene.replaced(friction_states="pulled"), record).rods)
    postures = HistoryPostures(GraspStage.of(scene), record, rods)
    respond = responder(search, robust)
    places = places_of_nodes(grasp.problem, grasp.attempt.x, 0)
    assert places.size == 25
    for sign in (-1.0, 1.0):
        response = respond.to(row(robust, np.full(robust.errors.histories.size, sign)))
        spare = _spare(response) / postures.scale
        posture = postures.found([np.full((12, 1), sign)], postures.start)
        # A sum of some 50 rows, of which each counts 50 times as much as the reserve.
        assert posture.violated < 5e-5
        assert spare - 1e-3 < posture.reserve < spare + 0.06


def _spare(response):
    """Least force that friction still bears [N]."""
    problem, x = response.copy.problem, response.attempt.x
    numbers = problem.numbers
    spares = []
    for finger in numbers.fingers:
        spares += [(finger.friction, finger.force * x[problem.contacts[name]]) for name in finger.contacts]
    spares += [(support.friction, numbers.force * x[problem.contacts[support.name]]) for support in numbers.supports]
    return min(friction * force[0] - np.hypot(*force[1:3]) for friction, force in spares)
