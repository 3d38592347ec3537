"""The package in other languages: Python by ctypes, JavaScript by WebAssembly."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

from continuum_grasp.export.control.loop import DIAGNOSIS
from continuum_grasp.export.control.source import ANOMALIES
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.layer import calls_of, stateful_of, structs_of
from continuum_grasp.export.part import SECONDS, Call, Method, Part, Stateful
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill


def interface(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> dict[str, object]:
    """Structs and functions as plain values: fields with their shapes and types, arguments with their structs."""
    structs = {s.name: [[f.name, list(f.shape), "real"] for f in s.fields] for s in structs_of(subject, parts)}
    if any(function.types[0] == "controller" for function in stateful_of(parts)):
        structs["diagnosis"] = [[name, [], kind] for kind, name, _ in DIAGNOSIS]
    return {
        "real": subject.real.name,
        "abi": int(words["abi"][:-1], 16),
        "configuration": words["hash"],
        "structs": structs,
        "begun": [name for name in _BEGUN if name in structs and stateful_of(parts)],
        "open": _OPEN,
        "functions": {
            call.name: {
                "inputs": [[a.name, a.kind.name if a.is_struct else None] for a in call.inputs],
                "output": [call.output.name, call.output.kind.name],
            }
            for call in calls_of(parts)
        },
        "stateful": {
            function.types[0]: {
                "function": function.name,
                "bytes": [int(words[f"{name}_bytes"]) for name in function.types],
                "members": _members(subject, function),
                "inputs": list(function.inputs),
                "output": function.output,
                "methods": {
                    m.name: {"inputs": list(m.inputs), "output": m.output, "counts": m.counts} for m in function.methods
                },
            }
            for function in stateful_of(parts)
        },
    }


_BEGUN = ("measurement", "reference", "command")
"""Structs with a function that fills them with what they begin with."""
_OPEN = ("measurement", "reference")
"""Structs of which a part may be given; the rest is as they begin: not measured, as the scene wants it."""


def _beginnings(subject: Subject) -> dict[str, dict[str, object]]:
    """What structs of a closed loop begin with; those that are not here with zeros."""
    loop = subject.loop
    if loop is None:
        return {}
    return {
        "measurement": {field.name: math.nan for field in loop.measurement.fields},
        "reference": {
            field.name: [float(value)] * field.size
            for field, value in zip(loop.reference.fields, loop.wanted, strict=True)
        },
        "command": {field.name: float(value) for field, value in zip(loop.command.fields, loop.before, strict=True)},
    }


def _members(subject: Subject, function: Stateful) -> list[str]:
    """What may be changed of what a function keeps, in its order."""
    known = ["known"] if subject.loop is not None and subject.loop.known is not None else []
    return (["settings"] if function.types[0] == "controller" else []) + known


def python_binding(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> str:
    """A module with the structs and functions."""
    calls, stateful = calls_of(parts), stateful_of(parts)
    begun = _beginnings(subject) if stateful else {}
    structs = [_python_struct(struct, begun.get(struct.name)) for struct in structs_of(subject, parts)]
    if any(function.types[0] == "controller" for function in stateful):
        structs.append(_PYTHON_DIAGNOSIS)
    if calls:
        parameters = "" if subject.parameters is None else ', ("parameters", Parameters)'
        structs.append(f'class Model(_Struct):\n    _fields_ = [("abi", ctypes.c_uint32){parameters}]\n\n')
    more = {
        "structs": "\n".join(structs),
        "model": _PYTHON_MODEL if calls else "",
        "methods": "".join(_python_method(call) for call in calls),
        "stateful": "".join(_python_stateful(subject, function, words) for function in stateful),
        "use": f"print(f.tip({subject.prefix}.State(), {subject.prefix}.Input()))" if calls else "print(f)",
        "abi_python": words["abi"][:-1],
        "anomalies": "\n".join(
            ["ANOMALIES = {", *(f'    {2**k}: "{text}",' for k, text in enumerate(ANOMALIES.values())), "}", ""]
        )
        if stateful
        else "",
    }
    return fill("examples/python/binding.py.txt", {**words, **more})


_PYTHON_KINDS = {"uint32_t": "ctypes.c_uint32", "int": "ctypes.c_int", "real": "Real"}
_PYTHON_MODEL = """
        self.model = Model()
        \"\"\"Its parameters may be changed at any time.\"\"\"
        self.code = self._call("init_abi", ctypes.byref(self.model), ctypes.c_uint32(ABI))
        \"\"\"What the last call returned; positive codes warn.\"\"\"\
"""


