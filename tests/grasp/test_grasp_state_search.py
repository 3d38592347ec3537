"""The certificate's own search for friction states: against LPs, the optimizer's statics, and all vertices."""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog

from continuum_grasp.grasp import Status, certify, optimize_grasp
from continuum_grasp.grasp.certificate.certificate import _recomputed
from continuum_grasp.grasp.certificate.held import held_postures, searched
from continuum_grasp.grasp.certificate.postures import Postures
from continuum_grasp.grasp.certificate.recomputed import RecomputedGrasp
from continuum_grasp.grasp.certificate.reserve import Limits, greatest_reserve
from continuum_grasp.grasp.robust.response import Responder
from continuum_grasp.grasp.robust.states import OBJECT
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.load import load
from tests.grasp_scenes import CONFIGS
from tests.marks import few

STICKS = {"dry_friction": [{"stiffness": 0.02, "moment": 0.01}]}
WINCH = {"kind": "length", "time_constant": 0.02}
CABLE = {"axial_stiffness": 1e4, "series_stiffness": 3e4, "drive": WINCH, "time_constant": None, "min_tension": 0.0}


def mug(friction=0.0, elements=2, **changes):
    """The mug of the shipped scene, by a finger with four friction states."""
    own = {"finger.tendons.friction": friction, "fidelity.elements": elements, "fidelity.family": "clothoid"}
    return load(CONFIGS / "mug.yaml").changed({**own, "solver.effort": "quick", **changes})


def sticking(**changes):
    """The same by a finger whose bending sticks: neither pulled nor released is the worst."""
    return mug(**{"finger.damping": {**STICKS, "friction_cells": 2}, **changes})


@pytest.fixture(scope="module")
def found():
    return optimize_grasp(sticking())


# -- the few directions -----------------------------------------------------------------------------------------------


def test_the_greatest_reserve_is_that_of_linear_problems():
    rng = np.random.default_rng(0)
    count, rows, cones, size = 6, 12, 3, 3
    slopes, cone_slopes = rng.normal(size=(rows, size)), rng.normal(size=(cones, 3, size))
    slacks, values = rng.uniform(-0.3, 2.0, (count, rows)), rng.normal(size=(count, cones, 3))
    cone_slopes[:, 2] = values[..., 2] = 0.0
    found = greatest_reserve(Limits(slacks, slopes, values, cone_slopes))
    for b in range(count):
        # Unknowns w, r, t.
        above = [[*-slopes[k], 0.0, -1.0] for k in range(rows)]
        right = [*slacks[b]]
        for k, sign in product(range(cones), (1.0, -1.0)):
            above.append([*(sign * cone_slopes[k, 1] - cone_slopes[k, 0]), 1.0, 0.0])
            right.append(values[b, k, 0] - sign * values[b, k, 1])
        bounds = [(None, None)] * (size + 1) + [(0.0, None)]
        best = linprog([0.0] * size + [-1.0, 100.0], A_ub=above, b_ub=right, bounds=bounds)
        assert found.reserve[b] - 100.0 * found.excess[b] == pytest.approx(-best.fun, abs=1e-5)


def test_the_forces_of_the_reserve_are_its_slopes():
    rng = np.random.default_rng(1)
    slopes, cone_slopes = rng.normal(size=(10, 2)), rng.normal(size=(3, 3, 2))
    slacks, values = rng.uniform(0.1, 1.0, (1, 10)), rng.normal(size=(1, 3, 3))
    values[..., 0] += 3.0

    def reserve(off):
        found = greatest_reserve(Limits(slacks + off[:10], slopes, values + off[10:].reshape(3, 3), cone_slopes))
        return float(found.reserve[0] - 100.0 * found.excess[0])

    one = greatest_reserve(Limits(slacks, slopes, values, cone_slopes))
    forces = np.concatenate([one.slack_forces[0], one.cone_forces[0].ravel()])
    step = 1e-4
    by_difference = [(reserve(step * e) - reserve(-step * e)) / (2.0 * step) for e in np.eye(19)]
    np.testing.assert_allclose(forces, by_difference, atol=2e-3)


# -- postures ---------------------------------------------------------------------------------------------------------


