"""Variables of a functional mock-up unit: what its C and its modelDescription.xml have in common."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from numpy.typing import NDArray

from continuum_grasp.export import Field

Kind = Literal["input", "tunable", "fixed", "state", "output", "rate"]
_C_KINDS = {
    "input": "FMU_INPUT",
    "tunable": "FMU_TUNABLE",
    "fixed": "FMU_START",
    "state": "FMU_START",
    "output": "FMU_RESULT",
    "rate": "FMU_RESULT",
}


@dataclass(frozen=True, kw_only=True)
class Variable(Field):
    """A real variable; its range is infinite where any number will do.

    A ``fixed`` variable is a parameter that is set before the simulation alone; a ``state`` an output whose ``start``
    may be set until then; a ``rate`` the derivative of the state as many places behind the first rate.
    ``may_be_missing``: whether NaN stands for a value that is not there.
    """

    kind: Kind
    start: float = 0.0
    may_be_missing: bool = False

    @property
    def nominal(self) -> float | None:
        """Size of usual values."""
        return self.usual or (abs(self.start) if self.kind == "tunable" and self.start != 0.0 else None)

    @property
    def c_source(self) -> str:
        """Row of the variable in the table in C."""
        low = max(self.low, -sys.float_info.max)
        high = min(self.high, sys.float_info.max)
        numbers = ", ".join(repr(float(value)) for value in (self.start, low, high))
        return f'  {{"{self.name}", "{self.unit}", {numbers}, {_C_KINDS[self.kind]}, {int(self.may_be_missing)}}}'


@dataclass(frozen=True)
class UnitContents:
    """Contents of a functional mock-up unit."""

    identifier: str
    """Name of files and symbols; a C identifier."""
    title: str
    what: str
    """Part of the scene that this is, in words."""
    step: float
    """Internal step [s]; the longest one where communication steps of any length are taken."""
    any_step: bool
    """Whether communication steps may have any length, or are whole multiples of the internal step."""
    stop: float
    """End of the scene [s]."""
    groups: Mapping[str, tuple[Variable, ...]]
    """Real variables, side by side like the members of a struct, by the name of their place in C; value references are
    the places in this order, whole numbers behind them."""
    counts: tuple[Variable, ...]
    continuous: bool
    """Whether real variables change between steps, or from one step to the next alone."""
    linear: bool
    """Whether there are directional derivatives."""
    feedthrough: bool
    """Whether outputs that are no states depend on the inputs of now."""
    glue: tuple[str, ...]
    """Templates of the C between library and standard: of types, then of functions."""
    words: Mapping[str, Any]
    """Words of these templates."""
    sources: Mapping[str, str]
    """C of the library by file name."""
    flags: tuple[str, ...]
    """Flags of the compiler, for the same bits everywhere."""
    manifest: Mapping[str, Any] = field(repr=False)
    """Origin of the library: what it was made from."""

    @property
    def variables(self) -> list[Variable]:
        return [variable for group in self.groups.values() for variable in group]

    @property
    def places(self) -> dict[str, int]:
        """Beginnings of the groups."""
        starts = itertools.accumulate((len(group) for group in self.groups.values()), initial=0)
        return dict(zip(self.groups, starts, strict=False))


def variables_of(
    group: str,
    kind: Kind,
    entries: Iterable[Field],
    starts: Sequence[float] | NDArray[Any] | None = None,
    *,
    may_be_missing: bool = False,
) -> tuple[Variable, ...]:
    """Variables ``group.name`` of the fields of a struct, with their values to begin with."""
    variables = []
    for k, entry in enumerate(entries):
        start = 0.0 if starts is None else float(starts[k])
        same = {**vars(entry), "name": f"{group}.{entry.name}"}
        variables.append(Variable(**same, kind=kind, start=start, may_be_missing=may_be_missing))
    return tuple(variables)


def count(name: str, text: str) -> Variable:
    """A whole number that is an output."""
    return Variable(name, "", text, kind="output")


TIP = variables_of(
    "tip",
    "output",
    [
        Field("x", "m", "of the tip in the world"),
        Field("y", "m", "of the tip in the world"),
        Field("angle", "rad", "of the tip; its tangent is (-sin, cos) of it"),
    ],
)
"""Position and angle of the tip."""
