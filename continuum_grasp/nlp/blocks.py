"""Problems that are sums of small blocks: a kind of block is differentiated once, a problem of any structure is not.

A kind is a function of local unknowns z and data d that gives rows, with its exact first and second derivatives. Block
i of a kind reads the unknowns x[z_i] of the problem, has data d_i, and adds its rows to the rows g[r_i]; several blocks
may add to the same row, as contacts do to the balance of an object. With constant matrices S of zeros and ones,

    g = S_g vec(rows),    nz(dg/dx) = S_J nz(d rows / dz),    nz(Hessian) = S_H nz(sum over r of lam_r d2 rows_r / dz2)

The objective is c' x + x' diag(s) x / 2 with costs c and s.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, Indices
from continuum_grasp.core import CSource
from continuum_grasp.nlp.attempt import Start
from continuum_grasp.nlp.problem import NLP, Constraints
from continuum_grasp.nlp.sums import entries_at, scattered

ORDER = 4
"""Coefficients of a cubic spline per axis that act in a cell."""
LONG = 500
"""Instructions of second derivatives from which on functions of a kind are compiled: an interpreter takes 10 to 14
times as long for thousands of them, and hardly longer for a few (`benchmarks.bench_rods`, with and without ``CC=``)."""
_STORED = 64
"""Structures whose problems are stored in a process."""
_problems: dict[tuple[object, ...], NLP] = {}


@dataclass(frozen=True, eq=False)
class Lookup:
    """A spline in a table that blocks of a kind read.

    A block reads the coefficients of the cell that it is in. Cell and coefficients change only from cell to cell, where
    a cubic spline and two of its derivatives are the same from both sides: so they are data, and ``found``, by which
    the rows know the spline near a place, is data, too. Rows that are exact to second order in the unknowns have exact
    derivatives: a Taylor polynomial about the place does.

    Attributes
    ----------
    at : casadi.SX
        Place in the table (axes,), in steps of the table; an expression of unknowns and data.
    first : casadi.SX
        Index of the table's first coefficient, a number among the data.
    counts : casadi.SX
        Coefficients along the axes (axes,), numbers among the data; the last axis varies fastest.
    given : casadi.SX
        Expression of unknowns and data for ``series``.
    series : casadi.Function
        ``given``, the cell (axes,) and its coefficients (4^axes,) to ``found``.
    found : casadi.SX
        Symbols on which the rows depend.
    """

    at: ca.SX
    first: ca.SX
    counts: ca.SX
    given: ca.SX
    series: ca.Function
    found: ca.SX


class BlockKind:
    """Rows of a block as a function of its unknowns and data, with derivatives.

    Parameters
    ----------
    name : str
    unknowns, data : casadi.SX
        Symbols.
    rows : casadi.SX
        Expression of these, and of ``lookup.found``.
    lookup : Lookup, optional
    """

    def __init__(
        self,
        name: str,
        unknowns: ca.SX,
        data: ca.SX,
        rows: ca.SX,
        lookup: Lookup | None = None,
    ) -> None:
        self.name = name
        self._symbols, self._lookup = (unknowns, data, rows), lookup
        self.unknowns = int(unknowns.numel())
        self.data = int(data.numel())
        self.count = int(rows.numel())
        self.axes = 0 if lookup is None else int(lookup.at.numel())
        found = ca.SX(0, 1) if lookup is None else lookup.found
        forces = ca.SX.sym("forces", self.count)
        jacobian = ca.jacobian(rows, unknowns)
        hessian = ca.triu(ca.hessian(ca.dot(forces, rows), unknowns)[0])
        self.jacobian_pattern, self.hessian_pattern = jacobian.sparsity(), hessian.sparsity()
        given = [unknowns, data, found]
        self.values = ca.Function(f"{name}_rows", given, [ca.densify(rows)], {"cse": True})
        self.slopes = ca.Function(f"{name}_slopes", given, [ca.densify(rows), jacobian.nz[:]], {"cse": True})
        self.curvature = ca.Function(f"{name}_curvature", [*given, forces], [hessian.nz[:]], {"cse": True})
        self.first: int | None = None
        if lookup is not None:
            (self.first,) = ca.jacobian(lookup.first, data).sparsity().get_col()
            read = [lookup.at, lookup.first, lookup.counts, lookup.given]
            self.read = ca.Function(f"{name}_read", [unknowns, data], read, {"cse": True})
            self.series = lookup.series
        if self.curvature.n_instructions() > LONG:
            self._compile()

    @cached_property
    def tangent(self) -> BlockKind:
        """Changes of the rows to first order: a kind of the unknowns, followed by as many changes of them."""
        unknowns, data, rows = self._symbols
        changes = ca.SX.sym("changes", self.unknowns)
        both = ca.vertcat(unknowns, changes)
        changed = ca.jtimes(rows, unknowns, changes)
        return BlockKind(f"{self.name}_tangent", both, data, changed, self._lookup)

    def _compile(self) -> None:
        """Take compiled functions if they are there; else have them compiled once per machine, as kinds are few."""
        names = ["values", "slopes", "curvature", *(["read", "series"] if self.axes else [])]
        functions = CSource([getattr(self, name) for name in names]).loaded_or_begun(f"{self.name} of grasps")
        for name, function in zip(names, functions or [], strict=False):
            setattr(self, name, function)

    def moved(self, data: Array, by: int) -> Array:
        """Data of a block whose coefficients are so many places further in the table."""
        if self.first is None or by == 0:
            return data
        moved = data.copy()
        moved[self.first] += by
        return moved

    def found(self, unknowns: ca.MX, data: ca.MX, numbers: ca.MX, table: int, count: int) -> ca.MX:
        """Values that the lookups of blocks find, a column each; the table starts at a place among the numbers."""
        if not self.axes:
            return ca.MX(0, count)
        at, first, counts, given = self.read.map(count)(unknowns, data)
        cell = _cell(at, counts, ca)
        place = ca.repmat(first, ORDER**self.axes, 1)
        stride: ca.MX | float = 1.0
        for axis in reversed(range(self.axes)):
            along = ca.repmat(cell[axis, :] - 1.0, ORDER**self.axes, 1) + ca.repmat(_offsets(self.axes)[axis], 1, count)
            place = place + along * stride
            stride = stride * ca.repmat(counts[axis, :], ORDER**self.axes, 1)
        # From the numbers themselves: a part of them would be a copy of the table in each call.
        coefficients = ca.reshape(numbers[ca.vec(place) + table], ORDER**self.axes, count)
        return self.series.map(count)(given, cell, coefficients)

    def value(self, unknowns: Array, data: Array, table: Array) -> Array:
        """Rows (count,) of one block by values."""
        return np.array(self.values(unknowns, data, self._found(unknowns, data, table))).ravel()

    def slope(self, unknowns: Array, data: Array, table: Array) -> Array:
        """Derivatives (count, unknowns) of the rows of one block by values."""
        slopes = np.zeros((self.count, self.unknowns))
        entries = self.slopes(unknowns, data, self._found(unknowns, data, table))[1]
        i, j = self.jacobian_pattern.get_triplet()
        slopes[i, j] = np.array(entries).ravel()
        return slopes

    def _found(self, unknowns: Array, data: Array, table: Array) -> Any:
        """Values that the lookup of one block finds."""
        if not self.axes:
            return np.zeros(0)
        at, first, counts, given = (np.array(part).ravel() for part in self.read(unknowns, data))
        cell = _cell(at, counts, np)
        grid = table[int(first[0]) :][: int(counts.prod())].reshape(counts.astype(int))
        near = grid[tuple(slice(int(c) - 1, int(c) - 1 + ORDER) for c in cell)]
        return self.series(given, cell, near.ravel())


def _cell(at: Any, counts: Any, lib: Any) -> Any:
    """Cell of a place in a table: its four coefficients per axis begin one before it."""
    # 1e-9: share of a cell by which the last place is within the last cell
    return lib.floor(lib.fmin(lib.fmax(at, 1.0), counts - 2.0 - 1e-9))


def _offsets(axes: int) -> list[ca.DM]:
    """Offsets (4^axes,) of a cell's coefficients along each axis."""
    return [ca.DM(part.ravel().astype(float)) for part in np.indices((ORDER,) * axes)]


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Blocks of one kind."""

    kind: BlockKind
    unknowns: list[Indices]
    rows: list[Indices]
    data: list[Array]


@dataclass(frozen=True, eq=False)
class IncludedProblem:
    """Places of a problem's unknowns and rows in another one that includes it."""

    problem: BlockProblem
    unknowns: Indices
    rows: Indices


