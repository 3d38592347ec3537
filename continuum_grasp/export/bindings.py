"""The package in other languages: Python by ctypes, JavaScript by WebAssembly."""

from __future__ import annotations

import json
import math
from pprint import pformat

from continuum_grasp.control import ControlParts
from continuum_grasp.export.control.source import ANOMALIES
from continuum_grasp.export.layer import Contents
from continuum_grasp.export.part import Call, Stateful
from continuum_grasp.export.subject import Subject

_OPEN = ("measurement", "reference")
"""Structs that may be given in part; the rest is as they begin: not measured, as the scene wants it."""


def _interface(contents: Contents) -> dict[str, object]:
    """Structs and functions as plain values: fields with shapes, types and units, arguments with their structs."""
    words = contents.words
    structs = {s.name: [[f.name, list(f.shape), "real", f.unit] for f in s.fields] for s in contents.structs}
    if any(function.types[0] == "controller" for function in contents.stateful):
        structs["diagnosis"] = [[number.exported, [], number.kind, number.text] for number in ControlParts.diagnosis]
    functions = dict[str, object]()
    stateful = dict[str, object]()
    for call in contents.calls:
        functions[call.name] = {
            "text": call.text,
            "inputs": [[a.name, a.kind.name if a.is_struct else None] for a in call.inputs],
            "output": [call.output.name, call.output.kind.name],
        }
    for function in contents.stateful:
        stateful[function.types[0]] = {
            "text": function.text,
            "function": function.name,
            "bytes": [int(words[f"{name}_bytes"]) for name in function.types],
            "members": _members(contents.subject, function),
            "inputs": list(function.inputs),
            "output": function.output,
            "methods": {m.name: {"text": m.text, "inputs": m.inputs, "output": m.output} for m in function.methods},
        }
    return {
        "real": contents.subject.real.name,
        "abi": int(words["abi"][:-1], 16),
        "configuration": words["hash"],
        "structs": structs,
        "begun": _beginnings(contents),
        "open": list(_OPEN),
        "functions": functions,
        "stateful": stateful,
    }


def _beginnings(contents: Contents) -> dict[str, dict[str, object]]:
    """First values of structs that have a function to fill them; others begin with zeros."""
    subject = contents.subject
    loop = contents.subject.loop
    beginnings = dict[str, dict[str, object]]()
    if contents.calls and subject.touching is not None:
        beginnings["state"] = {**subject.state.named(subject.start)}
    if loop is not None and contents.stateful:
        defaults: dict[str, dict[str, object]] = {
            "measurement": {field.name: math.nan for field in loop.measurement.fields},
            "reference": {name: [value] * loop.nodes for name, value in loop.reference.named(loop.wanted).items()},
            "command": {**loop.command.named(loop.before)},
        }
        beginnings |= {struct.name: defaults[struct.name] for struct in contents.structs if struct.name in defaults}
    return beginnings


def _members(subject: Subject, function: Stateful) -> list[str]:
    """Members of a function's memory that may be changed, in order."""
    if function.types[0] == "mission":
        return []
    known = ["known"] if subject.loop is not None and subject.loop.known is not None else []
    return (["settings"] if function.types[0] == "controller" else []) + known


def python_binding(contents: Contents) -> str:
    """A module with the structs and functions."""
    return contents.fill(
        "examples/python/binding.py.txt",
        interface=pformat(_interface(contents), width=118, compact=True, sort_dicts=False),
        anomalies=[(2**k, text) for k, text in enumerate(ANOMALIES.values())],
    )


def wasm_exports(contents: Contents) -> list[str]:
    """Functions that a module exports."""
    calls, stateful = contents.calls, contents.stateful
    names = ["strerror", "version", "abi", "configuration", *(f"{name}_init_abi" for name in _beginnings(contents))]
    names += [f"{function.types[0]}_{method.name}" for function in stateful for method in function.methods]
    names += [call.name for call in calls] + (["init_abi"] if calls else [])
    names += [name for function in stateful for name in (function.name, f"{function.types[0]}_init_abi")]
    return [f"{contents.subject.prefix}_{name}" for name in names]


def wasm_files(contents: Contents) -> dict[str, str]:
    """Script, wrapper and test for WebAssembly, by path."""
    prefix = contents.subject.prefix
    calls = contents.calls
    stateful = contents.stateful
    used = [_use_of_call(contents, call) for call in calls[:1]]
    used += [contents.fill("wasm/use_stateful.mjs", owner=f.types[0], output=f.output) for f in stateful]
    if calls:
        example = f"const {{ code, {calls[0].output.name} }} = finger.{calls[0].name}({_arguments(calls[0])});"
    else:
        last = stateful[-1]
        owner = stateful[-1].types[0]
        example = f"const {owner} = finger.new_{owner}();\n//   const {{ code, {last.output} }} = {owner}.step("
        example += f"{', '.join(last.inputs)});"
    more = {
        "exports": wasm_exports(contents),
        "interface": json.dumps(_interface(contents) | {"begun": list(_beginnings(contents))}),
        "use": "".join(used).rstrip("\n"),
        "example": example,
    }
    files = {f"wasm/{name}": contents.fill(f"wasm/{name}", **more) for name in _WASM}
    return {**files, f"wasm/{prefix}.mjs": contents.fill("wasm/wrapper.mjs", **more)}


_WASM = ("build.sh", "test.mjs", "string.h", "string.c", "vectors.c")


def _arguments(call: Call) -> str:
    return ", ".join("{}" if a.is_struct else repr(0.5 * a.fields[0].high) for a in call.inputs)


def _use_of_call(contents: Contents, call: Call) -> str:
    first = call.inputs[0]
    arguments = _arguments(call)
    spoilt = f'{{ ...finger.begin("{first.kind.name}"), {first.fields[0].name}: NaN }}' if first.is_struct else "NaN"
    words = {
        "name": call.name,
        "given": arguments,
        "bad": arguments.replace("{}", spoilt, 1),
        "output": call.output.name,
    }
    return contents.fill("wasm/use_call.mjs", **words)
