"""The test program of a package: its vectors as C, and one function that runs each public function on a row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.export.part import Argument
from continuum_grasp.export.reals import Real
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill
from continuum_grasp.export.vectors import Vectors, arguments_of

__all__ = ["check_source", "vectors_source"]

_RANDOM = {
    "float": "next_random(seed)",
    "double": "(uint64_t)next_random(seed) << 32 | next_random(seed)",
}
"""C of random bits of a real number."""


def vectors_source(subject: Subject, vectors: Sequence[Vectors], words: dict[str, str]) -> str:
    """Header with the vectors as hexadecimal floating literals."""
    tables = "\n".join(_tables(v, subject.prefix, subject.real) for v in vectors)
    return fill("tests/vectors.h", {**words, "tables": tables, "width": str(subject.real.width)})


def check_source(subject: Subject, vectors: Sequence[Vectors], words: dict[str, str]) -> str:
    """C that runs the vectors without a library but memcpy."""
    table = ",\n".join(
        f'  {{"{v.call.name}", run_{v.call.name}, {v.call.name}_inputs, {v.call.name}_outputs, {v.call.name}_codes, '
        f"{v.call.name}_bad,\n   {len(v.inputs)}, {v.inputs.shape[1]}, {v.outputs.shape[1]}, {len(v.bad)}, "
        f"{2 + sum(a.is_struct for a in v.call.inputs)}}}"
        for v in vectors
    )
    more = {
        "runners": "\n".join(_runner(subject, v) for v in vectors),
        "table": table,
        "count": str(len(vectors)),
        "most_inputs": str(max(v.inputs.shape[1] for v in vectors)),
        "most_outputs": str(max(v.outputs.shape[1] for v in vectors)),
        "width": str(subject.real.width),
        "exponent": hex(subject.real.exponent_mask) + "u" + subject.real.bits_suffix,
        "random_bits": _RANDOM[subject.real.name],
    }
    return fill("tests/check.c", {**words, **more})


def _tables(vectors: Vectors, prefix: str, real: Real) -> str:
    name, untouched = vectors.call.name, (vectors.codes < 0)[:, None]
    bad = ",\n".join(f"  {{{b.row}, {b.entry}, {_bits(b.value, real)}, {int(b.code)}}}" for b in vectors.bad)
    return f"""\
static const {prefix}_real {name}_inputs[] = {{
{_rows(vectors.inputs, real)}
}};
static const {prefix}_real {name}_outputs[] = {{
{_rows(np.where(untouched, 0, vectors.outputs), real)}
}};
static const signed char {name}_codes[] = {{{", ".join(str(int(code)) for code in vectors.codes)}}};
static const bad_input {name}_bad[] = {{
{bad}
}};
"""


def _rows(rows: np.ndarray, real: Real) -> str:
    return ",\n".join("  " + ", ".join(real.hexadecimal(v) for v in row) for row in rows)


def _bits(value: float, real: Real) -> str:
    return hex(int(np.array([value], dtype=real.dtype).view(real.bits)[0])) + "u" + real.bits_suffix


def _runner(subject: Subject, vectors: Vectors) -> str:
    prefix, call = subject.prefix, vectors.call
    declared, copied, passed, at, pointer = [], [], [], 0, 0

    def address(expression: str) -> str:
        nonlocal pointer
        pointer += 1
        return f"null == {pointer} ? 0 : {expression}"

    passed.append(address("&model"))
    for argument in arguments_of(subject, call):
        if argument.name == "parameters":
            copied.append(f"  memcpy(&model.parameters, row + {at}, sizeof model.parameters);")
        elif argument.is_struct:
            declared.append(f"  {prefix}_{argument.kind.name} {argument.name};")
            copied.append(f"  memcpy(&{argument.name}, row + {at}, sizeof {argument.name});")
            passed.append(address(f"&{argument.name}"))
        else:
            passed.append(f"row[{at}]")
        at += argument.size
    output: Argument = call.output
    declared.append(f"  {prefix}_{output.kind.name} {output.name};")
    passed.append(address(f"&{output.name}"))
    newline = "\n"
    return f"""\
static int run_{call.name}(const {prefix}_real *row, {prefix}_real *out, uint32_t other_abi, int null, int repeat)
{{
  {prefix}_model model;
{newline.join(declared)}
  int k, code = {prefix}_init(&model);
{newline.join(copied)}
  memcpy(&{output.name}, out, sizeof {output.name});
  model.abi ^= other_abi;
  for (k = 0; k < repeat; ++k)
    code = {prefix}_{call.name}({", ".join(passed)});
  memcpy(out, &{output.name}, sizeof {output.name});
  return code;
}}
"""
