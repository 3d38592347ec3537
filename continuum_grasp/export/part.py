"""Parts of a package, each with kernels, structs, public functions and their truth.

A part is what ``--what`` names. It brings the strict kernels, the structs of the header and the public functions, each
with the C between its checked inputs and its outputs and with a reference that computes the same bits from arrays.
Checks, declarations, documentation, test vectors and bindings all follow from that. A part written by hand in C
(estimator and controller) brings its text in ``sources`` and ``declarations``, its functions in ``stateful``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.export.fields import Field, Struct, each_once
from continuum_grasp.export.kernel import Kernel

Rows = Mapping[str, Array]
"""Inputs of many calls: (count, size) by the name of the argument."""
Reference = Callable[[Rows], tuple[Array, Array]]
"""Rows of the output (count, size) and the codes (count) that the C must return."""


class Code(IntEnum):
    """Zero: done; above: the output is good, with a warning; below: the output was not touched."""

    text: str
    advice: str

    def __new__(cls, value: int, text: str, advice: str) -> Code:
        """Make a code with its explanation, and what a caller does about it."""
        made = int.__new__(cls, value)
        made._value_ = value
        made.text, made.advice = text, advice
        return made

    OK = 0, "done", "use the output"
    WARN_COARSE_STEP = 1, "done; the step is stable but too long to be accurate", "take shorter steps"
    WARN_LEFT_RANGE = (
        2,
        "done; the state (of a step: the next one) is out of range, and no step will take it",
        "do not go on from this state",
    )
    WARN_ITERATION_LIMIT = (
        3,
        "done; the command is of a new plan that was not solved to its tolerance",
        "apply the command; where it is so in most calls, raise `controller.iterations` of the scene",
    )
    WARN_BOUND_LEFT = (
        4,
        "done; the command is of a new plan that leaves a soft bound",
        "apply the command; the plan returns to the bound as soon as it can",
    )
    WARN_PREVIOUS_PLAN = (
        5,
        "no new plan; the command is of the last one",
        "apply the command, and log why (diagnosis); single calls are no harm",
    )
    WARN_SAFE_RAMP = (
        6,
        "no plan; the command is en route to the safe one",
        "apply the command, stop what the finger was doing, and find the cause (diagnosis) before it goes on",
    )
    WARN_ESTIMATE_RESTARTED = (
        7,
        "the estimate was not finite or out of its range; the estimator started again",
        "do not act on the estimate until it has settled",
    )
    WARN_BEYOND_LIMIT = (
        8,
        "done; the command is on its way to a limit that it is beyond, as fast as its rate allows",
        "apply the command",
    )
    ERR_NULL = -1, "a pointer is null", "correct the call: outputs were left alone"
    ERR_NON_FINITE = (
        -2,
        "an input or a parameter is NaN or infinite",
        "hold the last command; correct the number",
    )
    ERR_RANGE = (
        -3,
        "an input or a parameter is out of its range",
        "hold the last command; bring the number into its range",
    )
    ERR_STEP = -4, "the step is not above zero or too long to be stable", "take a step within the table below"
    ERR_RESULT = -5, "the result is not finite", "do not go on from this state"
    ERR_ABI = (
        -6,
        "the passed memory was not initialized, or by another version of this library",
        "initialize it; compile caller and library with the same header",
    )
    ERR_CONFIGURATION = (
        -7,
        "the library was made from another configuration than its caller was compiled for",
        "compile caller and library from the same package",
    )


@dataclass(frozen=True)
class Bad:
    """A row with one number replaced."""

    row: int
    entry: int
    value: float
    code: Code


ROW_FLAGS = 4
"""Numbers before the others of a row of a stateful function: begin anew, late, whether something else was applied, and
the kind of the call."""


@dataclass(frozen=True)
class Vectors:
    """Rows of one function: inputs (count, inputs), outputs (count, outputs), codes (count); and bad inputs."""

    name: str
    runner: str
    """C of the check program that runs a row."""
    inputs: Array
    outputs: Array
    codes: NDArray[np.int_]
    bad: tuple[Bad, ...]
    pointers: int
    """Count of its arguments that may be null."""
    close: int
    """Count of the outputs, the first ones, that must agree where rounding may differ."""
    stateful: bool = False
    """Whether a row depends on those before, by the memory of the function; such rows have ``ROW_FLAGS`` first."""

    @property
    def count(self) -> int:
        """Cases in all."""
        return len(self.inputs) + len(self.bad)


@dataclass(frozen=True)
class Argument:
    """An argument of a public function: a struct by its address, or a number."""

    name: str
    kind: Struct | Field
    array: str
    """Name of its numbers in the body: an array, or the number itself."""
    code: Code = Code.ERR_RANGE
    """Code returned where a number of the argument is out of range."""
    drawn: bool = False
    """Whether numbers out of their range are taken; the function warns then."""

    @property
    def is_struct(self) -> bool:
        """Whether it is passed by its address."""
        return isinstance(self.kind, Struct)

    @property
    def is_member(self) -> bool:
        """Whether it is a struct of the model."""
        return self.name == "parameters"

    @property
    def fields(self) -> tuple[Field, ...]:
        return self.kind.fields if isinstance(self.kind, Struct) else (self.kind,)

    @property
    def numbers(self) -> list[Field]:
        return [field for field in self.fields for _ in range(field.size)]

    @property
    def size(self) -> int:
        """Count of numbers."""
        return self.kind.size


@dataclass(frozen=True)
class Call:
    """A public function of the package.

    Its C takes the model, the inputs and the address of the output, and returns a code. Inputs arrive in ``body``
    checked, under the names of their arrays, the parameters as ``p``; the body fills ``result``, and may set ``code``
    to a warning or return an error. The reference is given the rows by the same names.
    """

    name: str
    text: str
    inputs: tuple[Argument, ...]
    output: Argument
    body: str
    reference: Reference
    guard: str = ""
    """C that may return an error once its inputs are in range each."""
    codes: tuple[Code, ...] = ()
    """Warnings and errors that it may return beyond the common ones of all functions."""
    compiled: Reference | None = None
    """The reference of many rows by compiled C, of the same bits; None where it is no faster."""


NUMBER = "number"
"""Input of a method that is a number instead of a struct."""


class PartMethod(NamedTuple):
    """A further function of a stateful one, ``<prefix>_<owner>_<name>``, of structs or a number.

    It writes a struct or returns a number.
    """

    name: str
    text: str
    inputs: list[str]
    output: str | None


@dataclass(frozen=True)
class Stateful:
    """A public function that keeps something between its calls, in memory of its caller."""

    name: str
    text: str
    runner: str
    """C of the check program that runs it on a row."""
    types: tuple[str, ...]
    """Types of what it keeps and works in; the check program has one of each, of the same name."""
    inputs: tuple[str, ...]
    output: str
    methods: tuple[PartMethod, ...] = ()


@dataclass(frozen=True)
class PackagePart:
    """An entry of ``--what``."""

    name: str
    kernels: Sequence[Kernel]
    calls: tuple[Call, ...]
    constants: Mapping[str, str] = field(default_factory=dict)
    """C expressions of ``#define``s of the header, by name behind the prefix."""
    declarations: str = ""
    """C of the header behind the functions of ``calls``: further functions and what they need."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Further files, by path in the package; C under ``src`` becomes part of the library."""
    further: tuple[Struct, ...] = ()
    """Structs beyond the ones of ``calls``."""
    codes: tuple[Code, ...] = ()
    """Codes beyond the ones of ``calls``."""
    stateful: tuple[Stateful, ...] = ()
    """Functions that keep something."""

    @property
    def structs(self) -> list[Struct]:
        """Structs of its functions, each once."""
        kinds = [argument.kind for call in self.calls for argument in (*call.inputs, call.output)]
        return each_once([*(kind for kind in kinds if isinstance(kind, Struct)), *self.further])