class BlockProblem(Constraints):
    """A problem that is written as unknowns by name, rows by name, and blocks between them.

    Attributes
    ----------
    at : dict of str to ndarray of int
        Places of the unknowns by name.
    table : ndarray
        Coefficients that lookups read.
    """

    def __init__(self, name: str, table: ArrayLike = ()) -> None:
        super().__init__()
        self.name = name
        self.table = np.asarray(table, dtype=float)
        self._tables = [(self.table, 0)]
        self.at: dict[str, Indices] = {}
        self._low: list[float] = []
        self._high: list[float] = []
        self._blocks: dict[str, _Blocks] = {}
        self._costs: dict[int, tuple[float, float]] = {}

    # -- writing -----------------------------------------------------------------------------------------------

    def unknown(self, name: str, low: ArrayLike, high: ArrayLike) -> Indices:
        """Add unknowns between bounds (size,); their places."""
        lows, highs = np.asarray(low, float), np.asarray(high, float)
        size = max(lows.size, highs.size)
        at = np.arange(len(self._low), len(self._low) + size)
        self._low += np.full(size, lows).tolist()
        self._high += np.full(size, highs).tolist()
        self.at[name] = at
        return at

    def named(self, other: BlockProblem, x: Array) -> Array:
        """Unknowns by the ones ``x`` of the same names and sizes in another problem; zeros where it has none."""
        found = np.zeros(self.size)
        for name, at in self.at.items():
            if name in other.at and other.at[name].size == at.size:
                found[at] = x[other.at[name]]
        return found

    def add(self, kind: BlockKind, unknowns: ArrayLike, rows: ArrayLike, data: ArrayLike) -> None:
        """Add a block of a kind by the places of its unknowns and rows, and its data."""
        blocks = self._blocks.setdefault(kind.name, _Blocks(kind, [], [], []))
        at, own, numbers = np.array(unknowns, int).ravel(), np.array(rows, int).ravel(), np.array(data, float).ravel()
        if (at.size, own.size, numbers.size) != (kind.unknowns, kind.count, kind.data):
            sizes = kind.unknowns, kind.count, kind.data
            raise ValueError(f"{kind.name}: {[at.size, own.size, numbers.size]} unknowns, rows and data for {sizes}")
        blocks.unknowns.append(at)
        blocks.rows.append(own)
        blocks.data.append(numbers)

    def of_kind(self, name: str) -> Iterator[tuple[BlockKind, Indices, Indices, Array]]:
        """Blocks of a kind by its name: the kind, places of unknowns and rows, and data."""
        if name in self._blocks:
            blocks = self._blocks[name]
            for at, rows, data in zip(blocks.unknowns, blocks.rows, blocks.data, strict=True):
                yield blocks.kind, at, rows, data

    def include(self, name: str, part: BlockProblem) -> IncludedProblem:
        """Add all that another problem consists of: unknowns, rows, blocks, and costs."""
        unknowns = self.unknown(name, *part.limits)
        rows = np.arange(self.count, self.count + part.count)
        self.blocks += [
            replace(block, name=f"{name}, {block.name}", rows=block.rows + self.count) for block in part.blocks
        ]
        self.count += part.count
        first = self._first_of(part.table)
        for blocks in part._blocks.values():
            for at, of, data in zip(blocks.unknowns, blocks.rows, blocks.data, strict=True):
                self.add(blocks.kind, unknowns[at], rows[of], blocks.kind.moved(data, first))
        for place, costs in part._costs.items():
            self.cost(unknowns[place], *costs)
        return IncludedProblem(part, unknowns, rows)

    def _first_of(self, table: Array) -> int:
        """Place of the first coefficient of another problem's table, which is appended if it is a new one."""
        for known, first in self._tables:
            if known is table:
                return first
        self._tables.append((table, self.table.size))
        self.table = np.concatenate([self.table, table])
        return self._tables[-1][1]

    def cost(self, at: ArrayLike, linear: float, square: float = 0.0) -> None:
        """Add costs of unknowns to the objective: linear x + square x^2 / 2."""
        for place in np.ravel(np.asarray(at, int)).tolist():
            before = self._costs.get(place, (0.0, 0.0))
            self._costs[place] = before[0] + linear, before[1] + square

    def scale_costs(self, at: ArrayLike, factor: float) -> None:
        """Multiply the costs of unknowns by a factor."""
        for place in np.ravel(np.asarray(at, int)).tolist():
            linear, square = self._costs.get(place, (0.0, 0.0))
            self._costs[place] = factor * linear, factor * square

    def bound(self, at: ArrayLike, low: ArrayLike | None = None, high: ArrayLike | None = None) -> None:
        """Change bounds of unknowns."""
        places = np.ravel(np.asarray(at, int)).tolist()
        for bounds, values in ((self._low, low), (self._high, high)):
            if values is not None:
                for place, value in zip(places, np.broadcast_to(np.asarray(values, float), len(places)), strict=True):
                    bounds[place] = float(value)

    @cached_property
    def free_row(self) -> int:
        """A row without bounds, for rows of blocks that do not matter."""
        return int(self.rows("free", self.name, "1", 1, 1.0, -np.inf, np.inf).item())

    def add_tangents(self, changes: Indices, rows: Indices) -> None:
        """Add the changes of rows to first order.

        Parameters
        ----------
        changes : ndarray of int, shape (size before,)
            Place of the unknown that is the change of each unknown.
        rows : ndarray of int, shape (count before,)
            Place of the row that is the change of each row; -1 of rows whose changes do not matter.
        """
        places = np.where(rows < 0, self.free_row, rows)
        for blocks in list(self._blocks.values()):
            for at, own, data in zip(blocks.unknowns, blocks.rows, blocks.data, strict=True):
                if own.max() < len(rows) and (rows[own] >= 0).any():
                    self.add(blocks.kind.tangent, [*at, *changes[at]], places[own], data)

    # -- solving -----------------------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self._low)

    @property
    def limits(self) -> tuple[Array, Array]:
        """Bounds of the unknowns (size,)."""
        return np.array(self._low), np.array(self._high)

    @property
    def parameters(self) -> Array:
        """Data of all blocks, the table, and the costs."""
        costs = np.zeros((2, self.size))
        for place, pair in self._costs.items():
            costs[:, place] = pair
        data = [np.concatenate(blocks.data) for blocks in self._blocks.values()]
        return np.concatenate([*data, self.table, *costs])

    def objective(self, x: Array) -> float:
        """Costs of unknowns (size,)."""
        return float(sum(c * x[at] + 0.5 * s * x[at] ** 2 for at, (c, s) in self._costs.items()))

    def start(self, x: Array) -> Start:
        """A start of a solver at unknowns (size,)."""
        low, high = self.limits
        return Start(np.clip(x, low, high), low, high, *self.bounds(), p=self.parameters)

    def row_values(self, x: Array, rows: Indices, kinds: Sequence[str] = ()) -> Array:
        """Sums in some rows (rows,) of the blocks of all kinds, or of some, at unknowns."""
        g = np.zeros(self.count)
        wanted = set(np.ravel(rows).tolist())
        for name, blocks in self._blocks.items():
            if kinds and name not in kinds:
                continue
            for at, own, data in zip(blocks.unknowns, blocks.rows, blocks.data, strict=True):
                if wanted.intersection(own.tolist()):
                    np.add.at(g, own, blocks.kind.value(x[at], data, self.table))
        return g[rows]

    @property
    def nlp(self) -> NLP:
        """The problem with its derivatives; the same one for all of the same structure."""
        blocks = tuple(
            (name, np.array(b.unknowns).tobytes(), np.array(b.rows).tobytes()) for name, b in self._blocks.items()
        )
        key = self.name, self.size, self.count, self.table.size, blocks
        if key not in _problems:
            while len(_problems) >= _STORED:
                del _problems[next(iter(_problems))]
            _problems[key] = _Sum(self.name, self.size, self.count, self.table.size, list(self._blocks.values())).nlp
        return _problems[key]


