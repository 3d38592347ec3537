"""JSON Schema of the configurations, for editors and for what errors say: keys, choices and descriptions."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from functools import cached_property
from typing import Any

from pydantic import BaseModel

from continuum_grasp.scene.document import KeyPath
from continuum_grasp.scene.load import model_of

__all__ = ["KINDS", "Shape", "json_schema", "schema_text"]


KINDS = ("simulate", "identify", "grasp", "mpc", "mission", "plan", "sweep", "finger")

_Node = dict[str, Any]
_SUFFIX = "Changes"
_GRASP = {"type": "string", "description": "Path of a grasp file, relative to this file."}


def json_schema(kind: str) -> _Node:
    """JSON Schema of one kind of configuration file.

    Parameters
    ----------
    kind : str
        ``simulate``, ``identify``, ``grasp``, ``mpc``, ``mission``, ``plan``, ``sweep`` or ``finger``.

    Returns
    -------
    dict
        The schema of what `load` accepts: of the model, and where a finger may stand also the path of a
        finger file, or changes to one (``extends``).

    Raises
    ------
    InputError
        Where there is no such kind.
    """
    schema = model_of(kind).model_json_schema()
    definitions = schema.setdefault("$defs", {})
    if kind == "finger":
        schema["properties"] = {
            "schema_version": {"const": 1, "description": "Format of this file."},
            "extends": {
                "type": "string",
                "description": "Path of another finger file that this one changes.",
            },
            **schema["properties"],
        }
        schema["required"] = ["schema_version"]
        schema["anyOf"] = [{"required": ["rod"]}, {"required": ["extends"]}]
    elif kind != "sweep":
        if "GraspScene" in definitions:  # in a mission or plan
            _take_files(definitions["GraspScene"], "GraspFinger", definitions)
            grasp = schema["properties"]["grasp"]
            grasp["anyOf"] = [_GRASP, *(grasp.get("anyOf") or [{"$ref": grasp.pop("$ref")}])]
        if "finger" in schema["properties"]:
            _take_files(schema, "GraspFinger" if kind == "grasp" else "Finger", definitions)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": f"continuum_grasp {kind} configuration",
    }


def schema_text(kind: str) -> str:
    """The schema as the text of its file."""
    return json.dumps(json_schema(kind), indent=1, ensure_ascii=False) + "\n"


def _take_files(scene: _Node, own: str, definitions: _Node) -> None:
    """Let a scene name finger files where fingers may stand."""
    changes = _changes(own, definitions)
    definitions[changes]["properties"] = {
        "extends": {"type": "string", "description": "Path of a finger file, relative to this file."},
        **definitions[changes]["properties"],
    }
    definitions[changes]["required"] = ["extends"]
    finger = {
        "description": "The finger itself, the path of a finger file, or changes to one (extends).",
        "anyOf": [
            {"type": "string", "description": "Path of a finger file, relative to this file."},
            {"$ref": f"#/$defs/{own}"},
            {"$ref": f"#/$defs/{changes}"},
        ],
    }
    scene["properties"]["finger"] = finger
    if own == "GraspFinger":
        many = scene["properties"]["fingers"]
        many.pop("anyOf"), many.pop("default", None)
        many |= {"type": "object", "minProperties": 1, "maxProperties": 4, "additionalProperties": finger}


def _changes(name: str, definitions: _Node) -> str:
    """Define a copy of a mapping, and of the mappings in it, that requires nothing; the name of the copy."""
    new = name + _SUFFIX
    if new not in definitions:
        definitions[new] = node = copy.deepcopy(definitions[name])
        node.pop("required", None)
        node["title"] = new
        node["properties"] = {key: _optional(child, definitions) for key, child in node["properties"].items()}
    return new


def _optional(node: Any, definitions: _Node) -> Any:
    """The same with each mapping replaced by its changes; lists stay, since they are replaced whole."""
    if isinstance(node, list):
        return [_optional(child, definitions) for child in node]
    if not isinstance(node, dict) or node.get("type") == "array":
        return node
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        if "properties" in definitions[name]:
            return {**node, "$ref": f"#/$defs/{_changes(name, definitions)}"}
        return node
    return {key: _optional(child, definitions) if key in {"anyOf", "allOf"} else child for key, child in node.items()}


class Shape:
    """Answers questions about a model from its JSON Schema, following the data into the branch it chose."""

    def __init__(self, model: type[BaseModel]) -> None:
        self._model = model

    @cached_property
    def _root(self) -> _Node:
        return self._model.model_json_schema()

    @cached_property
    def discriminators(self) -> tuple[str, ...]:
        """Names of the keys that select a branch of a union."""
        found: dict[str, None] = {}

        def search(node: Any) -> None:
            if isinstance(node, dict):
                tag = node.get("discriminator")
                if isinstance(tag, dict) and "propertyName" in tag:
                    found[tag["propertyName"]] = None
                for child in node.values():
                    search(child)
            elif isinstance(node, list):
                for child in node:
                    search(child)

        search(self._root)
        return tuple(found)

    def keys(self, path: KeyPath, data: Any) -> list[str]:
        """The keys that a mapping at ``path`` may have."""
        return list(dict.fromkeys(key for node in self._at(path, data) for key in node.get("properties", {})))

    def model_keys(self, name: str) -> list[str]:
        """The keys of the model of that class name."""
        node = self._root if self._root.get("title") == name else self._root.get("$defs", {}).get(name, {})
        return list(node.get("properties", {}))

    def choices(self, path: KeyPath, data: Any) -> list[str]:
        """The words allowed at ``path``."""
        found = (word for node in self._at(path, data) for word in [*node.get("enum", []), node.get("const")])
        return [word for word in dict.fromkeys(found) if isinstance(word, str)]

    def tags(self, path: KeyPath, data: Any) -> list[str]:
        """The branches of a tagged union at ``path``."""
        nodes = self._follow(path, data)
        found = (tag for node in nodes for tag in node.get("discriminator", {}).get("mapping", {}))
        return list(dict.fromkeys(found))

    def description(self, path: KeyPath, data: Any) -> str:
        """The first line of what is written about the key at ``path``, in lower case at its start."""
        for node in self._follow(path, data):
            text = str(node.get("description", "")).strip().split("\n")[0].rstrip(".")
            if text:
                return text if text[1:2].isupper() else text[0].lower() + text[1:]
        return ""

    def size(self, path: KeyPath, data: Any) -> int | None:
        """How many entries a list at ``path`` must have, where that is fixed."""
        for node in self._at(path, data):
            if node.get("type") == "array" and node.get("minItems") == node.get("maxItems") is not None:
                return int(node["minItems"])
        return None

    def _at(self, path: KeyPath, data: Any) -> list[_Node]:
        value = data
        for part in path:
            value = _child(value, part)
        return [node for start in self._follow(path, data) for node in self._branches(start, value)]

    def _follow(self, path: KeyPath, data: Any) -> list[_Node]:
        nodes, value = [self._root], data
        for part in path:
            nodes = [child for node in nodes for b in self._branches(node, value) for child in _children(b, part)]
            value = _child(value, part)
        return nodes

    def _branches(self, node: _Node, value: Any) -> Iterator[_Node]:
        if "$ref" in node:
            yield from self._branches(self._root["$defs"][node["$ref"].rpartition("/")[2]], value)
            return
        tag = node.get("discriminator", {})
        word = _child(value, tag["propertyName"]) if "propertyName" in tag else None
        if isinstance(word, str) and word in tag.get("mapping", {}):
            yield from self._branches({"$ref": tag["mapping"][word]}, value)
            return
        inner = [*node.get("anyOf", []), *node.get("oneOf", []), *node.get("allOf", [])]
        for branch in inner:
            yield from self._branches(branch, value)
        if not inner:
            yield node


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


def _child(value: Any, part: str | int) -> Any:
    if isinstance(value, dict):
        return value.get(part)
    if isinstance(value, list) and isinstance(part, int) and part < len(value):
        return value[part]
    return None
