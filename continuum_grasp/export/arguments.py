"""What the user of an export may say."""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Sequence
from typing import Any

from continuum_grasp.errors import InputError
from continuum_grasp.export.parts import OF_LOOPS, PARTS
from continuum_grasp.export.source import Source
from continuum_grasp.export.stability import MOST_SUBSTEPS

__all__ = ["count_of", "parts_of", "positive", "prefix_of"]

_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long main register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
"""
"""Of C."""
_HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math pthread setjmp signal stdarg stdbool stddef
stdint stdio stdlib string tgmath time wchar wctype
"""
"""Of its library, and of the system: a header of that name would be found in their place."""
_LIBRARIES = "c gcc m rt dl"
"""That are linked by such names."""
_TARGETS = "all clean help install package test"
"""Of CMake."""
_OWN = "accept check read run vectors write"
"""First words of other names in a package, and its further headers."""
_TAKEN = {*keyword.kwlist, *" ".join((_WORDS, _HEADERS, _LIBRARIES, _TARGETS, _OWN)).split()}
"""Words that cannot be the prefix."""


def prefix_of(given: Any) -> str:
    """A prefix that C takes.

    Raises
    ------
    InputError
        If it is none.
    """
    if not isinstance(given, str) or not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", given) or given in _TAKEN:
        raise InputError(
            "expected a free C identifier of small letters, digits and single underscores between them, that is no "
            f"word, header, library or target of C, Python or CMake, got {given!r:.60}",
            key="prefix",
        )
    return given


def count_of(given: Any) -> int:
    """A number of sub-steps.

    Raises
    ------
    InputError
        If it is none.
    """
    if type(given) is not int or not 1 <= given <= MOST_SUBSTEPS:
        raise InputError(f"expected a whole number from 1 to {MOST_SUBSTEPS}, got {given!r:.60}", key="substeps")
    return given


def positive(given: float | None, key: str) -> float | None:
    """A number above zero, or None.

    Raises
    ------
    InputError
        If it is none.
    """
    if given is not None and not (isinstance(given, (int, float)) and 0.0 < given < math.inf):
        raise InputError(f"expected a number above zero, got {given!r:.60}", key=key)
    return given


def parts_of(what: Sequence[str] | None, source: Source) -> list[str]:
    """Names of the parts of a package, in their order; by default those that suit what is exported.

    Raises
    ------
    InputError
        If they are none.
    """
    if what is None:
        loop = source.loop
        without = () if loop is None or loop.estimator is not None else ("estimator",)
        what = [name for name in PARTS if (name in OF_LOOPS) == (loop is not None) and name not in without]
    names = [what] if isinstance(what, str) else list(what)
    for name in names:
        if name not in PARTS:
            raise InputError(f"expected some of {', '.join(PARTS)}, got {name!r:.60}", key="what")
    if not names or len(set(names)) < len(names):
        raise InputError(f"expected one part or more, each once, got {names}", key="what")
    return [name for name in PARTS if name in names]
