"""Small functions with their first and second derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

__all__ = ["Term", "derived"]


@dataclass(frozen=True)
class Term:
    """A function of unknowns and numbers with its derivatives.

    Attributes
    ----------
    value : casadi.Function
        (z, d) -> o (no).
    jacobian : casadi.Function
        (z, d) -> J (no, nz), dense.
    hessian : casadi.Function
        (z, d, weights (no)) -> H (nz, nz), dense and symmetric: that of the weighted sum of the outputs, or what
        stands for it.
    """

    value: ca.Function
    jacobian: ca.Function
    hessian: ca.Function

    @property
    def size(self) -> int:
        """Number of outputs."""
        return int(self.value.numel_out(0))


def derived(name: str, z: ca.SX, d: ca.SX, o: ca.SX, *, exact: bool = True, squared: ca.SX | None = None) -> Term:
    """A term from its expression.

    Parameters
    ----------
    name : str
    z, d : casadi.SX
        Unknowns and numbers.
    o : casadi.SX
        Outputs.
    exact : bool
        False: the Hessian is that of Gauss and Newton, of the last output alone.
    squared : casadi.SX, optional
        Errors whose half sum of squares the last output is, for Gauss and Newton.
    """
    outputs = ca.densify(ca.SX(o))
    weights = ca.SX.sym("weights", outputs.numel())
    if exact:
        hessian = ca.hessian(ca.dot(weights, outputs), z)[0]
    elif squared is not None and squared.numel():
        slope = ca.jacobian(squared, z)
        hessian = weights[-1] * ca.mtimes(slope.T, slope)
    else:
        hessian = ca.SX(z.numel(), z.numel())
    return Term(
        ca.Function(name, [z, d], ca.cse([outputs]), ["z", "d"], ["o"]),
        ca.Function(f"{name}_jac", [z, d], ca.cse([ca.densify(ca.jacobian(outputs, z))]), ["z", "d"], ["J"]),
        ca.Function(f"{name}_hess", [z, d, weights], ca.cse([ca.densify(hessian)]), ["z", "d", "weights"], ["H"]),
    )
