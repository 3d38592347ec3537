"""Values as plain JSON, the same text for the same value, and as YAML that people read too."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Callable, Mapping
from datetime import date
from enum import Enum
from typing import Any

import numpy as np
import yaml

from continuum_grasp.base import InputError


def _json_number(value: float) -> float | str:
    if math.isfinite(value):
        return value
    if math.isnan(value):
        return "NaN"
    if value > 0:
        return "Infinity"
    return "-Infinity"


def plain(value: Any, key: str = "", number: Callable[[float], Any] = _json_number) -> Any:
    """A value in the types that JSON has.

    Numpy numbers and arrays become numbers and lists, validated models and mappings become objects, paths,
    dates and enumerations become strings. JSON has no NaN and no infinity: they become the strings ``"NaN"``,
    ``"Infinity"`` and ``"-Infinity"``, which ``float`` reads back, unless ``number`` turns floats into something else.
    Errors name ``key``, the dotted path of the value.
    """
    kind = type(value)
    if value is None or kind is str or kind is bool or kind is int:  # nearly all, and quickly
        return value
    if kind is float:
        return number(value)
    if kind is dict or isinstance(value, Mapping):
        return {_name(k, key): plain(v, f"{key}.{k}" if key else str(k), number) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v, f"{key}[{i}]", number) for i, v in enumerate(value)]
    if isinstance(value, Enum):
        return plain(value.value, key, number)
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist(), key, number)
    for base in (str, int, float):
        if isinstance(value, base):
            return plain(base(value), key, number)
    if hasattr(value, "model_dump"):
        return plain(value.model_dump(mode="python"), key, number)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, date):
        return value.isoformat()
    raise InputError(f"expected a value that JSON can hold, got {type(value).__name__}", key=key or None)


def digest(value: Any) -> str:
    """SHA-256 (64 hexadecimal digits) of a value's plain form, equal whatever the order of its keys."""
    text = json.dumps(plain(value), sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _name(name: Any, key: str) -> str:
    if not isinstance(name, str):
        raise InputError(f"expected a string as key, got {name!r}", key=key or None)
    return name


_BARE = re.compile(r"[A-Za-z][A-Za-z0-9_./+-]*( [A-Za-z0-9_./+-]+)*")
_WORDS = {"true", "false", "yes", "no", "on", "off", "null", "y", "n"}
"""Texts that YAML 1.1 reads as something else."""


class _Dumper(yaml.SafeDumper):
    """Texts bare or in double quotes, and lists of numbers in one line where they fit."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write everything out, where two values are the same object too."""
        return True


def _text_node(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    bare = _BARE.fullmatch(text) and text.lower() not in _WORDS
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if bare else '"')


def _list_node(dumper: yaml.SafeDumper, values: list[Any]) -> yaml.Node:
    node = dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=True)
    flat = not any(isinstance(value, (dict, list, str)) for value in values)
    # 110: width of a line [characters]: fits terminals and the page of a report without a bar to scroll
    node.flow_style = flat and sum(len(child.value) + 2 for child in node.value) <= 110
    return node


_Dumper.add_representer(str, _text_node)
_Dumper.add_representer(list, _list_node)


def _nine_digits(value: float) -> float:
    return float(f"{value:.9g}")


def yaml_text(value: Any, *, exact: bool = False) -> str:
    """Mappings, lists, arrays, texts, numbers and None as block-style YAML 1.1, which 1.2 reads alike.

    ``exact`` keeps all digits of numbers, so that the same ones are read back; otherwise nine.
    """
    written = plain(value, number=float if exact else _nine_digits)
    return yaml.dump(written, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=float("inf"))
