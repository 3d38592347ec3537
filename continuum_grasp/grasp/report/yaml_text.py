"""Plain data as YAML text."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

__all__ = ["yaml_text"]

_BARE = re.compile(r"[A-Za-z][A-Za-z0-9_./+-]*( [A-Za-z0-9_./+-]+)*")
_WORDS = {"true", "false", "yes", "no", "on", "off", "null", "y", "n"}
_WIDTH = 110
"""Of a line [characters]: fits terminals and the page of a report without a bar to scroll."""


def yaml_text(value: Any, *, exact: bool = False) -> str:
    """Mappings, lists, texts, numbers and None as block-style YAML 1.1, which 1.2 reads alike.

    Parameters
    ----------
    value : dict, list, ndarray, str, float, int, bool or None
        What to write.
    exact : bool, optional
        Keep all digits of numbers, so that the same ones are read back; otherwise nine.

    Returns
    -------
    str
        Ends in a line break.
    """
    value = _plain(value, exact)
    return ("\n".join(_lines(value)) if isinstance(value, (dict, list)) and value else _scalar(value)) + "\n"


def _plain(value: Any, exact: bool) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(inner, exact) for key, inner in value.items()}
    if hasattr(value, "tolist"):  # of numpy
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(inner, exact) for inner in value]
    return float(f"{value:.9g}") if isinstance(value, float) and not exact else value


def _lines(value: Any) -> list[str]:
    found = []
    if isinstance(value, dict):
        for key, inner in value.items():
            name = _text(str(key))
            if _nested(inner):
                indent = "  " if isinstance(inner, dict) else ""
                found += [f"{name}:", *(indent + line for line in _lines(inner))]
            else:
                found.append(f"{name}: {_flat(inner)}")
        return found
    for inner in value:
        if _nested(inner):
            first, *rest = _lines(inner)
            found += [f"- {first}", *(f"  {line}" for line in rest)]
        else:
            found.append(f"- {_flat(inner)}")
    return found


def _nested(value: Any) -> bool:
    """Whether a value takes lines of its own."""
    if not isinstance(value, (dict, list)) or not value:
        return False
    if isinstance(value, dict):
        return True
    return any(isinstance(v, (Mapping, list, tuple, str)) for v in value) or len(_flat(value)) > _WIDTH


def _flat(value: Any) -> str:
    if isinstance(value, dict):
        return "{}"
    if isinstance(value, list):
        return "[" + ", ".join(_scalar(v) for v in value) + "]"
    return _scalar(value)


def _scalar(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, (dict, list)):
        return _flat(value)
    return _text(str(value))


def _number(value: float) -> str:
    if not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    digits, exponent, power = repr(value).partition("e")
    if "." not in digits:  # 1e-06 would be a text in YAML 1.1
        digits += ".0"
    return digits + exponent + power


def _text(value: str) -> str:
    if _BARE.fullmatch(value) and value.lower() not in _WORDS:
        return value
    quoted = json.dumps(value, ensure_ascii=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in quoted)
