"""The commands of docs/command_line.md, as they are written there and in that order."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from continuum_grasp.cli import app

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/command_line.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
LINES = [line.removeprefix("continuum-grasp ") for block in BLOCKS for line in block.splitlines()]


QUICK = ("new", "validate", "schema", "modes")
"""Verbs that take a second or two."""


def check(lines):
    """Run commands, and compare their exit status with the one that is written beside them."""
    for line in lines:
        done = CliRunner().invoke(app, shlex.split(line, comments=True))
        stated = re.search(r"# status (\d)$", line)
        assert done.exit_code == (int(stated[1]) if stated else 0), f"{line}\n{done.output}"
        if "--json" in line and not stated:
            json.loads(done.stdout)
        if "objct" in line:
            assert done.stderr in PAGE


@pytest.mark.deep
def test_quick_commands_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check(line for line in LINES if line.split()[0] in QUICK)


@pytest.mark.deep
def test_every_command_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check(LINES)
    verbs = {line.split()[0] for line in LINES}
    assert {path.parent.name for path in tmp_path.glob("runs/*/*")} == verbs - {*QUICK, "doctor"}


def test_the_table_has_every_verb():
    rows = re.findall(r"^\| `([a-z-]+)` \|(?: [^|]*\|){3}$", PAGE, re.MULTILINE)
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
        commands[verb].make_context(verb, arguments).close()
