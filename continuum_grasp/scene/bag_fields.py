"""Fields of messages of ROS 2, as the library for bags decodes them, by paths such as ``position.x`` or ``data[0]``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any

_PART = re.compile(r"\w+|\[\d+\]")


def parts_of(path: str) -> tuple[str | int, ...]:
    return tuple(int(part[1:-1]) if part.startswith("[") else part for part in _PART.findall(path))


def joined(parts: Sequence[str | int]) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")


def leaves(message: Any) -> Iterator[str]:
    """Fields of a message that are no messages themselves; lists by their first entry."""
    for name in type(message).__slots__:
        value = getattr(message, name)
        if isinstance(value, SimpleNamespace):
            yield from (f"{name}.{leaf}" for leaf in leaves(value))
        elif isinstance(value, (str, int, float)):
            yield name
        elif len(value) and isinstance(value[0], SimpleNamespace):
            yield from (f"{name}[0].{leaf}" for leaf in leaves(value[0]))
        else:
            yield f"{name}[0]"


def value_of(message: Any, parts: Sequence[str | int]) -> Any:
    """Value of a field; None beyond the end of a list."""
    for part in parts:
        if isinstance(part, int):
            if part >= len(message):
                return None
            message = message[part]
        else:
            message = getattr(message, part)
    return message


def is_number(message: Any, parts: Sequence[str | int]) -> bool:
    return "[" not in joined(parts) and isinstance(value_of(message, parts), (int, float))


def cell_of(message: Any, parts: Sequence[str | int]) -> str:
    """Text of a field that reads back as the same number."""
    value = value_of(message, parts)
    if isinstance(value, bool):
        return str(int(value))
    return "" if value is None else repr(value) if isinstance(value, float) else str(value).strip()