@pytest.mark.deep
@pytest.mark.parametrize(
    "scene",
    few(
        [
            sticking(),
            mug(0.08, **{f"finger.tendons.{key}": value for key, value in CABLE.items()}),
            mug(0.08),
            load(CONFIGS / "pinch_above.yaml").changed(
                {
                    **{f"fingers.{name}.tendons.friction": 0.1 for name in ("lower", "upper")},
                    "fidelity.elements": 2,
                    "fidelity.family": "clothoid",
                    "stability": "ignore",
                }
            ),
        ],
        1,
    ),
)
def test_postures_have_the_reserve_that_the_optimizer_finds(scene):
    """Two codes that share nothing: IPOPT with CasADi's statics, and numpy; guarded places change it by up to 4e-5."""
    grasp = optimize_grasp(scene)
    own = {key: value for key, value in grasp.arrays.items() if not key.startswith("held.")}
    reached = RecomputedGrasp(grasp.scene, own)
    responder, postures = Responder(grasp.scene, own, Budget()), Postures(reached)
    held = list(held_postures(reached, grasp.arrays))
    rng = np.random.default_rng(5)
    for _ in range(4):
        states = rng.choice([-1.0, 1.0], postures.count)
        response = responder.to(np.concatenate([np.zeros(OBJECT), states]))
        near = min(held, key=lambda one: int((one[0] != states).sum()))[1]
        posture = postures.at(states, near)
        assert posture is not None
        cones = _recomputed(grasp.scene, posture.arrays, reached=False)[1]
        assert cones is not None
        theirs = _recomputed(grasp.scene, {**own, **response.arrays, **stated(reached, states)}, reached=False)[1]
        least = [
            min(c.friction * c.normal_force - float(np.hypot(c.friction_force, c.lift)) for c in one.contacts)
            for one in (cones, theirs)
        ]
        assert least[0] == pytest.approx(least[1], abs=1e-3 * reached.force_scale)


def stated(grasp, states):
    """Friction states (K,) as arrays of a grasp."""
    columns = Postures(grasp).columns
    return {f"{name}.friction_states": states[own] for name, own in columns.items()}


# -- search -----------------------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_the_search_is_reported(found):
    search = found.certificate.search
    assert found.solved
    assert search.holds
    assert search.unsettled == 0
    assert f"searched {search.tried} sets of friction states" in found.table()
    assert found.certificate.data()["friction_state_search"]["tried"] == search.tried
    assert found.certificate["held with the worst friction states that the certificate finds"].passed


@pytest.mark.deep
def test_a_worst_vertex_that_is_not_stored_is_found_again(found):
    """Of all vertices, by brute force with the optimizer's statics, none is worse."""
    pulled_and_released = {key: value[:2] if key.startswith("held.") else value for key, value in found.arrays.items()}
    search = certify(found.scene, pulled_and_released).search
    own = {key: value for key, value in found.arrays.items() if not key.startswith("held.")}
    responder = Responder(found.scene, own, Budget())
    every = [responder.to(np.concatenate([np.zeros(OBJECT), z])) for z in product((1.0, -1.0), repeat=4)]
    worst = min(every, key=lambda response: response.reserve)
    assert search.reserve == pytest.approx(found.certificate.search.reserve, abs=1e-5)
    np.testing.assert_array_equal(search.states, worst.error[OBJECT:])


@pytest.mark.deep
def test_vertices_that_the_optimizer_misses_become_part_of_its_problem(found, monkeypatch):
    monkeypatch.setattr("continuum_grasp.grasp.robust.search.descended", lambda *_: iter(()))
    again = optimize_grasp(sticking())
    assert again.status is found.status
    assert again.statistics["robust"]["corners_of_the_certificate"] > 0
    assert again.tension == pytest.approx(found.tension, rel=1e-3)


@pytest.mark.deep
def test_a_grasp_that_its_own_worst_vertex_breaks_is_not_optimal(monkeypatch):
    monkeypatch.setattr("continuum_grasp.grasp.robust.search.descended", lambda *_: iter(()))
    monkeypatch.setattr("continuum_grasp.grasp.robust.solve.RETURNS", 0)
    refuted = optimize_grasp(sticking(), raise_on_failure=False)
    assert refuted.status is Status.NOT_SOLVED
    assert "not at one that the certificate found: friction states in bending" in refuted.message
    assert "friction cone" in refuted.violated[0]
    assert "Lower damping.dry_friction.moment" in refuted.advice
    assert not refuted.certificate.search.holds


@pytest.mark.deep
def test_states_without_an_answer_are_said(found, monkeypatch):
    solved = Postures.at
    worse = tuple(found.certificate.search.states)

    def at(self, states, near, **options):
        return None if tuple(states) == worse else solved(self, states, near, **options)

    monkeypatch.setattr(Postures, "at", at)
    grasp = RecomputedGrasp(found.scene, found.arrays)
    search = searched(grasp, found.arrays, partial(_recomputed, found.scene))
    assert search.unsettled == 1
    assert "1 of them without an answer" in search.words


def test_a_grasp_without_friction_states_is_not_searched(monkeypatch):
    monkeypatch.setattr("continuum_grasp.grasp.certificate.held.search_states", lambda *_: pytest.fail("searched"))
    assert optimize_grasp(mug()).certificate.search is None
    assert optimize_grasp(sticking(friction_states="pulled")).certificate.search is None
