"""One language: words that have a better one in the field occur neither in the package nor in its documentation."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = {".py", ".c", ".h", ".md", ".yaml", ".json", ".ipynb", ".txt", ".in", ".mjs", ".cpp", ".cu", ".sh", ".cmake"}
PLACES = ("continuum_grasp", "docs", "configs", "schema", "notebooks", "examples", "tests", "benchmarks")
PAGES = ("README.md", "CONTRIBUTING.md", "SECURITY.md")
OWN = {Path(__file__).resolve()}
"""This table itself."""

REPLACED = {
    r"programmes?": "NLP, QP, LP or SOCP; in prose problem",
    r"rubs|rub|rubbing|rubbed": "tendon friction",
    r"thrown": "needs a continuous tip moment",
    r"told": "reported or stated",
    r"is meant|nothing is said": "default",
    r"prices?|priced|dear|dearer": "penalty, weight, expensive",
    r"kept": "satisfied, retained, stateful or stored",
    r"stretch|stretches": "segment",
    r"make-up|ProblemMake": "structure, ProblemSpec",
    r"things?": "body, or what it is",
    r"crews?|everybody|somebody|nobody": "worker pool, worker",
    r"meanings": "descriptions",
    r"twins?": "reference implementation",
    r"hurried": "iteration cap",
    r"held back by": "active constraints",
    r"goes on where|go on where": "resumes after an interruption",
    r"sooner done": "faster",
    r"give or take": "within",
    r"beaten by|beaten": "dominated",
    r"on the way": "en route",
    r"rooms?|houses?": "package, module",
    r"set-points?|set_points?": "setpoint",
    r"doubtful|lies open|the way in|worst round": "a noun that says the state",
    r"hangs? together|holds? together": "is correlated",
}
"""Regular expressions of words that are not used, and what is written in their place."""
BRITISH = (
    r"behaviours?|centres?|centred|colours?|coloured|neighbours?|neighbouring|favours?|labelled|modelled|modelling|"
    r"travell\w+|(?:milli|centi|kilo|micro)?metres?|analys(?:e|ed|es)|catalogues?|artefacts?|"
    r"(?:optim|minim|maxim|linear|initial|general|normal|recogn|discret|parametr|real|stabil|visual|organ|regular|factor|"
    r"final|penal|summar|symmetr|quant)is(?:e|es|ed|er|ers|ing|ation|ations)"
)
"""Spelling is American, as in IPOPT, CasADi and acados."""


def files() -> list[Path]:
    """Text files of the project that people read."""
    found = [ROOT / page for page in PAGES]
    for place in PLACES:
        found += [path for path in (ROOT / place).rglob("*") if path.suffix in TEXT]
    # Measured tables and the changes of old versions stay as they were written.
    stored = {("benchmarks", "results"), ("docs", "changes")}
    return [path for path in found if path.resolve() not in OWN and path.relative_to(ROOT).parts[:2] not in stored]


def uses(pattern: str) -> list[str]:
    """Places where a word occurs: file, line, and what stands there."""
    word = re.compile(rf"(?<![A-Za-z])(?:{pattern})(?![A-Za-z])", re.IGNORECASE)
    found = []
    for path in files():
        name = str(path.relative_to(ROOT))
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if word.search(line) and "image/png" not in line:
                found.append(f"{name}:{number}: {line.strip()[:120]}")
    return found


@pytest.mark.parametrize("pattern", REPLACED)
def test_words_that_are_replaced_do_not_occur(pattern):
    found = uses(pattern)
    assert not found, f"write {REPLACED[pattern]} instead:\n" + "\n".join(found)


@pytest.mark.deep
def test_spelling_is_american():
    found = uses(BRITISH)
    assert not found, "\n".join(found)


def test_the_scan_finds_what_it_should():
    """Words in identifiers count, parts of other words do not."""
    word = re.compile(r"(?<![A-Za-z])(?:kept)(?![A-Za-z])", re.IGNORECASE)
    assert word.search("what is kept_of the")
    assert not word.search("unkept")
