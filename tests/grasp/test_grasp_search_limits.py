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
from continuum_grasp.grasp.tried import Basin, Tried, branch_of, least_of
from continuum_grasp.nlp import Budget, SolverStatus
from tests import certificate_cases as cases

TENSION, MOST = 10.0, 60.0
NONE = 1e-4 * MOST
"""Tension that counts as none [N]: 1e-4 of the greatest of the finger."""


class Grasp(SimpleNamespace):
    """One of its own, whatever others hold."""

    __eq__ = object.__eq__
    __hash__ = object.__hash__


def start(estimate=math.nan, imbalance=0.0, tensions=(0.0, 0.0), angle=0.0, doubt=0.0):
    contact = SimpleNamespace(normal_angle=angle, part=0)
    return SimpleNamespace(
        label="scan", estimate=estimate, imbalance=imbalance, tensions={"finger": tensions}, doubt=doubt,
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


def explore(search, *scanned):
    """Go on from such starts of a scan."""
    search.basins_of = lambda mode: list(scanned)
    search._from_basins(frozenset({"finger.tip", "palm"}))


def solved(scanned, *grasps, **more):
    search, starts = searching(*grasps, **more)
    explore(search, scanned)
    return bool(starts)


def unsolved(imbalance, elements):
    """Whether a basin is tried after two others led to nothing."""
    search, starts = searching(elements=elements)
    search.tried = [grasp(), grasp()]
    explore(search, start(imbalance=imbalance))
    return bool(starts)


def scanned(imbalance, *grasps, **more):
    """How many of three scanned starts of more elements are tried, the last of which is so far from balance."""
    search, starts = searching(*grasps, **{"elements": 3, **more})
    explore(search, start(1.0, 0.9), start(2.0, 0.9), start(3.0, imbalance))
    return len(starts)


def keeps(tension, **more):
    """Whether a basin counts as solved by a grasp with so much tension."""
    search, _ = searching(found := grasp(tension), **more)
    search.attempt = lambda *_, **options: found
    search._solve(basin := Basin(start(estimate=TENSION)))
    return basin.solved


def over(effort, iterations):
    """Whether a search that has a grasp ends after so many iterations."""
    search, _ = searching(grasp(), **{"solver.effort": effort})
    search.budget.left = 1
    search._first_left = 1 + iterations
    return search._is_over


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
    ("estimate of a basin that is solved", 1.1 * TENSION, lambda e: solved(start(estimate=e), grasp())),
    ("estimate of a basin that is open", 0.98 * TENSION - NONE,
     lambda e: searching(grasp())[0].is_open(Basin(start(estimate=e)))),
    ("tension of a start that is worth a try", 1.5 * TENSION,
     lambda t: searching(grasp())[0]._promises(start(tensions=(0.5 * t, 0.5 * t)))),
    ("estimate of a basin that is solved for another aim", 2.0 * MOST,
     lambda e: solved(start(estimate=e), grasp(), objective="greatest_friction_margin")),
    ("iterations of a search with a grasp", 600.0, lambda n: not over("normal", n)),
    ("iterations of a quick one", 150.0, lambda n: not over("quick", n)),
    ("tension that keeps what a basin promised", (TENSION + NONE) / 0.98, keeps),
    ("imbalance of a basin", 0.02, lambda off: unsolved(off, 2)),
    ("imbalance of a scanned start of more elements", 0.2, lambda off: scanned(off) == 3),
    ("press above what is proven", 1.0 + 1e-3, proven),
    ("objective for which a grasp that converged is taken", 2.0 * (1.0 + 1e-3),
     lambda cost: least_of([grasp(objective=2.0, optimal=False), grasp(objective=cost)]).attempt.optimal),
    ("difference of estimates of one basin", 1.0 / (1.0 - 1e-3), lambda e: module._same(start(1.0), start(e))),
    ("violation of a start that is verified", 1e-2, lambda off: verified(off)),
    ("objective that is clearly worse", 1.05 + 1e-4, lambda cost: cost < searching(grasp())[0]._enough),
    ("turn of contacts of one branch", math.pi / 8, lambda a: branch_of(start(angle=a)) == branch_of(start())),
]  # fmt: skip


@pytest.mark.parametrize(("limit", "decides"), [row[1:] for row in LIMITS], ids=[row[0] for row in LIMITS])
def test_the_search_decides_otherwise_on_either_side_of_a_limit(limit, decides):
    # Some limits are one and a part of a thousand.
    assert decides((1.0 - 1e-6) * limit)
    assert not decides((1.0 + 1e-6) * limit)


def test_directions_are_known_but_for_whole_turns():
    assert branch_of(start(angle=np.pi)) == branch_of(start(angle=-np.pi))


def test_a_basin_far_from_balance_is_tried_first_alone():
    search, starts = searching()
    for count in (1, 2):
        explore(search, start(imbalance=0.5))
        search.tried.append(grasp())
        assert len(starts) == count
    explore(search, start(imbalance=0.5))
    assert len(starts) == 2