def _python_stateful(subject: Subject, function: Stateful, words: dict[str, str]) -> str:
    owner, work = function.types
    members = "".join(f'\n    ("{name}", {name.title()}),' for name in _members(subject, function))
    given = ", ".join(f"{name}: {name.title()}" for name in function.inputs)
    passed = ", ".join(f"ctypes.byref({name})" for name in function.inputs)
    kind = function.output.title()
    return f'''

class _{owner.title()}Head(_Struct):
    _fields_ = [
        ("abi", ctypes.c_uint32),{members.replace("(", "    (")}
    ]


class {owner.title()}:
    """{function.text} ``head`` has what may be changed; ``code`` is what the last call returned."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._memory = ctypes.create_string_buffer({words[f"{owner}_bytes"]})
        self._work = ctypes.create_string_buffer({words[f"{work}_bytes"]})
        self.head = _{owner.title()}Head.from_buffer(self._memory)
        self.code = library._call("{owner}_init_abi", self._memory, ctypes.c_uint32(ABI))

    def step(self, {given}) -> {kind}:
        """One call."""
        output = {kind}()
        arguments = (self._memory, self._work, {passed}, ctypes.byref(output))
        self.code = self._library._call("{function.name}", *arguments)
        return output
{"".join(_python_further(subject.prefix, owner, method) for method in function.methods)}'''


def _python_further(prefix: str, owner: str, method: Method) -> str:
    name = f"{owner}_{method.name}"
    if method.counts:
        return f'''
    def {method.name}(self) -> int:
        """{method.text}"""
        return self._library._c.{prefix}_{name}(self._memory) & 0xFFFFFFFF
'''
    kinds = [kind.title() for kind in method.inputs]
    given = "".join(f", {argument}: {kind}" for argument, kind in zip(("state", "before"), kinds, strict=False))
    if len(kinds) == 1:
        given = f", {method.name}: {kinds[0]}"
    names = [method.name] if len(kinds) == 1 else ["state", "before"][: len(kinds)]
    passed = ", ".join([f'"{name}"', "self._memory", *(f"ctypes.byref({n})" for n in names)])
    if method.inputs == (SECONDS,):
        given, passed = f", {SECONDS}: float", f'"{name}", self._memory, Real({SECONDS})'
    if method.output is None:
        return f'''
    def {method.name}(self{given}) -> None:
        """{method.text}"""
        self._library._call({passed})
'''
    kind = method.output.title()
    return f'''
    def {method.name}(self{given}) -> {kind}:
        """{method.text}"""
        output = {kind}()
        self._library._call({passed}, ctypes.byref(output))
        return output
'''


_PYTHON_DIAGNOSIS = (
    'class Diagnosis(_Struct):\n    """What is known of the last call of a controller."""\n\n    _fields_ = [\n'
    + "".join(f'        ("{name}", {_PYTHON_KINDS[kind]}),  # {text}\n' for kind, name, text in DIAGNOSIS)
    + "    ]\n\n"
)


def _python_struct(struct: Struct, begin: Mapping[str, object] | None) -> str:
    fields = "\n".join(
        f'        ("{f.name}", Real{"".join(f" * {n}" for n in reversed(f.shape))}),  # [{f.unit}]'
        for f in struct.fields
    )
    head = f'class {struct.name.title()}(_Struct):\n    """{struct.text}"""\n\n'
    more = ""
    if begin is not None:
        values = ", ".join(f'"{name}": {_python_number(value)}' for name, value in begin.items())
        more = f"    _begin_ = {{{values}}}\n"
    more += "    _open_ = True\n" if struct.name in _OPEN and begin is not None else ""
    return f"{head}    _fields_ = [\n{fields}\n    ]\n{more}\n"


