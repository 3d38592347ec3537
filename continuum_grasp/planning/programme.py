"""A nonlinear programme that is put together from small functions, each evaluated at many places.

Values, Jacobian and Hessian of the Lagrangian are assembled from those of the small functions, which may be compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.planning.term import Term

__all__ = ["Block", "Programme"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

OBJECTIVE = -1
"""Row number that stands for the objective."""


@dataclass(frozen=True)
class Block:
    """Constraints of one name.

    Attributes
    ----------
    name : str
    key : str
        The YAML key that sets them.
    unit : str
    rows : (count, size) ndarray of int
        Row numbers: one line per node or interval.
    lower, upper : (count, size) ndarray
        Bounds, in units of the programme.
    scale : (size,) ndarray
        Physical amount of one such unit.
    """

    name: str
    key: str
    unit: str
    rows: Indices
    lower: Array
    upper: Array
    scale: Array

    def values(self, g: Array) -> Array:
        """What is bounded, in physical units (count, size)."""
        return np.asarray(g[self.rows] * self.scale)

    def excess(self, g: Array) -> Array:
        """By how much the bounds are left, in units of the programme (count, size)."""
        part = g[self.rows]
        return np.maximum(np.maximum(self.lower - part, part - self.upper), 0.0)


@dataclass
class _Placed:
    """A term at many places: columns (nz, count) that it reads, rows (no, count) that it adds to, with factors."""

    term: Term
    columns: Indices
    rows: Indices
    factors: Array
    data: Array


@dataclass
class Programme:
    """Minimise f(w) subject to lower <= g(w) <= upper and low <= w <= high.

    Attributes
    ----------
    low, high : list of float
        Bounds of the unknowns.
    blocks : list of Block
        Constraints.
    margins : dict of str to ndarray
        By how much the bounds of a block are moved inwards, by its name.
    """

    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)
    margins: dict[str, Array] = field(default_factory=dict)
    _placed: list[_Placed] = field(default_factory=list)
    _linear: list[tuple[int, int, float]] = field(default_factory=list)
    _rows: int = 0

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

    def require(
        self,
        name: str,
        key: str,
        unit: str,
        count: int,
        scale: ArrayLike,
        lower: ArrayLike = 0.0,
        upper: ArrayLike = 0.0,
    ) -> Indices:
        """Add constraints, to be filled by ``add`` and ``add_linear``: their row numbers (count, size)."""
        amounts = np.atleast_1d(np.asarray(scale, dtype=float))
        rows = np.arange(self._rows, self._rows + count * amounts.size).reshape(count, amounts.size)
        low, high = (np.array(np.broadcast_to(b, rows.shape), dtype=float) for b in (lower, upper))
        self.blocks.append(Block(name, key, unit, rows, low, high, amounts))
        self._rows += rows.size
        return rows

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
        term : Term
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

    @property
    def count(self) -> int:
        """Number of constraints."""
        return self._rows

    @property
    def bounds(self) -> dict[str, Array]:
        """Bounds by the names of the solver."""
        lower, upper = np.zeros(self.count), np.zeros(self.count)
        for block in self.blocks:
            margin = self.margins.get(block.name, 0.0)
            lower[block.rows], upper[block.rows] = block.lower + margin, block.upper - margin
        return {"lbx": np.array(self.low), "ubx": np.array(self.high), "lbg": lower, "ubg": upper}

    def block(self, name: str) -> Block | None:
        """The constraints of a name, if there are any."""
        return next((block for block in self.blocks if block.name == name), None)

    @cached_property
    def _w(self) -> ca.MX:
        return ca.MX.sym("w", self.size)

    @cached_property
    def _p(self) -> ca.MX:
        return ca.MX.sym("p", 0)

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
            kept = rows <= columns
            blocks.append(ca.vec(out)[np.flatnonzero(kept).tolist()])
            entries.append((rows[kept], columns[kept], np.ones(int(kept.sum()))))
        return _gathered(entries, blocks, self.size, self.size)

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """What IPOPT calls: ``grad_f``, ``jac_g`` and ``hess_lag``."""
        w, p = self._w, self._p
        f, g = self._values
        gradient, jacobian = self._slopes
        sigma, lam = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.count)
        curvature = self._curvature(sigma, lam)
        return {
            "grad_f": ca.Function("nlp_grad_f", [w, p], [f, ca.densify(gradient.T)], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", [w, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l",
                [w, p, sigma, lam],
                [curvature],
                ["x", "p", "lam_f", "lam_g"],
                ["triu_hess_gamma_x_x"],
            ),
        }

    @property
    def nlp(self) -> dict[str, ca.MX]:
        """The programme as CasADi's solvers take it."""
        f, g = self._values
        return {"x": self._w, "p": self._p, "f": f, "g": g}


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
