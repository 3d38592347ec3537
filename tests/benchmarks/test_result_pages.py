"""Pages of ``benchmarks/results``: of which version they are, and what those beside acados show."""

from __future__ import annotations

import json

import pytest

from benchmarks.harness import ROOT
from benchmarks.mpc.peers import BUILDS, QP_SOLVERS
from benchmarks.report import RESULTS, markdown

PAGES = sorted(path.stem for path in RESULTS.glob("*.md"))


def page(name):
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def minor(version):
    return tuple(int(part) for part in version.split(".")[:2])


@pytest.mark.parametrize("name", PAGES)
def test_figures_are_of_the_last_version_or_newer(name):
    machine = page(name)["machine"]
    measured = machine.get("continuum_grasp") or machine["continuum-grasp"]  # as pages of 0.7 have it
    last = max(minor(file.stem) for file in (ROOT / "docs/changes").glob("*.md"))
    assert minor(measured) >= last, "measure it anew, or delete it, and all figures from it"


@pytest.mark.parametrize("name", PAGES)
def test_pages_are_made_from_their_data(name):
    assert (RESULTS / f"{name}.md").read_text(encoding="utf-8") == markdown(page(name))


def test_acados_is_measured_in_both_builds_beside_scalar_code_and_lanes():
    (table,) = (t for t in page("mpc_race")["tables"] if t["title"] == "Closed loop: arcs")
    rows = {row[0]: dict(zip(table["columns"], row, strict=True)) for row in table["rows"]}
    for label in [f"acados, {build} BLASFEO, {form}" for build in BUILDS for form in QP_SOLVERS]:
        for own in ("ours, scalar", "ours, lanes"):
            expected = rows[label]["median [us]"] / rows[own]["median [us]"]
            assert rows[label][f"times {own}"] == pytest.approx(expected, rel=0.3)
