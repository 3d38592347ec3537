"""Plain data as YAML that people read too."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import yaml

_BARE = re.compile(r"[A-Za-z][A-Za-z0-9_./+-]*( [A-Za-z0-9_./+-]+)*")
_WORDS = {"true", "false", "yes", "no", "on", "off", "null", "y", "n"}
"""Texts that YAML 1.1 reads as something else."""
_WIDTH = 110
"""Width of a line [characters]: fits terminals and the page of a report without a bar to scroll."""


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
    node.flow_style = flat and sum(len(child.value) + 2 for child in node.value) <= _WIDTH
    return node


_Dumper.add_representer(str, _text_node)
_Dumper.add_representer(list, _list_node)


def yaml_text(value: Any, *, exact: bool = False) -> str:
    """Mappings, lists, arrays, texts, numbers and None as block-style YAML 1.1, which 1.2 reads alike.

    ``exact`` keeps all digits of numbers, so that the same ones are read back; otherwise nine.
    """
    plain, width = _plain(value, exact), float("inf")
    return yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=width)


def _plain(value: Any, exact: bool) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(inner, exact) for key, inner in value.items()}
    if hasattr(value, "tolist"):  # of numpy
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(inner, exact) for inner in value]
    return float(f"{value:.9g}") if isinstance(value, float) and not exact else value
