"""Contents that a model allows: keys, choices and descriptions, looked up in its JSON Schema."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache, cached_property, reduce
from typing import Any

from pydantic import BaseModel

from continuum_grasp.scene.document import KeyPath, child
from continuum_grasp.scene.units import Unit

_Node = dict[str, Any]
_CLAUSE = re.compile(r"(?<=\])[:;]|[.;](?=\s|$)")
"""End of the first clause of a description: after a unit, or of a sentence."""


class Shape:
    """Answers questions about a model from its JSON Schema, following the data into the branch it chose."""

    def __init__(self, model: type[BaseModel]) -> None:
        self._model = model

    @cached_property
    def _root(self) -> _Node:
        return _schema(self._model)

    @cached_property
    def discriminators(self) -> tuple[str, ...]:
        """Names of the keys that select a branch of a union."""
        return tuple(set(re.findall(r'"propertyName": "(\w+)"', json.dumps(self._root))))

    def keys(self, path: KeyPath, data: Any) -> list[str]:
        """The keys that a mapping at ``path`` may have."""
        return list(dict.fromkeys(key for node in self._at(path, data) for key in node.get("properties", {})))

    def model_keys(self, name: str) -> list[str]:
        node = self._root if self._root.get("title") == name else self._root.get("$defs", {}).get(name, {})
        return list(node.get("properties", {}))

    def choices(self, path: KeyPath, data: Any) -> list[str]:
        """The words allowed at ``path``."""
        words = (word for node in self._at(path, data) for word in [*node.get("enum", []), node.get("const")])
        return [word for word in dict.fromkeys(words) if isinstance(word, str)]

    def tags(self, path: KeyPath, data: Any) -> list[str]:
        """The branches of a tagged union at ``path``."""
        nodes = self._follow(path, data)
        tags = (tag for node in nodes for tag in node.get("discriminator", {}).get("mapping", {}))
        return list(dict.fromkeys(tags))

    def description(self, path: KeyPath, data: Any) -> str:
        """The first clause of the description of the key at ``path``, in lower case at its start."""
        for node in self._follow(path, data):
            text = _CLAUSE.split(" ".join(str(node.get("description", "")).split()), maxsplit=1)[0]
            if text:
                return text if text[1:2].isupper() else text[0].lower() + text[1:]
        return ""

    def unit(self, path: KeyPath, data: Any) -> str | None:
        """The SI unit of the number at ``path``, which may stand at the list or mapping around it."""
        for end in range(len(path), 0, -1):
            nodes = [alternative for node in self._follow(path[:end], data) for alternative in alternatives(node)]
            units = {node["unit"] for node in nodes if "unit" in node}
            if units:
                return units.pop() if len(units) == 1 else None
        return None

    def in_si(self, path: KeyPath, value: Any, data: Any = None) -> Any:
        """Return the value for ``path`` with texts that have a unit converted to SI numbers; other texts stay."""
        if isinstance(value, dict):
            return {key: self.in_si((*path, key), entry, data) for key, entry in value.items()}
        if isinstance(value, list | tuple):
            return [self.in_si((*path, k), entry, data) for k, entry in enumerate(value)]
        return Unit(self.unit(path, data)).read(value) if isinstance(value, str) else value

    def size(self, path: KeyPath, data: Any) -> int | None:
        """Return the number of entries of a list at ``path``; None if it is not fixed."""
        for node in self._at(path, data):
            if node.get("type") == "array" and node.get("minItems") == node.get("maxItems") is not None:
                return int(node["minItems"])
        return None

    def _at(self, path: KeyPath, data: Any) -> list[_Node]:
        value = reduce(child, path, data)
        return [node for start in self._follow(path, data) for node in self._branches(start, value)]

    def _follow(self, path: KeyPath, data: Any) -> list[_Node]:
        nodes, value = [self._root], data
        for part in path:
            nodes = [child for node in nodes for b in self._branches(node, value) for child in _children(b, part)]
            value = child(value, part)
        return nodes

    def _branches(self, node: _Node, value: Any) -> Iterator[_Node]:
        if "$ref" in node:
            yield from self._branches(self._root["$defs"][node["$ref"].rpartition("/")[2]], value)
            return
        # The data's tag selects one branch; without it all may have been meant.
        tag = node.get("discriminator", {})
        word = child(value, tag["propertyName"]) if "propertyName" in tag else None
        if isinstance(word, str) and word in tag.get("mapping", {}):
            yield from self._branches({"$ref": tag["mapping"][word]}, value)
            return
        inner = [*node.get("anyOf", []), *node.get("oneOf", []), *node.get("allOf", [])]
        for branch in inner:
            yield from self._branches(branch, value)
        if not inner:
            yield node


@cache
def _schema(model: type[BaseModel]) -> _Node:
    """JSON Schema of a model; the schema of a closed loop takes 0.5 s, and a sweep asks for it several times."""
    return model.model_json_schema()


def _children(node: _Node, part: str | int) -> Iterator[_Node]:
    if isinstance(part, str):
        if part in node.get("properties", {}):
            yield node["properties"][part]
        elif isinstance(node.get("additionalProperties"), dict):
            yield node["additionalProperties"]
    elif part < len(node.get("prefixItems", [])):
        yield node["prefixItems"][part]
    elif isinstance(node.get("items"), dict):
        yield node["items"]


def alternatives(node: _Node) -> Iterator[_Node]:
    """A node, and the nodes that it is a choice of, near to far."""
    yield node
    for branch in [*node.get("anyOf", []), *node.get("oneOf", [])]:
        yield from alternatives(branch)
