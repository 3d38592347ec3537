"""Units of variables as exponents of base units."""

from __future__ import annotations

import re

_BASE = {
    "m": {"m": 1},
    "kg": {"kg": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Hz": {"s": -1},
    "1": {},
}
_TOKEN = re.compile(r"\s*(\(|\)(\d*)|/|([A-Za-z]+|1)(\d*))")


def base_unit(unit: str) -> dict[str, int] | None:
    """Exponents by base unit of a unit as labels write it, like ``N m2`` or ``1/(rad/s)2``; None where it is none.

    Factors stand side by side; a stroke divides by the one factor, or parenthesis, behind it: ``N m2`` is
    ``{"kg": 1, "m": 3, "s": -2}``.
    """
    found, at = _product(unit, 0)
    return None if found is None or at != len(unit) else {name: power for name, power in found.items() if power}


def _product(unit: str, at: int) -> tuple[dict[str, int] | None, int]:
    """Exponents of the factors up to the end or a closing parenthesis, and where that is."""
    found: dict[str, int] = {}
    sign, empty = 1, True
    while match := _TOKEN.match(unit, at):
        word, at = match[1], match.end()
        if word.startswith(")"):
            return (None if empty else found), match.start()
        if word == "/":
            sign = -1
            continue
        inner: dict[str, int] | None
        if word == "(":
            inner, at = _product(unit, at)
            closing = _TOKEN.match(unit, at)
            if inner is None or closing is None or not closing[1].startswith(")"):
                return None, at
            power, at = int(closing[2] or 1), closing.end()
        else:
            inner, power = _BASE.get(match[3]), int(match[4] or 1)
        if inner is None:
            return None, at
        for name, exponent in inner.items():
            found[name] = found.get(name, 0) + sign * power * exponent
        sign, empty = 1, False
    return (None if empty else found), at
