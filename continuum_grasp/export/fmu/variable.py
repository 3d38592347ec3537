"""Variables of a functional mock-up unit: what its C and its modelDescription.xml have in common."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from numpy.typing import NDArray

from continuum_grasp.export.control.loop import identifiers, unit_of
from continuum_grasp.export.manifest import FLAGS
from continuum_grasp.export.package import Asked, package_files
from continuum_grasp.export.parts.seen import TOUCH

Kind = Literal["input", "tunable", "fixed", "state", "output", "rate"]
_C_KINDS = {
    "input": "FMU_INPUT",
    "tunable": "FMU_TUNABLE",
    "fixed": "FMU_START",
    "state": "FMU_START",
    "output": "FMU_RESULT",
    "rate": "FMU_RESULT",
}


@dataclass(frozen=True)
class Variable:
    """A real variable.

    Attributes
    ----------
    kind : {"input", "tunable", "fixed", "state", "output", "rate"}
        What is fixed is a parameter that is set before the simulation alone; a state an output whose start may be set
        until then; a rate the derivative of the state as many places behind the first rate.
    start, low, high : float
        Ranges are infinite where any number will do; results have no start.
    nominal : float, optional
        Size of usual values.
    may_be_missing : bool
        Whether NaN stands for a value that is not there.
    """

    name: str
    unit: str
    text: str
    kind: Kind
    start: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    nominal: float | None = None
    may_be_missing: bool = False

    @property
    def c_source(self) -> str:
        """Row of the variable in the table in C."""
        low, high = max(self.low, -sys.float_info.max), min(self.high, sys.float_info.max)
        numbers = ", ".join(repr(float(value)) for value in (self.start, low, high))
        return f'  {{"{self.name}", "{self.unit}", {numbers}, {_C_KINDS[self.kind]}, {int(self.may_be_missing)}}}'


@dataclass(frozen=True)
class Unit:
    """Contents of a functional mock-up unit.

    Attributes
    ----------
    identifier : str
        Of files and symbols; a C identifier.
    title, what : str
        Name of the scene, and what of it this is, in words.
    step : float
        Internal step [s].
    stop : float
        End of the scene [s].
    groups, counts
        Real variables, side by side like the members of a struct by the name of their place in C, and whole numbers;
        value references are the places in this order.
    continuous : bool
        Whether real variables change between steps, or from one step to the next alone.
    linear : bool
        Whether there are directional derivatives.
    feedthrough : bool
        Whether outputs that are no states depend on the inputs of now.
    glue : tuple of str
        Templates of the C between library and standard: of types, then of functions.
    words : mapping
        Words of these templates.
    sources : mapping of str to str
        C of the library by file name.
    flags : tuple of str
        Of the compiler, for the same bits everywhere.
    manifest : mapping
        What the library was made from.
    """

    identifier: str
    title: str
    what: str
    step: float
    stop: float
    groups: Mapping[str, tuple[Variable, ...]]
    counts: tuple[Variable, ...]
    continuous: bool
    linear: bool
    feedthrough: bool
    glue: tuple[str, ...]
    words: Mapping[str, Any]
    sources: Mapping[str, str]
    flags: tuple[str, ...]
    manifest: Mapping[str, Any] = field(repr=False)

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
    entries: Iterable[Mapping[str, Any]],
    starts: Sequence[float] | NDArray[Any] | None = None,
    **more: Any,
) -> tuple[Variable, ...]:
    """Variables ``group.name`` of the entries that a manifest has of a struct, with their values to begin with."""
    variables = []
    for k, entry in enumerate(entries):
        known = {name: entry[name] for name in ("low", "high", "nominal") if name in entry}
        start = 0.0 if starts is None else float(starts[k])
        if kind == "tunable" and start != 0.0:
            known.setdefault("nominal", abs(start))
        name, text = f"{group}.{entry['name']}", entry.get("text", "")
        variables.append(Variable(name, entry["unit"], text, kind, start, **known, **more))
    return tuple(variables)


def count(name: str, text: str) -> Variable:
    """A whole number that is an output."""
    return Variable(name, "", text, "output")


TIP = (
    Variable("tip.x", "m", "of the tip in the world", "output"),
    Variable("tip.y", "m", "of the tip in the world", "output"),
    Variable("tip.angle", "rad", "of the tip; its tangent is (-sin, cos) of it", "output"),
)
"""Position and angle of the tip."""


def contact_variables(touching: Sequence[str]) -> tuple[Variable, ...]:
    """Gaps, forces and places of contacts by their names."""
    of = [(field, unit, text, at) for field, unit, text in TOUCH for at in identifiers(touching)]
    return tuple(Variable(f"contact.{at}.{field}", unit, text, "output") for field, unit, text, at in of)


def labeled(
    group: str, kind: Kind, labels: Sequence[str], starts: Sequence[float] | NDArray[Any] | None = None
) -> tuple[Variable, ...]:
    """Variables of labels ``name [unit]``, with their values to begin with."""
    entries = [{"name": n, "unit": unit_of(label)} for n, label in zip(identifiers(labels), labels, strict=True)]
    return variables_of(group, kind, entries, starts)


_OF_LIBRARY = ("include/", "src/")
"""Folders of a package that its library is made of."""
STRICT = (*FLAGS["strict"], *FLAGS["gcc"])
"""Flags of gcc with which results are the same bits everywhere."""


def library_of(given: Any, **options: Any) -> tuple[dict[str, str], dict[str, Any]]:
    """Headers and sources of a package in double precision by file name, and what its manifest holds."""
    files, manifest = package_files(given, Asked("double", **options), tested=False)
    return {path.rpartition("/")[2]: text for path, text in files.items() if path.startswith(_OF_LIBRARY)}, manifest
