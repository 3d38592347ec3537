"""A nonlinear problem with its derivatives, and its named blocks of constraints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, Indices, amount_text
from continuum_grasp.nlp.attempt import Multipliers, Start

_GREATEST = 100.0
"""Greatest gradient at the start, beyond which functions are scaled, and greatest mean multiplier (IPOPT:
nlp_scaling_max_gradient, s_max)."""


@dataclass(frozen=True, eq=False)
class NLP:
    """Minimize f(x, p) subject to lower <= g(x, p) <= upper and low <= x <= high.

    Attributes
    ----------
    name : str
    x, f, g, p : casadi.SX or casadi.MX
        Unknowns (n), objective, constraints (m) and parameters (np; none by default) as symbols and expressions.
    derivatives : mapping of str to casadi.Function
        Derivatives assembled by hand, in the form of CasADi; the others come from automatic differentiation:
        ``grad_f`` (x, p) -> f, gradient; ``jac_g`` (x, p) -> g, Jacobian; ``hess_lag`` (x, p, lam_f, lam_g) -> upper
        triangle of the Hessian of lam_f f + lam_g' g, or what stands for it; ``slope`` as the attribute.
    semidefinite : bool
        Whether ``hess_lag`` is positive semidefinite everywhere, as the Gauss-Newton matrix is.

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
        hessian_inputs = ["x", "p", "lam:f", "lam:g"]
        factories = {
            "grad_f": ("nlp_grad_f", ["x", "p"], ["f", "grad:f:x"], {}),
            "jac_g": ("nlp_jac_g", ["x", "p"], ["g", "jac:g:x"], {}),
            "hess_lag": ("nlp_hess_l", hessian_inputs, ["triu:hess:gamma:x:x"], {"gamma": ["f", "g"]}),
        }
        return {key: self.derivatives.get(key) or self.values.factory(*how) for key, how in factories.items()}

    @cached_property
    def values(self) -> ca.Function:
        """``(x, p)``: f and g."""
        values = [self.f, self.g]
        if isinstance(self.x, ca.SX):
            # What several constraints have in common is written, and so differentiated, once.
            values = ca.cse(values)
        return ca.Function("nlp", [self.x, self.p], values, ["x", "p"], ["f", "g"])

    @cached_property
    def slope(self) -> ca.Function:
        """``(x, p, lam_f, lam_g)``: derivative of lam_f f + lam_g' g by the parameters, a column."""
        return self.derivatives.get("slope") or self.values.factory(
            "nlp_slope", ["x", "p", "lam:f", "lam:g"], ["grad:gamma:p"], {"gamma": ["f", "g"]}
        )

    def optimality_error(self, start: Start, x: Array, multipliers: Multipliers) -> float:
        """Compute the scaled error of a point in the conditions of optimality, whatever a solver says of it.

        Karush, Kuhn and Tucker: with the multipliers lam of constraints and z of bounds, which are negative at lower
        ends, grad f + J' lam + z = 0, lower <= g <= upper, low <= x <= high, and each multiplier times the slack that
        is left to its end is 0. The error is as in IPOPT (A. Waechter, L. T. Biegler, doi:10.1007/s10107-004-0559-y,
        equations 5 and 6, section 3.8): the greatest of dual, primal and complementarity errors, of functions whose
        gradients at the start are scaled down to 100, dual and complementarity divided by the mean multiplier per 100,
        where it exceeds one. It is infinite where something is not finite. The solver gives the start: it has
        bounds, parameters, and the point that scales the functions.
        """
        # Once: CasADi takes 70 ns for each number of an array.
        p = ca.DM(start.p)
        by_f, by_g = _scales(self, start, p)
        _, gradient = (np.array(v).ravel() for v in self.functions["grad_f"](x, p))
        value, jacobian = self.functions["jac_g"](x, p)
        g = np.array(value).ravel()
        forces = multipliers.constraints
        bounds = multipliers.bounds
        slope = gradient + np.array(jacobian.T @ forces).ravel() + bounds
        fixed = start.low == start.high  # no condition: the multiplier is whatever balances
        low = np.concatenate([start.low, start.lower])
        high = np.concatenate([start.high, start.upper])
        at = np.concatenate([x, g])
        scale = np.concatenate([np.ones(x.size), by_g])
        pressed = by_f * np.concatenate([bounds, forces]) / scale
        if not all(np.isfinite(v).all() for v in (at, slope, pressed)):
            return float("inf")
        primal = scale * np.maximum(np.maximum(low - at, at - high), 0.0)
        # A multiplier whose end is infinite has the wrong sign.
        push = np.stack([np.maximum(-pressed, 0.0), np.maximum(pressed, 0.0)])
        # Beyond its end a point has no slack; by how much counts as primal.
        slack = np.maximum(np.stack([at - low, high - at]), 0.0) * scale
        bounded = np.isfinite(slack) & (low != high)
        mean = np.abs(pressed).mean() if pressed.size else 0.0
        share = max(_GREATEST, float(mean)) / _GREATEST
        dual = np.concatenate([by_f * np.abs(slope[~fixed]), push[~np.isfinite(slack)]]) / share
        gap = push * np.where(bounded, slack, 0.0) / share
        return float(max(dual.max(initial=0.0), primal.max(initial=0.0), gap.max(initial=0.0)))


