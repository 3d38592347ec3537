"""Unknowns and constraints of a grasp problem, by name, as expressions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.nlp import Constraints, Violation

__all__ = ["BlockList", "Variable"]

Array = NDArray[Any]


@dataclass(frozen=True)
class Variable:
    """Some unknowns, in units of the problem.

    Attributes
    ----------
    name : str
    symbol : casadi.SX
        A column.
    start : int
        Position of the first entry among all unknowns.
    """

    name: str
    symbol: ca.SX
    start: int

    @property
    def stop(self) -> int:
        """Position behind the last entry."""
        return self.start + int(self.symbol.numel())


class BlockList(Constraints):
    """Collects unknowns and constraints, and keeps their places."""

    def __init__(self) -> None:
        super().__init__()
        self.variables: dict[str, Variable] = {}
        self._columns: list[ca.SX] = []
        self._unknowns = 0

    def unknown(self, name: str, size: int = 1) -> ca.SX:
        """Add unknowns."""
        variable = Variable(name, ca.SX.sym(name, size), self._unknowns)
        self.variables[name] = variable
        self._unknowns += size
        return variable.symbol

    def require(
        self, name: str, expression: ca.SX, unit: str, key: str, *, lower: float = 0.0, upper: float = 0.0
    ) -> None:
        """Add constraints ``lower <= expression <= upper``."""
        column = ca.vec(ca.SX(expression))
        if column.numel():
            self.rows(name, key, unit, int(column.numel()), 1.0, lower, upper)
            self._columns.append(column)

    @property
    def x(self) -> ca.SX:
        """All unknowns."""
        return ca.vertcat(*(v.symbol for v in self.variables.values()))

    @property
    def g(self) -> ca.SX:
        """All constraint expressions."""
        return ca.vertcat(*self._columns)

    def pack(self, values: Mapping[str, Any], default: float) -> Array:
        """A column for all unknowns from values by name."""
        out = np.full(self._unknowns, default)
        for name, variable in self.variables.items():
            if name in values:
                out[variable.start : variable.stop] = values[name]
        return out

    def violations(self, g: Array, tolerance: float, units: Mapping[str, float]) -> list[Violation]:
        """The constraints that a point violates by more than ``tolerance``, worst first.

        ``units`` are the amounts of a unit of the problem, by unit; they belong to a scene, the blocks to many.
        """
        scaled = (replace(block, scale=np.array([units.get(block.unit, 1.0)])) for block in self.blocks)
        found = [block.violation(g[block.rows]) for block in scaled]
        return sorted((v for v in found if v.scaled > tolerance), key=lambda v: -v.scaled)
