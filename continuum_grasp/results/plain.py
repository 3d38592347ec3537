"""From Python values to plain JSON, the same text for the same value."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping
from datetime import date
from enum import Enum
from typing import Any

import numpy as np

from continuum_grasp.errors import InputError


def plain(value: Any, key: str = "") -> Any:
    """A value in the types that JSON has.

    Numpy numbers and arrays become numbers and lists, validated models and mappings become objects, paths,
    dates and enumerations become strings. JSON has no NaN and no infinity: they become the strings ``"NaN"``,
    ``"Infinity"`` and ``"-Infinity"``, which ``float`` reads back. Errors name ``key``, the dotted path of the value.
    """
    kind = type(value)
    if value is None or kind is str or kind is bool or kind is int:  # nearly all, and quickly
        return value
    if kind is float:
        return _number(value)
    if kind is dict:
        return {_name(k, key): plain(v, f"{key}.{k}" if key else k) for k, v in value.items()}
    if isinstance(value, Enum):
        return plain(value.value, key)
    if isinstance(value, str):
        return str(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, (float, np.floating)):
        return _number(float(value))
    if isinstance(value, np.ndarray):
        return plain(value.tolist(), key)
    if hasattr(value, "model_dump"):
        return plain(value.model_dump(mode="python"), key)
    if isinstance(value, Mapping):
        return {_name(k, key): plain(v, f"{key}.{k}" if key else str(k)) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v, f"{key}[{i}]") for i, v in enumerate(value)]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, date):
        return value.isoformat()
    raise InputError(f"expected a value that JSON can hold, got {type(value).__name__}", key=key or None)


def digest(value: Any) -> str:
    """SHA-256 (64 hexadecimal digits) of a value's plain form, equal whatever the order of its keys."""
    text = json.dumps(plain(value), sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _number(value: float) -> float | str:
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return value


def _name(name: Any, key: str) -> str:
    if not isinstance(name, str):
        raise InputError(f"expected a string as key, got {name!r}", key=key or None)
    return name
