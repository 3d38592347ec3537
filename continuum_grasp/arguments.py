"""Arguments of public functions that are no arrays, checked: the value itself, or an `InputError` that names it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any

from continuum_grasp.errors import InputError


def choice(key: str, value: Any, allowed: Iterable[Any]) -> Any:
    """One of some words or numbers."""
    known = tuple(allowed)
    # Not by ``in``: what compares to an array, as some foreign types do, has no truth.
    if isinstance(value, str | int) and any(value is one or value == one for one in known):
        return value
    raise InputError(f"expected one of {', '.join(map(str, known))}, got {value!r:.60}", key=key)


def whole(key: str, value: Any, least: int = 1) -> int:
    """A whole number, 1 or more where no other least one is given."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise InputError(f"expected a whole number, {least} or more, got {value!r:.60}", key=key)
    return int(value)


def positive(key: str, value: Any) -> float:
    """A finite number above zero."""
    number = _double(value)
    if not 0.0 < number < math.inf:
        raise InputError(f"expected a finite number above 0, got {value!r:.60}", key=key)
    return number


def within(key: str, value: Any, least: float, most: float) -> float:
    """A number of a range, ends included."""
    number = _double(value)
    if not least <= number <= most:
        raise InputError(f"expected a number from {least:g} to {most:g}, got {value!r:.60}", key=key)
    return number


def instance(key: str, value: Any, *kinds: type) -> Any:
    """An object of one of some classes."""
    if not isinstance(value, kinds):
        raise InputError(f"expected {_words(kinds)}, got {value!r:.60}", key=key)
    return value


def _words(kinds: tuple[type, ...]) -> str:
    return " or ".join(f"{'an' if kind.__name__[0] in 'AEIOU' else 'a'} {kind.__name__}" for kind in kinds)


def _double(value: Any) -> float:
    """A number in double precision; NaN for what is none."""
    try:
        return float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:  # a whole number beyond the doubles
        return math.inf if value > 0 else -math.inf
