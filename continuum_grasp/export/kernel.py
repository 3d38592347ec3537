"""Strict C of one CasADi function, and the same arithmetic on numpy arrays, to the last bit.

CasADi's own generator writes calls of the mathematical library, literals of one precision and names of its own. This
one walks the same instructions and writes single assignments of additions, multiplications, divisions and comparisons,
so that every compiler that keeps to IEEE 754 (and does not fuse multiplications with additions) finds the same bits.
"""

from __future__ import annotations

import ctypes
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.core import OPERATORS, Compiler, CReal, straight_function
from continuum_grasp.export.build import strict_library
from continuum_grasp.export.fields import fill
from continuum_grasp.export.strict_math import FUNCTIONS, c_source, reference

_NAMES = {value: name for name, value in vars(ca).items() if name.startswith("OP_")}
_C: dict[int, str] = OPERATORS | {
    ca.OP_INV: "{one} / {0}",
    ca.OP_FABS: "{0} < {zero} ? -{0} : {0}",
    ca.OP_SIGN: "{0} < {zero} ? -{one} : ({0} > {zero} ? {one} : {zero})",
    ca.OP_FMIN: "{0} < {1} ? {0} : {1}",
    ca.OP_FMAX: "{0} > {1} ? {0} : {1}",
    ca.OP_LT: "{0} < {1} ? {one} : {zero}",
    ca.OP_LE: "{0} <= {1} ? {one} : {zero}",
    ca.OP_EQ: "{0} < {1} || {0} > {1} ? {zero} : {one}",
    ca.OP_NE: "{0} < {1} || {0} > {1} ? {one} : {zero}",
    ca.OP_AND: "({0} < {zero} || {0} > {zero}) && ({1} < {zero} || {1} > {zero}) ? {one} : {zero}",
    ca.OP_OR: "{0} < {zero} || {0} > {zero} || {1} < {zero} || {1} > {zero} ? {one} : {zero}",
    ca.OP_NOT: "{0} < {zero} || {0} > {zero} ? {zero} : {one}",
    ca.OP_IF_ELSE_ZERO: "{0} < {zero} || {0} > {zero} ? {1} : {zero}",
}
"""C by operation; arguments are names or literals."""
_NUMPY: dict[int, Callable[..., Array]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_INV: lambda a: a.dtype.type(1) / a,
    ca.OP_FABS: lambda a: np.where(a < 0, -a, a),
    ca.OP_SIGN: lambda a: np.where(a < 0, -a.dtype.type(1), np.where(a > 0, a.dtype.type(1), a.dtype.type(0))),
    ca.OP_FMIN: lambda a, b: np.asarray(np.where(a < b, a, b)),
    ca.OP_FMAX: lambda a, b: np.asarray(np.where(a > b, a, b)),
    ca.OP_LT: lambda a, b: (a < b).astype(a.dtype),
    ca.OP_LE: lambda a, b: (a <= b).astype(a.dtype),
    ca.OP_EQ: lambda a, b: (~((a < b) | (a > b))).astype(a.dtype),
    ca.OP_NE: lambda a, b: ((a < b) | (a > b)).astype(a.dtype),
    ca.OP_AND: lambda a, b: (((a < 0) | (a > 0)) & ((b < 0) | (b > 0))).astype(a.dtype),
    ca.OP_OR: lambda a, b: ((a < 0) | (a > 0) | (b < 0) | (b > 0)).astype(a.dtype),
    ca.OP_NOT: lambda a: (~((a < 0) | (a > 0))).astype(a.dtype),
    ca.OP_IF_ELSE_ZERO: lambda a, b: np.where((a < 0) | (a > 0), b, a.dtype.type(0)),
}
_CALLS = {getattr(ca, f"OP_{name.upper()}"): name for name in FUNCTIONS} | {ca.OP_CONSTPOW: "pow"}
MOST_INSTRUCTIONS = 45_000
"""Instructions of one function without loops: of 15,000, 33,000 and 55,000, gcc 12 took 5, 17 and 48 s and 0.2, 0.5 and
1.3 GB (-O2, one core); so many stay within 1 GB."""
_SHOWN = {"SQ": "*", "MUL": "*", "ADD": "+", "SUB": "-", "TWICE": "+", "DIV": "/", "INV": "/"}


