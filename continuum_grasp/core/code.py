"""Code that runs a function: interpreted by CasADi's virtual machine, or machine code, compiled where that pays.

How often a function is called is announced before it starts, or counted. It is compiled when interpreting the calls
so far and those announced takes longer than compiling it and running the result: whatever follows, all takes at most
twice the time that it would take with all calls known before (A. R. Karlin et al., Competitive snoopy caching,
Algorithmica 3, 1988, doi:10.1007/BF01762111). Calls that earlier runs announced count, too, so that what runs again and
again is compiled by one of its runs. Code that is in the cache costs no compiling.

The C of controllers cannot be interpreted and is always compiled: quickly, or optimized if this pays. If
``CONTINUUM_GRASP_QUICK_COMPILE`` is set, it decides: 1 for code that is compiled quickly, 0 for optimized code.

The seconds below are measured by ``python -m benchmarks.bench_code``.
"""

from __future__ import annotations

import ctypes
import math
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import casadi as ca

from continuum_grasp.core.cache import Cache
from continuum_grasp.core.compiler import CompileError, Compiler, quick_compile

_EARLIER = Cache("earlier", ".txt")
"""Number of calls, or of instructions, that code ran without optimization."""
_WARNED: set[str] = set()
"""Reports of missing or failing compilers so far."""


class CodeKind(StrEnum):
    """Kind of code that runs a function."""

    OPTIMIZED = "optimized"
    QUICK = "quickly compiled"
    INTERPRETED = "interpreted"

    @staticmethod
    def forced() -> CodeKind | None:
        """Kind of code that the environment asks for; None where the rule of this file decides."""
        if not os.environ.get("CONTINUUM_GRASP_QUICK_COMPILE"):
            return None
        return CodeKind.QUICK if quick_compile() else CodeKind.OPTIMIZED

    @staticmethod
    def force_optimized() -> None:
        """Optimize all code of this process and of its child processes."""
        os.environ["CONTINUUM_GRASP_QUICK_COMPILE"] = "0"

    @staticmethod
    def of_source(source: str, instructions: float = math.inf) -> CodeKind:
        """Return the kind of code for C that cannot be interpreted, from the number of instructions of a run."""
        if (kind := CodeKind.forced()) is not None:
            return kind
        compiler = Compiler.find()
        if compiler is None or math.isinf(instructions) or compiler.is_known(source, quick=False):
            return CodeKind.OPTIMIZED
        lines = source.count("\n")
        identity = compiler.identity(source)
        total = _EARLIER.total(identity) + instructions

        def seconds(kind: CodeKind) -> float:
            file, line = _COMPILING[kind]
            known = kind is CodeKind.QUICK and compiler.is_known(source, quick=True)
            return (0.0 if known else file + lines * line) + total * _RUNNING[kind]

        kind = min(CodeKind.OPTIMIZED, CodeKind.QUICK, key=seconds)
        if kind is CodeKind.QUICK:
            _EARLIER.total(identity, instructions)
        return kind


_WRITING = 5e-6
"""Seconds of writing a line of C."""
_COMPILING = {CodeKind.OPTIMIZED: (0.15, 0.24e-3), CodeKind.QUICK: (0.1, 0.06e-3)}
"""Seconds of compiling a file, and a line of it (gcc 12, one core of an AMD EPYC)."""
_RUNNING = {CodeKind.OPTIMIZED: 1.3e-9, CodeKind.QUICK: 8e-9, CodeKind.INTERPRETED: 7.3e-9}
"""Seconds of an instruction. Quickly compiled code stores each result in memory, as the virtual machine does: a
function that can be interpreted is never compiled quickly."""
_OPERATION = 0.2e-6
"""Seconds of an operation of the virtual machine on whole matrices: a call, or a product."""
_CALL_FROM_PYTHON = 100
"""Operations that a call from Python takes as long as: 20 us."""


@dataclass(frozen=True)
class Size:
    """Size of a function: lines of its C, instructions of a call, and operations on matrices of a call."""

    lines: float
    instructions: float
    operations: float = 0.0

    @staticmethod
    def of(function: ca.Function) -> Size:
        """Return the size of a function with its calls: each function is written once, and runs once per call."""
        known: dict[int, Size] = {}
        called = _size(function, known)
        return Size(sum(each.lines for each in known.values()), called.instructions, called.operations)

    def seconds(self, kind: CodeKind) -> float:
        """Seconds of a call."""
        operations = _OPERATION * self.operations if kind is CodeKind.INTERPRETED else 0.0
        return _RUNNING[kind] * self.instructions + operations


