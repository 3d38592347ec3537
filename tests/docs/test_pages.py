"""Pages that people read: all are found, and every link in them leads somewhere; nothing is built."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.site.charts import chart
from docs.site.notebook_pages import convert
from docs.site.pages import anchors, links, target
from docs.site.reference import names_page

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/**/*.md", "benchmarks/**/*.md", "examples/**/*.md")
    for path in ROOT.glob(pattern)
)
LISTED = re.findall(
    r"^ +- .*?([\w./]+\.(?:md|ipynb))$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE
)
"""Pages that the navigation of the site names."""


def test_every_page_is_in_the_navigation_once():
    wanted = [path for path in PAGES if not path.startswith("examples/")]
    wanted += [path.relative_to(ROOT).as_posix() for path in (ROOT / "notebooks").rglob("*.ipynb")]
    assert sorted(LISTED) == sorted(wanted)


def test_the_overview_names_every_guide():
    """The changelog names the changes of old versions."""
    named = {target(page, link)[0] for page in ("docs/README.md", "CHANGELOG.md") for link in links(read(page))}
    assert [path for path in PAGES if path.startswith("docs/") and path not in {*named, "docs/README.md"}] == []


def test_the_changelog_has_the_last_version_and_links_to_all_before_it():
    """In short entries: one line a change."""
    text = read("CHANGELOG.md")
    (newest,) = re.findall(r"^## (?!.*unreleased)(.+)$", text, re.MULTILINE)
    linked = re.findall(r"\[([\d.]+)\]\(docs/changes/", text)
    assert set(linked) == {path.stem for path in (ROOT / "docs/changes").glob("*.md")}
    assert [newest, *linked] == sorted({newest, *linked}, key=lambda v: [int(n) for n in v.split(".")], reverse=True)
    entries = re.findall(r"^- .*(?:\n  .*)*", text, re.MULTILINE)
    assert [entry for entry in entries if len(entry) > 160] == []


LISTS = {f"docs/{page}.md" for page in ("errata", "paper", "gallery", "results", "consumers", "public_names")}
"""Pages that are lists: equations, errata, gallery, results, unsupported keys and public names."""
READ_BY_USERS = [page for page in PAGES if page.startswith("docs/") and not page.startswith("docs/changes/")]
"""Pages of the documentation; changes of old versions stay as they were written."""


def test_pages_that_people_write_are_short():
    """Fenced blocks and formulas are no prose."""
    no_prose = re.compile(r"^```.*?^```$|\$\$.*?\$\$", re.MULTILINE | re.DOTALL)
    prose = {page: no_prose.sub("", read(page)) for page in READ_BY_USERS}
    words = {page: len(text.split()) for page, text in prose.items() if page not in LISTS}
    assert sum(words.values()) <= 32_500, sorted(words.items(), key=lambda one: -one[1])


def test_the_page_of_public_names_is_that_of_the_doors():
    """If not: ``python -m docs.site.reference``."""
    assert read("docs/public_names.md") == names_page()


def test_the_readme_fits_on_few_lines():
    assert len(read("README.md").splitlines()) <= 120


def test_pages_name_their_nouns():
    """Outside of code no relative clause stands for a noun; pages that are written by tests or about the paper may."""
    phrase = re.compile(r"\b(?:what is|that of|those of|of which)\b", re.IGNORECASE)
    pages = ["README.md", *(page for page in READ_BY_USERS if page not in LISTS)]
    prose = {page: re.sub(r"^ *```.*?^ *```", "", read(page), flags=re.MULTILINE | re.DOTALL) for page in pages}
    found = {page: phrase.findall(" ".join(text.split())) for page, text in prose.items()}
    assert {page: phrases for page, phrases in found.items() if phrases} == {}


BEGINS = r"\A# .+\n\n- \*\*You provide:\*\* .+\n- \*\*It does:\*\* .+\n- \*\*You get:\*\* .+\n"
"""Begin of the page of a verb."""


def test_every_verb_says_first_what_you_provide_what_it_does_and_what_you_get():
    """On its page, which the table of the command line links; in that table where it has none."""
    rows = re.findall(r"^\| (?:\[`\w+`\]\((\w+\.md)\)|`\w+`) \|(.+)\|$", read("docs/command_line.md"), re.MULTILINE)
    assert [cells for _, cells in rows if not all(map(str.strip, cells.split("|")))] == []
    pages = {page for page, _ in rows} - {""}
    assert len(pages) == 12
    assert [page for page in pages if not re.match(BEGINS, read(f"docs/{page}"))] == []


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    dead = [link for link in links(read(page)) if not leads_somewhere(page, link)]
    assert not dead


def test_dead_links_are_found():
    assert not leads_somewhere("docs/mpc.md", "no_such_page.md")
    assert not leads_somewhere("docs/mpc.md", "mpc_realtime.md#no-such-heading")
    assert not leads_somewhere("docs/mpc.md", "../../outside.md")
    assert leads_somewhere("docs/mpc.md", "../benchmarks/results")


def test_links_are_those_that_a_reader_sees():
    text = 'a [b](c.md#d "e") ![f](g.png) <img src="h.gif"> `[no](code.md)` [web](https://doi.org/1) [r]\n\n[r]: i.md\n'
    assert links(f"{text}\n```\n[no](fenced.md)\n```\n") == ["c.md#d", "g.png", "h.gif", "i.md"]


def test_anchors_are_those_of_repository_browsers():
    """As GitHub documents them: lower case, spaces to hyphens, other punctuation away, repetitions counted."""
    text = "# What's `new_one`, in 1.0?\n\n## a - b\n\n## Same\n\n## Same\n\n## [Link](x.md) *it*\n\n<a id='no'></a>\n"
    found = {"whats-new_one-in-10", "a---b", "same", "same-1", "link-it"}
    assert anchors(text.replace("'no'", '"own"')) == {*found, "own"}


def test_notebooks_are_shown_with_what_they_printed():
    text, pictures = convert(ROOT / "notebooks/design_a_finger.ipynb")
    assert text.startswith("# ")
    assert text.count("```python") == 8
    assert [name for name in pictures if f"![]({name})" not in text] == []
    assert all(data.startswith(b"\x89PNG") for data in pictures.values())


def test_a_chart_is_to_scale():
    table = {"title": "t", "columns": ["", "median [ns]"], "rows": [["a", 20.0], ["b", 40.0], ["c", 50.0]]}
    widths = [float(width) for width in re.findall(r"width: ([\d.]+)%", chart(table))]
    assert widths == pytest.approx([0.4 * widths[2], 0.8 * widths[2], widths[2]], abs=0.01)
    table["rows"] = [["a", 1.0], ["b", 10.0], ["c", 1000.0]]
    places = [float(place) for place in re.findall(r"left: ([\d.]+)%", chart(table))]
    assert places[2] - places[0] == pytest.approx(3 * (places[1] - places[0]), abs=0.02)


def read(page: str) -> str:
    """Text of a page."""
    return (ROOT / page).read_text(encoding="utf-8")


def leads_somewhere(page: str, link: str) -> bool:
    """Whether a file or folder of the repository is there, with the heading that the link names."""
    path, anchor = target(page, link)
    if path.startswith("../") or not (ROOT / path).exists():
        return False
    return not anchor or not path.endswith(".md") or anchor in anchors(read(path))
