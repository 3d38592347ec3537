"""A model as compiled code: the same functions on numpy arrays."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Callable, Sequence
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import CompileError, Compiler, find_compiler
from continuum_grasp.core.integrators import METHODS, step_function
from continuum_grasp.core.source import batch_source, function_source, rollout_source
from continuum_grasp.errors import InputError, NumericalError
from continuum_grasp.model.finger_model import FUNCTIONS, FingerModel

__all__ = ["Core", "compile"]

Array = NDArray[np.float64]

_DOUBLES = ctypes.POINTER(ctypes.c_double)


class _Warned:
    """Whether the missing compiler has been reported."""

    done = False


def compile(model: FingerModel, functions: Sequence[str] | None = None) -> Core:
    """Compile a model for this machine.

    Parameters
    ----------
    model : FingerModel
        The model.
    functions : sequence of str, optional
        Functions to compile now; the others are compiled when they are first called. The forward dynamics where
        nothing is said.

    Returns
    -------
    Core
        The model's functions on numpy arrays.

    Raises
    ------
    InputError
        If a function is unknown.
    """
    core = Core(model)
    for name in ("forward_dynamics",) if functions is None else functions:
        core.prepare(name)
    return core


class Core:
    """The functions of a model on numpy arrays, compiled where there is a C compiler.

    Every function of the model is a method of the same name, with the model's inputs as positional or keyword
    arguments (missing ones are zero, ``p`` is nominal) and arrays as results. Without a C compiler the same calls run
    on CasADi's virtual machine, with one warning.

    Attributes
    ----------
    model : FingerModel
    compiled : bool
        Whether the code is compiled.
    """

    def __init__(self, model: FingerModel) -> None:
        self.model = model
        self._compiler: Compiler | None = find_compiler()
        self._units: dict[str, Any] = {}
        self._steps: dict[str, ca.Function] = {}
        if self._compiler is None:
            _warn("no C compiler found (tried CC, cc, gcc, clang)")

    @property
    def compiled(self) -> bool:
        """Whether the code is compiled."""
        return self._compiler is not None

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in FUNCTIONS:
            raise AttributeError(name)
        return self.prepare(name)

    def prepare(self, name: str) -> Callable[..., Any]:
        """Compile a function and give its caller.

        Raises
        ------
        InputError
            If the model has no such function.
        """
        if name not in FUNCTIONS:
            raise InputError(f"unknown function {name!r}: expected one of {', '.join(FUNCTIONS)}")
        if name not in self._units:
            function = getattr(self.model, name)
            library = self._library(function_source(function))
            nominal = np.array(self.model.p_nominal)
            self._units[name] = _Caller(function, library, nominal)
        return self._units[name]  # type: ignore[no-any-return]

    def batch(self, name: str, *arguments: ArrayLike | None) -> Array | tuple[Array, ...]:
        """A function of many states in one call.

        Parameters
        ----------
        name : str
            Function of the model.
        *arguments : array_like or None
            Per input a row per state, (count, size), or one row for all, (size,); None for zero (nominal ``p``).

        Returns
        -------
        ndarray or tuple of ndarray
            Per output (count, size), or (count, rows, columns) for a matrix.

        Raises
        ------
        InputError
            If shapes do not fit.
        """
        caller = self.prepare(name)
        function: ca.Function = caller.function  # type: ignore[attr-defined]
        rows = caller.rows(arguments)  # type: ignore[attr-defined]
        counts = {len(row) for row in rows if row.ndim == 2}
        if len(counts) != 1:
            raise InputError(f"{name}: one number of states expected, got {sorted(counts)}")
        count = counts.pop()
        outputs = [np.zeros((count, function.nnz_out(k))) for k in range(function.n_out())]
        unit = f"{name}_batch"
        if unit not in self._units:
            self._units[unit] = self._library(batch_source(function))
        library = self._units[unit]
        if library is None:
            for k in range(count):
                result = caller.call([row[k] if row.ndim == 2 else row for row in rows])  # type: ignore[attr-defined]
                for out, value in zip(outputs, result, strict=True):
                    out[k] = value
        else:
            strides = (ctypes.c_longlong * len(rows))(*[r.shape[1] if r.ndim == 2 else 0 for r in rows])
            getattr(library, unit)(ctypes.c_longlong(count), _pointers(rows), strides, _pointers(outputs))
        shaped = tuple(_shaped(function, k, out) for k, out in enumerate(outputs))
        return shaped[0] if len(shaped) == 1 else shaped

    def step_function(self, method: str) -> ca.Function:
        """The CasADi function of one step; see ``core.integrators``."""
        if method not in METHODS:
            raise InputError(f"unknown method {method!r}: expected one of {', '.join(METHODS)}")
        if method not in self._steps:
            linearization = self.model.linearization if method == "implicit" else None
            self._steps[method] = step_function(self.model.forward_dynamics, method, linearization)
        return self._steps[method]

    def rollout(
        self,
        x0: ArrayLike,
        steps: int,
        step: float,
        *,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        p: ArrayLike | None = None,
        substeps: int = 1,
        method: str = "rk4",
    ) -> Array:
        """Integrate from one state or from many, in one call per rollout.

        Parameters
        ----------
        x0 : (nx,) or (count, nx) array_like
            Initial state or states.
        steps : int
            Number of steps to keep.
        step : float
            Time between them [s].
        u, w : array_like, optional
            Inputs and forces: one row (constant), or ``2 * steps * substeps + 1`` rows at half sub-steps; zero where
            not given. With many states, (count, size) gives each its own constant.
        p : (np,) array_like, optional
            Parameters; nominal where not given.
        substeps : int
            Steps of the method per step.
        method : {"rk4", "implicit"}
            Integration method.

        Returns
        -------
        ndarray
            (steps + 1, nx), or (count, steps + 1, nx).

        Raises
        ------
        InputError
            If shapes do not fit.
        NumericalError
            If a state is not finite; ``result`` holds the states before it.
        """
        model = self.model
        start = np.ascontiguousarray(x0, dtype=float)
        if start.ndim == 2:
            return np.stack(
                [
                    self.rollout(
                        row,
                        steps,
                        step,
                        u=_own(u, k, len(start), model.nu),
                        w=_own(w, k, len(start), model.nw),
                        p=p,
                        substeps=substeps,
                        method=method,
                    )
                    for k, row in enumerate(start)
                ]
            )
        if start.shape != (model.nx,):
            raise InputError(f"x0: expected {model.nx} entries, got shape {start.shape}")
        if steps < 1 or substeps < 1 or not step > 0.0:
            raise InputError(f"steps, substeps and step must be positive, got {steps}, {substeps}, {step}")
        rows = 2 * steps * substeps + 1
        inputs = _signal("u", u, model.nu, rows)
        forces = _signal("w", w, model.nw, rows)
        parameters = _row("p", model.p_nominal if p is None else p, model.np)
        run = self._rollout_unit(method)
        states, kept = run(start, steps, substeps, step / substeps, inputs, forces, parameters)
        if kept < steps:
            reached = states[: kept + 1]
            raise NumericalError(
                f"the state is not finite after t = {kept * step:g} s (last finite state {reached[-1].tolist()}): "
                "the step is too large for this scene, or the finger left the range of the model; try a smaller "
                "step, more substeps or method='implicit'",
                time=kept * step,
                state=reached[-1],
                result=reached,
            )
        return states

    def _rollout_unit(self, method: str) -> Callable[..., tuple[Array, int]]:
        unit = f"{method}_rollout"
        if unit not in self._units:
            step = self.step_function(method)
            library = self._library(rollout_source(step))
            self._units[unit] = _Rollout(step, library)
        return self._units[unit]  # type: ignore[no-any-return]

    def _library(self, source: str) -> ctypes.CDLL | None:
        if self._compiler is None:
            return None
        try:
            return ctypes.CDLL(str(library_for(source, self._compiler)))
        except (CompileError, OSError) as error:
            _warn(f"compiling failed ({error})")
            self._compiler = None
            return None


class _Caller:
    """One function on numpy arrays."""

    def __init__(self, function: ca.Function, library: ctypes.CDLL | None, nominal: Array) -> None:
        self.function = function
        self.names = function.name_in()
        self._sizes = [function.nnz_in(k) for k in range(function.n_in())]
        self._nominal = nominal
        self._code = getattr(library, function.name()) if library is not None else None
        # Buffers with fixed addresses, so that a call passes nothing but pointers that are ready.
        self._inputs = [np.zeros(size) for size in self._sizes]
        self._outputs = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        self._work = np.zeros(max(function.sz_w(), 1))
        self._integers = np.zeros(max(function.sz_iw(), 1), dtype=np.int64)
        self._arguments = (
            (_DOUBLES * max(function.sz_arg(), 1))(*[_pointer(a) for a in self._inputs]),
            (_DOUBLES * max(function.sz_res(), 1))(*[_pointer(a) for a in self._outputs]),
            ctypes.c_void_p(self._integers.ctypes.data),
            _pointer(self._work),
            0,
        )
        self._lock = Lock()

    def __call__(self, *arguments: ArrayLike | None, **named: ArrayLike | None) -> Any:
        values = list(arguments) + [None] * (len(self.names) - len(arguments))
        for name, value in named.items():
            if name not in self.names:
                raise InputError(f"{self.function.name()}: unknown input {name!r}, expected {', '.join(self.names)}")
            values[self.names.index(name)] = value
        rows = self.rows(values)
        if any(row.ndim != 1 for row in rows):
            raise InputError(f"{self.function.name()}: one state expected; use batch for many")
        shaped = tuple(_shaped(self.function, k, out[None])[0] for k, out in enumerate(self.call(rows)))
        return shaped[0] if len(shaped) == 1 else shaped

    def rows(self, values: Sequence[ArrayLike | None]) -> list[Array]:
        """Contiguous inputs, each one row or a row per state."""
        if len(values) > len(self.names):
            raise InputError(f"{self.function.name()}: {len(self.names)} inputs expected, got {len(values)}")
        values = [*values, *[None] * (len(self.names) - len(values))]
        rows = []
        for name, size, value in zip(self.names, self._sizes, values, strict=True):
            if value is None:
                rows.append(self._nominal if name == "p" else np.zeros(size))
                continue
            array = np.ascontiguousarray(value, dtype=float)
            if array.ndim == 0 or (array.ndim == 1 and size == 1 and array.size == 1):
                array = np.full(size, float(array.ravel()[0])) if size == 1 else array.reshape(-1)
            if array.ndim > 2 or (array.shape[-1] != size and not (array.size == 0 and size == 0)):
                raise InputError(
                    f"{self.function.name()}: {name} has {size} entries, got an array of shape {np.shape(value)}"
                )
            rows.append(array)
        return rows

    def call(self, rows: Sequence[Array]) -> list[Array]:
        """Evaluate on one row per input."""
        if self._code is None:
            results = self.function.call([ca.DM(row) for row in rows])
            return [np.array(r.nonzeros()) for r in results]
        with self._lock:
            for buffer, row in zip(self._inputs, rows, strict=True):
                buffer[:] = row
            self._code(*self._arguments)
            return [buffer.copy() for buffer in self._outputs]


class _Rollout:
    """Many steps in one call."""

    def __init__(self, step: ca.Function, library: ctypes.CDLL | None) -> None:
        self._step = step
        self._code = None
        if library is not None:
            self._code = getattr(library, f"{step.name()}_rollout")
            self._code.restype = ctypes.c_longlong

    def __call__(
        self, x0: Array, keep: int, sub: int, h: float, u: Array, w: Array, p: Array
    ) -> tuple[Array, int]:
        states = np.empty((keep + 1, len(x0)))
        if self._code is None:
            return states, self._on_virtual_machine(states, x0, keep, sub, h, u, w, p)
        work = np.empty(max(self._step.sz_w(), 1))
        integers = np.empty(max(self._step.sz_iw(), 1), dtype=np.int64)
        kept = self._code(
            ctypes.c_longlong(keep),
            ctypes.c_longlong(sub),
            ctypes.c_double(h),
            _pointer(x0),
            _pointer(u),
            ctypes.c_longlong(0 if len(u) == 1 else u.shape[1]),
            _pointer(w),
            ctypes.c_longlong(0 if len(w) == 1 else w.shape[1]),
            _pointer(p),
            ctypes.c_void_p(integers.ctypes.data),
            _pointer(work),
            _pointer(states),
        )
        return states, int(kept)

    def _on_virtual_machine(
        self, states: Array, x0: Array, keep: int, sub: int, h: float, u: Array, w: Array, p: Array
    ) -> int:
        chain = self._step.mapaccum("chain", sub)
        states[0] = x0
        for k in range(keep):
            at = 2 * k * sub
            window = [u[at + i : at + i + 2 * sub - 1 : 2] if len(u) > 1 else u for i in range(3)]
            pushes = [w[at + i : at + i + 2 * sub - 1 : 2] if len(w) > 1 else w for i in range(3)]
            wide = [
                np.broadcast_to(v, (sub, v.shape[1])).T if len(v) == 1 else v.T for v in (*window, *pushes)
            ]
            result = chain(states[k], *[ca.DM(v) for v in wide], ca.repmat(ca.DM(p), 1, sub), ca.DM([[h] * sub]))
            states[k + 1] = np.array(result[:, -1]).ravel()
            if not np.all(np.isfinite(states[k + 1])):
                return k
        return keep


def _pointer(array: Array) -> Any:
    return ctypes.cast(array.ctypes.data, _DOUBLES)


def _pointers(arrays: Sequence[Array]) -> Any:
    return (_DOUBLES * max(len(arrays), 1))(*[_pointer(a) for a in arrays])


def _shaped(function: ca.Function, k: int, rows: Array) -> Array:
    """Rows of an output in its own shape; CasADi is column-major."""
    height, width = function.size_out(k)
    if width == 1:
        return rows
    return np.ascontiguousarray(rows.reshape(len(rows), width, height).transpose(0, 2, 1))


def _row(name: str, value: ArrayLike, size: int) -> Array:
    array = np.ascontiguousarray(value, dtype=float).reshape(-1)
    if array.size != size:
        raise InputError(f"{name}: expected {size} entries, got {array.size}")
    return array


def _signal(name: str, value: ArrayLike | None, size: int, rows: int) -> Array:
    if value is None:
        return np.zeros((1, size))
    array = np.ascontiguousarray(value, dtype=float)
    if array.ndim <= 1:
        return _row(name, array, size)[None]
    if array.shape != (rows, size):
        raise InputError(f"{name}: expected ({size},) or ({rows}, {size}), got {array.shape}")
    return array


def _own(value: ArrayLike | None, k: int, count: int, size: int) -> ArrayLike | None:
    array = None if value is None else np.asarray(value, dtype=float)
    return array[k] if array is not None and array.shape == (count, size) else array


def _warn(why: str) -> None:
    if not _Warned.done:
        _Warned.done = True
        warnings.warn(
            f"{why}: running on CasADi's virtual machine, which gives the same numbers 20 to 100 times slower",
            RuntimeWarning,
            stacklevel=4,
        )