def _size(function: ca.Function, known: dict[int, Size]) -> Size:
    """Count the lines of a function, and instructions and operations with its calls; ``known`` has all found
    functions.
    """
    key = hash(function)
    if key in known:
        return known[key]
    count = function.n_instructions() if function.is_a("SXFunction") or function.is_a("MXFunction") else 0
    if function.is_a("SXFunction"):
        known[key] = Size(count, count)
        return known[key]
    # Inputs and outputs have no expression.
    inner = [k for k in range(count) if function.instruction_id(k) not in (ca.OP_INPUT, ca.OP_OUTPUT)]
    expressions = [function.instruction_MX(k) for k in inner]
    called = [e.which_function() for e in expressions if e.is_call()]
    if not count:  # maps, switches and the like: their contents, once
        called = [function.get_function(name) for name in function.get_function()]
    sizes = [_size(each, known) for each in called]
    instructions = sum(size.instructions for size in sizes) + sum(e.nnz() for e in expressions)
    known[key] = Size(count, instructions, 1 + count + sum(size.operations for size in sizes))
    return known[key]


class Backend:
    """Runner of the functions of a model: a compiler, until it fails; without a compiler, the virtual machine.

    The log calls their code ``what``.
    """

    def __init__(self, compiled: bool = True, what: str = "the model") -> None:
        self.compiler = Compiler.find() if compiled else None
        self._what = what
        if compiled and self.compiler is None:
            warn(Compiler.why_none())

    def load(self, source: str, *, quick: bool) -> ctypes.CDLL | None:
        """The compiled library of a source; None, with a warning, where compiling fails."""
        if self.compiler is None:
            return None
        try:
            return ctypes.CDLL(str(self.compiler.library(source, self._what, quick=quick)))
        except (CompileError, OSError) as error:
            warn(f"compiling failed ({error})")
            self.compiler = None  # what failed once would fail, and take its time, with every function
            return None


class FunctionCode:
    """Code of a function, or of a program made of it: interpreted until compiling pays.

    Parameters
    ----------
    function : casadi.Function
        The function, whose size decides.
    source : callable
        Writes the C.
    backend : Backend
        Compiles it.
    from_python : bool
        Whether each call comes from Python, rather than from a loop over rows or steps.

    Attributes
    ----------
    kind : CodeKind
        Kind of code that runs now.
    """

    def __init__(
        self, function: ca.Function, source: Callable[[], str], backend: Backend, *, from_python: bool = False
    ) -> None:
        self._function, self._write, self._backend, self._from_python = function, source, backend, from_python
        self.kind = CodeKind.INTERPRETED
        self._library: ctypes.CDLL | None = None
        self._source: str | None = None
        self._calls = self._expected = self._earlier = 0.0

    def expect(self, calls: float) -> FunctionCode:
        """Announce calls, and compile now if they pay for it; an infinite number always does."""
        self._expected = self._calls + calls
        self._choose(self._expected)
        if self._source is not None and self._backend.compiler is not None:
            _EARLIER.total(self._backend.compiler.identity(self._source), calls)
        return self

    def library(self, calls: float = 1.0) -> ctypes.CDLL | None:
        """Return the library for a number of further calls; None if the virtual machine runs them."""
        self._calls += calls
        if self.kind is CodeKind.INTERPRETED:
            self._choose(max(self._calls, self._expected))
        return self._library

    @cached_property
    def _pays_from(self) -> tuple[float, float]:
        """Return the least numbers of calls that make optimized code faster, with and without this code in the
        cache.
        """
        size = Size.of(self._function)
        operations = size.operations + (_CALL_FROM_PYTHON if self._from_python else 0)
        size = Size(size.lines, size.instructions, operations)
        gain = size.seconds(CodeKind.INTERPRETED) - size.seconds(CodeKind.OPTIMIZED)
        file, line = _COMPILING[CodeKind.OPTIMIZED]
        written = _WRITING * size.lines
        return written / max(gain, 1e-12), (written + file + line * size.lines) / max(gain, 1e-12)

    def _choose(self, calls: float) -> None:
        compiler, kind = self._backend.compiler, CodeKind.forced()
        if compiler is None or self.kind is CodeKind.OPTIMIZED:
            return
        if kind is None:
            cached, compiled = self._pays_from
            if calls < cached:
                return
            if self._earlier + calls < compiled and self._source is not None:  # it was not in the cache
                return
        if self._source is None:
            self._source = self._write()
            self._earlier = _EARLIER.total(compiler.identity(self._source))
        if kind is None and self._earlier + calls < compiled and not compiler.is_known(self._source, quick=False):
            return
        kind = kind or CodeKind.OPTIMIZED
        self._library = self._backend.load(self._source, quick=kind is CodeKind.QUICK)
        if self._library is not None:
            self.kind, self._source = kind, None


def warn(why: str) -> None:
    """Report once that the virtual machine runs what should be compiled."""
    if why not in _WARNED:
        _WARNED.add(why)
        warnings.warn(
            f"{why}: running on CasADi's virtual machine, which gives the same numbers up to 20 times slower",
            RuntimeWarning,
            stacklevel=5,  # the line of the user that made the core
        )
