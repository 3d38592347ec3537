"""Equations of motion and bounds of the state on the grid: single shooting or collocation."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from continuum_grasp.arrays import Array, Indices
from continuum_grasp.control.ocp.bounds import ABSENT
from continuum_grasp.nlp import Block
from continuum_grasp.planning.assembly import OBJECTIVE, Assembly
from continuum_grasp.planning.motion import Motion
from continuum_grasp.planning.shooting import Term, derived, shooting_interval

_PARTS = 4
"""Places per interval at which the finger stays out of zones [1], the last one at the node."""
_OUTSIDE_WHEN_RELAXED = 100.0
"""Penalty per share by which a hard bound is violated, where only the distance from the goal is minimized
[units of the squared distance]: large, so that bounds give way last."""


@dataclass(frozen=True)
class Grid:
    """Columns of the unknowns of a plan: duration (1, 1), states at the nodes (N + 1, ns), controls (N, nu), and states
    at the collocation points (N, degree, ns), which single shooting does not have.
    """

    time: Indices
    s: Indices
    v: Indices
    inner: Indices

    @property
    def intervals(self) -> int:
        """N."""
        return len(self.v)

    def reads(self, s: Indices) -> Indices:
        """Columns of [s, v, T] for states (N, ns) of the intervals."""
        return np.hstack([s, self.v, np.repeat(self.time, self.intervals, axis=0)])


def add_shooting(assembly: Assembly, motion: Motion, flow: Term, grid: Grid, weight: float) -> tuple[Term, list[ca.DM]]:
    """The end of each interval, by a flow, is the next node; the running objective is weighted by ``weight``.

    Returns the motion over an interval, and the numbers that it reads in each.
    """
    intervals, (steps, stages) = grid.intervals, motion.steps
    term = shooting_interval(flow, motion.ns, intervals, steps, stages)
    rows = _defects(assembly, motion, intervals)
    into = np.hstack([rows, np.full((intervals, 1), OBJECTIVE)])
    data = _numbers(motion, (np.arange(intervals)[:, None] + np.linspace(0.0, 1.0, steps + 1)) / intervals)
    assembly.add(term, grid.reads(grid.s[:-1]), into, data, np.append(np.ones(motion.ns), weight))
    assembly.add_linear(rows, grid.s[1:], -1.0)
    return term, [ca.DM(each.T) for each in data]


def add_collocation(assembly: Assembly, motion: Motion, grid: Grid, weight: float) -> None:
    """Polynomials whose rates are those of the motion at the collocation points."""
    intervals, degree = grid.intervals, motion.scene.solver.degree
    points = ca.collocation_points(degree, "radau")
    rates, ends, quadrature = (np.array(m) for m in ca.collocation_coeff(points))
    data = _numbers(motion, (np.arange(intervals)[:, None] + np.array(points)) / intervals)
    h = 1.0 / intervals
    # A polynomial is given by its values at the start of the interval and at the points.
    basis = [grid.s[:-1], *(grid.inner[:, j] for j in range(degree))]
    for j in range(degree):
        rows = _defects(assembly, motion, intervals, f"motion at point {j + 1}")
        into = np.hstack([rows, np.full((intervals, 1), OBJECTIVE)])
        factors = np.append(np.full(motion.ns, -h), weight * h * quadrature.ravel()[j])
        assembly.add(motion.flow, grid.reads(grid.inner[:, j]), into, data[:, j], factors)
        for columns, rate in zip(basis, rates[:, j], strict=True):
            assembly.add_linear(rows, columns, rate)
    rows = _defects(assembly, motion, intervals)
    for columns, end in zip(basis, ends.ravel(), strict=True):
        assembly.add_linear(rows, columns, end)
    assembly.add_linear(rows, grid.s[1:], -1.0)


def _defects(assembly: Assembly, motion: Motion, intervals: int, name: str = "motion") -> Indices:
    return assembly.rows(name, "intervals", "state", intervals, motion.s_scale)


def _numbers(motion: Motion, shares: Array) -> Array:
    """Numbers that the motion reads (count, points, nd) at shares of the duration (count, points)."""
    # Only where the duration is given does anything vary over time.
    rows = motion.numbers(shares.ravel() * motion.scene.duration_range[1])
    return rows.reshape(*shares.shape, -1)


@dataclass(frozen=True)
class _Bound:
    """Rows of one name: entries among the stages' rows, where and how they are evaluated, places per interval."""

    entries: list[int]
    term: Term
    columns: Indices
    data: Array
    parts: int