def test_the_start_that_came_nearest_has_more_patience_where_there_is_no_grasp(monkeypatch):
    search, _ = searching(elements=4)
    tried, violations = [], iter((0.4, 0.1, 0.3))

    def attempt(start, **options):
        tried.append((start, options.get("patience")))
        return Grasp(attempt=SimpleNamespace(stalled=True, badness=next(violations, 0.0), converged=False))

    search.attempt = attempt
    starts = [start(estimate) for estimate in (1.0, 2.0, 3.0)]
    monkeypatch.setattr(search, "basins_of", lambda mode: starts)
    monkeypatch.setattr(search, "rough_starts_of", lambda mode: [])
    monkeypatch.setattr(module, "contact_modes", lambda scene: [frozenset({"finger.tip"})])
    search.run()
    assert tried == [*((one, 7) for one in starts), (starts[1], None)]


@pytest.mark.parametrize(("grasps", "patience"), [(0, 7), (1, 4)])
def test_with_a_grasp_a_scanned_start_has_less_patience(grasps, patience):
    search, _ = searching(*[grasp() for _ in range(grasps)], elements=4)
    search.attempt = lambda start, **options: asked.update(options)
    asked: dict = {}
    search._solve(Basin(start()))
    # One of an oval takes 47 iterations, and is the best.
    assert (asked["patience"], asked["iterations"]) == (patience, None)


@pytest.mark.parametrize(("effort", "most"), [("quick", 4), ("normal", 4), ("thorough", 9)])
def test_with_a_grasp_four_rough_starts_in_a_row_may_lead_to_nothing_better(effort, most, monkeypatch):
    search, starts = searching(grasp(), elements=4, **{"solver.effort": effort})
    turns = (start(angle=0.8 * k) for k in range(1, 10))
    monkeypatch.setattr(search, "rough_starts_of", lambda mode: list(turns))
    search._from_rough([frozenset({"finger.tip"})], search._effort.in_vain)
    assert len(starts) == most
    assert search.exploration.pruned.get("after others that led to nothing better", 0) == 9 - most


def test_rough_starts_of_a_branch_that_holds_do_not_count_as_in_vain(monkeypatch):
    search, starts = searching(grasp(), elements=4)
    monkeypatch.setattr(search, "rough_starts_of", lambda mode: [start() for _ in range(9)])
    search._from_rough([frozenset({"finger.tip"})], search._effort.in_vain)
    assert len(starts) == 9


def test_a_proof_that_there_is_no_grasp_ends_the_search_after_six_starts(monkeypatch):
    search, _ = searching(elements=4)
    search.attempt = lambda start, **options: search.tried.append(grasp())
    monkeypatch.setattr(GraspSearch, "impossible", True)
    monkeypatch.setattr(search, "rough_starts_of", lambda mode: [start() for _ in range(9)])
    search._from_rough(frozenset({"finger.tip"}), 4)
    assert len(search.tried) == 6


def test_without_a_tip_no_scanned_start_is_too_far_from_balance():
    assert (scanned(0.9), scanned(0.9, grasp())) == (2, 2)
    search, starts = searching(elements=3)
    search.basins_of = lambda mode: [start(float(k), 0.9) for k in range(3)]
    search._from_basins(frozenset({"finger.middle", "palm"}))
    assert len(starts) == 3


def test_other_aims_begin_with_three_grasps_of_least_tension(monkeypatch):
    search, starts = searching(objective="greatest_friction_margin")
    monkeypatch.setattr(search, "run_before", lambda before: before.good.extend(grasp(objective=k) for k in range(5)))
    monkeypatch.setattr(module.GraspStart, "of", lambda scene, arrays: arrays)
    monkeypatch.setattr(module, "replace", lambda start, label: start)
    search._from(search.scene.replaced(objective="least_tension"), "least tension")
    assert len(starts) == 3


@pytest.mark.parametrize(
    ("effort", "basins", "starts"),
    [("quick", 3, 2), ("normal", 12, 8), ("thorough", 12, 24)],
)
def test_an_effort_is_so_many_basins_and_rough_starts(effort, basins, starts, monkeypatch):
    """Rough starts are three times as many of four fingers."""
    search, found = searching(**{"solver.effort": effort})
    mode, asked = frozenset({"finger.tip", "palm"}), []
    monkeypatch.setattr(search, "basins_of", lambda *_: [start(estimate=1.0 + k) for k in range(20)])
    search._from_basins(mode)
    assert len(found) == basins
    # Of sets of contacts that are scanned a thorough search alone takes rough starts, too.
    monkeypatch.setattr(search, "_from_basins", lambda *_: True)
    monkeypatch.setattr(search, "_from_rough", lambda modes, _: asked.extend(modes))
    search.run()
    assert asked == (contact_modes(search.scene) if effort == "thorough" else [])
    asked.clear()
    monkeypatch.setattr(module, "make_starts", lambda scene, mode, count: asked.append(count) or [])
    for count in (1, 2, 4):
        search.scene = SimpleNamespace(setups=[None] * count)
        search.rough_starts_of(mode)
        search._rough.clear()
    search.scene = SimpleNamespace(setups=[None])
    assert search.rough_starts_of(mode) is search.rough_starts_of(mode)
    assert asked == [starts, starts, 3 * starts, starts]


