"""The package in other languages: Python by ctypes, JavaScript by WebAssembly."""

from __future__ import annotations

import json
from collections.abc import Sequence

from continuum_grasp.export.codes import Code
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.header import abi_of, calls_of, structs_of
from continuum_grasp.export.part import Call, Part
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill

__all__ = ["interface", "python_binding", "wasm_files"]


def interface(subject: Subject, parts: Sequence[Part]) -> dict[str, object]:
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
    }


def python_binding(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> str:
    """A module with the structs and functions."""
    structs = [_python_struct(struct) for struct in structs_of(subject, parts)]
    parameters = "" if subject.parameters is None else ', ("parameters", Parameters)'
    structs.append(f'class Model(_Struct):\n    _fields_ = [("abi", ctypes.c_uint32){parameters}]\n\n')
    more = {
        "structs": "\n".join(structs),
        "methods": "".join(_python_method(call) for call in calls_of(parts)),
        "abi_python": abi_of(subject, parts)[:-1],
        "abi_code": str(int(Code.ERR_ABI)),
    }
    return fill("examples/python/binding.py.txt", {**words, **more})


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
    prefix, call = subject.prefix, calls_of(parts)[0]
    numbers = ", ".join("{}" if a.is_struct else repr(0.5 * a.fields[0].high) for a in call.inputs)
    bad = numbers.replace("{}", f"{{ {call.inputs[0].fields[0].name}: NaN }}", 1)
    names = [f"{prefix}_{name}" for name in ("init_abi", "strerror", "version", "abi", "configuration")]
    names += [f"{prefix}_{call.name}" for call in calls_of(parts)]
    more = {
        **words,
        "exports": " ".join(f"-Wl,--export={name}" for name in names),
        "interface": json.dumps(interface(subject, parts)),
        "first_call": call.name,
        "first_output": call.output.name,
        "first_arguments": numbers,
        "bad_arguments": bad,
    }
    return {
        "wasm/build.sh": fill("wasm/build.sh", more),
        f"wasm/{prefix}.mjs": fill("wasm/wrapper.mjs", more),
        "wasm/test.mjs": fill("wasm/test.mjs", more),
        "wasm/string.h": fill("wasm/string.h", more),
        "wasm/string.c": fill("wasm/string.c", more),
    }
