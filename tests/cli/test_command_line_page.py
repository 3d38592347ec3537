"""Commands on pages are those of the command line; ``tests/docs/test_guides.py`` runs docs/command_line.md."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.main import get_command

from continuum_grasp.cli import app

ROOT = Path(__file__).parents[2]
ADDED = {"pull-off"}
"""Verbs of the add-on in ``examples``, which tests/addons runs."""
PAGE = (ROOT / "docs/command_line.md").read_text(encoding="utf-8")


def test_the_table_has_every_verb():
    rows = re.findall(r"^\| \[?`([a-z-]+)`(?:\]\(\w+\.md\))? \|(?: [^|]+\|){3}$", PAGE, re.MULTILINE)
    assert rows == list(get_command(app).commands)
    home = (ROOT / "docs/README.md").read_text(encoding="utf-8").partition("## How the parts fit together")[2]
    assert set(rows) - {"new", "schema", "validate", "doctor"} <= set(
        re.findall(r"`([a-z-]+)`", home.partition("\n## ")[0])
    )


PAGES = [ROOT / "README.md", ROOT / "benchmarks/README.md", *(ROOT / "docs").glob("*.md")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_on_a_page_is_one(page):
    """Verbs, options and arguments; files need not be there."""
    commands = get_command(app).commands
    for line in re.findall(r"^(?: {4})?continuum-grasp (?!-)(.+)$", page.read_text(encoding="utf-8"), re.MULTILINE):
        verb, *arguments = shlex.split(line, comments=True)
        if verb not in ADDED:
            commands[verb].make_context(verb, arguments).close()