class StateBounds:
    """Bounds of the state, at the nodes and for zones also between them; ``relaxed`` bounds have a penalty.

    Between nodes the state is a cubic polynomial through both nodes with their rates, as far as these are states too.
    """

    def __init__(self, assembly: Assembly, motion: Motion, grid: Grid, relaxed: bool) -> None:
        self._assembly, self._motion, self._grid = assembly, motion, grid
        self._bounds: dict[str, _Bound] = {}
        bounded = motion.bounded
        least, most = np.array(bounded.least), np.array(bounded.most)
        lower = np.where(least > -ABSENT, least, -np.inf)
        upper = np.where(most < ABSENT, most, np.inf)
        zones = tuple(motion.scene.bounds.keep_out)
        for name, entries in _groups(bounded.names, zones).items():
            key, unit, size = f"bounds.{name}", "of its limit", 1.0
            if name in zones:
                key, unit, size = f"bounds.keep_out.{name}", "m", motion.length
            bound = self._bounds[name] = self._bound(entries, _PARTS if name in zones else 1)
            count = grid.intervals * bound.parts
            scale = np.full(len(entries), size)
            rows = assembly.rows(name, key, unit, count, scale, lower[entries], upper[entries])
            assembly.add(bound.term, bound.columns, rows, bound.data)
            share = motion.first_duration / count / motion.scales.objective  # penalties are per second
            if relaxed:
                self._soften(rows, np.full(len(entries), _OUTSIDE_WHEN_RELAXED), np.zeros(len(entries)))
            elif not motion.hard[entries].any():
                self._soften(rows, share * bounded.linear[entries], share * bounded.quadratic[entries])

    def _bound(self, entries: list[int], parts: int) -> _Bound:
        """Rows at equal parts of every interval."""
        motion, grid = self._motion, self._grid
        before, after, time = ca.SX.sym("before", motion.ns), ca.SX.sym("after", motion.ns), ca.SX.sym("T")
        at = ca.SX.sym("at")
        s, _, _, numbers = motion.symbols
        x, _, _, p, _ = motion.physical
        rows = motion.rows(x, ca.DM.zeros(motion.nu), p)[entries]
        state = self._between(before, after, time, at) if parts > 1 else after
        z, d = ca.vertcat(before, after, time), ca.vertcat(numbers, at)
        term = derived("rows", z, d, ca.substitute(rows, s, state), exact=motion.exact)
        shares = np.tile(np.arange(1, parts + 1) / parts, grid.intervals)
        columns = np.hstack([grid.s[:-1], grid.s[1:], np.repeat(grid.time, grid.intervals, axis=0)])
        fixed = np.tile(motion.numbers([0.0]), (len(shares), 1))
        return _Bound(entries, term, np.repeat(columns, parts, axis=0), np.hstack([fixed, shares[:, None]]), parts)

    def _between(self, before: ca.SX, after: ca.SX, time: ca.SX, at: ca.SX) -> ca.SX:
        """State at a share of an interval."""
        motion, names = self._motion, self._motion.prediction.x_names
        rates = {name.split(" ")[0]: k for k, name in enumerate(names)}
        h = time * motion.scales.time / self._grid.intervals
        change = after - before
        values = []
        for k in range(motion.ns):
            rate = rates.get(f"{names[k].split(' ')[0]}_rate") if k < motion.nx else None
            value = before[k] + at * change[k]
            if rate is not None:
                # Hermite's cubic: the line, and what the rates at both ends differ from its slope.
                size = h * float(motion.scales.x[rate] / motion.scales.x[k])
                first, last = size * before[rate] - change[k], size * after[rate] - change[k]
                value += at * (1 - at) * ((1 - at) * first - at * last)
            values.append(value)
        return ca.vertcat(*values)

    def _soften(self, rows: Indices, linear: Array, quadratic: Array) -> None:
        """Slacks of rows, and their penalty."""
        z = ca.SX.sym("slack", rows.shape[1])
        penalty = ca.dot(ca.DM(linear), z) + 0.5 * ca.dot(ca.DM(quadratic), z * z)
        squared = ca.DM(np.sqrt(quadratic)) * z
        term = derived("penalty", z, ca.SX(0, 1), penalty, exact=self._motion.exact, squared=squared)
        # One slack for either direction, both positive: a smooth form of the absolute value.
        for sign in (1.0, -1.0):
            slack = self._assembly.variables(len(rows), rows.shape[1], 0.0)
            self._assembly.add_linear(rows, slack, sign)
            self._assembly.add(term, slack, [OBJECTIVE], [])

    def values(self, w: Array, g: Array, block: Block) -> Array:
        """Values that a block of constraints bounds (count, size), without slacks."""
        bound = self._bounds.get(block.name)
        if bound is None:
            return np.asarray(g[block.rows])
        return np.array(bound.term.value.map(len(bound.columns))(ca.DM(w[bound.columns].T), ca.DM(bound.data.T))).T

    def tighten(self, margins: Array) -> None:
        """Move the bounds inwards by amounts (N, ns)."""
        for name, bound in self._bounds.items():
            self._assembly.margins[name] = np.repeat(margins[:, bound.entries], bound.parts, axis=0)


def _groups(names: list[str], zones: tuple[str, ...]) -> dict[str, list[int]]:
    """Entries of each bound: curvature, speed, and zones by name."""
    found: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        stem, _, number = name.rpartition("_")
        # A zone may itself be called "post_1".
        label = name if name in zones else stem if number.isdigit() else name
        found.setdefault("speed" if label == "bending_rate" else label, []).append(k)
    return found
