"""A nonlinear problem that is assembled from small functions, each evaluated at many places.

Values, Jacobian and Hessian of the Lagrangian are assembled from those of the small functions, which may be compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.nlp import NLP, Constraints, Multipliers, Start
from continuum_grasp.planning.shooting import Term

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

OBJECTIVE = -1
"""Row number that stands for the objective."""


@dataclass
class _Placed:
    """A term at many places: columns (nz, count) that it reads, rows (no, count) that it adds to, with factors."""

    term: Term
    columns: Indices
    rows: Indices
    factors: Array
    data: Array


class Assembly(Constraints):
    """Minimize f(w) subject to lower <= g(w) <= upper and low <= w <= high.

    Attributes
    ----------
    semidefinite : bool
        Whether all terms have Hessians of Gauss and Newton.
    low, high : list of float
        Bounds of the unknowns.
    margins : dict of str to ndarray
        By how much the bounds of a block are moved inwards, by its name.
    """

    def __init__(self, *, semidefinite: bool = False) -> None:
        super().__init__()
        self.semidefinite = semidefinite
        self.low: list[float] = []
        self.high: list[float] = []
        self.margins: dict[str, Array] = {}
        self._placed: list[_Placed] = []
        self._linear: list[tuple[int, int, float]] = []

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
    ) -> None:
        """Add a term at several places.

        Parameters
        ----------
        columns : (count, nz) ndarray of int
            Unknowns that it reads at each place.
        rows : (count, no) array_like of int
            Rows to which its outputs are added; -1 for the objective.
        data : array_like
            Numbers that it reads at each place (count, columns, rows of its input), or the same for all.
        factors : array_like
            By which outputs are multiplied, (count, no) or less.
        """
        count = len(columns)
        into = np.broadcast_to(np.asarray(rows, dtype=np.int64), (count, term.size)).T
        high, wide = term.value.size_in(1)
        numbers = np.asarray(data, dtype=float).ravel()
        every = np.tile(numbers, 1 if numbers.size == count * high * wide else count)
        factor = np.broadcast_to(factors, (count, term.size)).T.copy()
        self._placed.append(_Placed(term, columns.T, into, factor, every.reshape(count * wide, high).T))

    def add_linear(self, rows: Indices | int, columns: Indices, factors: ArrayLike) -> None:
        """Add factor times unknown to rows (or to the objective), entry by entry."""
        shape = columns.shape
        every = (np.broadcast_to(v, shape).ravel().tolist() for v in (rows, columns, factors))
        self._linear += list(zip(*every, strict=True))

    # -- what the solver takes ----------------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.low)

    def start(self, w: Array, multipliers: Multipliers | None = None, barrier: float | None = None) -> Start:
        """A start of the solver; see `continuum_grasp.nlp.Start`."""
        bounds = np.array(self.low), np.array(self.high), *self.bounds(self.margins)
        return Start(w, *bounds, multipliers=multipliers, barrier=barrier)

    @cached_property
    def _w(self) -> ca.MX:
        return ca.MX.sym("w", self.size)

    def _given(self, placed: _Placed) -> ca.MX:
        """What a term reads, a column per place."""
        picked = self._w[placed.columns.ravel(order="F").tolist()]
        return ca.reshape(picked, *placed.columns.shape)

    @cached_property
    def _values(self) -> tuple[ca.MX, ca.MX]:
        """Objective and constraints."""
        total = ca.MX.zeros(1 + self.count)
        if self._linear:
            rows, columns, factors = (np.array(v) for v in zip(*self._linear, strict=True))
            matrix = _sparse(rows + 1, columns, factors, 1 + self.count, self.size)
            total = ca.mtimes(matrix, self._w)
        for placed in self._placed:
            out = placed.term.value.map(placed.rows.shape[1])(self._given(placed), ca.DM(placed.data))
            spread = _sparse(
                placed.rows.ravel(order="F") + 1,
                np.arange(placed.rows.size),
                placed.factors.ravel(order="F"),
                1 + self.count,
                placed.rows.size,
            )
            total += ca.mtimes(spread, ca.vec(out))
        return total[0], total[1:]

    @cached_property
    def _slopes(self) -> tuple[ca.MX, ca.MX]:
        """Gradient of the objective (sparse row) and Jacobian of the constraints."""
        entries: list[tuple[Indices, Indices, Array]] = []
        blocks: list[ca.MX] = []
        for placed in self._placed:
            outputs, places = placed.rows.shape
            inputs = placed.columns.shape[0]
            out = placed.term.jacobian.map(places)(self._given(placed), ca.DM(placed.data))
            blocks.append(ca.vec(out))
            rows = np.tile(placed.rows[:, None, :], (1, inputs, 1))
            columns = np.tile(placed.columns[None, :, :], (outputs, 1, 1))
            factors = np.tile(placed.factors[:, None, :], (1, inputs, 1))
            entries.append(tuple(v.ravel(order="F") for v in (rows, columns, factors)))  # type: ignore[arg-type]
        if self._linear:
            rows, columns, factors = (np.array(v) for v in zip(*self._linear, strict=True))
            blocks.append(ca.MX.ones(rows.size))
            entries.append((rows, columns, factors.astype(float)))
        matrix = _gathered(entries, blocks, 1 + self.count, self.size, shift=1)
        return matrix[0, :], matrix[1:, :]

    def _curvature(self, of_objective: ca.MX, multipliers: ca.MX) -> ca.MX:
        """Upper triangle of the Hessian of the Lagrangian."""
        every = ca.vertcat(of_objective, multipliers)
        entries: list[tuple[Indices, Indices, Array]] = []
        blocks: list[ca.MX] = []
        for placed in self._placed:
            inputs, places = placed.columns.shape
            picked = every[(placed.rows.ravel(order="F") + 1).tolist()] * ca.DM(placed.factors.ravel(order="F"))
            weights = ca.reshape(picked, *placed.rows.shape)
            out = placed.term.hessian.map(places)(self._given(placed), ca.DM(placed.data), weights)
            rows = np.tile(placed.columns[:, None, :], (1, inputs, 1)).ravel(order="F")
            columns = np.tile(placed.columns[None, :, :], (inputs, 1, 1)).ravel(order="F")
            # The lower triangle counts too where a place reads its unknowns in another order than that of the columns.
            upper = rows <= columns
            blocks.append(ca.vec(out)[np.flatnonzero(upper).tolist()])
            entries.append((rows[upper], columns[upper], np.ones(int(upper.sum()))))
        return _gathered(entries, blocks, self.size, self.size)

    @cached_property
    def nlp(self) -> NLP:
        """The problem with its derivatives."""
        w, p = self._w, ca.MX.sym("p", 0)
        f, g = self._values
        gradient, jacobian = self._slopes
        sigma, lam = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.count)
        hessian_names = ["x", "p", "lam_f", "lam_g"]
        functions = {
            "grad_f": ca.Function("nlp_grad_f", [w, p], [f, ca.densify(gradient.T)], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", [w, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l", [w, p, sigma, lam], [self._curvature(sigma, lam)], hessian_names, ["triu_hess_gamma_x_x"]
            ),
        }
        return NLP("plan", w, f, g, p, functions, self.semidefinite)


def _sparse(rows: Indices, columns: Indices, factors: Array, height: int, width: int) -> ca.DM:
    """A sparse matrix from its entries, those of one place added."""
    key, place = np.unique(columns * height + rows, return_inverse=True)
    values = np.bincount(place, weights=factors, minlength=key.size)
    pattern = ca.Sparsity.triplet(height, width, (key % height).tolist(), (key // height).tolist())
    return ca.DM(pattern, values)


def _gathered(
    entries: list[tuple[Indices, Indices, Array]], blocks: list[ca.MX], height: int, width: int, shift: int = 0
) -> ca.MX:
    """A sparse matrix whose entries are sums of entries of vectors times factors."""
    rows, columns, factors = (np.concatenate([e[k] for e in entries]) for k in range(3))
    key, place = np.unique(columns * height + rows + shift, return_inverse=True)
    pattern = ca.Sparsity.triplet(height, width, (key % height).tolist(), (key // height).tolist())
    add = _sparse(place, np.arange(place.size), factors, key.size, place.size)
    return ca.MX(pattern, ca.mtimes(add, ca.vertcat(*blocks)))
