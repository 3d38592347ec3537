"""A nonlinear problem that is assembled from small functions, each evaluated at many places.

Values, Jacobian and Hessian of the Lagrangian are assembled from small functions, which may be compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.addons.planning.shooting import Term
from continuum_grasp.base import Array, Indices
from continuum_grasp.nlp import NLP, Constraints

OBJECTIVE = -1
"""Row number that stands for the objective."""


@dataclass
class _Placed:
    """A term at many places: columns (nz, count) that it reads, rows (no, count) that it adds to, with factors.

    Rows belong to the objective and then the constraints, so that one matrix serves both. ``aside``: what it adds to
    the objective steers the solver, and is not part of what was asked.
    """

    term: Term
    columns: Indices
    rows: Indices
    factors: Array
    data: Array
    aside: bool


class Assembly(Constraints):
    """Minimize f(w) subject to lower <= g(w) <= upper and low <= w <= high.

    ``semidefinite`` states whether all terms have Hessians of Gauss and Newton.
    """

    def __init__(self, *, semidefinite: bool) -> None:
        super().__init__()
        self.semidefinite = semidefinite
        self.low: list[float] = []
        self.high: list[float] = []
        self._placed: list[_Placed] = []
        self._linear: list[list[NDArray[Any]]] = []

    def variables(self, count: int, size: int, low: ArrayLike = -np.inf, high: ArrayLike = np.inf) -> Indices:
        """Add unknowns: their column numbers (count, size)."""
        start = len(self.low)
        self.low += np.broadcast_to(low, (count, size)).ravel().tolist()
        self.high += np.broadcast_to(high, (count, size)).ravel().tolist()
        return np.arange(start, start + count * size).reshape(count, size)

    def fix(self, columns: Indices, values: ArrayLike) -> None:
        """Give unknowns their values."""
        for column, value in zip(columns.ravel(), np.broadcast_to(values, columns.shape).ravel(), strict=True):
            self.low[column] = self.high[column] = float(value)

    def add(
        self,
        term: Term,
        columns: Indices,
        rows: Indices | Sequence[int],
        data: ArrayLike,
        factors: ArrayLike = 1.0,
        *,
        aside: bool = False,
    ) -> None:
        """Add factors (count, no) times the outputs of a term at several places to rows (count, no), -1: the objective.

        It reads the unknowns of ``columns`` (count, nz), and ``data``: numbers of each place (count, columns, rows of
        its input), or the same for all.
        """
        count = len(columns)
        into = np.broadcast_to(np.asarray(rows, dtype=np.int64) + 1, (count, term.size)).T
        high, wide = term.value.size_in(1)
        numbers = np.asarray(data, dtype=float).ravel()
        every = np.tile(numbers, 1 if numbers.size == count * high * wide else count)
        factor = np.broadcast_to(factors, (count, term.size)).T
        self._placed.append(_Placed(term, columns.T, into, factor, every.reshape(count * wide, high).T, aside))

    def add_linear(self, rows: Indices | int, columns: Indices, factors: ArrayLike) -> None:
        """Add factor times unknown to rows (or to the objective), entry by entry."""
        self._linear.append([np.broadcast_to(v, columns.shape).ravel() for v in (rows + 1, columns, factors)])

    # -- what the solver takes ----------------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.low)

    @property
    def limits(self) -> tuple[Array, Array]:
        """Least and greatest values of the unknowns."""
        return np.array(self.low), np.array(self.high)

    @cached_property
    def _w(self) -> ca.MX:
        return ca.MX.sym("w", self.size)

    def _given(self, placed: _Placed) -> tuple[ca.MX, ca.MX]:
        """Values that a term reads, a column per place."""
        # CasADi's vectors are read column by column: hence ``order="F"`` everywhere.
        picked = self._w[placed.columns.ravel(order="F").tolist()]
        return ca.reshape(picked, *placed.columns.shape), ca.MX(placed.data)

    @cached_property
    def _straight(self) -> list[NDArray[Any]]:
        """Rows, columns and factors of all that is linear."""
        return [np.concatenate(parts) for parts in zip(*self._linear, strict=True)]

    def _values(self) -> ca.MX:
        """Objective and constraints."""
        rows, columns, factors = self._straight
        total = ca.mtimes(_sparse(rows, columns, factors, 1 + self.count, self.size), self._w)
        for placed in self._placed:
            rows = placed.rows.ravel(order="F")
            factors = placed.factors.ravel(order="F")
            out = placed.term.value.map(placed.rows.shape[1])(*self._given(placed))
            total += ca.mtimes(_sparse(rows, np.arange(rows.size), factors, 1 + self.count, rows.size), ca.vec(out))
        return total

    def aside(self, w: Array) -> float:
        """Part of the objective at w of terms that are aside."""
        chosen = [placed for placed in self._placed if placed.aside]
        outputs = [np.array(p.term.value.map(p.rows.shape[1])(w[p.columns], p.data)) for p in chosen]
        return float(sum((p.factors * out).sum() for p, out in zip(chosen, outputs, strict=True)))

    def _slopes(self) -> ca.MX:
        """Gradient of the objective (a row) above the Jacobian of the constraints, sparse."""
        entries, blocks = [], []
        for placed in self._placed:
            out = placed.term.jacobian.map(placed.rows.shape[1])(*self._given(placed))
            blocks.append(ca.vec(out))
            each = np.broadcast_arrays(placed.rows[:, None], placed.columns[None], placed.factors[:, None])
            entries.append([v.ravel(order="F") for v in each])
        blocks.append(ca.MX.ones(self._straight[0].size))
        return _gathered([*entries, self._straight], blocks, 1 + self.count, self.size)

    def _curvature(self, multipliers: ca.MX) -> ca.MX:
        """Upper triangle of the Hessian of the Lagrangian; the multipliers belong to objective and constraints."""
        entries, blocks = [], []
        for placed in self._placed:
            picked = multipliers[placed.rows.ravel(order="F").tolist()]
            weights = ca.reshape(picked * ca.DM(placed.factors.ravel(order="F")), *placed.rows.shape)
            out = placed.term.hessian.map(placed.rows.shape[1])(*self._given(placed), weights)
            each = np.broadcast_arrays(placed.columns[:, None], placed.columns[None])
            rows, columns = (v.ravel(order="F") for v in each)
            # The lower triangle counts too where a place reads its unknowns in another order than that of the columns.
            upper = rows <= columns
            blocks.append(ca.vec(out)[np.flatnonzero(upper).tolist()])
            entries.append([rows[upper], columns[upper], np.ones(int(upper.sum()))])
        return _gathered(entries, blocks, self.size, self.size)

    @cached_property
    def first_order(self) -> ca.Function:
        """(w) -> gradient of the objective (a row) above the Jacobian of the constraints."""
        return ca.Function("first_order", [self._w], [self._slopes()])

    @cached_property
    def values(self) -> ca.Function:
        """(w) -> objective, constraints."""
        nlp = self.nlp
        return ca.Function("values", [nlp.x], [nlp.f, nlp.g])

    @cached_property
    def nlp(self) -> NLP:
        """The problem with its derivatives."""
        w = self._w
        p = ca.MX.sym("p", 0)
        values, slopes = self._values(), self._slopes()
        f = values[0]
        g = values[1:]
        sigma = ca.MX.sym("lam_f")
        lam = ca.MX.sym("lam_g", self.count)
        hessian = self._curvature(ca.vertcat(sigma, lam))
        names = ["x", "p", "lam_f", "lam_g"]
        gradient = ca.densify(slopes[0, :].T)
        functions = {
            "grad_f": ca.Function("nlp_grad_f", [w, p], [f, gradient], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", [w, p], [g, slopes[1:, :]], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function("nlp_hess_l", [w, p, sigma, lam], [hessian], names, ["triu_hess_gamma_x_x"]),
        }
        return NLP("plan", w, f, g, p, functions, self.semidefinite)


def _pattern(rows: Indices, columns: Indices, height: int, width: int) -> tuple[ca.Sparsity, Indices]:
    """Pattern of a matrix from the places of its entries, and which of its nonzeros each of them is."""
    key, place = np.unique(columns * height + rows, return_inverse=True)
    return ca.Sparsity.triplet(height, width, (key % height).tolist(), (key // height).tolist()), place


def _sparse(rows: Indices, columns: Indices, factors: Array, height: int, width: int) -> ca.DM:
    """A sparse matrix from its entries; entries of one place are added."""
    pattern, place = _pattern(rows, columns, height, width)
    return ca.DM(pattern, np.bincount(place, weights=factors, minlength=pattern.nnz()))


def _gathered(entries: Sequence[Sequence[NDArray[Any]]], blocks: list[ca.MX], height: int, width: int) -> ca.MX:
    """A sparse matrix whose entries are sums of entries of vectors times factors."""
    rows, columns, factors = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    pattern, place = _pattern(rows, columns, height, width)
    add = _sparse(place, np.arange(place.size), factors, pattern.nnz(), place.size)
    return ca.MX(pattern, ca.mtimes(add, ca.vertcat(*blocks)))
