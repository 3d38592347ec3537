"""What users read, such as notebooks, guides and examples in docstrings, imports public names only."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
COMPARED = {"mpc_solvers.ipynb", "speed_against_error.ipynb"}
"""Notebooks that compare with other programs and with the paper's equations, which are in ``benchmarks``."""
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "examples").rglob("*.md"))]
SCRIPTS = sorted((ROOT / "examples").rglob("*.py"))
MODULES = sorted((ROOT / "continuum_grasp").rglob("*.py"))


def blocks(file: Path) -> Iterator[str]:
    """Python sources in a notebook, page, script or the docstrings of a module."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        # Lines of IPython's own, such as %matplotlib, are no Python.
        code = ("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
        yield from (re.sub(r"^\s*[%!].*$", "", source, flags=re.MULTILINE) for source in code)
    elif file.suffix == ".md":
        yield from re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    elif file in SCRIPTS:
        yield text
    else:
        lines = re.findall(r"^ *>>> ((?:from|import) .*)$", text, re.MULTILINE)
        yield "\n".join(lines)


def imported(source: str) -> Iterator[tuple[str, str | None]]:
    """Modules and the names taken from them, by imports and as ``cg.NAME``."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias.name) for alias in node.names)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "cg":
            yield "continuum_grasp", node.attr


def is_public(module: str, name: str | None) -> bool:
    """Whether a name is in the ``__all__`` of the package or of one of its packages."""
    package, _, inner = module.partition(".")
    if package != "continuum_grasp":
        return True
    if "." in inner.removeprefix("addons."):
        return False
    names = getattr(import_module(module), "__all__", ())
    # Packages themselves are public too: from continuum_grasp import plotting.
    if inner in ("", "addons") and name is not None and name not in names:
        return hasattr(import_module(f"{module}.{name}"), "__all__")
    return name is None or name in names


@pytest.mark.parametrize("file", [*NOTEBOOKS, *PAGES, *SCRIPTS], ids=lambda file: file.relative_to(ROOT).as_posix())
def test_only_public_names_are_imported(file):
    found = [one for source in blocks(file) for one in imported(source)]
    assert [one for one in found if not is_public(*one)] == []
    if file.name not in COMPARED:
        assert [module for module, _ in found if module.partition(".")[0] in ("benchmarks", "tests")] == []


def test_docstrings_import_only_public_names():
    found = {(file.name, *one) for file in MODULES for source in blocks(file) for one in imported(source)}
    assert len(found) > 50
    assert [one for one in found if not is_public(*one[1:])] == []


def test_the_judge_itself():
    assert is_public("continuum_grasp", "simulate")
    assert is_public("continuum_grasp", "plotting")
    assert is_public("continuum_grasp.control", "stages_of")
    assert not is_public("continuum_grasp.control.ocp.stages", "stages_of")
    assert not is_public("continuum_grasp.control", "numbers")
    assert list(blocks(ROOT / "docs/control.md"))
