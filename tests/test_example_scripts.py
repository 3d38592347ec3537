"""Scripts in ``examples``: each runs, finds the number of its independent source, and is listed with its picture."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from PIL import Image

from docs.examples import PICTURES, WIDTH, scripts
from tests.marks import but

ROOT = Path(__file__).parents[1]
NAMES = [script.stem for script in scripts()]
COSTLY = ["ex08_do_mpc", "ex09_grasp_reasons", "ex11_sweep", "ex19_commission"]
"""Five to nine seconds each the first time."""


@pytest.mark.parametrize("name", but(COSTLY, NAMES))
def test_an_example_finds_the_number_of_its_source(name, tmp_path, monkeypatch, capsys):
    """Its ``main`` asserts the number; without ``--out`` it writes nothing."""
    monkeypatch.chdir(tmp_path)
    plt.switch_backend("Agg")
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    example = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(example)
        found, expected = example.main()
    except SystemExit as missing:
        pytest.skip(str(missing))
    finally:
        plt.close("all")
    assert found == pytest.approx(expected, rel=0.02)
    assert "expected" in capsys.readouterr().out.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_there_are_twenty_ideas():
    assert [name[2:4] for name in NAMES] == [f"{k:02d}" for k in range(1, len(NAMES) + 1)]
    assert len(NAMES) >= 20


@pytest.mark.parametrize("name", NAMES)
def test_an_example_is_short_and_says_where_its_number_comes_from(name):
    text = (ROOT / "examples" / f"{name}.py").read_text(encoding="utf-8")
    tree = ast.parse(text)
    assert 20 <= len(text.splitlines()) <= 60
    assert 2 <= len(ast.get_docstring(tree).splitlines()) <= 5
    assert sum(isinstance(node, ast.Assert) for node in ast.walk(tree)) == 1
    modules = [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert not any(part.startswith("_") for module in modules for part in module.split("."))


@pytest.mark.parametrize("name", NAMES)
def test_the_page_shows_an_example_with_its_picture(name):
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    assert f"(../examples/{name}.py)" in page
    assert f"(pictures/examples/{name}.webp)" in page
    picture = PICTURES / f"{name}.webp"
    assert picture.stat().st_size < 40_000
    with Image.open(picture) as image:
        assert image.width == WIDTH


def test_every_picture_is_of_an_example():
    assert {path.stem for path in PICTURES.iterdir()} == set(NAMES)
