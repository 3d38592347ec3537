"""How the motion holds on the grid: multiple shooting or collocation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.planning.assembly import OBJECTIVE, Assembly
from continuum_grasp.planning.motion import Motion
from continuum_grasp.planning.shooting import shooting_interval

__all__ = ["Grid", "add_collocation", "add_shooting", "default_substeps"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_LONGER = 2.0
"""How much longer than where the search begins a duration is expected to be."""
_TARGET = 0.6
"""Product of sub-step and fastest rate, where the Runge-Kutta method is accurate to some 1e-4 of the fastest mode."""


@dataclass(frozen=True)
class Grid:
    """Columns of the unknowns of a plan.

    Attributes
    ----------
    time : (1, 1) ndarray of int
        The duration.
    s : (N + 1, ns) ndarray of int
        States at the nodes.
    v : (N, nv) ndarray of int
        Controls of the intervals.
    inner : (N, degree, ns) ndarray of int
        States at the collocation points; empty for multiple shooting.
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


def default_substeps(motion: Motion) -> int:
    """Runge-Kutta steps per interval that the stiffness asks for."""
    scene = motion.scene
    least, most = scene.input_limits
    low, high = np.full(motion.nu, least), np.full(motion.nu, most)
    rate = motion.prediction.fastest_rate(low, high)
    longest = min(scene.duration_range[1], _LONGER * motion.first_duration)
    return max(1, math.ceil(longest / scene.intervals * rate / _TARGET))


def add_shooting(assembly: Assembly, motion: Motion, grid: Grid, substeps: int, weight: float) -> None:
    """The end of each interval is the next node; the running objective is weighted by ``weight``."""
    intervals = grid.intervals
    term = shooting_interval(motion.flow, motion.ns, intervals, substeps)
    rows = _defects(assembly, motion, intervals)
    into = np.hstack([rows, np.full((intervals, 1), OBJECTIVE)])
    instants = np.arange(intervals)[:, None] + np.linspace(0.0, 1.0, 2 * substeps + 1)
    data = _numbers(motion, instants / intervals)
    assembly.add(term, grid.reads(grid.s[:-1]), into, data, np.append(np.ones(motion.ns), weight))
    assembly.add_linear(rows, grid.s[1:], -1.0)


def add_collocation(assembly: Assembly, motion: Motion, grid: Grid, weight: float) -> None:
    """Polynomials whose rates are those of the motion at the collocation points."""
    intervals, degree = grid.intervals, motion.scene.solver.degree
    points = ca.collocation_points(degree, motion.scene.solver.points)
    rates, ends, quadrature = (np.array(m) for m in ca.collocation_coeff(points))
    data = _numbers(motion, (np.arange(intervals)[:, None] + np.array(points)) / intervals)
    h = 1.0 / intervals
    for j in range(degree):
        rows = _defects(assembly, motion, intervals, f"motion at point {j + 1}")
        into = np.hstack([rows, np.full((intervals, 1), OBJECTIVE)])
        factors = np.append(np.full(motion.ns, -h), weight * h * quadrature.ravel()[j])
        assembly.add(motion.flow, grid.reads(grid.inner[:, j]), into, data[:, j], factors)
        for i in range(degree + 1):
            assembly.add_linear(rows, grid.s[:-1] if i == 0 else grid.inner[:, i - 1], rates[i, j])
    rows = _defects(assembly, motion, intervals)
    for i, end in enumerate(ends.ravel()):
        assembly.add_linear(rows, grid.s[:-1] if i == 0 else grid.inner[:, i - 1], end)
    assembly.add_linear(rows, grid.s[1:], -1.0)


def _defects(assembly: Assembly, motion: Motion, intervals: int, name: str = "motion") -> Indices:
    return assembly.rows(name, "intervals", "state", intervals, motion.s_scale)


def _numbers(motion: Motion, shares: Array) -> Array:
    """What the motion reads (count, points, nd) at shares of the duration (count, points)."""
    rows = motion.numbers(shares.ravel() * motion.scene.duration_range[1])
    return rows.reshape(*shares.shape, -1)
