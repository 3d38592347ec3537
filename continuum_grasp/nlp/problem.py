"""A nonlinear problem with its derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca

__all__ = ["NLP"]


@dataclass(frozen=True, eq=False)
class NLP:
    """Minimize f(x, p) subject to lower <= g(x, p) <= upper and low <= x <= high.

    Attributes
    ----------
    name : str
    x, f, g, p : casadi.SX or casadi.MX
        Unknowns (n), objective, constraints (m) and parameters (np; none by default) as symbols and expressions.
    derivatives : mapping of str to casadi.Function
        Those that are assembled by hand, in the form of CasADi; the others are found by automatic differentiation:
        ``grad_f`` (x, p) -> f, gradient; ``jac_g`` (x, p) -> g, Jacobian; ``hess_lag`` (x, p, lam_f, lam_g) -> upper
        triangle of the Hessian of lam_f f + lam_g' g, or what stands for it.
    semidefinite : bool
        Whether ``hess_lag`` is positive semidefinite everywhere, as that of Gauss and Newton is.

    Examples
    --------
    >>> import casadi as ca
    >>> from continuum_grasp.nlp import NLP
    >>> x = ca.SX.sym("x", 2)
    >>> problem = NLP("circle", x, x[0] + x[1], ca.dot(x, x) - 2)
    >>> problem.functions["grad_f"]([1, 1], [])[1]
    DM([1, 1])
    """

    name: str
    x: Any
    f: Any
    g: Any
    p: Any = None
    derivatives: Mapping[str, ca.Function] = field(default_factory=dict)
    semidefinite: bool = False

    def __post_init__(self) -> None:
        if self.p is None:
            object.__setattr__(self, "p", type(self.x).sym("p", 0))

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """``grad_f``, ``jac_g`` and ``hess_lag``; differentiated once for all solvers of the problem."""
        oracle = ca.Function("nlp", [self.x, self.p], [self.f, self.g], ["x", "p"], ["f", "g"])
        hessian_inputs = ["x", "p", "lam:f", "lam:g"]
        found = {
            "grad_f": ("nlp_grad_f", ["x", "p"], ["f", "grad:f:x"], {}),
            "jac_g": ("nlp_jac_g", ["x", "p"], ["g", "jac:g:x"], {}),
            "hess_lag": ("nlp_hess_l", hessian_inputs, ["triu:hess:gamma:x:x"], {"gamma": ["f", "g"]}),
        }
        return {key: self.derivatives.get(key) or oracle.factory(*how) for key, how in found.items()}
