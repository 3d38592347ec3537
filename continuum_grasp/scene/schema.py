"""JSON Schema of the configurations, for editors."""

from __future__ import annotations

import copy
import json
from typing import Any

from continuum_grasp.base import InputError
from continuum_grasp.scene.assembly import VERSION
from continuum_grasp.scene.config_kinds import kinds
from continuum_grasp.scene.shape import alternatives
from continuum_grasp.scene.units import QUANTITIES, to_si

DEFINITIONS = "definitions.json"
"""File of the definitions that the schemas of all kinds share."""

_Node = dict[str, Any]
_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_SUFFIX = "Changes"
_VERSION_KEY = {"const": VERSION, "description": "Format of this file."}
_GRASP = {"type": "string", "description": "Path of a grasp file, relative to this file."}


def json_schema(kind: str) -> _Node:
    """JSON Schema of one kind of configuration file."""
    if kind not in kinds():
        raise InputError(f"no such kind of configuration: expected one of {', '.join(kinds())}, got {kind!r}")
    schema: _Node = kinds()[kind].scene_class.model_json_schema()
    definitions = schema.setdefault("$defs", {})
    for node in (schema, *definitions.values()):
        for key in node.get("properties", {}).values():
            _give_examples(key)
    if kind == "finger":
        schema["properties"] = {
            "schema_version": _VERSION_KEY,
            "extends": {
                "type": "string",
                "description": "Path of another finger file that this one changes.",
            },
            **schema["properties"],
        }
        schema["required"] = []
        # A finger that changes another one needs no rod of its own.
        schema["anyOf"] = [{"required": ["rod"]}, {"required": ["extends"]}]
    elif kinds()[kind].names_files:
        if "GraspScene" in definitions:  # in a mission or plan
            _take_files(definitions["GraspScene"], "GraspFinger", definitions)
            grasp = schema["properties"]["grasp"]
            grasp["anyOf"] = [_GRASP, *(grasp.get("anyOf") or [{"$ref": grasp.pop("$ref")}])]
        if "finger" in schema["properties"]:
            _take_files(schema, "GraspFinger" if kind == "grasp" else "Finger", definitions)
    # Only files need it, not values from Python.
    schema["properties"]["schema_version"] = _VERSION_KEY
    schema["required"].insert(0, "schema_version")
    return {
        "$schema": _DIALECT,
        **schema,
        "title": f"continuum_grasp {kind} configuration",
    }


def schema_text(schema: _Node) -> str:
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def schema_files() -> dict[str, str]:
    """Texts of a folder of schemas by name: one file per kind, and one of the definitions that they share."""
    shared = dict[str, _Node]()
    files = dict[str, str]()
    for kind in kinds():
        schema = json_schema(kind)
        shared |= schema.pop("$defs")
        files[f"{kind}.json"] = schema_text(schema).replace('"#/$defs/', f'"{DEFINITIONS}#/$defs/')
    return {**files, DEFINITIONS: schema_text({"$schema": _DIALECT, "$defs": dict(sorted(shared.items()))})}


def _give_examples(key: _Node) -> None:
    """Add the example of its quantity to a key for one number with a unit, unless the key has an example."""
    nodes = list(alternatives(key))
    units = [node["unit"] for node in nodes if node.get("unit") in QUANTITIES]
    if units and any("number" in node.get("type", ()) for node in nodes) and not any("examples" in n for n in nodes):
        example = QUANTITIES[units[0]].example
        key["examples"] = [to_si(example, units[0]), example]


def _take_files(scene: _Node, kind: str, definitions: _Node) -> None:
    """Let a scene name finger files where fingers may stand."""
    changes = _changes(kind, definitions)
    definitions[changes]["properties"] = {
        "extends": {"type": "string", "description": "Path of a finger file, relative to this file."},
        **definitions[changes]["properties"],
    }
    definitions[changes]["required"] = ["extends"]
    finger = {
        "description": "The finger itself, the path of a finger file, or changes to one (extends).",
        "anyOf": [
            {"type": "string", "description": "Path of a finger file, relative to this file."},
            {"$ref": f"#/$defs/{kind}"},
            {"$ref": f"#/$defs/{changes}"},
        ],
    }
    scene["properties"]["finger"] = finger
    if kind == "GraspFinger":
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
    """A schema with each mapping replaced by its changes; lists stay, since they are replaced whole."""
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