def _scales(problem: NLP, start: Start, p: ca.DM) -> tuple[float, Array]:
    """Factors of the objective and of the constraints (m,)."""
    x = np.clip(start.x, start.low, start.high)
    gradient = np.array(problem.functions["grad_f"](x, p)[1]).ravel()
    jacobian = problem.functions["jac_g"](x, p)[1]
    rows = np.zeros(jacobian.shape[0])
    np.maximum.at(rows, np.array(jacobian.sparsity().row(), dtype=int), np.abs(np.array(jacobian.nonzeros())))
    return float(_scale(np.abs(gradient).max(initial=0.0))), _scale(rows)


def _scale(slopes: Any) -> Any:
    with np.errstate(divide="ignore"):
        # 1e-8: least scale of functions (IPOPT: nlp_scaling_min_value)
        return np.maximum(np.minimum(_GREATEST / np.asarray(slopes), 1.0), 1e-8)


@dataclass(frozen=True)
class Violation:
    """Amount by which a constraint is violated.

    Attributes
    ----------
    name, unit, key : str
        As in the block.
    index : int
        The worst entry of the block.
    amount : float
        In ``unit``.
    scaled : float
        In units of the problem, in which constraints compare.

    Examples
    --------
    >>> from continuum_grasp.nlp import Violation
    >>> print(Violation("contact gap, tip", 0, 0.0021, "m", "contacts.tip", 0.01))
    contact gap, tip: violated by 0.0021 m (contacts.tip)
    """

    name: str
    index: int
    amount: float
    unit: str
    key: str
    scaled: float

    def __str__(self) -> str:
        amount = f"{100.0 * self.amount:.3g} %" if self.unit == "1" else amount_text(self.amount, self.unit)
        words = f"violated by {amount}" if math.isfinite(self.amount) else "not a finite number"
        return f"{self.name}: {words} ({self.key})"


@dataclass(frozen=True)
class Block:
    """Constraints of one name.

    Attributes
    ----------
    name : str
        The condition, in words.
    key : str
        The YAML key that sets them.
    unit : str
    rows : (count, size) ndarray of int
        Row numbers: one line per place.
    lower, upper : (count, size) ndarray
        Bounds, in units of the problem.
    scale : (size,) ndarray
        Amount of one such unit, in ``unit``.
    """

    name: str
    key: str
    unit: str
    rows: Indices
    lower: Array
    upper: Array
    scale: Array

    def violation(self, values: Array) -> Violation:
        """The worst entry of values (count, size); its amount is infinite where a value is not finite."""
        excess = np.maximum(np.maximum(self.lower - values, values - self.upper), 0.0)
        excess = np.where(np.isfinite(values).all(), excess, np.inf)
        amounts = excess * self.scale
        index = int(amounts.argmax())
        worst = float(excess.max(initial=0.0))
        return Violation(self.name, index, float(amounts.flat[index]), self.unit, self.key, worst)


class Constraints:
    """Blocks of constraints, one below the other.

    Attributes
    ----------
    blocks : list of Block
    count : int
        Number of rows.
    """

    def __init__(self) -> None:
        self.blocks: list[Block] = []
        self.count = 0

    def rows(
        self,
        name: str,
        key: str,
        unit: str,
        count: int,
        scale: ArrayLike = 1.0,
        lower: ArrayLike = 0.0,
        upper: ArrayLike = 0.0,
    ) -> Indices:
        """Add a block at ``count`` places: its row numbers (count, size of the scale)."""
        amounts = np.array(scale, dtype=float, ndmin=1)
        rows = np.arange(self.count, self.count + count * amounts.size).reshape(count, amounts.size)
        low, high = (np.full(rows.shape, bound, dtype=float) for bound in (lower, upper))
        self.blocks.append(Block(name, key, unit, rows, low, high, amounts))
        self.count += rows.size
        return rows

    def bounds(self) -> tuple[Array, Array]:
        """Bounds of all rows."""
        lower = np.zeros(self.count)
        upper = np.zeros(self.count)
        for block in self.blocks:
            lower[block.rows], upper[block.rows] = block.lower, block.upper
        return lower, upper

    def start_within(
        self,
        low: Array,
        high: Array,
        x: Array,
        *,
        multipliers: Multipliers | None = None,
        barrier: float | None = None,
        patience: int | None = None,
    ) -> Start:
        """Start from unknowns between limits, as `Start` has it."""
        bounds = low, high, *self.bounds()
        return Start(x, *bounds, multipliers=multipliers, barrier=barrier, patience=patience)
