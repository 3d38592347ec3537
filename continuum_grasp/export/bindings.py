"""The package in other languages: Python by ctypes, JavaScript by WebAssembly."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from continuum_grasp.export.codes import Code
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.header import abi_of, calls_of, kept_of, structs_of
from continuum_grasp.export.part import Call, Kept, Part
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill

__all__ = ["interface", "python_binding", "wasm_files"]


def interface(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> dict[str, object]:
    """Structs and functions as plain values: fields with their shapes, arguments with their structs."""
    return {
        "real": subject.real.name,
        "abi": int(abi_of(subject, parts)[:-1], 16),
        "structs": {s.name: [[f.name, list(f.shape)] for f in s.fields] for s in structs_of(subject, parts)},
        "functions": {
            call.name: {
                "inputs": [[a.name, a.kind.name if a.is_struct else None] for a in call.inputs],
                "output": [call.output.name, call.output.kind.name],
            }
            for call in calls_of(parts)
        },
        "kept": {
            function.types[0]: {
                "function": function.name,
                "bytes": [int(words[f"{name}_bytes"]) for name in function.types],
                "members": _members(subject, function),
                "inputs": list(function.inputs),
                "output": function.output,
            }
            for function in kept_of(parts)
        },
    }


def _members(subject: Subject, function: Kept) -> list[str]:
    """What may be changed of what a function keeps, in its order."""
    known = ["known"] if subject.loop is not None and subject.loop.known is not None else []
    return (["settings"] if function.types[0] == "controller" else []) + known


def python_binding(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> str:
    """A module with the structs and functions."""
    structs = [_python_struct(struct) for struct in structs_of(subject, parts)]
    calls, kept = calls_of(parts), kept_of(parts)
    if calls:
        parameters = "" if subject.parameters is None else ', ("parameters", Parameters)'
        structs.append(f'class Model(_Struct):\n    _fields_ = [("abi", ctypes.c_uint32){parameters}]\n\n')
    more = {
        "structs": "\n".join(structs),
        "model": _PYTHON_MODEL if calls else "",
        "methods": "".join(_python_method(call) for call in calls),
        "kept": "".join(_python_kept(subject, function, words) for function in kept),
        "use": f"print(f.tip({subject.prefix}.State(), {subject.prefix}.Input()))" if calls else "print(f)",
        "abi_python": abi_of(subject, parts)[:-1],
        "abi_code": str(int(Code.ERR_ABI)),
    }
    return fill("examples/python/binding.py.txt", {**words, **more})


_PYTHON_MODEL = """
        self.model = Model()
        \"\"\"Its parameters may be changed at any time.\"\"\"
        self.code = self._call("init_abi", ctypes.byref(self.model), ctypes.c_uint32(ABI))
        \"\"\"What the last call returned; positive codes warn.\"\"\"\
"""


def _python_kept(subject: Subject, function: Kept, words: dict[str, str]) -> str:
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
'''


def _python_struct(struct: Struct) -> str:
    fields = "\n".join(
        f'        ("{f.name}", Real{"".join(f" * {n}" for n in reversed(f.shape))}),  # [{f.unit}]'
        for f in struct.fields
    )
    head = f'class {struct.name.title()}(_Struct):\n    """{struct.text}"""\n\n'
    return f"{head}    _fields_ = [\n{fields}\n    ]\n\n"


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
    prefix, calls, kept = subject.prefix, calls_of(parts), kept_of(parts)
    names = [f"{prefix}_{name}" for name in ("strerror", "version", "abi", "configuration")]
    names += [f"{prefix}_{call.name}" for call in calls] + ([f"{prefix}_init_abi"] if calls else [])
    names += [f"{prefix}_{name}" for function in kept for name in (function.name, f"{function.types[0]}_init_abi")]
    structs = {struct.name: struct for struct in structs_of(subject, parts)}
    used = (_use_of_call(calls[0]) if calls else "") + "".join(_use_of_kept(function, structs) for function in kept)
    more = {
        **words,
        "exports": " ".join(f"-Wl,--export={name}" for name in names),
        "interface": json.dumps(interface(subject, parts, words)),
        "use": used.rstrip("\n"),
        "example": _example_of_call(calls[0]) if calls else _example_of_kept(kept[-1]),
    }
    found = {f"wasm/{name}": fill(f"wasm/{name}", more) for name in _WASM}
    return {**found, f"wasm/{prefix}.mjs": fill("wasm/wrapper.mjs", more)}


_WASM = ("build.sh", "test.mjs", "string.h", "string.c", "vectors.c")


def _arguments(call: Call) -> str:
    return ", ".join("{}" if a.is_struct else repr(0.5 * a.fields[0].high) for a in call.inputs)


def _example_of_call(call: Call) -> str:
    return f"const {{ code, {call.output.name} }} = finger.{call.name}({_arguments(call)});"


def _example_of_kept(function: Kept) -> str:
    owner = function.types[0]
    given = ", ".join(function.inputs)
    return f"const {owner} = finger.new_{owner}();\n//   const {{ code, {function.output} }} = {owner}.step({given});"


def _use_of_call(call: Call) -> str:
    bad = _arguments(call).replace("{}", f"{{ {call.inputs[0].fields[0].name}: NaN }}", 1)
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


def _allowed(struct: Struct) -> str:
    """An object whose numbers are in their ranges: zero where that is."""
    ends = [f"{f.name}: {f.low if f.low > 0.0 else f.high!r}" for f in struct.fields if f.low > 0.0 or f.high < 0.0]
    return f"{{ {', '.join(ends)} }}"


def _use_of_kept(function: Kept, structs: Mapping[str, Struct]) -> str:
    owner = function.types[0]
    given = ", ".join(_allowed(structs[name]) for name in function.inputs)
    return f"""\
const {owner} = finger.new_{owner}();
const {function.output} = {owner}.step({given});
if ({function.output}.code < 0) ++failed;
console.log(JSON.stringify({function.output}));
"""
