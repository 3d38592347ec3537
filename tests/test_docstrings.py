"""Public functions explain themselves: signature, numpydoc sections, and an example that runs."""

from __future__ import annotations

import ast
import doctest
import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

import continuum_grasp
from tests.marks import but

ROOT = Path(__file__).parents[1]
MODULES = [
    ".".join(door.parent.relative_to(ROOT).parts)
    for door in sorted((ROOT / "continuum_grasp").rglob("__init__.pyi"), key=lambda door: (len(door.parts), door))
    if door.parent.name != "cli"
]


def public() -> dict[str, object]:
    """Functions and classes by the name under which a user imports them; the shortest where there are several."""
    found: dict[int, tuple[str, object]] = {}
    for module in MODULES:
        home = import_module(module)
        for name in getattr(home, "__all__", ()):
            value = getattr(home, name)
            if callable(value):
                found.setdefault(id(value), (f"{module}.{name}", value))
    return dict(found.values())


PUBLIC = public()
FUNCTIONS = [
    name
    for name, value in PUBLIC.items()
    if inspect.isfunction(value) and "; see `continuum_grasp." not in (inspect.getdoc(value) or "")
]
"""All but those that point at the function for users that they are behind."""
METHODS = {
    method.__qualname__: method
    for value in PUBLIC.values()
    if inspect.isclass(value)
    for name, method in inspect.getmembers(value, inspect.isfunction)
    if method.__module__.startswith("continuum_grasp.") and not name.startswith("_")
}
EXPLAINED = PUBLIC | METHODS
NO_NAME = re.compile(
    r'^ *"""(?:What|Which|How|Where|When|The same|It|Its|Of|That|These|This|They|Those|Their|None:|As i[nt]|\[)'
    r"(?!\w)",
    re.MULTILINE,
)
"""Openings of docstrings that do not stand alone, as on hover: pronouns, and units of no noun."""
NO_NOUN = re.compile(r"\b(?:what\s+is|that\s+of|those\s+of|of\s+which)\b", re.IGNORECASE)
"""Clauses that stand for a noun: a reader has to find out which one."""
WITH_EXAMPLES = [name for name, value in EXPLAINED.items() if ">>>" in (inspect.getdoc(value) or "")]


def test_a_docstring_stands_alone():
    sources = Path(continuum_grasp.__path__[0]).rglob("*.py")
    found = [(file.name, line) for file in sources for line in NO_NAME.findall(file.read_text(encoding="utf-8"))]
    assert found == []


def docstrings(source: str) -> list[str]:
    """Docstrings of a module: its own, and those of its classes, functions and attributes."""
    bodies = (getattr(node, "body", None) for node in ast.walk(ast.parse(source)))
    statements = (statement for body in bodies if isinstance(body, list) for statement in body)
    values = (statement.value for statement in statements if isinstance(statement, ast.Expr))
    return [value.value for value in values if isinstance(value, ast.Constant) and isinstance(value.value, str)]


def test_docstrings_name_nouns():
    """At most 60 clauses in the package that stand for a noun, and none in what users see first."""
    sources = Path(continuum_grasp.__path__[0]).rglob("*.py")
    texts = [text for file in sources for text in docstrings(file.read_text(encoding="utf-8"))]
    assert sum(len(NO_NOUN.findall(text)) for text in texts) <= 60
    public = {name: NO_NOUN.findall(inspect.getdoc(value) or "") for name, value in EXPLAINED.items()}
    assert {name: found for name, found in public.items() if found} == {}


def test_the_count_of_clauses_sees_attributes_and_line_breaks():
    source = 'class A:\n    """Of\n    which."""\n\n    a: int\n    """That of\n    b, what\n    is."""\n'
    assert [len(NO_NOUN.findall(text)) for text in docstrings(source)] == [1, 2]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_has_parameters_and_an_example(name):
    function = PUBLIC[name]
    text = inspect.getdoc(function) or ""
    for parameter, value in inspect.signature(function).parameters.items():
        assert value.kind is not value.VAR_KEYWORD or f"**{parameter}" in text
        assert parameter in text, f"{name}: nothing about {parameter}"
        assert value.annotation is not inspect.Parameter.empty
    assert "Examples\n--------" in text


COSTLY = [
    f"continuum_grasp.{name}"
    for name in (
        *("accuracy_report", "commission", "run_closed_loop", "plan", "addons.mission.check_mission"),
        "addons.learning.TorchOperators",
    )
]


@pytest.mark.parametrize("name", but(COSTLY, WITH_EXAMPLES))
def test_the_example_runs(name, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[1])
    value = EXPLAINED[name]
    for toolkit in ("jax", "torch"):
        if f">>> import {toolkit}\n" in (inspect.getdoc(value) or ""):
            pytest.importorskip(toolkit)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    for test in doctest.DocTestFinder(recurse=False).find(value, name, globs={}):
        runner.run(test)
    assert runner.summarize(verbose=False).failed == 0
