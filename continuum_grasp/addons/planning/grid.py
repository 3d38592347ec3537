"""Equations of motion and bounds of the state on the grid: single shooting or collocation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from continuum_grasp.addons.planning.assembly import OBJECTIVE, Assembly
from continuum_grasp.addons.planning.motion import PlannedMotion
from continuum_grasp.addons.planning.shooting import Term, derived, shooting_interval
from continuum_grasp.base import Array, Indices

MOST_ELEMENTS = 16
"""Most elements of an interval [1]: of 10 ms, half the time in which a contact at 2 m/s closes a rounding of 1 mm."""
BOUNDED = 4
"""Places per element at which bounds of the state hold, the last one at the node [1]."""


@dataclass(frozen=True)
class PlanGrid:
    """Columns of the unknowns of a plan: duration (1, 1), states at the nodes (N + 1, ns), controls (N, nu), and states
    at the collocation points of all elements (elements, degree, ns), which single shooting does not have.

    Every interval has so many equal elements as ``counts`` (N) states.
    """

    time: Indices
    s: Indices
    v: Indices
    points: Indices
    counts: Indices

    @cached_property
    def interval(self) -> Indices:
        """Interval of each element."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def lengths(self) -> Array:
        """Length of each element [intervals]."""
        return np.asarray(1.0 / self.counts[self.interval])

    @cached_property
    def starts(self) -> Array:
        """Beginning of each element [intervals]."""
        within = np.arange(len(self.interval)) - (np.cumsum(self.counts) - self.counts)[self.interval]
        return np.asarray(self.interval + within * self.lengths)

    @property
    def shares(self) -> Array:
        """Shares (elements, degree) of their interval at which the motion holds."""
        points = np.array(ca.collocation_points(self.points.shape[1], "radau"))
        return np.asarray((self.starts - self.interval)[:, None] + self.lengths[:, None] * points)

    @cached_property
    def basis(self) -> Indices:
        """Columns (elements, basis, ns) of states that give the motion over each element: of collocation its start, the
        last point before, and its points; else both nodes.
        """
        first = self.s[self.interval]
        if not self.points.size:
            return np.stack([first, self.s[1:]], axis=1)
        later = np.flatnonzero(self.starts > self.interval)
        first[later] = self.points[later - 1, -1]
        return np.concatenate([first[:, None], self.points], axis=1)

    def at(self, times: Array) -> tuple[Indices, Array]:
        """Columns (count, basis, ns) and weights (count, basis) of states at times [intervals] after the first node.

        Of collocation they are on its polynomial, else on the line between both nodes.
        """
        # 1e-9: rounding of the ends of elements [intervals]
        element = np.searchsorted(self.starts, times - 1e-9) - 1
        tau = [0.0, *(ca.collocation_points(self.points.shape[1], "radau") if self.points.size else [1.0])]
        local = (times - self.starts[element]) / self.lengths[element]
        weights = np.linalg.solve(np.vander(tau).T, np.vander(local, len(tau)).T).T
        return self.basis[element], np.asarray(weights)

    def reads(self, s: Indices) -> Indices:
        """Columns of [s, v, T] for a state (elements, ns) of each element."""
        return np.hstack([s, self.v[self.interval], np.repeat(self.time, len(s), axis=0)])


def add_shooting(
    assembly: Assembly, motion: PlannedMotion, flow: Term, grid: PlanGrid, weight: float, resolution: tuple[int, int]
) -> tuple[Term, list[ca.DM]]:
    """The end of each interval, by a flow, is the next node; the running objective is weighted by ``weight``.

    ``resolution`` is the number of steps per interval, and of stages per step. Returns the motion over an interval, and
    the numbers that it reads in each.
    """
    intervals = len(grid.v)
    steps, stages = resolution
    term = shooting_interval(flow, motion.ns, intervals, steps, stages)
    rows = _defects(assembly, motion, intervals)
    into = np.hstack([rows, np.full((intervals, 1), OBJECTIVE)])
    times = np.arange(intervals)[:, None] + np.linspace(0.0, 1.0, steps + 1)
    data = motion.numbers(times / intervals)
    assembly.add(term, grid.reads(grid.s[:-1]), into, data, np.append(np.ones(motion.ns), weight))
    assembly.add_linear(rows, grid.s[1:], -1.0)
    return term, [ca.DM(each.T) for each in data]


def add_collocation(assembly: Assembly, motion: PlannedMotion, grid: PlanGrid, weight: float) -> None:
    """Polynomials whose rates equal the motion's at the collocation points."""
    intervals = len(grid.v)
    degree = grid.points.shape[1]
    count = len(grid.interval)
    data = motion.numbers((grid.interval[:, None] + grid.shares) / intervals)
    h = grid.lengths[:, None] / intervals
    rates, ends, quadrature = (np.array(m) for m in ca.collocation_coeff(ca.collocation_points(degree, "radau")))
    for j in range(degree):
        rows = _defects(assembly, motion, count, f"motion at point {j + 1}")
        into = np.hstack([rows, np.full((count, 1), OBJECTIVE)])
        factors = np.hstack([np.tile(-h, motion.ns), weight * h * quadrature.ravel()[j]])
        assembly.add(motion.flow, grid.reads(grid.points[:, j]), into, data[:, j], factors)
        for columns, rate in zip(grid.basis.swapaxes(0, 1), rates[:, j], strict=True):
            assembly.add_linear(rows, columns, rate)
    rows = _defects(assembly, motion, intervals)
    last = grid.basis[np.cumsum(grid.counts) - 1]
    for columns, end in zip(last.swapaxes(0, 1), ends.ravel(), strict=True):
        assembly.add_linear(rows, columns, end)
    assembly.add_linear(rows, grid.s[1:], -1.0)


