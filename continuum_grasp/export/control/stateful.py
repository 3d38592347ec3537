"""Vectors, sizes and use of functions that keep something."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from continuum_grasp.export.accuracy import OutputError
from continuum_grasp.export.control.host import Host
from continuum_grasp.export.control.replay import replayed
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.header import abi_of, header, stateful_of
from continuum_grasp.export.layer import internal_header, kernels_source, layer_source
from continuum_grasp.export.part import Part, Stateful, Vectors
from continuum_grasp.export.reals import REALS
from continuum_grasp.export.subject import Subject

__all__ = ["SIZES", "UNKNOWN", "stateful_usage", "stateful_vectors"]

SIZES = ("estimator_bytes", "estimator_work_bytes", "controller_bytes", "controller_work_bytes")
"""Places of the header for what is known once it was compiled."""
UNKNOWN = "0x7fffffff"
"""What stands there before."""


def stateful_vectors(
    subject: Subject,
    parts: Sequence[Part],
    wide: Sequence[Part],
    files: Mapping[str, str],
    words: dict[str, str],
) -> tuple[list[Vectors], dict[str, tuple[OutputError, ...]]]:
    """Vectors of all such functions by a build on this machine, and their rounding errors; writes the sizes to words.

    The error is the greatest difference of the first outputs (command, estimate) in usual rows from a build in double
    that is given the same rows. It is no bound: where a measurement is left out by one build alone, or another active
    set ends the iterations, outputs jump.
    """
    functions = stateful_of(parts)
    host = _host(subject, functions, files)
    words |= {f"{name}_bytes": str(size) for name, size in host.sizes.items()}
    vectors = [function.vectors(host, function.runner) for function in functions]
    errors: dict[str, tuple[OutputError, ...]] = {}
    if subject.real.name == "float" and subject.loop is not None:
        double = replace(subject, real=REALS["double"])
        written = {**words, "real": "double", **dict.fromkeys(SIZES, UNKNOWN)}
        written["abi"] = abi_of(double, wide, written)
        other = _host(double, functions, _files(double, wide, written, files["tests/check.h"]))
        structs = {struct.name: struct for part in parts for struct in part.structs}
        for v, function in zip(vectors, functions, strict=True):
            output = structs[function.output]
            errors[v.name] = _differences(v, output, *replayed(subject.loop, v, other, double.real))
    return vectors, errors


def stateful_usage(prefix: str, function: Stateful) -> str:
    """C of a first call."""
    owner = function.types[0]
    structs = [*function.inputs, function.output]
    lines = [f"static {prefix}_{name} {name};" for name in (*function.types, *structs)]
    passed = ", ".join(f"&{name}" for name in (*function.types, *structs))
    lines.append(f"int code = {prefix}_{owner}_init(&{owner});")
    notes = {
        "measurement": " /* nothing measured: NaN */",
        "reference": " /* the setpoints of the scene, at all nodes */",
        "command": " /* what was applied before */",
    }
    for name in function.inputs:
        lines.append(f"if (code >= 0) code = {prefix}_{name}_init(&{name});{notes[name]}")
    lines.append("/* every period: write what was measured into the measurement, leave the rest NaN; then */")
    lines.append(f"if (code >= 0) code = {prefix}_{function.name}({passed});")
    lines.append(f"if (code < 0) report({prefix}_strerror(code)); /* above zero: a warning, see the table of codes */")
    return "\n".join(lines)


def _host(subject: Subject, functions: Sequence[Stateful], files: Mapping[str, str]) -> Host:
    runners = {function.name: function.runner for function in functions}
    owners = list(dict.fromkeys(name for function in functions for name in function.types))
    return Host(files, subject.prefix, subject.real, runners, owners)


def _files(subject: Subject, parts: Sequence[Part], words: dict[str, str], check: str) -> dict[str, str]:
    prefix = subject.prefix
    return {
        f"include/{prefix}.h": header(subject, parts, words),
        f"src/{prefix}_internal.h": internal_header(subject, parts, words),
        f"src/{prefix}_kernels.c": kernels_source(subject, parts, words),
        f"src/{prefix}.c": layer_source(subject, parts, words),
        "tests/check.h": check,
        **{path: text for part in parts for path, text in part.sources.items()},
    }


def _differences(vectors: Vectors, output: Struct, codes: np.ndarray, other: np.ndarray) -> tuple[OutputError, ...]:
    """Greatest of each output; infinite where only one of them gives an output."""
    usual = vectors.inputs[:, 3] == 0.0
    found, true = vectors.outputs[usual, : vectors.close].astype(float), other[usual, : vectors.close]
    off = np.abs(found - true).max(axis=0)
    if ((codes < 0) != (vectors.codes < 0))[usual].any():
        off[:] = np.inf
    return tuple(
        OutputError(field.name, field.unit, float(f"{difference:.2g}"), float(f"{size:.2g}"))
        for field, difference, size in zip(output.fields, off, np.abs(true).max(axis=0), strict=True)
    )
