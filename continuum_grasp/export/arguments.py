"""What the user of an export may say."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from continuum_grasp.errors import InputError
from continuum_grasp.export.parts import OF_LOOPS, PARTS
from continuum_grasp.export.source import Source

__all__ = ["count_of", "parts_of", "prefix_of"]

_TAKEN = {"auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern"}
_TAKEN |= {"float", "for", "goto", "if", "inline", "int", "long", "main", "register", "restrict", "return", "short"}
_TAKEN |= {
    "signed",
    "sizeof",
    "static",
    "struct",
    "switch",
    "typedef",
    "union",
    "unsigned",
    "void",
    "volatile",
    "while",
}
"""Words that cannot be the prefix."""


def prefix_of(given: Any) -> str:
    """A prefix that C takes.

    Raises
    ------
    InputError
        If it is none.
    """
    if not isinstance(given, str) or not re.fullmatch(r"[a-z][a-z0-9_]*", given) or given in _TAKEN:
        raise InputError(
            f"expected a free C identifier of small letters, digits and underscores, got {given!r:.60}", key="prefix"
        )
    return given


def count_of(given: Any) -> int:
    """A number of sub-steps.

    Raises
    ------
    InputError
        If it is none.
    """
    if type(given) is not int or not 1 <= given <= 1000:
        raise InputError(f"expected a whole number from 1 to 1000, got {given!r:.60}", key="substeps")
    return given


def parts_of(what: Sequence[str] | None, source: Source) -> list[str]:
    """Names of the parts of a package, in their order; where nothing is said those that suit what is exported.

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