def test_estimates_of_more_elements_than_a_scan_has_prune_nothing():
    """However much tension a basin is estimated to take, and however far from balance it is."""
    far = start(estimate=100.0 * TENSION, imbalance=0.9, tensions=(100.0 * TENSION, 0.0))
    for elements, tried in ((2, False), (3, True)):
        assert solved(far, grasp(), elements=elements) == tried
        assert searching(grasp(), elements=elements)[0]._promises(far) == tried
    assert keeps(100.0 * TENSION, elements=3)
    search, _ = searching(grasp(100.0 * TENSION), elements=3)
    # What the budget left out is open.
    assert search.is_open(Basin(far))
    assert not search.is_open(Basin(far, tried=True))


@pytest.mark.parametrize(("elements", "few"), [(4, None), (5, 4), (8, 4)])
def test_more_than_four_elements_begin_with_four(elements, few):
    coarse = searching(elements=elements)[0]._few
    assert (coarse and coarse.scene.setups[0].elements) == few


def ended(objective, badness=0.0, *, converged=True):
    """An attempt with few elements, and the start that it was made from."""
    attempt = SimpleNamespace(start=start(), converged=converged, objective=objective, badness=badness)
    return SimpleNamespace(attempt=attempt, start=f"held {objective:.3g}")


def with_few(monkeypatch, *ends):
    """The starts that a search of many elements tries after one of few came to these ends, which are grasps where they
    converged.
    """
    search, tried = searching(elements=8)
    few = search._few
    monkeypatch.setattr(few, "run", lambda: few.tried.extend(ends))
    few.good.extend(end for end in ends if end.attempt.converged)
    search.run()
    return tried


def test_grasps_of_few_elements_are_continued_once_and_the_nearest_misses_are_tried(monkeypatch):
    """Of six starts two lead to one grasp with few elements, the others to none: of these so many are tried."""
    misses = [ended(0.0, badness, converged=False) for badness in (0.5, 3, 2, 1)]
    grasps = [ended(1.0), ended(1.0 + 1e-9)]
    tried = with_few(monkeypatch, grasps[0], misses[0], grasps[1], *misses[1:])
    # The grasp with few elements was none with many: it is the nearest.
    assert tried == ["held 1", *(end.attempt.start for end in (grasps[0], misses[0], misses[3]))]


def test_grasps_of_few_elements_are_continued_the_best_first(monkeypatch):
    assert with_few(monkeypatch, ended(2.0), ended(1.0), ended(1.5))[:3] == ["held 1", "held 1.5", "held 2"]


@pytest.mark.parametrize(("status", "again"), [("stopped", 1), ("infeasible", 0)])
def test_a_grasp_of_few_elements_goes_on_from_where_it_was_cut(status, again, monkeypatch):
    cut = Grasp(attempt=SimpleNamespace(status=SolverStatus(status)), start="cut", acceptable=False)
    search, _ = searching(elements=8)
    few, tried = search._few, []
    monkeypatch.setattr(few, "run", lambda: few.tried.append(ended(1.0)))
    monkeypatch.setattr(few, "good", few.tried)
    monkeypatch.setattr(search, "attempt", lambda start, **options: tried.append(start) or cut)
    search.run()
    assert tried.count("cut") == again


@pytest.mark.parametrize(("grasps", "iterations"), [((), 80), ((grasp(),), 40)])
def test_rough_starts_get_few_iterations_and_fewer_with_a_grasp(grasps, iterations, monkeypatch):
    search, _ = searching(*grasps)
    seen = []
    monkeypatch.setattr(search, "rough_starts_of", lambda _: [start(angle=3.0)])
    monkeypatch.setattr(search, "attempt", lambda start, **options: seen.append(options["iterations"]))
    search._from_rough([frozenset({"finger.tip"})], search._effort.in_vain)
    assert seen == [iterations]


def test_rough_starts_of_all_sets_of_contacts_take_turns_the_likeliest_first(monkeypatch):
    search, solved = searching()
    doubts = {"one": (0.3, 0.4), "two": (0.5,), "three": (0.1, 0.2)}
    monkeypatch.setattr(search, "rough_starts_of", lambda mode: [start(doubt=doubt) for doubt in doubts[mode]])
    search._from_rough([*doubts], 4)
    assert [each.doubt for each in solved] == [0.1, 0.3, 0.5, 0.2, 0.4]


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
