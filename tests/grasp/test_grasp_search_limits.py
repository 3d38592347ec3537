"""The limits by which the search chooses; from inside: starts and grasps on either side of each are put in.

The limits by which the search chooses among starts and grasps: each decides otherwise on either side of it.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.grasp import search as module
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.tried import Candidate, Tried, least_of
from continuum_grasp.nlp import Budget
from tests import certificate_cases as cases

TENSION, MOST = 10.0, 60.0
NONE = 1e-4 * MOST
"""Tension that counts as none [N]: 1e-4 of the greatest of the finger."""


class Grasp(SimpleNamespace):
    """One of its own, whatever others hold."""

    __eq__ = object.__eq__
    __hash__ = object.__hash__


def start(estimate=math.nan, imbalance=0.0, tensions=(0.0, 0.0), angle=0.0):
    contact = SimpleNamespace(normal_angle=angle, part=0)
    return SimpleNamespace(
        label="map", is_spare=False, is_rough=False,
        estimate=estimate, imbalance=imbalance, tensions={"finger": tensions},
        contacts={"finger.tip": contact}, fingers={"finger": SimpleNamespace(sides=(1,))},
    )  # fmt: skip


def grasp(tension=TENSION, objective=1.0, optimal=True, press=1.0):
    arrays = {"finger.tensions": np.array([tension, 0.0]), "contact_forces": np.array([[press, 0.0, 0.0]])}
    attempt = SimpleNamespace(objective=objective, optimal=optimal, converged=True, start=start(), stalled=False)
    return Grasp(attempt=attempt, arrays=arrays, acceptable=True, solver=None)


def searching(*grasps, elements=2, **changes):
    """A search that has these grasps, and the starts that it goes on to solve from."""
    scene = cases.squeezed_disc()[0].changed({"fidelity.elements": elements, **changes})
    search, solved = GraspSearch(scene, Budget()), []
    search.good, search.tried = list(grasps), list(grasps)
    search.attempt = lambda start, **options: solved.append(start)
    return search, solved


def settled(estimate, imbalance=0.0, tried=False):
    return Candidate(start(estimate, imbalance), tried)


def polished(estimate, *grasps, **more):
    """Whether a settled exact rod is tried beside grasps."""
    search, starts = searching(*grasps, **more)
    search.settle = lambda *_, **__: [settled(estimate)]
    search._from_settled()
    return bool(starts)


def explored(candidate, *grasps, **more):
    search, _ = searching(*grasps, **more)
    search.settled = search.__dict__["_settled_exactly"] = [candidate]
    return search.exploration


def verified(badness):
    """Whether an attempt whose violation is so much gets a certificate, which passes here."""
    tried = Tried(SimpleNamespace(badness=badness), None, None)
    tried.__dict__["certificate"] = SimpleNamespace(passed=True)
    return tried.verified


def proven(press):
    search, _ = searching(grasp(press=press), objective="least_normal_force")
    search.__dict__["bound"] = 1.0
    return search.proven


LIMITS = [
    ("estimate of an exact rod that is tried", 1.02 * (TENSION + NONE) - NONE, lambda e: polished(e, grasp())),
    ("estimate of an exact rod that is missing", 0.98 * (TENSION + NONE) - NONE,
     lambda e: explored(settled(e), grasp()).untried == 1),
    ("tension of an exact rod that elements do not follow", 0.97 * (TENSION + NONE) - NONE,
     lambda e: explored(settled(e, tried=True), grasp()).exact_less == e),
    ("imbalance of an exact rod that holds", 1e-5, lambda off: explored(settled(1.0, off), grasp()).untried == 1),
    ("press above what is proven", 1.0 + 1e-3, proven),
    ("objective for which a grasp that converged is taken", 2.0 * (1.0 + 1e-3),
     lambda cost: least_of([grasp(objective=2.0, optimal=False), grasp(objective=cost)]).attempt.optimal),
    ("violation of a start that is verified", 1e-2, lambda off: verified(off)),
]  # fmt: skip


@pytest.mark.parametrize(("limit", "decides"), [row[1:] for row in LIMITS], ids=[row[0] for row in LIMITS])
def test_the_search_decides_otherwise_on_either_side_of_a_limit(limit, decides):
    # Some limits are one and a part of a thousand.
    assert decides((1.0 - 1e-6) * limit)
    assert not decides((1.0 + 1e-6) * limit)


@pytest.mark.parametrize(("changes", "tried"), [({"objective": "greatest_friction_margin"}, 1), ({}, 0)])
def test_tensions_of_exact_rods_tell_nothing_of_other_aims(changes, tried):
    assert polished(100.0 * TENSION, grasp(), **changes) == bool(tried)


def test_rods_do_not_tell_of_histories_of_friction():
    candidate, friction = settled(0.5 * TENSION, tried=True), {"finger.tendons.friction": 0.1, "fidelity.family": "arc"}
    assert explored(candidate, grasp()).exact_less == 0.5 * TENSION
    assert math.isnan(explored(candidate, grasp(), **friction).exact_less)


@pytest.mark.parametrize("elements", [8, 4])
@pytest.mark.parametrize(("held", "nearest", "tried"), [(False, 1.0, 2), (False, 2e-3, 6), (True, 1.0, 2)])
def test_where_no_finger_holds_others_are_tried(elements, held, nearest, tried):
    """Boldly, then carefully: the nearest miss, all that hold before their optimum; none once there is a grasp."""
    search, starts = searching(elements=elements)
    misses = [settled(1.0, imbalance=nearest * (1.0 + 0.1 * k)) for k in range(3)]
    for miss in misses:
        miss.start.is_spare = True
    search.settle = lambda *_, **__: [settled(1.0)] * held + misses
    attempt = search.attempt
    search.attempt = lambda start, **options: (attempt(start, **options), held and search.good.append(grasp()))[0]
    search._from_settled()
    assert len(starts) == tried


def test_other_aims_begin_with_three_grasps_of_least_tension(monkeypatch):
    search, starts = searching(objective="greatest_friction_margin")
    monkeypatch.setattr(
        search, "run_before", lambda before, **_: before.good.extend(grasp(objective=k) for k in range(5))
    )
    monkeypatch.setattr(module.GraspStart, "of", lambda scene, arrays: arrays)
    monkeypatch.setattr(module, "replace", lambda start, label: start)
    search._from(GraspSearch(search.scene.replaced(objective="least_tension"), search.budget), "least tension")
    assert len(starts) == 3


@pytest.mark.parametrize(("effort", "fingers"), [("quick", 4), ("normal", 8), ("thorough", 24)])
def test_an_effort_is_so_many_settled_fingers(effort, fingers):
    search, found = searching(elements=8, **{"solver.effort": effort})
    search.settle = lambda *_, **__: [settled(1.0 + k) for k in range(30)]
    search._from_settled()
    # Boldly, then carefully.
    assert len(found) == 2 * fingers


@pytest.mark.parametrize(("pegs", "count"), [(5, 32), (6, 64), (7, 64)])
def test_so_many_sets_of_contacts_are_tried_the_greatest_first(pegs, count):
    free = {"x": (-0.5, 0.5), "y": (-0.5, 0.5)}
    around = {
        f"peg_{k}": {"type": "point", "position": (1.0 + k, 0.0), "radius": 0.01, "touch": "auto"} for k in range(pegs)
    }
    scene = searching()[0].scene.changed({"supports": around, "object.free": free})
    sizes = [len(mode) for mode in contact_modes(scene)]
    assert len(sizes) == count
    assert sizes[0] == pegs + 1
    assert sizes == sorted(sizes, reverse=True)
