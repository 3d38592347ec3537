"""Columns of named symbols and rows of named constraints: the parts of a grasp problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, Indices
from continuum_grasp.nlp import Constraints, Violation


class Places:
    """Places of named entries in a column: of the unknowns, or of the run-time numbers."""

    def __init__(self, sizes: Mapping[str, int] | None = None) -> None:
        self.at: dict[str, slice] = {}  # by name
        self.size = 0
        for name, size in (sizes or {}).items():
            self.add(name, size)

    def add(self, name: str, size: int) -> None:
        """Append entries under a name."""
        self.at[name] = slice(self.size, self.size + size)
        self.size += size

    def placed(self, part: Places, names: Sequence[str]) -> Indices:
        """Places here of the entries of a part, in whose names {0}, {1} ... stand for ``names``; new ones are
        appended.
        """
        found = [np.zeros(0, dtype=int)]
        for name, size in part.sizes.items():
            named = name.format(*names)
            if named not in self.at:
                self.add(named, size)
            found.append(np.arange(self.size)[self.at[named]])
        return np.concatenate(found)

    @property
    def sizes(self) -> dict[str, int]:
        """Number of entries by name."""
        return {name: at.stop - at.start for name, at in self.at.items()}

    def pack(self, values: Mapping[str, ArrayLike], default: float | None = None) -> Array:
        """The column of numbers for these values; a missing one is the default, if there is one.

        Raises
        ------
        KeyError
            A number is missing, or values have another size than their symbol.
        """
        out = np.full(self.size, np.nan if default is None else default)
        for name, at in self.at.items():
            if default is None or name in values:
                part = np.asarray(values[name], dtype=float).ravel()
                if part.size != at.stop - at.start:
                    raise KeyError(f"{name}: expected {at.stop - at.start} numbers, got {part.size}")
                out[at] = part
        return out


class Columns(Places):
    """Symbols by name, in the order in which they were first asked for."""

    def __init__(self) -> None:
        super().__init__()
        self._symbols: dict[str, ca.SX] = {}

    def __call__(self, name: str, size: int = 1) -> ca.SX:
        """The symbol of a name; created on the first call."""
        if name not in self._symbols:
            self._symbols[name] = ca.SX.sym(name, size)
            self.add(name, size)
        return self._symbols[name]

    @property
    def symbol(self) -> ca.SX:
        return ca.vertcat(*self._symbols.values()) if self._symbols else ca.SX(0, 1)


class ConstraintRows(Constraints):
    """Named constraints in units of a problem."""

    def violations(self, g: Array, tolerance: float, units: Mapping[str, tuple[float, str]]) -> list[Violation]:
        """The constraints that a point violates by more than ``tolerance``, worst first.

        ``units`` are the amounts of a unit of the problem and their SI unit, by the unit of a row; they belong to a
        scene, the rows to many.
        """
        lower, upper = self.bounds()
        off = ~(np.maximum(lower - g, g - upper) <= tolerance)  # also where a value is not finite
        violated = (block for block in self.blocks if off[block.rows].any())
        violations = []
        for block in violated:
            amount, unit = units.get(block.unit, (1.0, block.unit))
            violations.append(replace(block, scale=np.array([amount]), unit=unit).violation(g[block.rows]))
        return sorted((v for v in violations if v.scaled > tolerance), key=lambda v: -v.scaled)


class Expressed(ConstraintRows):
    """Named constraints with their expressions."""

    def __init__(self) -> None:
        super().__init__()
        self._expressions: list[ca.SX] = []

    def require(
        self, name: str, expression: ca.SX, unit: str, key: str, *, lower: float = 0.0, upper: float = 0.0
    ) -> None:
        """Add constraints ``lower <= expression <= upper``; ``unit`` is one of `units_of_rows`, or ``rad``, ``1``."""
        column = ca.vec(ca.SX(expression))
        if column.numel():
            self.rows(name, key, unit, int(column.numel()), 1.0, lower, upper)
            self._expressions.append(column)

    @property
    def g(self) -> ca.SX:
        """All constraint expressions."""
        return ca.vertcat(*self._expressions)


Symbolic = TypeVar("Symbolic", ca.SX, ca.MX)


def in_space(vector: ca.SX) -> ca.SX:
    """A vector (3,); one of the plane has no third component, structurally."""
    return ca.vertcat(vector, ca.SX(3 - vector.numel(), 1))


def rotation(angle: Symbolic) -> Symbolic:
    """Rotation matrix (2, 2)."""
    c, s = ca.cos(angle), ca.sin(angle)
    matrix: Symbolic = ca.vertcat(ca.horzcat(c, -s), ca.horzcat(s, c))
    return matrix
