"""One row of the table as one line of text that tells whether it is whole."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping
from typing import Any

__all__ = ["decode", "encode", "number"]

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
