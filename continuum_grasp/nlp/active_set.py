"""Solutions next to a known one, by Newton's method with the limits that act there.

Next to a solution at which strict complementarity holds, the same limits act, so that the conditions of optimality are
equations (A. V. Fiacco, 1983). The matrix of the known solution serves as long as residuals fall; then it is formed
anew. A step takes one evaluation of the rows and their slopes in place of an iteration of a solver. Where other limits
act, nothing is found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from continuum_grasp.base import Array, Indices
from continuum_grasp.nlp.attempt import Attempt, Multipliers, SolverStatus, Start
from continuum_grasp.nlp.problem import NLP

_CLEARLY = 100.0
"""Least multiplier of a limit that acts, per distance from it: both are 3e-5 where a solver that ends at a product of
1e-9 cannot tell."""
_STEPS = 14
"""Most steps."""
_FALLS = 0.2
"""Factor of the residual from step to step from which on the matrix is formed anew, which takes three steps."""
_FAR = 10.0
"""Greatest residual, per first one."""
_REGULAR = 1e-11
"""Added to the diagonal [units of the problem]: directions that do not matter have no curvature."""
Solve = Callable[[Array], Array]


class DenseCall:
    """A function of CasADi on memory of its own: it takes 70 ns for each number of an array that it is given."""

    def __init__(self, function: ca.Function) -> None:
        buffer: Any
        buffer, self._run = function.buffer()
        self._buffer = buffer
        self._given = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self._found = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        for k, values in enumerate(self._given):
            buffer.set_arg(k, values.data)
        for k, values in enumerate(self._found):
            buffer.set_res(k, values.data)

    def __call__(self, *given: Array) -> list[Array]:
        """Entries of all results, by dense arguments."""
        for own, values in zip(self._given, given, strict=True):
            own[:] = values
        self._run()
        return [values.copy() for values in self._found]


class ActiveSet:
    """The limits that act at a solution, as equations for solutions nearby.

    Parameters
    ----------
    nlp : NLP
    start : Start
        Of the solution.
    attempt : Attempt
        The solution.
    tolerance : float
        On residuals, limits, and signs of multipliers.
    """

    def __init__(self, nlp: NLP, start: Start, attempt: Attempt, tolerance: float = 1e-8) -> None:
        self._nlp, self._attempt, self._start, self._tolerance = nlp, attempt, start, tolerance
        forces, bounds = attempt.multipliers.constraints, attempt.multipliers.bounds
        self._equal = start.lower == start.upper
        # A limit acts if its multiplier exceeds what is left to it: interior points have both.
        self._rows = np.flatnonzero(self._equal | (np.abs(forces) > _left(forces, attempt.g, start.lower, start.upper)))
        self._fixed = start.low == start.high
        acts = np.abs(bounds) > _left(bounds, attempt.x, start.low, start.high)
        self._free = np.flatnonzero(~self._fixed & ~acts)
        self._bound = np.setdiff1d(np.arange(bounds.size), self._free)

    @cached_property
    def key(self) -> bytes:
        """The limits that act; equal for solutions of a problem with the same ones."""
        return self._rows.tobytes() + self._free.tobytes()

    def near(self, start: Start) -> Attempt | None:
        """The solution of a problem nearby; None where the same limits do not act or it is too far."""
        known, free, rows, bound = self._attempt, self._free, self._rows, self._bound
        x, forces = start.x.copy(), np.zeros(known.g.size)
        forces[rows] = known.multipliers.constraints[rows]
        x[bound] = np.where(known.multipliers.bounds < 0.0, start.low, start.high)[bound]
        limits = np.where(forces < 0.0, start.lower, start.upper)
        p, before, first, solve = start.p, np.inf, np.inf, self._solve
        for step in range(_STEPS):
            g, slope, jacobian = self._values(x, p, forces)
            residual = np.concatenate([slope[free], (g - limits)[rows]])
            size = float(np.abs(residual).max(initial=0.0))
            if size <= self._tolerance:
                return self._attempted(start, x, g, forces, slope)
            if not size < _FAR * first:
                return None
            if step and size > _FALLS * before:
                solve = self._solved(x, p, forces, jacobian)
            before, first = size, min(first, size) if step else size
            change = solve(-residual)
            x[free] += change[: free.size]
            forces[rows] += change[free.size :]
        return None

    def _values(self, x: Array, p: Array, forces: Array) -> tuple[Array, Array, Array]:
        """Rows, gradient of the Lagrange function without bounds, and entries of the slopes of the rows."""
        g, entries = self._functions["jac_g"](x, p)
        _, gradient = self._functions["grad_f"](x, p)
        row, column = self._slopes
        pulls = np.bincount(column, entries * forces[row], minlength=x.size)
        return g, gradient + pulls, entries

    def _attempted(self, start: Start, x: Array, g: Array, forces: Array, slope: Array) -> Attempt | None:
        """The solution, if it satisfies all other limits and multipliers have their signs."""
        bounds, known = np.zeros(x.size), self._attempt.multipliers
        bounds[self._bound] = -slope[self._bound]
        pairs = (bounds, known.bounds, ~self._fixed), (forces, known.constraints, ~self._equal)
        turned = any((now[at] * was[at] < 0.0).any() for now, was, at in pairs)
        violation = start.violation(x, g)
        if turned or violation > self._tolerance:
            return None
        return replace(
            self._attempt,
            status=SolverStatus.SOLVED,
            x=x,
            g=g,
            objective=float(self._functions["grad_f"](x, start.p)[0][0]),
            multipliers=Multipliers(bounds, forces),
            iterations=0,
            violation=violation,
        )

    @cached_property
    def _solve(self) -> Solve:
        """Solve with the matrix of the known solution."""
        x, p, forces = self._attempt.x, self._start.p, self._attempt.multipliers.constraints
        return self._solved(x, p, forces, self._functions["jac_g"](x, p)[1])

    def _solved(self, x: Array, p: Array, forces: Array, jacobian: Array) -> Solve:
        """Solve with the matrix of the conditions at a point."""
        (upper,) = self._functions["hess_lag"](x, p, np.ones(1), forces)
        entries = np.concatenate([upper, jacobian])[self._taken]
        size = self._free.size + self._rows.size
        diagonal = np.full(size, _REGULAR)
        diagonal[self._free.size :] *= -1.0
        rows, columns = self._places
        own = np.arange(size)
        matrix = (np.concatenate([entries, diagonal]), (np.append(rows, own), np.append(columns, own)))
        factors = splu(csc_matrix(matrix, shape=(size, size)))
        return lambda right: np.asarray(factors.solve(right))

    @property
    def _functions(self) -> dict[str, DenseCall]:
        return _called(self._nlp)

    @cached_property
    def _slopes(self) -> tuple[Indices, Indices]:
        """Rows and columns of the entries of the slopes of the rows."""
        return _triplet(self._nlp.functions["jac_g"].sparsity_out(1))

    @cached_property
    def _pattern(self) -> tuple[Indices, Indices, Indices]:
        """Entries of Hessian and Jacobian that are in the matrix, and their rows and columns there."""
        (a, b), (c, d) = _triplet(self._nlp.functions["hess_lag"].sparsity_out(0)), self._slopes
        at, below = np.full(self._fixed.size, -1), np.full(self._equal.size, -1)
        at[self._free] = np.arange(self._free.size)
        below[self._rows] = self._free.size + np.arange(self._rows.size)
        first, second = np.concatenate([at[a], below[c]]), np.concatenate([at[b], at[d]])
        within = np.flatnonzero((first >= 0) & (second >= 0))
        other = within[first[within] != second[within]]
        rows = np.concatenate([first[within], second[other]])
        return np.concatenate([within, other]), rows, np.concatenate([second[within], first[other]])

    @property
    def _taken(self) -> Indices:
        return self._pattern[0]

    @property
    def _places(self) -> tuple[Indices, Indices]:
        return self._pattern[1:]


@lru_cache(maxsize=16)
def _called(nlp: NLP) -> dict[str, DenseCall]:
    """The functions of a problem, on memory of their own."""
    return {name: DenseCall(nlp.functions[name]) for name in ("grad_f", "jac_g", "hess_lag")}


def _triplet(sparsity: Any) -> tuple[Indices, Indices]:
    return np.array(sparsity.row(), int), np.array(sparsity.get_col(), int)


def _left(forces: Array, values: Array, low: Array, high: Array) -> Array:
    """Distances of values from the ends that their multipliers stand for, as multipliers that clearly exceed them."""
    return _CLEARLY * np.abs(np.where(forces < 0.0, values - low, high - values))
