"""The compiled inner loops of the scan, `kernel.c`; where there is no C compiler, numpy does the same."""

from __future__ import annotations

import ctypes
import os
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import CompileError, find_compiler

Array = NDArray[Any]


def library() -> ctypes.CDLL | None:
    """The library, compiled unless it is in the cache; None where that cannot be."""
    # A process that had no compiler for a while, or another one, is not bound to what it had then.
    return _library(os.environ.get("CC"), os.environ.get("PATH"))


@cache
def _library(_named: str | None, _path: str | None) -> ctypes.CDLL | None:
    compiler = find_compiler()
    if compiler is None:
        return None
    source = files(__package__).joinpath("kernel.c").read_text(encoding="utf-8")
    try:
        return ctypes.CDLL(str(library_for(source, compiler, "the scan of postures")))
    except (CompileError, OSError):
        return None


def called(name: str, out: Array, *arguments: Array | float) -> Array:
    """Call a function of the library: whole and other numbers, arrays of doubles or complex numbers, and its result."""
    held = [np.ascontiguousarray(each) if isinstance(each, np.ndarray) else each for each in (*arguments, out)]
    passed: list[Any] = []
    for each in held:
        if isinstance(each, np.ndarray):
            passed.append(ctypes.c_void_p(each.ctypes.data))
        else:
            passed.append(ctypes.c_double(each) if isinstance(each, float) else each)
    if getattr(library(), name)(*passed):
        raise MemoryError(f"{name}: {len(out)} systems")
    return out
