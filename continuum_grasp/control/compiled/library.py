"""A compiled C object in memory, called from Python with doubles."""

from __future__ import annotations

import ctypes
import hashlib
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.compiled.source import Field, settings_values
from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import CompileError, find_compiler, why_no_compiler
from continuum_grasp.errors import InputError

__all__ = ["Compiled", "load_library"]

Array = NDArray[np.float64]

_HEAD = struct.Struct("<8s16sqqq")
_MAGIC = b"cgstate1"
_ALIGNMENT = 64
"""Of the object's memory [bytes]: a cache line, and the widest vector register (AVX-512)."""


def load_library(source: str, users: str) -> ctypes.CDLL:
    """Compile a C source, or find it in the cache, and load it.

    Raises
    ------
    InputError
        If there is no C compiler, or it fails; ``users`` need it.
    """
    compiler = find_compiler()
    if compiler is None:
        raise InputError(f"{users} need a C compiler: {why_no_compiler()}")
    try:
        return ctypes.CDLL(str(library_for(source, compiler)))
    except (CompileError, OSError) as error:
        raise InputError(f"{users} need a C compiler, and compiling failed: {error}") from error


class Compiled:
    """An object of a C source that defines ``cg_size``, ``cg_settings`` and ``cg_start``, its state first.

    Parameters
    ----------
    source : str
        The C source.
    fields : sequence of Field
        Its settings.
    inputs, outputs : int
        Numbers of doubles that a call takes and returns.

    Attributes
    ----------
    input, output : ndarray
        What a call reads and writes.

    Raises
    ------
    InputError
        If there is no C compiler.
    """

    def __init__(self, source: str, fields: Sequence[Field], inputs: int, outputs: int) -> None:
        self._library = load_library(source, "controllers and estimators")
        for name in ("cg_size", "cg_state_size"):
            getattr(self._library, name).restype = ctypes.c_size_t
        self._key = hashlib.sha256(source.encode() + settings_values(fields).tobytes()).digest()[:16]
        memory = np.zeros(self._library.cg_size() + _ALIGNMENT, np.uint8)
        start = -memory.ctypes.data % _ALIGNMENT
        self._memory = memory[start : start + self._library.cg_size()]
        self.state = self._memory[: self._library.cg_state_size()]
        self.input, self.output = np.zeros(inputs), np.zeros(outputs)
        self.address = ctypes.c_void_p(self._memory.ctypes.data)
        self.input_address = ctypes.c_void_p(self.input.ctypes.data)
        self.output_address = ctypes.c_void_p(self.output.ctypes.data)
        self.configure(fields)

    def configure(self, fields: Sequence[Field]) -> None:
        """Set the settings; the state stays."""
        values = settings_values(fields)
        self._library.cg_settings(self.address, ctypes.c_void_p(values.ctypes.data))

    def function(self, name: str) -> Any:
        """Return a function of the library."""
        return getattr(self._library, name)

    def start(self, values: Array) -> None:
        """Start again from the arguments of ``cg_start``."""
        self._library.cg_start(self.address, ctypes.c_void_p(values.ctypes.data))

    def save(self, step: int, flags: int = 0) -> bytes:
        """Serialize the state with two numbers of its owner."""
        return _HEAD.pack(_MAGIC, self._key, self.state.size, step, flags) + self.state.tobytes()

    def restore(self, saved: bytes) -> tuple[int, int]:
        """Restore a saved state; return the owner's numbers.

        Raises
        ------
        InputError
            If the state is not one of the same problem, version and precision.
        """
        head = _HEAD.unpack(saved[: _HEAD.size]) if len(saved) >= _HEAD.size else (b"", b"", 0, 0, 0)
        magic, key, size, step, flags = head
        if magic != _MAGIC or size != len(saved) - _HEAD.size:
            raise InputError(f"expected a state from save_state, got {len(saved)} bytes of something else")
        if key != self._key or size != self.state.size:
            raise InputError("the saved state is of another problem, version or precision")
        self.state[:] = np.frombuffer(saved, np.uint8, offset=_HEAD.size)
        return step, flags
