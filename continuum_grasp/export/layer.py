"""The checked layer: the C between the public functions and the kernels."""

from __future__ import annotations

from collections.abc import Sequence

from continuum_grasp.export.fields import Struct
from continuum_grasp.export.header import calls_of, codes_of_package, prototype, structs_of
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Call, Part
from continuum_grasp.export.strict_math import c_source
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill

__all__ = ["internal_header", "kernels_of", "kernels_source", "layer_source"]


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
    """All kernels.

    Raises
    ------
    InputError
        If a constant is outside the range of single precision.
    """
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
