"""The report of speed against error: its figures agree with theory, its front with itself."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import continuum_grasp as cg
from tests.rods import NITINOL, order, rod_scene

COSTLY_FIXTURES = ("report",)


def release():
    """The paper's rod with a tip mass, let go."""
    return rod_scene(
        NITINOL, None, None, fidelity={"bending_range": None}, tip_mass=0.02, time={"duration": 0.3, "step": 0.005}
    )


@pytest.fixture(scope="module")
def report():
    return cg.accuracy_report(release(), counts=(1, 2, 4))


def rows(report, model):
    columns = report.choices.columns
    return [dict(zip(columns, row, strict=True)) for row in report.choices.rows if row[0] == model]


@pytest.mark.deep
@pytest.mark.parametrize(("family", "expected"), [("arc", 2.0), ("clothoid", 4.0)])
@pytest.mark.parametrize("column", ["tip / L", "frequency 1"])
def test_errors_fall_at_the_familys_order(report, family, expected, column):
    errors = {row["elements"]: row[column] for row in rows(report, family)}
    assert order([errors[2], errors[4]]) == pytest.approx([expected], abs=0.7)


@pytest.mark.deep
def test_motions_come_nearer_to_the_reference(report):
    for family in ("arc", "clothoid", "matched_clothoid"):
        errors = [row["motion / L"] for row in rows(report, family)]
        assert errors == sorted(errors, reverse=True)
    assert report.reference.error < 5e-2 * min(report.choices.column("motion / L"))


def test_the_front_is_not_dominated(report):
    for cost, error, sign in (("instructions", "tip / L", 1.0), ("real-time factor", "motion / L", -1.0)):
        i, j = report.choices.columns.index(cost), report.choices.columns.index(error)
        front = report.front(cost, error)
        assert front
        for row in report.choices.rows:
            better = [sign * other[i] <= sign * row[i] and other[j] <= row[j] for other in report.choices.rows]
            assert (row in front) == (sum(better) == 1)  # by itself alone


def test_it_is_saved_whole(report, tmp_path):
    report.save(tmp_path)
    report.save_pictures(tmp_path)
    found = sorted(file.name for file in tmp_path.iterdir())
    assert found == [".run.json", "accuracy.json", "accuracy.md", "accuracy.png"]
    saved = json.loads((tmp_path / "accuracy.json").read_text())
    assert len(saved["rows"]) == len(report.choices.rows)
    text = (tmp_path / "accuracy.md").read_text()
    assert "Not dominated in cost and error:" in text
    assert "## choices" in text


@pytest.mark.deep
def test_a_scene_at_rest_has_no_motion():
    report = cg.accuracy_report(rod_scene(NITINOL, None, None, fidelity={"bending_range": None}), counts=(1, 2))
    assert report.reference is None
    assert all(math.isnan(value) for value in report.choices.column("motion / L"))
    assert np.all(np.array(report.choices.column("tip / L")) > 0.0)


def test_coordinates_of_one_model_are_refused():
    posed = rod_scene(NITINOL, "arc", 2, initial={"q": [0.1, 0.1]})
    with pytest.raises(cg.InputError, match=r"initial\.q: .* give a pose"):
        cg.accuracy_report(posed)
