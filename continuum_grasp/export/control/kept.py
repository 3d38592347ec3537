"""Vectors, sizes and use of functions that keep something."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from continuum_grasp.export.control.host import Host
from continuum_grasp.export.control.replay import replayed
from continuum_grasp.export.header import abi_of, header, kept_of
from continuum_grasp.export.layer import internal_header, kernels_source, layer_source
from continuum_grasp.export.part import Kept, Part
from continuum_grasp.export.reals import REALS
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.vectors import Vectors

__all__ = ["SIZES", "UNKNOWN", "kept_usage", "kept_vectors"]

SIZES = ("estimator_bytes", "estimator_work_bytes", "controller_bytes", "controller_work_bytes")
"""Places of the header for what is known once it was compiled."""
UNKNOWN = "0x7fffffff"
"""What stands there before."""


def kept_vectors(
    subject: Subject,
    parts: Sequence[Part],
    wide: Sequence[Part],
    files: Mapping[str, str],
    words: dict[str, str],
) -> tuple[list[Vectors], dict[str, float]]:
    """Vectors of all such functions by a build on this machine, and their rounding errors; writes the sizes to words.

    The error is the greatest difference of the first outputs (command, estimate) in usual rows from a build in double
    that is given the same rows, per the greatest value of each.
    """
    functions = kept_of(parts)
    host = _host(subject, functions, files)
    words |= {f"{name}_bytes": str(size) for name, size in host.sizes.items()}
    vectors = [function.vectors(host, function.runner) for function in functions]
    errors = dict.fromkeys((v.name for v in vectors), 0.0)
    if subject.real.name == "float" and subject.loop is not None:
        double = replace(subject, real=REALS["double"])
        written = {**words, "real": "double", **dict.fromkeys(SIZES, UNKNOWN)}
        written["abi"] = abi_of(double, wide)
        other = _host(double, functions, _files(double, wide, written, files["tests/check.h"]))
        for v in vectors:
            errors[v.name] = _difference(v, *replayed(subject.loop, v, other, double.real))
    return vectors, errors


def kept_usage(prefix: str, function: Kept) -> str:
    """C of a first call."""
    owner = function.types[0]
    structs = [*function.inputs, function.output]
    lines = [f"static {prefix}_{name} {name};" for name in (*function.types, *structs)]
    passed = ", ".join(f"&{name}" for name in (*function.types, *structs))
    lines.append(f"int code = {prefix}_{owner}_init(&{owner});")
    lines.append(f"code = {prefix}_{function.name}({passed});")
    lines.append(f"if (code < 0) report({prefix}_strerror(code));")
    return "\n".join(lines)


def _host(subject: Subject, functions: Sequence[Kept], files: Mapping[str, str]) -> Host:
    runners = {function.name: function.runner for function in functions}
    kept = list(dict.fromkeys(name for function in functions for name in function.types))
    return Host(files, subject.prefix, subject.real, runners, kept)


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


def _difference(vectors: Vectors, codes: np.ndarray, other: np.ndarray) -> float:
    """Infinite where only one of them gives an output."""
    usual = vectors.inputs[:, 3] == 0.0
    if ((codes < 0) != (vectors.codes < 0))[usual].any():
        return float("inf")
    found, true = vectors.outputs[usual, : vectors.close].astype(float), other[usual, : vectors.close]
    scale = np.abs(true).max(axis=0)
    return float((np.abs(found - true).max(axis=0) / np.where(scale > 0.0, scale, 1.0)).max())
