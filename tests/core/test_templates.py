"""The language of templates: words, blocks, and blocks in blocks."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from continuum_grasp.core import Template

PAIRS = [("a", 1), ("b", 2)]
WORDS = {"n": 3, "none": (), "of": SimpleNamespace(size=0.5, map={"k": 7}), "pairs": PAIRS, "rows": [[1, 2], []]}


@pytest.mark.parametrize(
    ("template", "text"),
    [
        ("x << 2; vector<<<n>>> = <<of.size:.3f>>, <<of.map.k>>", "x << 2; vector<3> = 0.500, 7"),
        ("<<if n>>yes<<else>>no<<end>> <<if none>>yes<<else>>no<<end>>", "yes no"),
        ("<<if not none>>a<<end>><<if not n>>b<<else>>c<<end>>", "ac"),
        ("{<<for k, v in pairs|, >>.<<k>> = <<v>><<end>>}", "{.a = 1, .b = 2}"),
        (r"<<for k, v in pairs|,\n>><<k>><<end>>", "a,\nb"),
        ("<<for row in rows>>[<<for v in row| >><<v>><<end>>]<<if row>>+<<end>><<end>>", "[1 2]+[]"),
        ("<<for n in none>><<n>><<end>><<n>>", "3"),
        ("<<for n in rows>>[<<for v in n>><<v>><<end>>]<<end>><<n>>", "[12][]3"),
        ("<<if n>><<if none>>a<<else>>b<<end>>c<<else>>d<<end>>", "bc"),
    ],
)
def test_filled(template, text):
    assert Template(template).filled(WORDS) == text


def test_what_is_filled_in_is_no_template():
    assert Template("<<n>>").filled({"n": "<<m>>"}) == "<<m>>"
