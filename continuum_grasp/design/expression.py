"""Expressions of a design with their exact derivatives."""

from __future__ import annotations

import ast
from collections.abc import Mapping

import casadi as ca
import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.scene.design import names_in

_FUNCTIONS = {"sqrt": ca.sqrt, "exp": ca.exp, "log": ca.log}


class Expression:
    """A formula of named quantities."""

    def __init__(self, text: str) -> None:
        self.text, self.names = text, tuple(sorted(names_in(text)))
        symbols = {name: ca.SX.sym(name) for name in self.names}
        tree = ast.parse(text.strip(), mode="eval")
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant):  # powers of integers may have any number of digits
                node.value = float(str(node.value))
        # The scene has refused all but numbers, names, sums, products, powers and these functions.
        formula = ca.SX(eval(compile(tree, text, "eval"), {"__builtins__": {}}, {**_FUNCTIONS, **symbols}))
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
