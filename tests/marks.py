"""Cases that ``python3 start.py test`` leaves to ``python3 start.py test -m slow``; ``.ci/run`` does both."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def few(cases: Iterable[Any], count: int) -> list[Any]:
    """The first ``count`` cases as they are, the others marked slow; a tuple is a value per name."""
    every = list(cases)
    return [*every[:count], *(_slow(case) for case in every[count:])]


def _slow(case: Any) -> Any:
    if hasattr(case, "marks"):  # one of pytest.param
        return pytest.param(*case.values, marks=[*case.marks, pytest.mark.slow])
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
