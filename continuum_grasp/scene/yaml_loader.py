"""YAML as users mean it: 1.2 numbers and booleans, no duplicate keys, and the place of every value."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from continuum_grasp.base import InputError
from continuum_grasp.scene.document import Document, KeyPath, Place, text_of

MAX_BYTES = 2_000_000
"""600 times the largest shipped configuration; a list of that size takes 3 s to read."""
MAX_ALIASES = 100
"""No configuration needs more; aliases of aliases grow without bound ("billion laughs")."""
MAX_NODES = 300_000
"""Values after aliases were followed: what a file of MAX_BYTES can hold without any."""
MAX_DEPTH = 40
"""Levels; a scene has eight, and Python's recursion ends at a thousand."""

_TAG = "tag:yaml.org,2002:"
# YAML 1.2: in 1.1, which PyYAML reads by default, "no" is false, 010 is 8, 1e3 is a text and 1:30 is 90.
_CORE_SCHEMA = (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-+0123456789."),
    ),
)


class _Loader(yaml.SafeLoader):
    """SafeLoader with the scalars of the YAML 1.2 core schema, bounded in depth and aliases."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012
    _aliases = 0
    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        mark = event.start_mark
        if isinstance(event, yaml.AliasEvent):
            self._aliases += 1
            if self._aliases > MAX_ALIASES:
                raise yaml.MarkedYAMLError(problem=f"more than {MAX_ALIASES} aliases", problem_mark=mark)
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise yaml.MarkedYAMLError(problem=f"nested deeper than {MAX_DEPTH} levels", problem_mark=mark)
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1


for _name, _pattern, _first in _CORE_SCHEMA:
    _Loader.add_implicit_resolver(f"{_TAG}{_name}", re.compile(rf"^(?:{_pattern})$"), _first)


def read_yaml(path: str | Path, *, name: str | None = None) -> Document:
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"expected the path of a file, got {path!r:.60}")
    name = name or str(path)
    return parse_yaml(text_of(path, MAX_BYTES, name), name)


def parse_yaml(text: str, name: str = "<text>") -> Document:
    """Parse YAML text; ``name`` stands for the file in errors."""
    try:
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        what = " ".join(part for part in (error.context, error.problem) if part)
        raise InputError(
            f"not valid YAML: {what}",
            file=name,
            line=mark.line + 1 if mark else None,
            column=mark.column + 1 if mark else None,
        ) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, int(error.position)) + 1
        raise InputError(f"not valid YAML: {error.reason}", file=name, line=line) from None
    if node is None:
        return Document(None, {(): Place(name, 1, 1)})
    builder = _Builder(name)
    return Document(builder.value(node, (), None, ()), builder.places)


class _Builder:
    """Turns composed nodes into plain data and notes where each came from."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.places: dict[KeyPath, Place] = {}
        self.count = 0

    def value(self, node: yaml.Node, path: KeyPath, key: yaml.Node | None, parents: tuple[yaml.Node, ...]) -> Any:
        self.count += 1
        if self.count > MAX_NODES:
            raise self.error(node, path, f"more than {MAX_NODES} values, aliases counted in full")
        # A node by identity: an alias gives the very node of its anchor.
        if any(node is parent for parent in parents):
            raise self.error(node, path, "an alias may not contain itself")
        here, above = node.start_mark, (key or node).start_mark
        self.places[path] = Place(self.name, here.line + 1, here.column + 1, above.line + 1, above.column + 1)
        if node.tag not in (f"{_TAG}map", f"{_TAG}seq") and not isinstance(node, yaml.ScalarNode):
            raise self.error(node, path, f"tags are not supported, got {node.tag!r}")
        if isinstance(node, yaml.MappingNode):
            return {
                k: self.value(child, (*path, k), key_node, (*parents, node))
                for k, key_node, child in self.entries(node, path)
            }
        if isinstance(node, yaml.SequenceNode):
            return [self.value(child, (*path, k), None, (*parents, node)) for k, child in enumerate(node.value)]
        return self.scalar(node, path)

    def entries(self, node: yaml.MappingNode, path: KeyPath) -> Iterator[tuple[str, yaml.Node, yaml.Node]]:
        lines: dict[str, int] = {}
        before: yaml.Node | None = None
        for key, child in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag != f"{_TAG}str":
                got = repr(key.value) if isinstance(key, yaml.ScalarNode) else f"a {key.id}"
                raise self.error(key, path, f"expected a word as key, got {got}{_comma_hint(before, key, child)}")
            if key.value == "<<":
                raise self.error(key, path, "merge keys (<<) are not supported; write the values out, or use extends")
            if key.value in lines:
                raise self.error(key, (*path, key.value), f"duplicate key, first given in line {lines[key.value]}")
            lines[key.value] = key.start_mark.line + 1
            before = child
            yield key.value, key, child

    def scalar(self, node: yaml.Node, path: KeyPath) -> Any:
        kind, text = node.tag.removeprefix(_TAG), str(node.value)
        if kind == "str":
            return text
        if kind == "null":
            return None
        word = text.lower()
        if kind == "bool":
            return word == "true"
        if kind not in ("int", "float"):
            raise self.error(node, path, f"tags are not supported, got {node.tag!r}")
        try:
            if kind == "int":
                base = {"0o": 8, "0x": 16}.get(text[:2], 10)
                return int(text[2:] if base != 10 else text, base)
            value = float(word.replace(".inf", "inf").replace(".nan", "nan"))
        except ValueError:
            raise self.error(node, path, f"cannot be read as {kind}: {text[:60]!r}") from None
        # Python silently rounds numbers beyond the range of doubles to infinity or zero.
        if math.isinf(value) and not word.endswith(".inf"):
            raise self.error(node, path, f"too large: expected a number up to 1.8e308, got {text[:60]}")
        if value == 0.0 and re.search("[1-9]", re.split("[eE]", text)[0]):
            raise self.error(node, path, f"too small: expected 0 or a number from 5e-324 on, got {text[:60]}")
        return value

    def error(self, node: yaml.Node, path: KeyPath, message: str) -> InputError:
        mark = node.start_mark
        return Place(self.name, mark.line + 1, mark.column + 1).error(message, path)


def _comma_hint(before: yaml.Node | None, key: yaml.Node, child: yaml.Node) -> str:
    """Advice where a decimal comma has cut a number in two: ``{length: 0,6}`` has the keys length and 6."""
    halves = [node.value if isinstance(node, yaml.ScalarNode) else "" for node in (before, key, child)]
    whole, part, value = halves
    if re.fullmatch(r"[-+]?\d+", whole) and re.fullmatch(r"\d+(?:[eE][-+]?\d+)?", part) and not value:
        return f" (write a decimal point, not a comma: {whole}.{part})"
    return ""
