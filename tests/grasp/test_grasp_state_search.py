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
from continuum_grasp.scene.finger import Tendons
from continuum_grasp.scene.load import load
from tests import certificate_cases as cases
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
    # What is sideways has any direction, another one for each cone.
    angle = rng.uniform(0.0, 2.0 * np.pi, cones)
    ways = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    turned = np.concatenate([values[..., :1], values[..., 1:2] * ways], axis=2)
    turned_slopes = np.concatenate([cone_slopes[:, :1], cone_slopes[:, 1:2] * ways[..., None]], axis=1)
    found = greatest_reserve(Limits(slacks, slopes, turned, turned_slopes))
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


def wrapped(friction=0.0, drive=None, branches=()):
    """The wrap made by hand, by a finger with a little friction."""
    scene, arrays = cases.wrapped_disc(mass=0.2)
    tendons = Tendons(offset=cases.OFFSET, max_tension=60.0, friction=friction, **(CABLE if drive else {}))
    tendons = tendons.replaced(time_constant=None, drive=drive) if drive else tendons
    damping = scene.finger.damping.model_validate({"dry_friction": branches, "friction_cells": 2}) if branches else None
    finger = scene.finger.replaced(tendons=tendons, **({"damping": damping} if damping else {}))
    return scene.replaced(finger=finger), arrays


def free_direction(arrays):
    """The change of the forces (9) that leaves a finger on a disc and the disc in balance, by differences."""
    q, lengths, base = arrays["finger.q"], arrays["finger.lengths"], arrays["finger.base"]

    def places(q):
        return cases.bent(base, cases.ends_of("arc", q, lengths, 0.0), lengths, np.cumsum(lengths))

    moves = [(places(q + step) - places(q - step)) / 2e-6 for step in 1e-6 * np.eye(q.size)]
    normals, center = arrays["contact_normals"], np.asarray(arrays["object.pose"])[:2]
    rows = np.zeros((q.size + 6, 9))
    for k, n in enumerate(normals):
        across, arm = np.array([-n[1], n[0]]), arrays["contact_positions"][k] - center
        for row, move in zip(rows, moves, strict=False) if k < 2 else ():
            row[3 * k : 3 * k + 2] = move[k, :2] @ n, move[k, :2] @ across - cases.HALF * move[k, 2]
        turn = [arm[0] * way[1] - arm[1] * way[0] for way in (n, across)]
        rows[q.size : q.size + 3, 3 * k : 3 * k + 2] = [*np.column_stack([n, across]).tolist(), turn]
        rows[q.size + 3 :, 3 * k + 2] = 1.0, *arm
    *_, right = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None])
    return right[-1].reshape(3, 3)


@pytest.mark.parametrize(
    "case",
    [
        lambda: wrapped(branches=({"stiffness": 0.05, "moment": 2e-4},)),
        lambda: wrapped(0.01),
        lambda: wrapped(0.01, WINCH),
    ],
)
def test_postures_balance_with_the_greatest_reserve(case):
    """All checks pass, and of all forces that balance in the same shape none leave the cones more."""
    scene, arrays = case()
    postures = Postures(RecomputedGrasp(scene, arrays))
    rng = np.random.default_rng(3)
    for _ in range(2):
        posture = postures.at(rng.choice([-1.0, 1.0], postures.count), arrays)
        assert posture is not None
        checks, _ = _recomputed(scene, posture.arrays, reached=False)
        assert [check.name for check in checks if not check.passed and not check.name.startswith("friction cone")] == []
        forces, away = posture.arrays["contact_forces"], free_direction(posture.arrays)

        def reserve(part, forces=forces, away=away):
            n, f, lift = (forces + part * away).T
            return (scene.contacts.friction * n - np.hypot(f, lift)).min()

        assert posture.reserve * postures.scale == pytest.approx(reserve(0.0), abs=1e-9)
        beside = max(reserve(part) for part in np.concatenate([-np.logspace(-4, 0, 30), np.logspace(-4, 0, 30)]))
        assert beside <= reserve(0.0) + 1e-5 * postures.scale
        # To first order in the states: postures solved anew near by, and the slope at either end.
        model, near = posture.model(), posture.states * rng.uniform(0.95, 1.0, postures.count)
        gain = postures.at(near, arrays).reserve - posture.reserve
        both = model.reserves(np.stack([posture.states, near]))
        assert both.reserve - posture.reserve == pytest.approx([0.0, gain], abs=0.03 * abs(gain) + 1e-7)
        mean = model.slopes(both).mean(axis=0)
        assert mean @ (near - posture.states) == pytest.approx(gain, abs=0.03 * abs(gain) + 1e-7)


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
    monkeypatch.setattr("continuum_grasp.grasp.robust.solve.EXCHANGES", 0)
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
