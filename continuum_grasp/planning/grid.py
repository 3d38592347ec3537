"""Equations of motion and bounds of the state on the grid: single shooting or collocation."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from continuum_grasp.arrays import Array, Indices
from continuum_grasp.control.ocp.bounds import ABSENT
from continuum_grasp.nlp import Block
from continuum_grasp.planning.assembly import OBJECTIVE, Assembly
from continuum_grasp.planning.motion import Motion, parameters_over_time
from continuum_grasp.planning.shooting import Term, derived, shooting_interval


@dataclass(frozen=True)
class Grid:
    """Columns of the unknowns of a plan: duration (1, 1), states at the nodes (N + 1, ns), controls (N, nu), and states
    at the collocation points of all ``elements`` of an interval (N, points, ns), which single shooting does not have.
    """

    time: Indices
    s: Indices
    v: Indices
    inner: Indices
    elements: int = 1

    @property
    def intervals(self) -> int:
        """Number of intervals N."""
        return len(self.v)

    def places(self, parts: int) -> tuple[Indices, Array]:
        """Columns (N parts, basis, ns) and weights (N parts, basis) of states at equal parts of every interval.

        Of collocation they are on its polynomial, else on the line between both nodes.
        """
        if parts == 1:
            return self.s[1:, None], np.ones((self.intervals, 1))
        elements, degree = self.elements, self.inner.shape[1] // self.elements
        tau = [0.0, *(ca.collocation_points(degree, "radau") if degree else [1.0])]
        basis = np.concatenate([self.s[:-1, None], self.inner if degree else self.s[1:, None]], axis=1)
        shares = elements * np.arange(1, parts + 1) / parts
        element = np.ceil(shares).astype(int) - 1
        of_element = np.linalg.solve(np.vander(tau).T, np.vander(shares - element, len(tau)).T).T
        weights = np.zeros((parts, basis.shape[1]))
        first = element * (len(tau) - 1)
        np.put_along_axis(weights, first[:, None] + np.arange(len(tau)), of_element, axis=1)
        return np.repeat(basis, parts, axis=0), np.tile(weights, (self.intervals, 1))

    def reads(self, s: Indices) -> Indices:
        """Columns of [s, v, T] for states (N, ns) of the intervals."""
        return np.hstack([s, self.v, np.repeat(self.time, self.intervals, axis=0)])


def add_shooting(
    assembly: Assembly, motion: Motion, flow: Term, grid: Grid, weight: float, resolution: tuple[int, int]
) -> tuple[Term, list[ca.DM]]:
    """The end of each interval, by a flow, is the next node; the running objective is weighted by ``weight``.

    ``resolution`` is the number of steps per interval, and of stages per step. Returns the motion over an interval, and
    the numbers that it reads in each.
    """
    intervals, (steps, stages) = grid.intervals, resolution
    term = shooting_interval(flow, motion.ns, intervals, steps, stages)
    rows = _defects(assembly, motion, intervals)
    into = np.hstack([rows, np.full((intervals, 1), OBJECTIVE)])
    data = _numbers(motion, (np.arange(intervals)[:, None] + np.linspace(0.0, 1.0, steps + 1)) / intervals)
    assembly.add(term, grid.reads(grid.s[:-1]), into, data, np.append(np.ones(motion.ns), weight))
    assembly.add_linear(rows, grid.s[1:], -1.0)
    return term, [ca.DM(each.T) for each in data]


def add_collocation(assembly: Assembly, motion: Motion, grid: Grid, weight: float) -> None:
    """Polynomials whose rates are those of the motion at the collocation points."""
    intervals, degree, elements = grid.intervals, motion.scene.solver.degree, grid.elements
    data = _numbers(motion, (np.arange(intervals)[:, None] + radau_points(degree, elements)) / intervals)
    h = 1.0 / (intervals * elements)
    # A polynomial is given by its values at the start of its element, the last point before, and at its points.
    basis = [grid.s[:-1], *(grid.inner[:, j] for j in range(degree * elements))]
    rates, ends, quadrature = (np.array(m) for m in ca.collocation_coeff(ca.collocation_points(degree, "radau")))
    for j in range(degree * elements):
        rows = _defects(assembly, motion, intervals, f"motion at point {j + 1}")
        into = np.hstack([rows, np.full((intervals, 1), OBJECTIVE)])
        factors = np.append(np.full(motion.ns, -h), weight * h * quadrature.ravel()[j % degree])
        assembly.add(motion.flow, grid.reads(grid.inner[:, j]), into, data[:, j], factors)
        first = j // degree * degree
        for columns, rate in zip(basis[first : first + degree + 1], rates[:, j % degree], strict=True):
            assembly.add_linear(rows, columns, rate)
    rows = _defects(assembly, motion, intervals)
    for columns, end in zip(basis[-degree - 1 :], ends.ravel(), strict=True):
        assembly.add_linear(rows, columns, end)
    assembly.add_linear(rows, grid.s[1:], -1.0)


def radau_points(degree: int, elements: int) -> Array:
    """Shares of an interval at which the motion holds, of equal elements."""
    points = np.array(ca.collocation_points(degree, "radau"))
    return np.asarray(((np.arange(elements)[:, None] + points) / elements).ravel())


def _defects(assembly: Assembly, motion: Motion, intervals: int, name: str = "motion") -> Indices:
    return assembly.rows(name, "intervals", "state", intervals, motion.s_scale)


def _numbers(motion: Motion, shares: Array) -> Array:
    """Numbers that the motion reads (count, points, nd) at shares of the duration (count, points)."""
    # Only where the duration is given does anything vary over time.
    rows = motion.numbers(shares.ravel() * motion.scene.duration_range[1])
    return rows.reshape(*shares.shape, -1)


class StateBounds:
    """Bounds of the state, at the nodes and between them; ``relaxed`` bounds have a penalty.

    Between the nodes of single shooting, where the state is not known, zones alone hold, of the line between both, and
    where there is contact.
    """

    def __init__(self, assembly: Assembly, motion: Motion, grid: Grid, relaxed: bool) -> None:
        self._assembly, self._motion = assembly, motion
        # Entries of each bound, and places: columns of states, weights of their sum, columns of the input held there.
        self._places: dict[str, tuple[list[int], Indices, Array, Indices]] = {}
        bounded = motion.bounded
        lower = np.where(bounded.least > -ABSENT, bounded.least, -np.inf)
        upper = np.where(bounded.most < ABSENT, bounded.most, np.inf)
        zones = tuple(motion.scene.bounds.keep_out)
        # With contact at the nodes alone: with bounds between them too, IPOPT did not solve the plan of a mug in 500
        # iterations; without, in 334.
        smooth = grid.inner.size and motion.scene.object is None
        for name, entries in _groups(bounded.names, zones).items():
            key, unit, size = f"bounds.{name}", "of its limit", 1.0
            if name in zones:
                key, unit, size = f"bounds.keep_out.{name}", "m", motion.length
            # 4: places per element at which bounds hold, the last one at the node
            parts = 4 * grid.elements if smooth or name in zones else 1
            self._places[name] = (entries, *grid.places(parts), np.repeat(grid.v, parts, axis=0))
            count, scale = len(self._places[name][1]), np.full(len(entries), size)
            rows = assembly.rows(name, key, unit, count, scale, lower[entries], upper[entries])
            self._add(*self._places[name], rows)
            share = motion.first_duration / count / motion.scales.objective  # penalties are per second
            if relaxed:
                # 100.0: penalty per share by which a hard bound is violated, where only the distance from the goal is
                # minimized [units of the squared distance]: large, so that bounds give way last
                self._soften(rows, np.full(len(entries), 100.0), np.zeros(len(entries)))
            elif not motion.hard[entries].any():
                self._soften(rows, share * bounded.linear[entries], share * bounded.quadratic[entries])

    def _add(self, entries: list[int], columns: Indices, weights: Array, held: Indices, rows: Indices) -> None:
        motion, (count, size) = self._motion, weights.shape
        z, numbers = motion.node
        x, u, _, p, _ = motion.physical
        basis, share = ca.SX.sym("basis", motion.ns, size), ca.SX.sym("share", size)
        value = ca.substitute(motion.rows(x, u, p)[entries], z[: motion.ns], ca.mtimes(basis, share))
        z = ca.vertcat(ca.vec(basis), z[motion.ns :])
        term = derived("rows", z, ca.vertcat(numbers, share), value, exact=motion.exact)
        data = np.hstack([np.tile(motion.numbers([0.0]), (count, 1)), weights])
        self._assembly.add(term, np.hstack([columns.reshape(count, -1), held]), rows, data)

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
            self._assembly.add(term, slack, [OBJECTIVE], [], aside=True)

    def values(self, w: Array, g: Array, block: Block) -> Array:
        """Values that a block of constraints bounds (count, size), without slacks."""
        if block.name not in self._places:
            return np.asarray(g[block.rows])
        motion, (entries, columns, weights, held) = self._motion, self._places[block.name]
        s, count = np.einsum("ij,ijk->ik", weights, w[columns]), len(columns)
        x, u = s[:, : motion.nx] * motion.scales.x, (s[:, motion.nx :] if motion.linear else w[held]) * motion.scales.u
        p = np.tile(parameters_over_time(motion.scene, motion.prediction, [0.0]).T, (1, count))
        return np.array(motion.rows.map(count)(x.T, u.T, p)).T[:, entries]


def _groups(names: list[str], zones: tuple[str, ...]) -> dict[str, list[int]]:
    """Entries of each bound: curvature, speed, and zones by name."""
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        stem, _, number = name.rpartition("_")
        # A zone may itself be called "post_1".
        label = name if name in zones else stem if number.isdigit() else name
        groups.setdefault("speed" if label == "bending_rate" else label, []).append(k)
    return groups