class _Sum:
    """Symbolic sum of the blocks of a structure."""

    def __init__(self, name: str, size: int, count: int, table: int, blocks: Sequence[_Blocks]) -> None:
        self._name, self._size, self._count = name, size, count
        sizes = [len(b.data) * b.kind.data for b in blocks]
        ends = np.cumsum([0, *sizes, table, size, size]).tolist()
        self.x, self.p = ca.MX.sym("x", size), ca.MX.sym("p", ends[-1])
        self._f_force, self._forces = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", count)
        *owned, _, self._linear, self._square = (self.p[a:b] for a, b in itertools.pairwise(ends))
        self._table = ends[-4]
        self._given = [self._given_to(b, data) for b, data in zip(blocks, owned, strict=True)]
        self._blocks = blocks

    def _given_to(self, blocks: _Blocks, data: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """Unknowns, data and what lookups find of all blocks of a kind, a column each."""
        kind, count = blocks.kind, len(blocks.data)
        unknowns = ca.reshape(self.x[np.concatenate(blocks.unknowns).tolist()], kind.unknowns, count)
        data = ca.reshape(data, kind.data, count)
        return unknowns, data, kind.found(unknowns, data, self.p, self._table, count)

    @cached_property
    def nlp(self) -> NLP:
        """The problem."""
        f = ca.dot(self._linear, self.x) + 0.5 * ca.dot(self._square, self.x * self.x)
        pairs = list(zip(self._blocks, self._given, strict=True))
        places = [np.concatenate(b.rows) for b in self._blocks]
        values = [ca.vec(b.kind.values.map(len(b.data))(*given)) for b, given in pairs]
        g = scattered(self._count, places, values)
        return NLP(self._name, self.x, f, g, self.p, self._derivatives(f))

    def _derivatives(self, f: ca.MX) -> Mapping[str, ca.Function]:
        values, rows, columns, slopes = list[ca.MX](), list[Indices](), list[Indices](), list[ca.MX]()
        first, second, curvatures = list[Indices](), list[Indices](), list[ca.MX]()
        for blocks, given in zip(self._blocks, self._given, strict=True):
            kind, count = blocks.kind, len(blocks.data)
            unknowns, places = np.array(blocks.unknowns), np.array(blocks.rows)
            value, slope = kind.slopes.map(count)(*given)
            i, j = (np.array(part, int) for part in kind.jacobian_pattern.get_triplet())
            values.append(ca.vec(value))
            rows.append(places[:, i].ravel())
            columns.append(unknowns[:, j].ravel())
            slopes.append(ca.vec(slope))
            if not kind.hessian_pattern.nnz():
                continue
            forces = ca.reshape(self._forces[places.ravel().tolist()], kind.count, count)
            i, j = (np.array(part, int) for part in kind.hessian_pattern.get_triplet())
            a, b = unknowns[:, i], unknowns[:, j]
            first.append(np.minimum(a, b).ravel())
            second.append(np.maximum(a, b).ravel())
            # A pair of different local unknowns that are the same one of the problem counts twice.
            twice = 1.0 + ((a == b) & (i != j)).ravel()
            curvatures.append(ca.vec(kind.curvature.map(count)(*given, forces)) * ca.DM(twice))
        own = np.arange(self._size)
        g = scattered(self._count, [np.concatenate(b.rows) for b in self._blocks], values)
        jacobian = entries_at((self._count, self._size), rows, columns, slopes)
        diagonal = self._f_force * self._square
        hessian = entries_at((self._size, self._size), [*first, own], [*second, own], [*curvatures, diagonal])
        x, p = self.x, self.p
        return {
            "grad_f": ca.Function(
                "grad_f", [x, p], [f, self._linear + self._square * x], ["x", "p"], ["f", "grad_f_x"]
            ),
            "jac_g": ca.Function("jac_g", [x, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "hess_lag",
                [x, p, self._f_force, self._forces],
                [hessian],
                ["x", "p", "lam_f", "lam_g"],
                ["triu_hess_gamma_x_x"],
            ),
        }
