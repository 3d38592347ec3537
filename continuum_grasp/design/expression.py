"""Expressions of a design with their exact derivatives."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene.design import names_in

Array = NDArray[Any]

_BINARY: dict[type, Any] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_FUNCTIONS = {"sqrt": ca.sqrt, "exp": ca.exp, "log": ca.log}


class Expression:
    """A formula of named quantities."""

    def __init__(self, text: str) -> None:
        self.text, self.names = text, tuple(sorted(names_in(text)))
        symbols = {name: ca.SX.sym(name) for name in self.names}
        formula = ca.SX(_built(ast.parse(text.strip(), mode="eval").body, symbols))
        column = ca.vertcat(*symbols.values())
        self._read = ca.Function("expression", [column], [formula, ca.gradient(formula, column)])

    def value(self, quantities: Mapping[str, float]) -> float:
        """Value for quantities by name."""
        return float(self._read([quantities[name] for name in self.names])[0])

    def gradient(self, quantities: Mapping[str, float], slopes: Mapping[str, Array]) -> Array:
        """Derivatives (n,) where those of the quantities are ``slopes``, (n,) each."""
        parts = np.array(self._read([quantities[name] for name in self.names])[1]).ravel()
        total: Array = np.sum([part * slopes[name] for part, name in zip(parts, self.names, strict=True)], axis=0)
        return total


def _built(node: ast.AST, symbols: Mapping[str, ca.SX]) -> Any:
    match node:
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.Name(id=name):
            return symbols[name]
        case ast.UnaryOp(op=op, operand=operand):
            inner = _built(operand, symbols)
            return -inner if isinstance(op, ast.USub) else inner
        case ast.BinOp(left=left, op=op, right=right):
            return _BINARY[type(op)](_built(left, symbols), _built(right, symbols))
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            return _FUNCTIONS[name](_built(argument, symbols))
    raise ValueError(f"no formula: {ast.dump(node)}")  # which the scene has refused
