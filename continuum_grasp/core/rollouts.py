"""Many steps from one state, or from many, in one call."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base import Array, CheckedArgument, InputError
from continuum_grasp.core.caller import pointer, pointers
from continuum_grasp.core.code import Backend, FunctionCode
from continuum_grasp.core.integrators import step_function
from continuum_grasp.core.source import rollout_source, rollouts_source, symbol_of

_CHUNK = 256
"""Steps on the virtual machine after which Ctrl-C and a state that is not finite end the run [1]."""
_LINKS = (64, 8, 1)
"""Steps per function of the virtual machine; motions of any length consist of such functions [1]: making one takes
0.7 ms a step, as long as running it; windows of a motion have many lengths (configs/simulate/hold_mug.yaml: five)."""


@dataclass(frozen=True)
class HalfStepSignal:
    """Rows over half steps, and the strides from one to the next in time and between rollouts."""

    rows: Array
    in_time: int
    per_rollout: int

    @staticmethod
    def of_one(rows: Array | HalfStepSignal) -> HalfStepSignal:
        """One row (size,) that stays, or rows (2 steps + 1, size) at the half steps of one rollout."""
        if isinstance(rows, HalfStepSignal):
            return rows
        whole = np.atleast_2d(np.ascontiguousarray(rows, dtype=float))
        return HalfStepSignal(whole[None], whole.shape[1] if len(whole) > 1 else 0, 0)

    @staticmethod
    def of(name: str, value: ArrayLike | None, size: int, rows: int, count: int | None) -> HalfStepSignal:
        """Rows over half steps, for one rollout (``count`` None) or for many."""
        if value is None:
            return HalfStepSignal(np.zeros((1, 1, size)), 0, 0)
        array = CheckedArgument(name, value).array(finite=True)
        if array.ndim <= 1:
            return HalfStepSignal(row(name, array, size)[None, None], 0, 0)
        if array.shape == (rows, size) and count == rows:
            raise InputError(
                f"{name}: {rows} rows can be one per half step or one per rollout; give ({count}, {rows}, {size})"
            )
        if array.shape == (rows, size):
            return HalfStepSignal(array[None], size, 0)
        if count is not None and array.shape == (count, size):
            return HalfStepSignal(array[:, None], 0, size)
        if count is not None and array.shape == (count, rows, size):
            return HalfStepSignal(array, size, rows * size)
        shapes = "" if count is None else f", ({count}, {size}) or ({count}, {rows}, {size})"
        raise InputError(f"{name}: expected ({size},) or ({rows}, {size}){shapes}, got {array.shape}")


class Rollouts:
    """Many steps from one state, or from many, in one call."""

    def __init__(
        self,
        step: ca.Function,
        backend: Backend | None = None,
        single: bool = True,
        *,
        compiled: bool = True,
        what: str = "the model",
    ) -> None:
        backend = backend or Backend(compiled, what)
        self._step = step
        self._single = single
        self._chains: dict[int, ca.Function] = {}
        self.code = FunctionCode(step, partial(rollout_source if single else rollouts_source, step), backend)

    @staticmethod
    def by(method: str, model: Any, *, what: str = "the model") -> Rollouts:
        """Return rollouts by a method of ``INTEGRATORS`` for a model with the functions that `step_function` needs."""
        return Rollouts(step_function(model, method), what=what)

    def _compiled(self, steps: int) -> Any:
        """Return the compiled function for a number of steps; None if the virtual machine takes them."""
        library = self.code.library(steps)
        if library is None:
            return None
        function = getattr(library, f"{symbol_of(self._step)}_{'levels' if self._single else 'rollouts'}")
        function.restype = None
        return function

    def __call__(
        self,
        x0: Array,
        keep: int,
        sub: int,
        h: float,
        u: Array | HalfStepSignal,
        w: Array | HalfStepSignal,
        p: Array,
    ) -> tuple[Array, NDArray[np.int64]]:
        """States (rollouts, keep + 1, nx) from x0 (rollouts, nx), and how many after the first are finite, of each.

        Inputs u and forces w of a single rollout are a row that stays, or rows at its half steps.
        """
        u, w = HalfStepSignal.of_one(u), HalfStepSignal.of_one(w)
        if self._single:
            (trajectory,), valid = self.levels(x0, (1,), 1, keep, sub, h, u, w, p)
            return trajectory[None], valid
        states = np.full((len(x0), keep + 1, x0.shape[1]), np.nan)
        valid = np.zeros(len(x0), dtype=np.int64)
        compiled = self._compiled(len(x0) * keep * sub)
        if compiled is None:
            for r, start in enumerate(x0):
                # One signal for all rollouts, or one each.
                signals = u.rows[r % len(u.rows)], w.rows[r % len(w.rows)]
                valid[r] = self._on_virtual_machine(states[r], start, keep, sub, h, *signals, p)
            return states, valid
        whole = ctypes.c_longlong
        begin = (whole(len(x0)), whole(keep), whole(sub), ctypes.c_double(h), pointer(x0))
        own_u = (pointer(u.rows), whole(u.in_time), whole(u.per_rollout))
        own_w = (pointer(w.rows), whole(w.in_time), whole(w.per_rollout))
        integers, work = self._scratch()
        tail = (pointer(p), _whole_numbers(integers), pointer(work), pointer(states), _whole_numbers(valid))
        compiled(*begin, *own_u, *own_w, *tail)
        return states, valid

    def levels(
        self,
        x0: Array,
        ratios: Sequence[int],
        every: int,
        keep: int,
        sub: int,
        h: float,
        u: Array | HalfStepSignal,
        w: Array | HalfStepSignal,
        p: Array,
    ) -> tuple[list[Array], NDArray[np.int64]]:
        """A motion in steps of several lengths, in one call.

        x0 (levels, nx) is where each level starts, ``ratios`` the length of its steps per h, 1 for the first, and
        ``every`` the stored states of the first level from one that the others store to the next. The other arguments
        come from one rollout, rows of u and w at half steps of h. Results: the states of each level, and how many
        of them are finite after the first (levels,).
        """
        u, w = HalfStepSignal.of_one(u), HalfStepSignal.of_one(w)
        counts = [keep if r == 1 else keep // every for r in ratios]
        states = [np.full((count + 1, x0.shape[1]), np.nan) for count in counts]
        valid = np.zeros(len(states), dtype=np.int64)
        compiled = self._compiled(sum(keep * sub // r for r in ratios))
        if compiled is None:
            for k, (r, count) in enumerate(zip(ratios, counts, strict=True)):
                substeps = sub if r == 1 else sub * every // r
                us, ws = (course.rows[0][:: r if course.in_time else 1] for course in (u, w))
                states[k][0] = x0[k]
                if count:
                    valid[k] = self._on_virtual_machine(states[k], x0[k], count, substeps, h * r, us, ws, p)
            return states, valid
        whole, start, lengths = ctypes.c_longlong, np.ascontiguousarray(x0), np.array(ratios, dtype=np.int64)
        begin = (whole(len(ratios)), _whole_numbers(lengths), whole(every), whole(keep), whole(sub), ctypes.c_double(h))
        signals = (pointer(u.rows), whole(u.in_time), pointer(w.rows), whole(w.in_time))
        integers, work = self._scratch()
        tail = (pointer(p), _whole_numbers(integers), pointer(work), pointers(states), _whole_numbers(valid))
        compiled(*begin, pointer(start), *signals, *tail)
        return states, valid

    def _scratch(self) -> tuple[NDArray[np.int64], Array]:
        """Work space of whole and of real numbers, for each call its own, so that calls may overlap in threads."""
        return np.empty(max(self._step.sz_iw(), 1), dtype=np.int64), np.empty(max(self._step.sz_w(), 1))

    def _chain(self, length: int) -> ca.Function:
        if length not in self._chains:
            self._chains[length] = self._step.mapaccum("chain", length)
        return self._chains[length]

    def _on_virtual_machine(
        self, states: Array, x0: Array, keep: int, sub: int, h: float, u: Array, w: Array, p: Array
    ) -> int:
        # One function of many steps: a call per step would spend most of its time in Python.
        chunk = max(1, min(keep, _CHUNK // sub))
        states[0] = x0
        for k in range(0, keep, chunk):
            at, last = k * sub, min(k + chunk, keep) * sub
            reached = [states[k : k + 1]]
            while at < last:
                length = next(n for n in _LINKS if n <= last - at)
                # Rows are at half steps: start, middle and end of step i are rows 2i, 2i + 1, 2i + 2.
                samples = [
                    rows[2 * at + i : 2 * (at + length) + i - 1 : 2].T
                    if len(rows) > 1
                    else np.repeat(rows.T, length, axis=1)
                    for rows in (u, w)
                    for i in range(3)
                ]
                fixed = ca.repmat(ca.DM(p), 1, length), ca.repmat(ca.DM(h), 1, length)
                try:
                    ends = self._chain(length)(reached[-1][-1], *[ca.DM(v) for v in samples], *fixed)
                except (
                    RuntimeError
                ):  # a step that runs away may leave a matrix singular, which the machine takes for an error
                    return k
                reached.append(np.array(ends).T)
                at += length
            following = np.concatenate(reached)[sub::sub]
            states[k + 1 : k + 1 + len(following)] = following
            broken = np.flatnonzero(~np.all(np.isfinite(following), axis=1))
            if broken.size:
                return k + int(broken[0])
        return keep


def _whole_numbers(array: NDArray[np.int64]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def row(name: str, value: ArrayLike, size: int) -> Array:
    """A vector (size,)."""
    array = CheckedArgument(name, value).array(finite=True).reshape(-1)
    if array.size != size:
        raise InputError(f"{name}: expected {size} entries, got {array.size}")
    return array
