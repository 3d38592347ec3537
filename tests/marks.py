"""Cases that ``python3 start.py test`` leaves to ``python3 start.py test -m slow``; ``.ci/run`` does both."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def few(cases: Iterable[Any], count: int) -> list[Any]:
    """The first ``count`` cases as they are, the others marked slow."""
    every = list(cases)
    rest = (case if isinstance(case, tuple) else (case,) for case in every[count:])
    return [*every[:count], *(pytest.param(*case, marks=pytest.mark.slow) for case in rest)]
