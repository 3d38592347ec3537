"""Named unknowns and constraints of an optimization problem, and the YAML key behind each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

__all__ = ["Block", "BlockList", "Variable", "Violation"]

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


@dataclass(frozen=True)
class Block:
    """Some constraints, in units of the problem.

    Attributes
    ----------
    name : str
        What must hold, in words.
    expression : casadi.SX
        A column.
    lower, upper : float
        Bounds of every entry.
    unit : str
        Of the physical amount: ``m``, ``N``, ``N m``, ``rad``, ``1/m`` or ``1``.
    key : str
        The YAML key that sets it.
    start : int
        Position of the first entry among all constraints.
    """

    name: str
    expression: ca.SX
    lower: float
    upper: float
    unit: str
    key: str
    start: int

    @property
    def stop(self) -> int:
        """Position behind the last entry."""
        return self.start + int(self.expression.numel())


@dataclass(frozen=True)
class Violation:
    """By how much a constraint is broken.

    Attributes
    ----------
    name, unit, key : str
        As of the block.
    amount : float
        In ``unit``.
    scaled : float
        In the problem's own units, where constraints compare.
    """

    name: str
    amount: float
    unit: str
    key: str
    scaled: float

    def __str__(self) -> str:
        return f"{self.name}: off by {self.amount:.3g} {self.unit} ({self.key})"


class BlockList:
    """Collects unknowns and constraints and keeps their places."""

    def __init__(self) -> None:
        self.variables: dict[str, Variable] = {}
        self.blocks: list[Block] = []
        self._unknowns = 0
        self._constraints = 0

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
            self.blocks.append(Block(name, column, lower, upper, unit, key, self._constraints))
            self._constraints += int(column.numel())

    @property
    def x(self) -> ca.SX:
        """All unknowns."""
        return ca.vertcat(*(v.symbol for v in self.variables.values()))

    @property
    def g(self) -> ca.SX:
        """All constraint expressions."""
        return ca.vertcat(*(b.expression for b in self.blocks))

    @property
    def g_bounds(self) -> tuple[Array, Array]:
        """Bounds of the constraint expressions."""
        sizes = [b.stop - b.start for b in self.blocks]
        return np.repeat([b.lower for b in self.blocks], sizes), np.repeat([b.upper for b in self.blocks], sizes)

    def pack(self, values: Mapping[str, Any], default: float) -> Array:
        """A column for all unknowns from values by name."""
        out = np.full(self._unknowns, default)
        for name, variable in self.variables.items():
            if name in values:
                out[variable.start : variable.stop] = values[name]
        return out

    def violations(self, g: Array, tolerance: float, units: Mapping[str, float]) -> list[Violation]:
        """The constraints that a point breaks by more than ``tolerance``, worst first."""
        found = []
        for block in self.blocks:
            part = g[block.start : block.stop]
            off = np.maximum(np.maximum(block.lower - part, part - block.upper), 0.0)
            worst = float(off.max(initial=0.0)) if np.isfinite(part).all() else float("inf")
            if worst > tolerance:
                amount = worst * units.get(block.unit, 1.0)
                found.append(Violation(block.name, amount, block.unit, block.key, worst))
        return sorted(found, key=lambda v: -v.scaled)
