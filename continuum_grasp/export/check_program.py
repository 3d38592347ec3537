"""The test program of a package: its vectors as C, and one function that runs each public function on a row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.export.part import Vectors
from continuum_grasp.export.reals import Real
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill

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
        f'  {{"{v.name}", run_{v.name}, {v.name}_inputs, {v.name}_outputs, {v.name}_codes, '
        f"{v.name}_bad, "
        f"{v.name}_spoilt,\n   {len(v.inputs)}, {v.inputs.shape[1]}, {v.outputs.shape[1]}, {v.close}, {len(v.bad)}, "
        f"{v.pointers}, {int(v.stateful)}}}"
        for v in vectors
    )
    more = {
        "runners": "\n".join(v.runner for v in vectors),
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
    name, untouched = vectors.name, (vectors.codes < 0)[:, None]
    bad = [(b.row, b.entry, _bits(b.value, real), int(b.code)) for b in vectors.bad]
    spoilt = [
        (int(k), int(j), _bits(vectors.inputs[k, j], real), 0) for k, j in np.argwhere(~np.isfinite(vectors.inputs))
    ]
    return f"""\
static const {prefix}_real {name}_inputs[] = {{
{_rows(np.where(np.isfinite(vectors.inputs), vectors.inputs, 0), real)}
}};
static const {prefix}_real {name}_outputs[] = {{
{_rows(np.where(untouched, 0, vectors.outputs), real)}
}};
static const signed char {name}_codes[] = {{{", ".join(str(int(code)) for code in vectors.codes)}}};
static const bad_input {name}_bad[] = {{
{_entries(bad)}
}};
static const bad_input {name}_spoilt[] = {{
{_entries([*spoilt, (-1, 0, _bits(0.0, real), 0)])}
}};
"""


def _entries(rows: Sequence[tuple[int, int, str, int]]) -> str:
    return ",\n".join(f"  {{{', '.join(map(str, row))}}}" for row in rows)


def _rows(rows: np.ndarray, real: Real) -> str:
    return ",\n".join("  " + ", ".join(real.hexadecimal(v) for v in row) for row in rows)


def _bits(value: float, real: Real) -> str:
    return hex(int(np.array([value], dtype=real.dtype).view(real.bits)[0])) + "u" + real.bits_suffix
