"""docs/results.md: its lists are what results declare, its lines run and print what stands there."""

from __future__ import annotations

import contextlib
import io
import re
import warnings
from pathlib import Path
from typing import Any

import pytest

from tests.results_page import BEGIN, PAGE, lists

ROOT = Path(__file__).parents[2]


def test_the_lists_are_what_results_declare() -> None:
    """If not: ``python -m tests.results_page``."""
    assert PAGE.read_text(encoding="utf-8").split(BEGIN)[1] == f"\n{lists()}"


_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?")


def assert_close(printed: str, text: str) -> None:
    """Assert that texts are the same but for blanks at the ends of lines and the last digits of numbers."""
    given = ["\n".join(line.rstrip() for line in one.splitlines()) for one in (printed, text)]
    assert _NUMBER.sub("#", given[0]) == _NUMBER.sub("#", given[1])
    found, expected = ([float(number) for number in _NUMBER.findall(one)] for one in given)
    assert found == pytest.approx(expected, rel=2e-3, abs=1e-6)  # compilers differ in the last digits


@pytest.mark.deep
def test_its_lines_run_and_print_what_stands_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    blocks = re.findall(r"```(python)?\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    names: dict[str, Any] = {}
    printed = ""
    for language, text in blocks:
        if not language:
            assert_close(printed, text)
            continue
        out = io.StringIO()
        with contextlib.redirect_stdout(out), warnings.catch_warnings():
            warnings.filterwarnings("ignore", "FigureCanvasAgg is non-interactive")
            exec(text, names)
        printed = out.getvalue()
