"""docs/paper.md: each row of its first table, measured anew."""

from __future__ import annotations

import re

import pytest

from tests.paper.equations import errors
from tests.rods import ROOT

ROWS = dict(re.findall(r"^\| (\(\d.*?) \|.*\| ([\d.e-]+) \|$", (ROOT / "docs/paper.md").read_text(), re.MULTILINE))


def test_every_equation_of_the_model_errs_by_what_the_page_says():
    found = errors()
    assert ROWS.keys() == found.keys()
    # Rounding differs from processor to processor.
    assert [name for name, error in found.items() if error > 4.0 * float(ROWS[name]) + 1e-16] == []


@pytest.mark.parametrize("number", range(1, 44))
def test_no_equation_is_missing(number):
    spans = [re.findall(r"\((\d+)\)(?:-\((\d+)\))?", name) for name in ROWS]
    covered = [range(int(a), int(b or a) + 1) for row in spans for a, b in row]
    assert sum(number in span for span in covered) == 1
