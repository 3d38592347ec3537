"""The public header, and the checked layer: the C between the public functions and the kernels."""

from __future__ import annotations

import hashlib
import textwrap
from collections.abc import Mapping, Sequence

from continuum_grasp import __version__
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Call, Code, Part, Stateful
from continuum_grasp.export.strict_math import c_source
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill, filled

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


def kernels_of(parts: Sequence[Part]) -> list[Kernel]:
    """Kernels of a package, each once."""
    return list({kernel.name: kernel for part in parts for kernel in part.kernels}.values())


def internal_header(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> str:
    """What kernels and checked layer share."""
    big = subject.prefix.upper()
    declared = "\n".join(f"{big}_API {kernel.prototype(subject.prefix)};" for kernel in kernels_of(parts))
    real = subject.real
    more = {
        "kernels": declared,
        "width": str(real.width),
        "exponent": hex(real.exponent_mask) + "u" + real.bits_suffix,
    }
    return fill("internal.h", {**words, **more})


def kernels_source(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> str:
    """All kernels."""
    kernels, prefix = kernels_of(parts), subject.prefix
    strict = c_source(set().union(*(kernel.calls for kernel in kernels)), subject.real, prefix)
    texts = [f"{kernel.c_source(prefix, subject.real)}" for kernel in kernels]
    body = "\n".join([strict, *texts] if strict else texts)
    return fill("kernels.c", {**words, "body": body.replace("\nvoid ", f"\n{prefix.upper()}_API void ")})


def layer_source(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> str:
    """The public functions."""
    prefix, calls = subject.prefix, calls_of(parts)
    inputs = _unique([a.kind for call in calls for a in call.inputs if isinstance(a.kind, Struct)])
    outputs = _unique([call.output.kind for call in calls if isinstance(call.output.kind, Struct)])
    checked = inputs if subject.parameters is None else [subject.parameters, *inputs]
    sizes = [
        f"typedef char {prefix}_{struct.name}_has_no_padding"
        f"[sizeof({prefix}_{struct.name}) == {struct.size} * sizeof({prefix}_real) ? 1 : -1];"
        for struct in structs_of(subject, parts)
    ]
    codes = [f'    case {prefix.upper()}_{code.name}: return "{code.text}";' for code in codes_of_package(parts)]
    nominal = [
        f"  model->parameters.{field.name} = {subject.real.literal(value)};"
        for field, value in zip(
            subject.parameters.fields if subject.parameters else (), subject.model.p_nominal, strict=True
        )
    ]
    model = {
        "bounds": "\n".join(_bounds(subject, struct) for struct in checked),
        "readers": "\n".join(struct.reader(prefix) for struct in checked),
        "writers": "\n".join(struct.writer(prefix) for struct in outputs),
        "check": fill("check_numbers.c", words),
        "functions": "\n".join(
            [
                *([subject.guard_function] if subject.guard else []),
                *(_function(subject, call) for call in calls),
                *(part.definitions for part in parts if part.definitions),
            ]
        ),
        "nominal": "".join(f"\n{line}" for line in nominal),
    }
    written = fill("layer_model.c", {**words, **model}) if calls else ""
    return fill("layer.c", {**words, "sizes": "\n".join(sizes), "model": written, "codes": "\n".join(codes)})


def library_files(subject: Subject, parts: Sequence[Part], words: dict[str, str]) -> dict[str, str]:
    """The library, and the header of its check program."""
    prefix = subject.prefix
    kernels = kernels_source(subject, parts, words)
    own = {path: text for part in parts for path, text in part.sources.items()}
    layer = layer_source(subject, parts, words)
    computed = "".join([kernels, layer, *(text for path, text in sorted(own.items()) if path.endswith(".c"))])
    counts = "".join(f"{name} {value}\n" for part in parts for name, value in part.constants.items())
    words["hash"] = hashlib.sha256(f"{subject.real.name}\n{counts}{computed}".encode()).hexdigest()[:16]
    return {
        f"include/{prefix}.h": header(subject, parts, words),
        f"src/{prefix}_internal.h": internal_header(subject, parts, words),
        f"src/{prefix}_kernels.c": kernels,
        f"src/{prefix}.c": layer,
        "tests/check.h": fill("tests/check.h", words),
        **own,
    }


def _unique(structs: list[Struct]) -> list[Struct]:
    return list({struct.name: struct for struct in structs}.values())


def _bounds(subject: Subject, struct: Struct) -> str:
    real = subject.real
    lows, highs = (
        ", ".join(real.literal(min(max(v, -real.greatest), real.greatest)) for v in side)
        for side in zip(*struct.bounded, strict=True)
    )
    kind = f"{subject.prefix.upper()}_API static const {subject.prefix}_real {struct.name}"
    return f"{kind}_low[] = {{{lows}}};\n{kind}_high[] = {{{highs}}};"


def _function(subject: Subject, call: Call) -> str:
    """A public function: what it accepts, what it does, what it gives."""
    prefix, big = subject.prefix, subject.prefix.upper()
    passed = _parameters(subject) + list(call.inputs)
    arrays = [a for a in passed if a.is_struct]
    given = ", ".join(["model", *(a.name for a in call.inputs), *(a.array for a in arrays)])
    return f"""\
{_accept(subject, call, arrays)}
{big}_API {prototype(call, prefix)}
{{
  {prefix}_real {", ".join(f"{a.array}[{a.size}]" for a in arrays)}, result[{call.output.size}];
  int code = {call.output.name} ? accept_{call.name}({given}) : {big}_ERR_NULL;
  if (code < 0) return code;
{call.body.rstrip()}
  if (!all_finite(result, {call.output.size})) return {big}_ERR_RESULT;
  write_{call.output.kind.name}(result, {call.output.name});
  return code;
}}
"""


def _accept(subject: Subject, call: Call, arrays: list[Argument]) -> str:
    """What reads and checks everything that a function is given."""
    prefix, big, real = subject.prefix, subject.prefix.upper(), subject.real
    declared = [f"const {prefix}_model *model"]
    declared += [
        f"const {prefix}_{a.kind.name} *{a.name}" if a.is_struct else f"{prefix}_real {a.name}" for a in call.inputs
    ]
    declared += [f"{prefix}_real *{a.array}" for a in arrays]
    nulls = ["model", *(a.name for a in call.inputs if a.is_struct)]
    lines = [
        f"{big}_API static int accept_{call.name}({', '.join(declared)})",
        "{",
        *([] if all(a.drawn for a in arrays) else ["  int code;"]),
        f"  if ({' || '.join(f'!{name}' for name in nulls)}) return {big}_ERR_NULL;",
        f"  if (model->abi != {big}_ABI) return {big}_ERR_ABI;",
    ]
    for a in arrays:
        place, name = "&model->parameters" if a.name == "parameters" else a.name, a.kind.name
        lines.append(f"  read_{name}({place}, {a.array});")
        if a.drawn:
            lines.append(f"  if (!all_finite({a.array}, {a.size})) return {big}_ERR_NON_FINITE;")
        else:
            lines.append(f"  if ((code = check({a.array}, {name}_low, {name}_high, {a.size})) < 0) return code;")
    for a in (a for a in call.inputs if not a.is_struct):
        low, high = (real.literal(v) for v in (a.fields[0].low, a.fields[0].high))
        lines.append(f"  if (!{prefix}_is_finite(&{a.array})) return {big}_ERR_NON_FINITE;")
        lines.append(f"  if ({a.array} < {low} || {a.array} > {high}) return {big}_{a.code.name};")
    lines += [call.guard.rstrip("\n")] if call.guard else []
    return "\n".join([*lines, f"  return {big}_OK;", "}", ""])


def _parameters(subject: Subject) -> list[Argument]:
    return [] if subject.parameters is None else [Argument("parameters", subject.parameters, "p")]
