"""Named CasADi functions of the expressions of a model."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca

from continuum_grasp.model.chain import column
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.planar import Scalar, Vec
from continuum_grasp.model.remade import Remade

MATRICES = frozenset(
    (
        "mass_matrix.M",
        "statics.K",
        "jacobian.J",
        "jacobian_rate.Jd",
        "joints.r",
        "waypoints.r",
        "linearization.A",
        "linearization.B",
        "pressed_linearization.A",
        "touch.force",
        "touch.normal",
        "touch.point",
    )
)
"""Outputs of finger models and systems that are matrices, whatever their size; all others are vectors."""


class Functions(Remade):
    """What a finger alone and a finger with an object have in common: functions with named inputs and outputs."""

    _equations: Equations

    def _function(self, name: str, inputs: str, **outputs: ca.SX | Vec | Scalar | list[Scalar]) -> ca.Function:
        """A function of space-separated inputs, which are symbols of the equations."""
        names = inputs.split()
        arguments = [getattr(self._equations, key) for key in names]
        expressions = [_dense(value) for value in outputs.values()]
        if "x" not in names:
            expressions = self._at_command(expressions)
        return ca.Function(name, arguments, ca.cse(expressions), names, list(outputs))

    def _at_command(self, expressions: list[ca.SX]) -> list[ca.SX]:
        """Expressions with the tip moment that u commands in place of the one that lags, which is a state."""
        eq = self._equations
        if not eq.lag.numel():
            return expressions
        commanded = ca.vertcat(ca.SX(eq.commanded.moment), 0.0)
        return list(ca.substitute(expressions, [eq.lag], [commanded]))

    @cached_property
    def forward_dynamics(self) -> ca.Function:
        """State derivative."""
        return self._function("forward_dynamics", "x u w p", xd=self._equations.state_rate)

    @cached_property
    def linearization(self) -> ca.Function:
        """Jacobians of the state derivative with respect to state and input."""
        eq = self._equations
        rate = column(eq.state_rate)
        return self._function("linearization", "x u w p", A=ca.jacobian(rate, eq.x), B=ca.jacobian(rate, eq.u))


def function_names(cls: type[Functions]) -> tuple[str, ...]:
    """Names of the functions of a class."""
    found = {name: value for base in reversed(cls.__mro__) for name, value in vars(base).items()}
    return tuple(n for n, value in found.items() if isinstance(value, cached_property) and not n.startswith("_"))


def matrix(rows: Sequence[Sequence[Scalar]]) -> ca.SX:
    """CasADi matrix of scalars."""
    return ca.vertcat(*[ca.horzcat(*[ca.SX(v) for v in row]) for row in rows])


def _dense(value: ca.SX | Vec | Scalar | list[Scalar]) -> ca.SX:
    if isinstance(value, Vec):
        return value.column()
    return ca.densify(column(value) if isinstance(value, list) else ca.SX(value))
