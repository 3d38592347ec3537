"""The package in other languages: Python by ctypes, JavaScript by WebAssembly."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

from continuum_grasp.export.control.loop import DIAGNOSIS
from continuum_grasp.export.control.source import ANOMALIES
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.layer import Contents
from continuum_grasp.export.part import SECONDS, Call, Method, Stateful
from continuum_grasp.export.subject import Subject

_BEGUN = ("state", "measurement", "reference", "command")
"""Structs with a function that fills them with what they begin with."""
_OPEN = ("measurement", "reference")
"""Structs of which a part may be given; the rest is as they begin: not measured, as the scene wants it."""


def _begun(contents: Contents) -> list[str]:
    names = {struct.name for struct in contents.structs if contents.stateful} - {"state"}
    if contents.calls and contents.subject.touching is not None:
        names.add("state")
    return [name for name in _BEGUN if name in names]


def _has_diagnosis(contents: Contents) -> bool:
    return any(function.types[0] == "controller" for function in contents.stateful)


def _interface(contents: Contents) -> dict[str, object]:
    """Structs and functions as plain values: fields with their shapes and types, arguments with their structs."""
    words = contents.words
    structs = {s.name: [[f.name, list(f.shape), "real"] for f in s.fields] for s in contents.structs}
    if _has_diagnosis(contents):
        structs["diagnosis"] = [[name, [], kind] for kind, name, _ in DIAGNOSIS]
    return {
        "real": contents.subject.real.name,
        "abi": int(words["abi"][:-1], 16),
        "configuration": words["hash"],
        "structs": structs,
        "begun": _begun(contents),
        "open": _OPEN,
        "functions": {
            call.name: {
                "inputs": [[a.name, a.kind.name if a.is_struct else None] for a in call.inputs],
                "output": [call.output.name, call.output.kind.name],
            }
            for call in contents.calls
        },
        "stateful": {
            function.types[0]: {
                "function": function.name,
                "bytes": [int(words[f"{name}_bytes"]) for name in function.types],
                "members": _members(contents.subject, function),
                "inputs": list(function.inputs),
                "output": function.output,
                "methods": {
                    m.name: {"inputs": list(m.inputs), "output": m.output, "counts": m.counts} for m in function.methods
                },
            }
            for function in contents.stateful
        },
    }


def _beginnings(subject: Subject) -> dict[str, dict[str, object]]:
    """What structs of a closed loop begin with; those that are not here with zeros."""
    found: dict[str, dict[str, object]] = {}
    if subject.touching is not None:
        found["state"] = dict(zip((field.name for field in subject.state.fields), subject.start, strict=True))
    loop = subject.loop
    if loop is None:
        return found
    wanted = zip(loop.reference.fields, loop.wanted, strict=True)
    return found | {
        "measurement": {field.name: math.nan for field in loop.measurement.fields},
        "reference": {field.name: [float(value)] * field.size for field, value in wanted},
        "command": {field.name: float(value) for field, value in zip(loop.command.fields, loop.before, strict=True)},
    }


def _members(subject: Subject, function: Stateful) -> list[str]:
    """What may be changed of what a function keeps, in its order."""
    known = ["known"] if subject.loop is not None and subject.loop.known is not None else []
    return (["settings"] if function.types[0] == "controller" else []) + known


def python_binding(contents: Contents) -> str:
    """A module with the structs and functions."""
    subject, calls, stateful = contents.subject, contents.calls, contents.stateful
    begun = _beginnings(subject)
    return contents.fill(
        "examples/python/binding.py.txt",
        calls=calls,
        replayed=not calls,
        stateful_count=len(stateful),
        controlled=_has_diagnosis(contents),
        structs="\n".join(
            _python_struct(struct, begun.get(struct.name) if struct.name in _begun(contents) else None)
            for struct in contents.structs
        ),
        diagnosis="".join(f'        ("{name}", {_PYTHON_KINDS[kind]}),  # {text}\n' for kind, name, text in DIAGNOSIS),
        parameters="" if subject.parameters is None else ', ("parameters", Parameters)',
        methods="".join(_python_call(call) for call in calls),
        stateful="".join(_python_stateful(contents, function) for function in stateful),
        abi_python=contents.words["abi"][:-1],
        anomalies="".join(f'    {2**k}: "{text}",\n' for k, text in enumerate(ANOMALIES.values())),
    )


_NAN = "float('nan')"
_PYTHON_KINDS = {"uint32_t": "ctypes.c_uint32", "int": "ctypes.c_int", "real": "Real"}


def _python_stateful(contents: Contents, function: Stateful) -> str:
    owner, work = function.types
    members = _members(contents.subject, function)
    return contents.fill(
        "examples/python/stateful.py.txt",
        owner=owner,
        Owner=owner.title(),
        members="".join(f'\n        ("{name}", {name.title()}),' for name in members),
        text=function.text,
        function=function.name,
        memory_bytes=contents.words[f"{owner}_bytes"],
        work_bytes=contents.words[f"{work}_bytes"],
        given=", ".join(f"{name}: {name.title()}" for name in function.inputs),
        passed=", ".join(f"ctypes.byref({name})" for name in function.inputs),
        Output=function.output.title(),
        methods="".join(_python_further(contents.subject.prefix, owner, method) for method in function.methods),
    )


def _python_method(name: str, given: Sequence[str], kind: str, text: str, *lines: str) -> str:
    head = f"    def {name}({', '.join(['self', *given])}) -> {kind}:"
    return "\n".join(["", head, f'        """{text}"""', *(f"        {line}" for line in lines), ""])


def _python_call(call: Call) -> str:
    given = [f"{a.name}: {a.kind.name.title() if a.is_struct else 'float'}" for a in call.inputs]
    passed = [f"ctypes.byref({a.name})" if a.is_struct else f"Real({a.name})" for a in call.inputs]
    kind = call.output.kind.name.title()
    arguments = ", ".join([f'"{call.name}"', "ctypes.byref(self.model)", *passed, "ctypes.byref(output)"])
    lines = f"output = {kind}()", f"self.code = self._call({arguments})", "return output"
    return _python_method(call.name, given, kind, call.text, *lines)


def _python_further(prefix: str, owner: str, method: Method) -> str:
    full = f"{owner}_{method.name}"
    if method.counts:  # ctypes reads an int; bits of anomalies are unsigned
        count = f"return self._library._c.{prefix}_{full}(self._memory) & 0xFFFFFFFF"
        return _python_method(method.name, (), "int", method.text, count)
    if method.inputs == (SECONDS,):
        given, passed = [f"{SECONDS}: float"], [f"Real({SECONDS})"]
    else:
        names = [method.name] if len(method.inputs) == 1 else ["state", "before"][: len(method.inputs)]
        given = [f"{name}: {kind.title()}" for name, kind in zip(names, method.inputs, strict=True)]
        passed = [f"ctypes.byref({name})" for name in names]
    arguments = ", ".join([f'"{full}"', "self._memory", *passed])
    if method.output is None:
        return _python_method(method.name, given, "None", method.text, f"self._library._call({arguments})")
    kind = method.output.title()
    lines = f"output = {kind}()", f"self._library._call({arguments}, ctypes.byref(output))", "return output"
    return _python_method(method.name, given, kind, method.text, *lines)


def _python_struct(struct: Struct, begin: Mapping[str, object] | None) -> str:
    fields = "\n".join(
        # C's array of arrays is written from the inside out in ctypes.
        f'        ("{f.name}", Real{"".join(f" * {n}" for n in reversed(f.shape))}),  # [{f.unit}]'
        for f in struct.fields
    )
    more = ""
    if begin is not None:
        values = ", ".join(f'"{name}": {repr(value).replace("nan", _NAN)}' for name, value in begin.items())
        more = f"    _begin_ = {{{values}}}\n"
        more += "    _open_ = True\n" if struct.name in _OPEN else ""
    head = f'class {struct.name.title()}(_Struct):\n    """{struct.text}"""\n\n'
    return f"{head}    _fields_ = [\n{fields}\n    ]\n{more}\n"


def wasm_exports(contents: Contents) -> list[str]:
    """Functions that a module exports."""
    calls, stateful = contents.calls, contents.stateful
    names = ["strerror", "version", "abi", "configuration", *(f"{name}_init_abi" for name in _begun(contents))]
    names += [f"{function.types[0]}_{method.name}" for function in stateful for method in function.methods]
    names += [call.name for call in calls] + (["init_abi"] if calls else [])
    names += [name for function in stateful for name in (function.name, f"{function.types[0]}_init_abi")]
    described = any(part.describes is not None for part in contents.parts)
    names += ["fields", *(f"field_{of}" for of in _DESCRIBED)] if described else []
    return [f"{contents.subject.prefix}_{name}" for name in names]


def wasm_files(contents: Contents) -> dict[str, str]:
    """Script, wrapper and test for WebAssembly, by path."""
    prefix, calls, stateful = contents.subject.prefix, contents.calls, contents.stateful
    used = [_use_of_call(contents, call) for call in calls[:1]]
    used += [contents.fill("wasm/use_stateful.mjs", owner=f.types[0], output=f.output) for f in stateful]
    if calls:
        example = f"const {{ code, {calls[0].output.name} }} = finger.{calls[0].name}({_arguments(calls[0])});"
    else:
        last, owner = stateful[-1], stateful[-1].types[0]
        example = f"const {owner} = finger.new_{owner}();\n//   const {{ code, {last.output} }} = {owner}.step("
        example += f"{', '.join(last.inputs)});"
    more = {
        "exports": " ".join(f"-Wl,--export={name}" for name in wasm_exports(contents)),
        "interface": json.dumps(_interface(contents)),
        "use": "".join(used).rstrip("\n"),
        "example": example,
    }
    found = {f"wasm/{name}": contents.fill(f"wasm/{name}", **more) for name in _WASM}
    return {**found, f"wasm/{prefix}.mjs": contents.fill("wasm/wrapper.mjs", **more)}


_DESCRIBED = ("struct", "name", "unit", "size", "low", "high")
"""What is known of a field at run time, of the part ``metadata``."""
_WASM = ("build.sh", "test.mjs", "string.h", "string.c", "vectors.c")


def _arguments(call: Call) -> str:
    return ", ".join("{}" if a.is_struct else repr(0.5 * a.fields[0].high) for a in call.inputs)


def _use_of_call(contents: Contents, call: Call) -> str:
    first, given = call.inputs[0], _arguments(call)
    spoilt = f'{{ ...finger.begin("{first.kind.name}"), {first.fields[0].name}: NaN }}' if first.is_struct else "NaN"
    words = {"name": call.name, "given": given, "bad": given.replace("{}", spoilt, 1), "output": call.output.name}
    return contents.fill("wasm/use_call.mjs", **words)
