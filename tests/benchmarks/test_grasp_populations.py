"""Scenes of the populations load and depend on their seed alone; files are compared by what holds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.grasp_populations import (
    IMAGES,
    POPULATIONS,
    Worker,
    against,
    document,
    image_of,
    judged,
    pairs,
    summary,
)
from benchmarks.harness import ROOT
from continuum_grasp.scene import GraspScene

COUNT = 3


@pytest.mark.parametrize("population", POPULATIONS)
def test_every_scene_and_image_loads(population):
    kind = POPULATIONS[population]
    for k in range(COUNT):
        data = document(population, k, elements=8)
        for image in IMAGES:
            scene = GraspScene.model_validate(image_of(data, image))
            assert len(scene.setups) == kind.fingers
            assert all(setup.elements == 8 for setup in scene.setups)
        if data["supports"]:
            scene = GraspScene.model_validate(data)
            assert all(abs(scene.gap_range(body)[0]) <= scene.touching_gap for body in scene.places)


def test_a_scene_depends_on_seed_and_number_alone():
    alone = document("two", 5)
    assert [document("two", k) for k in range(6)][5] == alone
    assert document("two", 5, seed=1) != alone
    many = document("two", 5, elements=16)
    assert many["fidelity"].pop("elements") == 16
    assert many == alone


def test_these_are_the_scenes_that_figures_are_of():
    # Drawn once; another machine or version of numpy has to draw the same.
    data = document("one", 0)
    drawn = data["object"]["mass"], data["fingers"]["finger"]["rod"]["length"], data["contacts"]["friction"]
    assert drawn == pytest.approx(FIRST, rel=1e-11)


FIRST = (0.248331181153, 0.232055624993, 0.637143845326)


def test_discs_become_polygons_of_the_same_area():
    data = next(d for k in range(40) if (d := document("one", k))["object"]["shape"] == "circle")
    corners = np.array(image_of(data, "facets")["object"]["vertices"])
    x, y = corners.T
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    assert area == pytest.approx(0.25 * math.pi * data["object"]["diameter"] ** 2, rel=1e-9)


def row(k, status, total=None, deviation=1e-4):
    held = {"total": total, "passed": True, "deviation": deviation} if total is not None else {}
    return {"population": "one", "k": k, "status": status, "most": 0.0, "cpu": 1.0 + k} | held


@pytest.mark.parametrize(
    ("a", "b", "word"),
    [
        (row(0, "optimal", 10.0), row(0, "feasible", 10.01), "equal"),
        (row(0, "optimal", 10.0), row(0, "feasible", 10.03), "A lower"),
        (row(0, "optimal", 10.03), row(0, "feasible", 10.0), "B lower"),
        (row(0, "optimal", 10.0), row(0, "unstable", 5.0), "A alone"),
        (row(0, "error"), row(0, "optimal", 5.0), "B alone"),
        (row(0, "limit"), row(0, "infeasible"), "none"),
    ],
)
def test_two_outcomes(a, b, word):
    assert against(a, b) == word


def test_outcomes_are_measured_by_the_best_that_exact_rods_confirm():
    a = [row(0, "optimal", 10.2), row(1, "infeasible"), row(2, "optimal", 10.0), row(3, "infeasible"), row(4, "limit")]
    b = [
        row(0, "feasible", 10.0),
        row(1, "feasible", 3.0),
        row(2, "feasible", 5.0, 0.02),
        row(3, "feasible", 1.0, 0.02),
    ]
    files = {"a": {"rows": a}, "b": {"rows": b}}
    scenes = {
        k: {label: each for label, rows in (("a", a), ("b", b)) for each in rows if each["k"] == k} for k in range(5)
    }
    found = judged(scenes, "a")
    assert found["optimal undercut"] == ["0 10.2 for 10"]
    assert found["infeasible that any holds"] == ["1"]
    assert found["held of those that any holds"] == ["0", "2"]
    assert found["error, limit"] == ["4"]
    outcomes, times, _ = summary(files, names=True)
    assert outcomes.rows[0][:7] == ["one", "a", 5, 2, 2, 1, "2 of 3"]
    assert times.rows[0][2] == 2.0  # of scenes 0 and 2
    table, _ = pairs(files, names=True)
    assert table.rows == [["one", 4, 0, 0, 2, 0, 2, 0]]


def test_scenes_that_only_others_searched_do_not_count():
    files = {"a": {"rows": [row(0, "infeasible")]}, "b": {"rows": [row(0, "infeasible"), row(1, "optimal", 10.0)]}}
    outcomes, _ = summary(files)
    assert [shown[6] for shown in outcomes.rows] == ["0 of 0", "1 of 1"]


@pytest.mark.deep
def test_a_scene_that_fails_or_takes_too_long_is_an_outcome_and_the_next_is_solved():
    worker = Worker(ROOT, "process", [])
    try:
        data = document("one", 3, elements=4)
        assert worker.solve(data | {"objective": "none such"}, 60.0)["status"] == "error"
        assert worker.solve(data, 0.05)["status"] == "limit"
        found = worker.solve(data, 60.0)
    finally:
        worker.remove()
    assert found["status"] in ("optimal", "feasible")
    assert found["passed"]
    assert found["cpu"] > 0.0
