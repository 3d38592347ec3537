"""A package's functions with memory, compiled on this machine with the strict flags, and run row by row."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core.compiler import find_compiler, why_no_compiler
from continuum_grasp.errors import InputError
from continuum_grasp.export.fields import Real

Array = NDArray[Any]

_FLAGS = ("-std=c99", "-O1", "-ffp-contract=off", "-fno-math-errno", "-shared", "-fPIC", "-w")
_GCC = ("-fexcess-precision=fast", "-fno-tree-vectorize")
_TIMEOUT = 600.0
"""After which a compiler is taken to hang [s]; builds take seconds."""


class Host:
    """The strict build; what it computes is to the last bit what every other strict build computes.

    Parameters
    ----------
    files : mapping
        Header, sources and ``tests/check.h`` of the package, by path.
    prefix : str
        Of the package.
    real : Real
        What it computes in.
    runners : mapping
        C functions ``run_...`` of the check program by the names of their functions.
    owners : sequence of str
        C types whose sizes are asked for.

    Attributes
    ----------
    sizes : dict of str to int
        Bytes by type.
    """

    def __init__(
        self, files: Mapping[str, str], prefix: str, real: Real, runners: Mapping[str, str], owners: Sequence[str]
    ) -> None:
        compiler = find_compiler()
        if compiler is None:
            raise InputError(f"the vectors of estimator and controller need a C compiler: {why_no_compiler()}")
        self._real = real
        with tempfile.TemporaryDirectory() as work:
            for name, text in {**files, "host.c": _source(prefix, runners, owners)}.items():
                path = Path(work) / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8")
            sources = [name for name in files if name.startswith("src/") and name.endswith(".c")]
            flags = (*_FLAGS, *(() if "clang" in compiler.version.lower() else _GCC), "-Iinclude", "-Itests")
            line = [*compiler.command, *flags, *sources, "host.c", "-o", "host.so"]
            done = subprocess.run(line, cwd=work, capture_output=True, text=True, timeout=_TIMEOUT, check=False)
            if done.returncode != 0:
                raise InputError(f"the C compiler refused the package: {done.stderr[:2000]}")
            self._library = ctypes.CDLL(str(Path(work) / "host.so"))
        self._library.host_size.restype = ctypes.c_size_t
        self.sizes = {name: int(self._library.host_size(k)) for k, name in enumerate(owners)}
        self._memory = ctypes.create_string_buffer(int(self._library.host_size(len(owners))))
        self._runs = {name: getattr(self._library, f"host_{name}") for name in runners}

    def run(self, name: str, row: Array, outputs: int) -> tuple[int, Array]:
        """Code and outputs of a row, after those before."""
        given = np.ascontiguousarray(row, dtype=self._real.dtype)
        out = np.zeros(outputs, dtype=self._real.dtype)
        code = self._runs[name](self._memory, ctypes.c_void_p(given.ctypes.data), ctypes.c_void_p(out.ctypes.data))
        return int(code), out


def _source(prefix: str, runners: Mapping[str, str], owners: Sequence[str]) -> str:
    sizes = ", ".join(f"sizeof({prefix}_{name})" for name in owners)
    whole = "\n".join(runners.values())
    exported = "".join(
        f"int host_{name}(check_memory *memory, const {prefix}_real *row, {prefix}_real *out)\n"
        f"{{\n  return run_{name}(memory, row, out, 0, 0, 1);\n}}\n"
        for name in runners
    )
    return f"""\
#include <stddef.h>
#include <string.h>
#include "check.h"
{whole}
{exported}
size_t host_size(int which)
{{
  const size_t sizes[] = {{{sizes}, sizeof(check_memory)}};
  return sizes[which];
}}
"""
