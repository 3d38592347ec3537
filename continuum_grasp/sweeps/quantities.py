"""Rows of the table: the numbers of a grasp, and the line of text that tells whether it is whole."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

from continuum_grasp.errors import InputError

_TAIL = len(b',"check":"00000000"}\n')


def encode(row: Mapping[str, Any]) -> bytes:
    """A row as a line of JSON that ends with the CRC-32 of what stands before it."""
    text = json.dumps(row, separators=(",", ":"), ensure_ascii=True, allow_nan=False).encode("ascii")
    return b'%s,"check":"%08x"}\n' % (text[:-1], zlib.crc32(text))


def decode(line: bytes) -> dict[str, Any] | None:
    """The row of a line; None where the line is torn or damaged."""
    body, tail = line[:-_TAIL] + b"}", line[-_TAIL:]
    if tail != b',"check":"%08x"}\n' % zlib.crc32(body):
        return None
    try:
        row = json.loads(body)
    except ValueError:
        return None
    return row if isinstance(row, dict) else None


def number(value: Any) -> float | int | str | None:
    """A value as it may stand in a row: None for nothing, NaN and infinity."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, int):
        return int(value)
    found = float(value)
    if not math.isfinite(found):
        return None
    return int(found) if hasattr(value, "dtype") and value.dtype.kind in "iub" else found


SOLVED = ("optimal", "feasible")
"""Statuses that mean a verified grasp."""


def quantities(result: Any, record: Sequence[str]) -> dict[str, Any]:
    """Numbers of a result by column; None where there is no grasp to have them.

    Parameters
    ----------
    result : GraspResult
    record : sequence of str
        Further columns, such as ``quality.epsilon_l1``.

    Raises
    ------
    InputError
        A grasp has no number of a name in ``record``.
    """
    solved = str(result.status) in SOLVED
    reason = result.reasons[0] if result.reasons else None
    found: dict[str, Any] = dict.fromkeys(("tension_sum", "tension_max", "normal_force_max", "friction_margin"))
    contacts = result.contacts if solved else ()
    if solved:
        tensions = [float(t) for finger in result.fingers.values() for t in finger.tensions]
        found |= {"tension_sum": sum(tensions), "tension_max": max(tensions, default=None)}
        found["normal_force_max"] = max((c.normal_force for c in contacts), default=None)
        found["friction_margin"] = min((c.friction_margin for c in contacts), default=None)
    found["contacts"] = len(contacts) if solved else None
    found["iterations"] = result.statistics.get("iterations")
    found["reason_limit"] = None if reason is None else reason.limit
    found["reason_needed"] = None if reason is None else reason.needed
    for name in record:
        found[name] = _recorded(result, name, solved)
    return {name: number(value) for name, value in found.items()}


def _quality(result: Any) -> Any:
    from continuum_grasp.grasp import GraspResult

    if isinstance(result, GraspResult):
        return result.quality if result.solved else None
    return result.quality


def _recorded(result: Any, name: str, solved: bool) -> Any:
    root, *parts = name.split(".")
    value = _quality(result) if root == "quality" else getattr(result, root)
    for part in parts:
        if value is None:
            return None
        known = part in value if isinstance(value, Mapping) else hasattr(value, part)
        if not known:
            if not solved:
                return None
            there = value if isinstance(value, Mapping) else [n for n in dir(value) if not n.startswith("_")]
            raise InputError(f"a grasp has no number of this name; {part!r} is none of {', '.join(there)}", key=name)
        value = value[part] if isinstance(value, Mapping) else getattr(value, part)
    if value is None or isinstance(value, str | int | float) or getattr(value, "ndim", 1) == 0:
        return value
    raise InputError(f"not one number, but {type(value).__name__}", key=name)
