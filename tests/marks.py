"""Cases that are left to ``-m deep`` (``tests/tiers.py``), and packages that are imported late."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import pytest

ROUNDING = pytest.mark.xfail(
    reason="whether the search of a few elements converges depends on the rounding of the processor", strict=False
)


def few(cases: Iterable[Any], count: int) -> list[Any]:
    """The first ``count`` cases as they are, the others marked deep; a tuple is a value per name."""
    every = list(cases)
    return [*every[:count], *(_deep(case) for case in every[count:])]


def every(stride: int, cases: Iterable[Any]) -> list[Any]:
    """Each ``stride``-th case as it is, the others marked deep."""
    return [case if k % stride == 0 else _deep(case) for k, case in enumerate(cases)]


def but(costly: Iterable[Any], cases: Iterable[Any]) -> list[Any]:
    """The cases as they are, but for the costly ones, which are marked deep."""
    known, every = list(costly), list(cases)
    assert all(case in every for case in known), f"not all of {known} are cases of this sweep"
    return [_deep(case) if case in known else case for case in every]


def _deep(case: Any) -> Any:
    if hasattr(case, "marks"):  # one of pytest.param
        return pytest.param(*case.values, marks=[*case.marks, pytest.mark.deep])
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.deep)


def optional(name: str) -> Any:
    """Import a package when a test first uses it, not when tests are collected; skip the module where it is missing."""
    if find_spec(name.partition(".")[0]) is None:
        pytest.skip(f"needs {name}", allow_module_level=True)
    return _Late(name)


class _Late:
    """A module that is imported when an attribute of it is first asked for."""

    def __init__(self, name: str) -> None:
        self.__name__ = name

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("_"):  # pytest looks for its marks in all that a module holds
            raise AttributeError(attribute)
        return getattr(import_module(self.__name__), attribute)