def _python_number(value: object) -> str:
    return repr(value).replace("nan", "float('nan')")


def _python_method(call: Call) -> str:
    names = [f"{a.name}: {a.kind.name.title() if a.is_struct else 'float'}" for a in call.inputs]
    passed = [f"ctypes.byref({a.name})" if a.is_struct else f"Real({a.name})" for a in call.inputs]
    kind = call.output.kind.name.title()
    arguments = ", ".join([f'"{call.name}"', "ctypes.byref(self.model)", *passed, "ctypes.byref(output)"])
    return f'''
    def {call.name}(self, {", ".join(names)}) -> {kind}:
        """{call.text}"""
        output = {kind}()
        self.code = self._call({arguments})
        return output
'''


def wasm_files(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> dict[str, str]:
    """Script, wrapper and test for WebAssembly, by path."""
    prefix, calls, stateful = subject.prefix, calls_of(parts), stateful_of(parts)
    names = [f"{prefix}_{name}" for name in ("strerror", "version", "abi", "configuration")]
    begun = [name for name in _BEGUN if stateful and name in {s.name for s in structs_of(subject, parts)}]
    names += [f"{prefix}_{name}_init_abi" for name in begun]
    names += [f"{prefix}_{function.types[0]}_{method.name}" for function in stateful for method in function.methods]
    names += [f"{prefix}_{call.name}" for call in calls] + ([f"{prefix}_init_abi"] if calls else [])
    names += [f"{prefix}_{name}" for function in stateful for name in (function.name, f"{function.types[0]}_init_abi")]
    used = (_use_of_call(calls[0]) if calls else "") + "".join(_use_of_stateful(function) for function in stateful)
    more = {
        **words,
        "exports": " ".join(f"-Wl,--export={name}" for name in names),
        "interface": json.dumps(interface(subject, parts, words)),
        "use": used.rstrip("\n"),
        "example": _example_of_call(calls[0]) if calls else _example_of_stateful(stateful[-1]),
    }
    found = {f"wasm/{name}": fill(f"wasm/{name}", more) for name in _WASM}
    return {**found, f"wasm/{prefix}.mjs": fill("wasm/wrapper.mjs", more)}


_WASM = ("build.sh", "test.mjs", "string.h", "string.c", "vectors.c")


def _arguments(call: Call) -> str:
    return ", ".join("{}" if a.is_struct else repr(0.5 * a.fields[0].high) for a in call.inputs)


def _example_of_call(call: Call) -> str:
    return f"const {{ code, {call.output.name} }} = finger.{call.name}({_arguments(call)});"


def _example_of_stateful(function: Stateful) -> str:
    owner = function.types[0]
    given = ", ".join(function.inputs)
    return f"const {owner} = finger.new_{owner}();\n//   const {{ code, {function.output} }} = {owner}.step({given});"


def _use_of_call(call: Call) -> str:
    first = call.inputs[0]
    spoilt = f'{{ ...finger.begin("{first.kind.name}"), {first.fields[0].name}: NaN }}' if first.is_struct else "NaN"
    bad = _arguments(call).replace("{}", spoilt, 1)
    return f"""\
const answer = finger.{call.name}({_arguments(call)});
if (answer.code < 0 || !Object.values(answer.{call.output.name}).flat(Infinity).every(Number.isFinite)) ++failed;
try {{
  finger.{call.name}({bad});
  ++failed;
}} catch (error) {{
  if (!(error instanceof FingerError)) throw error;
}}
console.log(JSON.stringify(answer));
"""


def _use_of_stateful(function: Stateful) -> str:
    owner = function.types[0]
    return f"""\
const {owner} = finger.new_{owner}();
const {function.output} = {owner}.step();
if ({function.output}.code < 0) ++failed;
console.log(JSON.stringify({function.output}));
"""
