"""A function, and a recursion over steps, of many rows in one call.

Rows may be strided arrays of doubles, so that broadcast rows are not copied.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.core.caller import pointers
from continuum_grasp.core.code import Backend, FunctionCode
from continuum_grasp.core.source import batch_source, scan_source, symbol_of


class Batch:
    """A function applied to many rows."""

    def __init__(self, function: ca.Function, backend: Backend) -> None:
        self.function = function
        self.code = FunctionCode(function, lambda: batch_source(function), backend)

    def __call__(self, count: int, rows: Sequence[Array]) -> list[Array]:
        """Outputs (count, nonzeros) of inputs (count, size), or (size,) for all rows."""
        function = self.function
        outputs = [np.empty((count, function.nnz_out(k))) for k in range(function.n_out())]
        if not count:
            return outputs
        library = self.code.library(count)
        if library is None:
            # CasADi maps over columns, and its matrices are column-major.
            columns = [np.broadcast_to(row, (count, row.shape[-1])).T for row in rows]
            mapped = function.map(count).call([ca.DM(column) for column in columns])
            for out, result in zip(outputs, mapped, strict=True):
                out[:] = np.array(result).reshape(out.shape[::-1], order="F").T
            return outputs
        ready = [dense_rows(row) for row in rows]
        strides = _whole_numbers([_stride(row, 0) if row.ndim == 2 else 0 for row in ready])
        call = getattr(library, f"{symbol_of(function)}_batch")
        call(ctypes.c_longlong(count), pointers(ready), strides, pointers(outputs))
        return outputs


class Scan:
    """A recursion over steps, of many rows.

    ``function`` is (carry, *signals) -> (next carry, *results) of columns. A signal may have fewer rows in time than
    there are steps, if that is a divisor: each then holds for several steps, and a row of a result is a sum over them.
    """

    def __init__(self, function: ca.Function, backend: Backend) -> None:
        self.function = function
        self.code = FunctionCode(function, lambda: scan_source(function), backend)

    def __call__(self, steps: int, given: Sequence[Array], rows: Sequence[int], back: bool = False) -> list[Array]:
        """The carry before and after every step (count, steps + 1, size), and the results (count, rows, size).

        ``given`` is the carry at the start (count, size), then signals (count, rows, size); ``rows`` counts the rows
        of the results. ``back``: from the last step to the first; sequences in time stay in the order of time.
        """
        function, (start, *signals) = self.function, given
        sizes = [function.nnz_out(k) for k in range(function.n_out())]
        outputs = [np.zeros((len(start), time, n)) for time, n in zip([steps + 1, *rows], sizes, strict=True)]
        if not len(start):
            return outputs
        library = self.code.library(steps * len(start))
        if library is None:
            self._on_virtual_machine(steps, start, signals, outputs, back)
            return outputs
        ready = [dense_rows(array) for array in given]
        getattr(library, f"{symbol_of(function)}_scan")(
            ctypes.c_longlong(len(start)),
            ctypes.c_longlong(steps),
            ctypes.c_int(back),
            pointers(ready),
            _whole_numbers([_stride(array, 0) for array in ready]),
            _whole_numbers([0, *(_stride(array, 1) for array in ready[1:])]),
            _whole_numbers([1, *(steps // array.shape[1] for array in signals)]),
            pointers(outputs),
            _whole_numbers([out.shape[1] * out.shape[2] for out in outputs]),
            _whole_numbers([1, *(steps // time for time in rows)]),
        )
        return outputs

    def _on_virtual_machine(
        self, steps: int, start: Array, signals: Sequence[Array], outputs: Sequence[Array], back: bool
    ) -> None:
        """The scan on CasADi's virtual machine, step by step."""
        mapped = self.function.map(len(start))
        carry, *results = outputs
        carry[:, steps if back else 0] = start
        for t in reversed(range(steps)) if back else range(steps):
            here, following = (t + 1, t) if back else (t, t + 1)
            now = [carry[:, here], *(signal[:, t * signal.shape[1] // steps] for signal in signals)]
            try:
                computed = [np.array(value).T for value in mapped.call([ca.DM(value.T) for value in now])]
            except (
                RuntimeError
            ):  # a row that runs away may leave a matrix singular, which the machine takes for an error
                computed = [np.full((len(start), out.shape[2]), np.nan) for out in outputs]
            carry[:, following] = computed[0]
            for result, value in zip(results, computed[1:], strict=True):
                result[:, t * result.shape[1] // steps] += value


def dense_rows(array: Array) -> Array:
    """The array itself, or a copy if its last entries are not side by side in memory."""
    if array.dtype == float and (array.shape[-1] <= 1 or array.strides[-1] == array.itemsize):
        return array
    return np.ascontiguousarray(array, dtype=float)


def _stride(array: Array, axis: int) -> int:
    """From one entry of an axis to the next, in numbers."""
    return array.strides[axis] // array.itemsize if array.shape[axis] > 1 else 0


def _whole_numbers(values: Sequence[int]) -> ctypes.Array[ctypes.c_longlong]:
    return (ctypes.c_longlong * max(len(values), 1))(*values)
