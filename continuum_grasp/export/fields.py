"""Data types of a package: two real types, and structs of entries with name, unit, range and meaning."""

from __future__ import annotations

import itertools
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import split_unit
from continuum_grasp.core import CReal, Template

LINE = 118
"""Characters of a line in the header, which is as wide as the sources of this package."""


REACH = 1e3
"""Times its usual size up to which a number is taken that has no range of its own [1]: a number beyond has another
unit, or is of a motion that diverged; angles are within the thousand turns up to which sine and cosine keep their
digits."""


@dataclass(frozen=True)
class Field:
    """An entry of a struct."""

    name: str
    unit: str
    text: str = ""
    """Meaning, where name and unit do not say it."""
    low: float = -math.inf
    """Least accepted value; infinite for a field that is no input."""
    high: float = math.inf
    scale: float = 1.0
    """Size of usual values, for the test vectors."""
    shape: tuple[int, ...] = ()

    @staticmethod
    def named(labels: Sequence[str], ranges: NDArray[Any] | None = None) -> tuple[Field, ...]:
        """Entries of a vector by their labels ``name [unit]``, with their ranges (size, 2) where there are any."""
        fields = tuple(Field(name, unit_of(label)) for name, label in zip(identifiers(labels), labels, strict=True))
        if ranges is None:
            return fields
        return tuple(
            replace(f, low=float(low), high=float(high)) for f, (low, high) in zip(fields, ranges, strict=True)
        )

    @property
    def size(self) -> int:
        """Count of numbers."""
        return math.prod(self.shape)

    @property
    def limits(self) -> str:
        """The range in words; empty for a field that is no input."""
        if -math.inf < self.low and self.high < math.inf:
            return f"{self.low:.6g} to {self.high:.6g}"
        return f"{self.low:.6g} or more" if self.low > -math.inf else f"up to {self.high:.6g}" * (self.high < math.inf)

    @property
    def usual(self) -> float | None:
        """Size of usual values in six digits, where it is known."""
        return float(f"{self.scale:.6g}") if self.scale != 1.0 and 0.0 < self.scale < math.inf else None

    def within(self, low: float, high: float, scale: float) -> Field:
        """A copy with a range and the size of usual values."""
        return replace(self, low=low, high=high, scale=scale)

    def around(self, scale: float) -> Field:
        """Give a number without a range of its own one from the size of its usual values."""
        return self.within(-REACH * scale, REACH * scale, scale)

    @property
    def sampled(self) -> tuple[float, float]:
        """Least and greatest value to try: of its range, and of usual values where it has none of its own."""
        reach = REACH * self.scale
        return self.low if self.low > -reach else -self.scale, self.high if self.high < reach else self.scale


@dataclass(frozen=True)
class Struct:
    """A C struct of numbers of one type, without padding."""

    name: str
    """Behind the prefix of the package."""
    text: str
    fields: tuple[Field, ...]

    @property
    def size(self) -> int:
        """Count of numbers."""
        return sum(field.size for field in self.fields)

    @property
    def bounded(self) -> tuple[tuple[float, float], ...]:
        """Range of every number."""
        return tuple((field.low, field.high) for field in self.fields for _ in range(field.size))

    def named(self, values: Iterable[float]) -> dict[str, float]:
        """Values by their fields, one each."""
        return {field.name: float(value) for field, value in zip(self.fields, values, strict=True)}

    def bounds(self, prefix: str, real: CReal, mark: str = "") -> str:
        """C of the least and of the greatest value of every number."""
        # C has no literal of infinity, and a finite number is within the greatest one.
        lows, highs = (", ".join(map(real.finite_literal, side)) for side in zip(*self.bounded, strict=True))
        kind = f"{mark}static const {prefix}_real {self.name}"
        return f"{kind}_low[] = {{{lows}}};\n{kind}_high[] = {{{highs}}};"

    def declaration(self, prefix: str) -> str:
        """C of the typedef."""
        rows = []
        for field in self.fields:
            shape = "".join(f"[{n}]" for n in field.shape)
            rows.append((f"  {prefix}_real {field.name}{shape};", _comment(field)))
        width = max(len(code) for code, _ in rows)
        lines = "\n".join(f"{code:<{width}}  {comment}" for code, comment in rows)
        text = "\n".join(textwrap.wrap(self.text, LINE - 3, initial_indent="/* ", subsequent_indent="   "))
        return f"{text} */\ntypedef struct {{\n{lines}\n}} {prefix}_{self.name};\n"

    @property
    def numbered(self) -> list[tuple[int, str]]:
        """Members and entries of arrays, the last index fastest, as in C, counted from zero."""
        names = []
        for field in self.fields:
            for place in itertools.product(*map(range, field.shape)):
                indices = "".join(f"[{k}]" for k in place)
                names.append(field.name + indices)
        return list(enumerate(names))


def to_digits(value: float, digits: int, rounding: Callable[[float], float]) -> float:
    """So many digits of a number above zero, upwards or downwards; zero for any other number."""
    factor = 10.0 ** (digits - 1 - math.floor(math.log10(value))) if value > 0.0 else 1.0
    return rounding(value * factor) / factor if value > 0.0 else 0.0


def each_once(structs: Iterable[Struct]) -> list[Struct]:
    """Structs by their names, the first of each."""
    unique: dict[str, Struct] = {}
    for struct in structs:
        unique.setdefault(struct.name, struct)
    return list(unique.values())


def outside(struct: Struct, rows: NDArray[Any]) -> NDArray[np.bool_]:
    """Rows (count, size) of a struct's numbers with one out of its range."""
    low, high = (np.array(side, dtype=rows.dtype) for side in zip(*struct.bounded, strict=True))
    return np.asarray(((rows < low) | (rows > high)).any(axis=1))


def _comment(field: Field) -> str:
    limits = f", {field.limits}" if field.limits else ""
    text = f"; {field.text}" if field.text else ""
    return f"/* [{field.unit}]{limits}{text} */"


def identifiers(labels: Iterable[str]) -> list[str]:
    """C identifiers of labels ``name [unit]``, each once."""
    names: list[str] = []
    for label in labels:
        name = re.sub(r"\W+", "_", split_unit(label).name, flags=re.ASCII).strip("_")
        name = f"_{name}" if name[:1].isdigit() else name or "unnamed"
        further = (f"{name}_{count}" for count in itertools.count(2))
        candidates = itertools.chain([name], further)
        names.append(next(candidate for candidate in candidates if candidate not in names))
    return names


def unit_of(label: str) -> str:
    """Unit of a label; 1 where it has none, as names of a scene's zones do."""
    match = re.search(r" \[([\w ]+(?:/[\w ]+)*)\]$", label, re.ASCII)
    return match[1] if match else "1"


def fill(name: str, words: Mapping[str, object]) -> str:
    """Fill a template, by its path below ``templates``, of some of the words; ``P`` is the prefix ``p`` in capitals."""
    return Template.of("export", name).filled({"P": str(words.get("p", "")).upper(), **words})
