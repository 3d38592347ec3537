"""Run-time numbers of a grasp problem: named symbols, filled from a scene when it is solved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["APEX", "Numbers"]

Array = NDArray[Any]

APEX = 2e-4
"""Rounding of the apex of spatial friction cones, as a part of the weight; it lies inside the true one."""


class Numbers:
    """Symbols by name, in the order in which they were asked for."""

    def __init__(self) -> None:
        self._symbols: dict[str, ca.SX] = {}

    def __call__(self, name: str, size: int = 1) -> ca.SX:
        """The symbol of a name; created on the first call."""
        if name not in self._symbols:
            self._symbols[name] = ca.SX.sym(name, size)
        return self._symbols[name]

    @property
    def symbol(self) -> ca.SX:
        """All of them as a column."""
        return ca.vertcat(*self._symbols.values()) if self._symbols else ca.SX(0, 1)

    def pack(self, values: Mapping[str, ArrayLike], default: float | None = None) -> Array:
        """The column of numbers for these values; what is missing is the default, if there is one.

        Raises
        ------
        KeyError
            A number is missing.
        """
        parts = []
        for name, symbol in self._symbols.items():
            if default is not None and name not in values:
                parts.append(np.full(symbol.numel(), default))
                continue
            part = np.asarray(values[name], dtype=float).ravel()
            if part.size != symbol.numel():
                raise KeyError(f"{name}: expected {symbol.numel()} numbers, got {part.size}")
            parts.append(part)
        return np.concatenate(parts) if parts else np.empty(0)