def _defects(assembly: Assembly, motion: PlannedMotion, intervals: int, name: str = "motion") -> Indices:
    return assembly.rows(name, "intervals", "state", intervals, motion.s_scale)


class StateBounds:
    """Bounds of the state, at the nodes and between them; ``relaxed`` bounds have a penalty.

    Between the nodes of single shooting, where the state is not known, zones alone hold, of the line between both, and
    where there is contact.
    """

    def __init__(self, assembly: Assembly, motion: PlannedMotion, grid: PlanGrid, relaxed: bool) -> None:
        self._assembly = assembly
        self._motion = motion
        # Terms of each bound by its key, columns that they read, and their numbers.
        self._terms: dict[str, tuple[Term, Indices, Array]] = {}
        bounded = motion.bounded
        # With contact at the nodes alone in the first search: with bounds between them too, IPOPT did not solve a plan
        # with a mug in 500 iterations; without, in 334.
        smooth = grid.points.size and (motion.scene.object is None or grid.counts.max() > 1)
        for key, entries in bounded.groups.items():
            name = key.removeprefix("keep_out.")
            of_zone = name != key
            unit = "of its limit"
            size = 1.0
            if of_zone:
                unit = "m"
                size = motion.length
            places = (grid.s[1:, None], np.ones((len(grid.v), 1)))
            held = grid.v
            lengths = np.ones(len(grid.v))
            if smooth or of_zone:
                times = grid.starts[:, None] + grid.lengths[:, None] * np.arange(1, BOUNDED + 1) / BOUNDED
                places = grid.at(times.ravel())
                held = np.repeat(grid.v[grid.interval], BOUNDED, axis=0)
                lengths = np.repeat(grid.lengths / BOUNDED, BOUNDED)
            term, columns, data = self._terms[f"bounds.{key}"] = self._term(entries, *places, held)
            scale = np.full(len(entries), size)
            limits = (bounded.least[entries], bounded.most[entries])
            rows = assembly.rows(name, f"bounds.{key}", unit, len(lengths), scale, *limits)
            assembly.add(term, columns, rows, data)
            # Penalties are per second.
            share = motion.first_duration / len(grid.v) / motion.scales.objective * lengths[:, None]
            if relaxed:
                # 100.0: penalty per share by which a hard bound is violated, where only the distance from the goal is
                # minimized [units of the squared distance]: large, so that bounds give way last
                self._soften(rows, np.full(len(entries), 100.0), np.zeros(len(entries)), 1.0)
            elif not bounded.hard[entries].any():
                self._soften(rows, bounded.linear[entries], bounded.quadratic[entries], share)

    def _term(self, entries: list[int], states: Indices, weights: Array, held: Indices) -> tuple[Term, Indices, Array]:
        """Entries of the bounds at places: columns of states, weights of their sum, columns of the input held there."""
        motion, (count, size) = self._motion, weights.shape
        z, numbers = motion.node
        x, u, _, p, _ = motion.physical
        basis = ca.SX.sym("basis", motion.ns, size)
        share = ca.SX.sym("share", size)
        rows = motion.rows(x, u, p)[entries]
        value = ca.substitute(rows, z[: motion.ns], ca.mtimes(basis, share))
        z = ca.vertcat(ca.vec(basis), z[motion.ns :])
        term = derived("rows", z, ca.vertcat(numbers, share), value, exact=motion.exact)
        same = np.tile(motion.numbers([0.0]), (count, 1))
        data = np.hstack([same, weights])
        return term, np.hstack([states.reshape(count, -1), held]), data

    def _soften(self, rows: Indices, linear: Array, quadratic: Array, share: Array | float) -> None:
        """Slacks of rows, and their penalty times the share of each row."""
        z = ca.SX.sym("slack", rows.shape[1])
        penalty = ca.dot(ca.DM(linear), z) + 0.5 * ca.dot(ca.DM(quadratic), z * z)
        squared = ca.DM(np.sqrt(quadratic)) * z
        term = derived("penalty", z, ca.SX(0, 1), penalty, exact=self._motion.exact, squared=squared)
        # One slack for either direction, both positive: a smooth form of the absolute value.
        for sign in (1.0, -1.0):
            slack = self._assembly.variables(len(rows), rows.shape[1], 0.0)
            self._assembly.add_linear(rows, slack, sign)
            self._assembly.add(term, slack, [OBJECTIVE], [], share, aside=True)

    def values(self, w: Array, g: Array, key: str, rows: Indices) -> Array:
        """Values that the constraints of a key bound (count, size), in some rows of the problem, without slacks."""
        if key not in self._terms:
            return np.asarray(g[rows])
        term, columns, data = self._terms[key]
        return np.array(term.value.map(len(columns))(w[columns.T], data.T)).T
