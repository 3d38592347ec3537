"""The public header, from structs, functions and codes."""

from __future__ import annotations

import hashlib
import textwrap
from collections.abc import Mapping, Sequence

from continuum_grasp import __version__
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.part import Call, Code, Part, Stateful
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill, filled

__all__ = ["abi_of", "calls_of", "codes_of_package", "header", "prototype", "stateful_of", "structs_of"]

_LINE = 118
"""Characters of a line in the header, which is as wide as the sources of this package."""


def structs_of(subject: Subject, parts: Sequence[Part]) -> list[Struct]:
    """Structs of a package, each once, those of the model first."""
    found = {subject.parameters.name: subject.parameters} if subject.parameters and calls_of(parts) else {}
    for part in parts:
        for struct in part.structs:
            found.setdefault(struct.name, struct)
    return list(found.values())


def calls_of(parts: Sequence[Part]) -> list[Call]:
    """Public functions of a package that take the model."""
    return [call for part in parts for call in part.calls]


def stateful_of(parts: Sequence[Part]) -> list[Stateful]:
    """Public functions of a package that keep something."""
    return [function for part in parts for function in part.stateful]


def codes_of_package(parts: Sequence[Part]) -> list[Code]:
    """Codes that some function of a package may return."""
    common = {Code.OK, Code.ERR_NULL, Code.ERR_NON_FINITE, Code.ERR_RANGE, Code.ERR_RESULT, Code.ERR_ABI}
    common.add(Code.ERR_CONFIGURATION)
    used = common.union(*(call.codes for call in calls_of(parts)), *(part.codes for part in parts))
    return sorted(used, key=lambda code: (code < 0, abs(code)))


def prototype(call: Call, prefix: str) -> str:
    """C declaration of a public function, without the semicolon."""
    arguments = [f"const {prefix}_model *model"]
    for argument in call.inputs:
        if argument.is_struct:
            arguments.append(f"const {prefix}_{argument.kind.name} *{argument.name}")
        else:
            arguments.append(f"{prefix}_real {argument.name}")
    arguments.append(f"{prefix}_{call.output.kind.name} *{call.output.name}")
    head, lines = f"int {prefix}_{call.name}(", [""]
    mark = len(f"{prefix.upper()}_API ")
    for k, declared in enumerate(arguments):
        text = declared + (", " if k < len(arguments) - 1 else ")")
        if mark + len(head) + len(lines[-1]) + len(text) > _LINE:
            lines.append("")
        lines[-1] += text
    return head + f"\n{' ' * (mark + len(head))}".join(line.rstrip() for line in lines)


def abi_of(subject: Subject, parts: Sequence[Part], words: Mapping[str, str]) -> str:
    """Number of the interface as C; another one where anything of its headers differs but title, version and hash.

    Sizes of memory, which are known once it was compiled, follow from its types.
    """
    same = {name: "" for name in words if name.endswith("_bytes")} | dict.fromkeys(
        ("abi", "hash", "title", "version"), ""
    )
    texts = [header(subject, parts, {**words, **same})]
    texts += [text for part in parts for path, text in part.sources.items() if path.startswith("include/")]
    return "0x" + hashlib.sha256("\n".join(texts).replace(__version__, "").encode()).hexdigest()[:8] + "u"


def header(subject: Subject, parts: Sequence[Part], words: Mapping[str, str]) -> str:
    """The header."""
    prefix, big = subject.prefix, subject.prefix.upper()
    dimensions = {
        "N": subject.n,
        "NX": subject.nx,
        "NU": subject.model.nu,
        "NW": subject.model.nw,
        "NP": subject.model.np,
    }
    notes = {
        "N": "bending coordinates",
        "NX": "states",
        "NU": "inputs",
        "NW": "force components",
        "NP": "run-time parameters",
    }
    modeled = bool(calls_of(parts))
    lines = [f"#define {big}_{name} {size} /* {notes[name]} */" for name, size in dimensions.items() if modeled]
    constants = {name: value for part in parts for name, value in part.constants.items()}
    lines += [f"#define {big}_{name} {value}" for name, value in constants.items()]
    codes = codes_of_package(parts)
    width = max(len(code.name) for code in codes)
    commas = [","] * (len(codes) - 1) + [" "]
    table = "\n".join(
        f"  {big}_{code.name:<{width}} = {int(code):2d}{comma} /* {code.text} */"
        for code, comma in zip(codes, commas, strict=True)
    )
    more = {
        "dimensions": "\n".join(lines),
        "codes": table,
        "structs": "\n".join(struct.declaration(prefix) for struct in structs_of(subject, parts)),
        "use": fill("use_model.h", words) if modeled else _use_of_stateful(stateful_of(parts)[-1], words),
        "model": fill("model.h", {**words, "model_parameters": _parameters_member(subject)}) if modeled else "",
        "functions": "\n".join(
            [
                *(_documented(call, prefix) for call in calls_of(parts)),
                *(filled(part.declarations, words) for part in parts if part.declarations),
            ]
        ),
    }
    return fill("header.h", {**words, **more})


def _use_of_stateful(function: Stateful, words: Mapping[str, str]) -> str:
    return fill("use_loop.h", {**words, "owner": function.types[0], "step": function.name})


def _parameters_member(subject: Subject) -> str:
    return "" if subject.parameters is None else f"\n  {subject.prefix}_parameters parameters;"


def _documented(call: Call, prefix: str) -> str:
    said = [f"{prefix.upper()}_{code.name}" for code in call.codes]
    own = f" Beyond the codes of every function: {', '.join(said)}." if said else ""
    text = "\n".join(textwrap.wrap(call.text + own, _LINE - 6, initial_indent="/* ", subsequent_indent="   "))
    return f"{text} */\n{prefix.upper()}_API {prototype(call, prefix)};\n"