class Kernel:
    """A CasADi function as C without a library: an SX function with named inputs and outputs.

    ``name`` stands behind the prefix of the package, ``text`` is what it computes, in one line. ``inputs`` and
    ``outputs`` are sizes by name; inputs that the function does not read are left out, and outputs without an entry.
    InputError where an operation has no strict C here, or where there are more than ``MOST_INSTRUCTIONS``.

    Outputs may be the inputs themselves, and all their entries are written. Of a function that is ``called`` by others
    inputs and outputs are apart, of outputs the structural nonzeros are written, and from the first one that is null on
    nothing is computed.
    """

    def __init__(self, name: str, function: ca.Function, text: str, *, called: bool = False) -> None:
        self.name = name
        self.text = text
        self._called = called
        symbols = function.sx_in()
        values = zip(function.name_out(), function.call(symbols), strict=True)
        # Structural zeros too are written to arrays and structs, of which C must fill every entry.
        outputs = {n: value if called else ca.densify(value) for n, value in values if value.numel()}
        self._function = f = ca.Function(name, symbols, list(outputs.values()), function.name_in(), list(outputs))
        self.check_size(name, f.n_instructions())
        self._operations = [f.instruction_id(k) for k in range(f.n_instructions())]
        for operation in set(self._operations) - {*_C, *_CALLS, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}:
            raise InputError(f"{name}: there is no strict C for the operation {_NAMES[operation]} of its expressions")
        # Arguments and results, asked for once: that takes longer than the arithmetic on many rows.
        self._program: list[tuple[int, list[Any], list[int]]] = [
            (o, [f.instruction_constant(k)] if o == ca.OP_CONST else f.instruction_input(k), f.instruction_output(k))
            for k, o in enumerate(self._operations)
        ]
        read = {arguments[0] for operation, arguments, _ in self._program if operation == ca.OP_INPUT}
        self.inputs = {f.name_in(k): f.nnz_in(k) for k in range(f.n_in()) if k in read}
        self.outputs = {f.name_out(k): f.nnz_out(k) for k in range(f.n_out()) if f.nnz_out(k)}

    @classmethod
    def of(
        cls, name: str, given: Mapping[str, ca.SX], found: Mapping[str, ca.SX], text: str, *, called: bool = False
    ) -> Kernel:
        """A kernel of expressions by name, which computes what they share once."""
        return cls(name, straight_function(name, given, found), text, called=called)

    @staticmethod
    def check_size(name: str, count: int, most: int = MOST_INSTRUCTIONS) -> None:
        """Refuse a function of so many instructions, before its C is written."""
        if count > most:
            raise InputError(
                f"{name} has about {count} instructions without loops, for which compilers take minutes: expected at "
                f"most {most}; use fewer elements, or omit the part that needs it",
                key="what",
            )

    @staticmethod
    def all_c_source(kernels: Sequence[Kernel], prefix: str, real: CReal) -> str:
        """C of kernels, behind the C of the mathematical functions that they call."""
        strict = c_source(set().union(*(kernel.calls for kernel in kernels)), real, prefix)
        texts = [kernel.c_source(prefix, real) for kernel in kernels]
        return "\n".join([strict, *texts] if strict else texts)

    @property
    def calls(self) -> set[str]:
        """Mathematical functions that it needs, of ``strict_math``."""
        return {_CALLS[operation] for operation in self._operations if operation in _CALLS}

    @property
    def operations(self) -> Counter[str]:
        """Number of operations of each kind."""
        found = Counter[str]()
        for operation, count in Counter(self._operations).items():
            name = _NAMES[operation].removeprefix("OP_")
            if name not in ("INPUT", "OUTPUT", "CONST", "ASSIGN"):
                found[_SHOWN.get(name, name.lower())] += count
        return found

    def prototype(self, prefix: str) -> str:
        """The C declaration, without the semicolon."""
        arguments = [f"const {prefix}_real *{name}" for name in self.inputs]
        arguments += [f"{prefix}_real *{name}" for name in self.outputs]
        return f"void {prefix}_kernel_{self.name}({', '.join(arguments)})"

    def call(self, prefix: str, **arguments: str) -> str:
        """C that calls it, with an expression for each input and output, its own name where none is given."""
        operands = ", ".join(arguments.get(name, name) for name in (*self.inputs, *self.outputs))
        return f"{prefix}_kernel_{self.name}({operands});"

    def c_source(self, prefix: str, real: CReal) -> str:
        """C in single assignments."""
        f = self._function
        kind = f"{prefix}_real"
        # By places of CasADi's work vector, which are used again: each holds the name that was written to it last.
        values: dict[int, str] = {}
        loads: dict[tuple[int, int], str] = {}
        lines: list[str] = []
        left = list(self.outputs.values())  # entries that are not written yet
        words = {"zero": real.literal(0.0), "one": real.literal(1.0)}
        for k, (operation, arguments, results) in enumerate(self._program):
            if operation == ca.OP_CONST:
                values[results[0]] = real.literal(arguments[0])
                continue
            if operation == ca.OP_INPUT:
                at = (arguments[0], arguments[1])
                if self._called and at not in loads:
                    lines.append(f"  const {kind} {f.name_in(at[0])}{at[1]} = {f.name_in(at[0])}[{at[1]}];")
                values[results[0]] = loads.setdefault(at, f"{f.name_in(at[0])}{at[1]}")
                continue
            operands = [values[a] for a in arguments]
            if operation == ca.OP_OUTPUT:
                lines.append(f"  {f.name_out(results[0])}[{results[1]}] = {operands[0]};")
                left[results[0]] -= 1
                if self._called and not any(left[: results[0] + 1]) and any(left):
                    lines.append(f"  if (!{f.name_out(results[0] + 1)}) return;")
                continue
            if operation in _CALLS:
                text = f"strict_{_CALLS[operation]}({', '.join(operands)})"
            else:
                text = _C[operation].format(*operands, **words)
            lines.append(f"  const {kind} a{k} = {text};")
            values[results[0]] = f"a{k}"
        # All inputs are read before the first output is written, so that outputs may be the inputs themselves. Where
        # they are apart, each is read where it is needed: with few registers, it would be stored and loaded again.
        inputs = [f"  const {kind} {name} = {f.name_in(i)}[{j}];" for (i, j), name in sorted(loads.items())]
        head = [f"/* {self.text} */", self.prototype(prefix), "{"]
        return "\n".join([*head, *(() if self._called else inputs), *lines, "}", ""])

    def evaluate(self, real: CReal, **rows: Array) -> dict[str, Array]:
        """Evaluate as the C does, to the last bit, for rows (count, size) of inputs by name; outputs of the same
        form.
        """
        f, t = self._function, real.dtype
        columns = {name: np.asarray(rows[name], dtype=t) for name in self.inputs}
        count = len(next(iter(rows.values())))
        outputs = {name: np.zeros((count, size), dtype=t) for name, size in self.outputs.items()}
        values: dict[int, Array] = {}
        with np.errstate(all="ignore"):
            for operation, arguments, results in self._program:
                if operation == ca.OP_OUTPUT:
                    outputs[f.name_out(results[0])][:, results[1]] = values[arguments[0]]
                elif operation == ca.OP_CONST:
                    values[results[0]] = np.full(count, t(arguments[0]))
                elif operation == ca.OP_INPUT:
                    values[results[0]] = columns[f.name_in(arguments[0])][:, arguments[1]]
                elif operation in _CALLS:
                    values[results[0]] = reference(_CALLS[operation], *(values[a] for a in arguments), real=real)
                else:
                    values[results[0]] = _NUMPY[operation](*(values[a] for a in arguments))
        return outputs

    def compiled(self, real: CReal) -> Callable[..., dict[str, Array]]:
        """``evaluate`` by the C itself, in a quarter of the time for many rows; by numpy without a compiler."""
        if Compiler.find() is None:
            return partial(self.evaluate, real)
        arguments = [*self.inputs.items(), *self.outputs.items()]
        source = f"{c_source(self.calls, real, 'c')}\n{self.c_source('c', real)}"
        words = {"real": real.name, "source": source, "arguments": arguments, "kernel": self.name}
        library = strict_library({"rows.c": fill("tests/rows.c", words)})

        def evaluate(**rows: Array) -> dict[str, Array]:
            count = len(rows[next(iter(self.inputs))])
            outputs = {name: np.zeros((count, size), dtype=real.dtype) for name, size in self.outputs.items()}
            given = [np.ascontiguousarray(rows[name], dtype=real.dtype) for name in self.inputs]
            pointers = (ctypes.c_void_p(array.ctypes.data) for array in (*given, *outputs.values()))
            library.rows(ctypes.c_long(count), *pointers)
            return outputs

        return evaluate
