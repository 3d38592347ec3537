"""A function of a model on numpy arrays, with its arguments checked."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError
from continuum_grasp.core.code import FunctionCode
from continuum_grasp.core.source import symbol_of
from continuum_grasp.model import Model
from continuum_grasp.scene import SAME

DOUBLES = ctypes.POINTER(ctypes.c_double)


class Caller:
    """A function on numpy arrays."""

    def __init__(
        self,
        function: ca.Function,
        code: FunctionCode,
        nominal: Array,
        check: Callable[[Sequence[Any]], None] | None = None,
    ) -> None:
        self.function = function
        self.code = code
        self._check = check
        self.names = function.name_in()
        sizes = [function.nnz_in(k) for k in range(function.n_in())]
        self._defaults = [nominal if n == "p" else np.zeros(size) for n, size in zip(self.names, sizes, strict=True)]
        # No friction is one history of many: it is never supposed.
        self._history = self.names.index("history") if "history" in self.names else None
        self._vectors = not any(m.startswith(f"{function.name()}.") for m in Model.MATRICES)
        # Buffers with fixed addresses, so that a call passes nothing but pointers that are ready.
        self._inputs = [np.zeros(size) for size in sizes]
        self._outputs = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        self._work = np.zeros(max(function.sz_w(), 1))
        self._integers = np.zeros(max(function.sz_iw(), 1), dtype=np.int64)
        self._arguments = (
            # CasADi uses the entries behind the arguments as scratch, hence sz_arg and sz_res.
            (DOUBLES * max(function.sz_arg(), 1))(*[pointer(a) for a in self._inputs]),
            (DOUBLES * max(function.sz_res(), 1))(*[pointer(a) for a in self._outputs]),
            ctypes.c_void_p(self._integers.ctypes.data),
            pointer(self._work),
            0,
        )
        self._lock = Lock()
        self._call: Callable[..., int] | None = None

    def prepare(self) -> Caller:
        """Compile now what would be compiled once calls have paid for it."""
        self.code.expect(math.inf)
        return self

    def _compiled(self) -> Callable[..., int] | None:
        """The compiled function; None while the virtual machine runs it."""
        if self._call is None and (library := self.code.library()) is not None:
            self._call = getattr(library, symbol_of(self.function))
        return self._call

    def __call__(self, *arguments: ArrayLike | None, **named: ArrayLike | None) -> Any:
        values = [*arguments, *[None] * (len(self.names) - len(arguments))]
        for name, value in named.items():
            if name not in self.names:
                raise InputError(f"{self.function.name()}: unknown input {name!r}, expected {', '.join(self.names)}")
            at = self.names.index(name)
            if at < len(arguments):
                raise InputError(f"{self.function.name()}: {name} is given twice")
            values[at] = value
        self._check_history(values)
        # Arrays of the right form are not converted; a conversion would take longer than most functions themselves.
        ready = len(values) == len(self._inputs) and all(
            value is None or (type(value) is np.ndarray and value.dtype == float and value.shape == buffer.shape)
            for value, buffer in zip(values, self._inputs, strict=True)
        )
        rows: Sequence[Any] = values if ready else self.rows(values)
        if not ready and any(np.ndim(row) != 1 for row in rows):
            raise InputError(f"{self.function.name()}: one state expected; use batch for many")
        if ready and self._check is not None:
            self._check(rows)
        results = self.call(rows)
        if self._vectors:
            return results[0] if len(results) == 1 else tuple(results)
        whole = tuple(shaped(self.function, k, out[None])[0] for k, out in enumerate(results))
        return whole[0] if len(whole) == 1 else whole

    def _check_history(self, values: Sequence[ArrayLike | None]) -> None:
        """Refuse a finger with friction whose history is not stated."""
        at = self._history
        if at is not None and (len(values) <= at or values[at] is None):
            raise InputError(
                f"{self.function.name()}: the finger has friction, and its shape does not determine the direction of "
                f"friction: give history ({self._inputs[at].size} entries), the friction states and then h; h = 1 "
                "alone means a finger that was bent from its unloaded shape, all zeros a finger without friction"
            )

    def rows(self, values: Sequence[ArrayLike | None]) -> list[Array]:
        """Contiguous inputs, each one row or a row per state."""
        self._check_history(values)
        if len(values) > len(self.names):
            raise InputError(f"{self.function.name()}: {len(self.names)} inputs expected, got {len(values)}")
        values = [*values, *[None] * (len(self.names) - len(values))]
        rows = []
        for name, value, default in zip(self.names, values, self._defaults, strict=True):
            if value is None:
                rows.append(default)
                continue
            array, size = CheckedArgument(name, value).array(), default.size
            if array.ndim == 0 or (array.ndim == 1 and size == 1 and array.size == 1):
                array = np.full(size, float(array.ravel()[0])) if size == 1 else array.reshape(-1)
            if array.ndim > 2 or (array.shape[-1] != size and not (array.size == 0 and size == 0)):
                raise InputError(
                    f"{self.function.name()}: {name} has {size} entries, got an array of shape {np.shape(value)}"
                )
            rows.append(array)
        if self._check is not None:
            self._check(rows)
        return rows

    def call(self, rows: Sequence[Any]) -> list[Array]:
        """Evaluate on one row per input; None stands for the default."""
        compiled = self._compiled()
        if compiled is None:
            arguments = [d if row is None else row for row, d in zip(rows, self._defaults, strict=True)]
            results = self.function.call([ca.DM(row) for row in arguments])
            return [np.array(r.nonzeros()) for r in results]
        with self._lock:  # the buffers belong to all threads, and ctypes releases the interpreter's lock
            for buffer, row, default in zip(self._inputs, rows, self._defaults, strict=True):
                buffer[:] = default if row is None else row
            compiled(*self._arguments)
            return [buffer.copy() for buffer in self._outputs]


def pointer(array: Array) -> Any:
    return ctypes.cast(array.ctypes.data, DOUBLES)


def pointers(arrays: Sequence[Array]) -> Any:
    return (DOUBLES * max(len(arrays), 1))(*[pointer(a) for a in arrays])


def shaped(function: ca.Function, k: int, rows: Array) -> Array:
    """Rows of an output in its own shape; CasADi is column-major."""
    if f"{function.name()}.{function.name_out(k)}" not in Model.MATRICES:
        return rows
    height, width = function.size_out(k)
    return np.ascontiguousarray(rows.reshape(len(rows), width, height).transpose(0, 2, 1))


def section_check(model: Model, function: ca.Function) -> Callable[[Sequence[Any]], None]:
    """Write the check that positions ``s`` are on the finger, of the inputs of a call: rows, None where not given.

    The compiled functions hold them within the finger without a word, since they are free of branches.
    """
    name, names, nominal = function.name(), function.name_in(), sum(model.structure.lengths)
    s_at, p_at = names.index("s"), names.index("p")
    entries = [k for k, label in enumerate(model.p_names) if label.startswith("element_lengths")]

    def check(rows: Sequence[Any]) -> None:
        s = rows[s_at]
        if s is None:
            return
        length: Any = nominal
        if entries and rows[p_at] is not None:
            length = rows[p_at][..., entries].sum(axis=-1, keepdims=True)
        elif s.size == 1:
            s = s.item()
        within = (s >= -SAME * length) & (s <= (1.0 + SAME) * length)
        if within is True or np.all(within):
            return
        wrong = np.flatnonzero(~np.broadcast_to(within, np.shape(s)).ravel()) if np.size(s) > 1 else np.zeros(1, int)
        worst, its = (np.broadcast_to(v, np.shape(within)).ravel()[wrong[0]] for v in (s, length))
        raise InputError(f"{name}: s: expected a position from 0 to the length {its:g} m, got {worst:g}")

    return check
