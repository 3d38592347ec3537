"""Variables of a functional mock-up unit: what its C and its modelDescription.xml have in common."""

from __future__ import annotations

import math
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
_GREATEST = 1.7976931348623157e308


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
        """Its row of the table in C."""
        low, high = max(self.low, -_GREATEST), min(self.high, _GREATEST)
        numbers = ", ".join(repr(float(value)) for value in (self.start, low, high))
        return f'  {{"{self.name}", "{self.unit}", {numbers}, {_C_KINDS[self.kind]}, {int(self.may_be_missing)}}}'


@dataclass(frozen=True)
class Group:
    """Variables that lie side by side, like the members of a struct; ``name`` is that of their place in C."""

    name: str
    variables: tuple[Variable, ...]


@dataclass(frozen=True)
class Unit:
    """What a functional mock-up unit is made of.

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
        Real variables and whole numbers; value references are the places in this order.
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
    groups: tuple[Group, ...]
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
        """All real variables."""
        return [variable for group in self.groups for variable in group.variables]

    @property
    def places(self) -> dict[str, int]:
        """Where the groups begin."""
        found, at = {}, 0
        for group in self.groups:
            found[group.name] = at
            at += len(group.variables)
        return found


def variables_of(
    group: str,
    kind: Kind,
    entries: Iterable[Mapping[str, Any]],
    starts: Sequence[float] | NDArray[Any] | None = None,
    **more: Any,
) -> tuple[Variable, ...]:
    """Variables ``group.name`` of the entries that a manifest has of a struct, with their values to begin with."""
    found = []
    for k, entry in enumerate(entries):
        low, high = entry.get("low", -math.inf), entry.get("high", math.inf)
        start = 0.0 if starts is None else float(starts[k])
        nominal = entry.get("nominal")
        if kind == "tunable" and nominal is None and start != 0.0:
            nominal = abs(start)
        found.append(
            Variable(
                f"{group}.{entry['name']}",
                entry["unit"],
                entry.get("text", ""),
                kind,
                start,
                low,
                high,
                nominal,
                **more,
            )
        )
    return tuple(found)


def count(name: str, text: str) -> Variable:
    """A whole number that is an output."""
    return Variable(name, "", text, "output")


_TIP = (
    ("x", "m", "of the tip in the world"),
    ("y", "m", "of the tip in the world"),
    ("angle", "rad", "of the tip; its tangent is (-sin, cos) of it"),
)


def tip_variables() -> tuple[Variable, ...]:
    """Position and angle of the tip."""
    return tuple(Variable(f"tip.{name}", unit, text, "output") for name, unit, text in _TIP)


def contact_variables(touching: Sequence[str]) -> list[Variable]:
    """Gaps, forces and places of contacts by their names."""
    names = identifiers(touching)
    return [Variable(f"contact.{at}.{field}", unit, text, "output") for field, unit, text in TOUCH for at in names]


def labeled(group: str, kind: Kind, labels: Sequence[str], starts: Sequence[float] | NDArray[Any]) -> Group:
    """Variables of labels ``name [unit]``, with their values to begin with."""
    named = zip(identifiers(labels), labels, starts, strict=True)
    own = tuple(Variable(f"{group}.{name}", unit_of(label), "", kind, float(start)) for name, label, start in named)
    return Group(f"FMU_{group.upper()}", own)


_OF_LIBRARY = ("include/", "src/")
"""Folders of a package that its library is made of."""
STRICT = (*FLAGS["strict"], *FLAGS["gcc"])
"""Flags of gcc with which results are the same bits everywhere."""


def library_of(given: Any, **options: Any) -> tuple[dict[str, str], dict[str, Any]]:
    """Headers and sources of a package in double precision by file name, and what its manifest holds."""
    files, manifest = package_files(given, Asked("double", **options), tested=False)
    return {path.rpartition("/")[2]: text for path, text in files.items() if path.startswith(_OF_LIBRARY)}, manifest
