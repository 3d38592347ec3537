"""Named variables and constraints of an optimisation problem: scale, bounds, the YAML key behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

__all__ = ["Block", "BlockList", "Variable", "Violation"]

Array = NDArray[Any]


@dataclass(frozen=True)
class Variable:
    """Some unknowns.

    Attributes
    ----------
    name : str
    symbol : casadi.SX
        Scaled unknowns, a column.
    scale : float
        Physical value = scale * symbol.
    lower, upper : ndarray
        Bounds of the scaled unknowns.
    start : int
        Position of the first entry among all unknowns.
    """

    name: str
    symbol: ca.SX
    scale: float
    lower: Array
    upper: Array
    start: int

    @property
    def physical(self) -> ca.SX:
        """The unknowns in SI units."""
        return self.scale * self.symbol

    @property
    def stop(self) -> int:
        """Position behind the last entry."""
        return self.start + int(self.symbol.numel())


@dataclass(frozen=True)
class Block:
    """Some constraints.

    Attributes
    ----------
    name : str
        What must hold, in words.
    expression : casadi.SX
        Scaled expressions, a column.
    lower, upper : ndarray
        Bounds of the scaled expressions.
    scale : float
        Physical amount = scale * expression.
    unit : str
        Of the physical amount.
    key : str
        The YAML key that sets it.
    start : int
        Position of the first entry among all constraints.
    """

    name: str
    expression: ca.SX
    lower: Array
    upper: Array
    scale: float
    unit: str
    key: str
    start: int

    @property
    def stop(self) -> int:
        """Position behind the last entry."""
        return self.start + self.lower.size


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
        In the problem's own scale, where constraints compare.
    """

    name: str
    amount: float
    unit: str
    key: str
    scaled: float

    def __str__(self) -> str:
        return f"{self.name}: off by {self.amount:.3g} {self.unit} ({self.key})"


class BlockList:
    """Collects variables and constraints and keeps their places."""

    def __init__(self) -> None:
        self.variables: dict[str, Variable] = {}
        self.blocks: list[Block] = []
        self._unknowns = 0
        self._constraints = 0

    def unknown(
        self,
        name: str,
        size: int,
        scale: float,
        lower: float | Sequence[float] = -np.inf,
        upper: float | Sequence[float] = np.inf,
    ) -> ca.SX:
        """Add unknowns with physical bounds; returns them in SI units."""
        low = np.broadcast_to(np.asarray(lower, dtype=float), (size,)) / scale
        high = np.broadcast_to(np.asarray(upper, dtype=float), (size,)) / scale
        variable = Variable(name, ca.SX.sym(name, size), scale, low, high, self._unknowns)
        self.variables[name] = variable
        self._unknowns += size
        return variable.physical

    def require(
        self,
        name: str,
        expression: ca.SX,
        scale: float,
        unit: str,
        key: str,
        *,
        lower: float = 0.0,
        upper: float = 0.0,
    ) -> None:
        """Add constraints ``lower <= expression <= upper``, all in SI units."""
        column = ca.vec(ca.SX(expression))
        size = int(column.numel())
        low, high = np.full(size, lower / scale), np.full(size, upper / scale)
        self.blocks.append(Block(name, column / scale, low, high, scale, unit, key, self._constraints))
        self._constraints += size

    @property
    def x(self) -> ca.SX:
        """All scaled unknowns."""
        return ca.vertcat(*(v.symbol for v in self.variables.values()))

    @property
    def g(self) -> ca.SX:
        """All scaled constraint expressions."""
        return ca.vertcat(*(b.expression for b in self.blocks))

    @property
    def x_bounds(self) -> tuple[Array, Array]:
        """Bounds of the scaled unknowns."""
        variables = self.variables.values()
        return np.concatenate([v.lower for v in variables]), np.concatenate([v.upper for v in variables])

    @property
    def g_bounds(self) -> tuple[Array, Array]:
        """Bounds of the scaled constraint expressions."""
        return np.concatenate([b.lower for b in self.blocks]), np.concatenate([b.upper for b in self.blocks])

    def violations(self, g: Array, tolerance: float) -> list[Violation]:
        """The constraints that a point breaks by more than ``tolerance`` (scaled), worst first."""
        found = []
        for block in self.blocks:
            part = g[block.start : block.stop]
            off = np.maximum(np.maximum(block.lower - part, part - block.upper), 0.0)
            worst = float(off.max(initial=0.0)) if np.isfinite(part).all() else float("inf")
            if worst > tolerance:
                found.append(Violation(block.name, worst * block.scale, block.unit, block.key, worst))
        return sorted(found, key=lambda v: -v.scaled)
