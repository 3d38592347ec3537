"""Bounds of the state: curvature, speed and zones."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.ocp.bounds import ABSENT
from continuum_grasp.nlp import Block
from continuum_grasp.planning.assembly import OBJECTIVE, Assembly
from continuum_grasp.planning.grid import Grid
from continuum_grasp.planning.motion import Motion
from continuum_grasp.planning.term import Term, derived

__all__ = ["StateBounds"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_PARTS = 4
"""Places per interval at which the finger stays out of zones [1], the last one at the node."""
_OUTSIDE_WHEN_RELAXED = 100.0
"""Penalty per share by which a hard bound is violated, where only the distance from the goal is minimized
[units of the squared distance]: large, so that bounds give way last."""


@dataclass(frozen=True)
class _Bound:
    """Rows of one name: entries among the stages' rows, where and how they are evaluated, places per interval."""

    entries: list[int]
    term: Term
    columns: Indices
    data: Array
    parts: int


class StateBounds:
    """What the state must not leave, at the nodes and for zones also between them.

    Between nodes the state is a cubic polynomial through both nodes with their rates, as far as these are states too.

    Parameters
    ----------
    assembly : Assembly
        Gets the rows.
    motion : Motion
    grid : Grid
    relaxed : bool
        Whether hard bounds get a penalty.
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
            scale = np.full(len(entries), size)
            count = grid.intervals * bound.parts
            rows = assembly.rows(name, key, unit, count, scale, lower[entries], upper[entries])
            assembly.add(bound.term, bound.columns, rows, bound.data)
            share = motion.first_duration / count / motion.scales.objective
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
        model_x, _, _, p, _ = motion.physical
        rows = motion.rows(model_x, ca.DM.zeros(motion.nu), p)[entries]
        state = self._between(before, after, time, at) if parts > 1 else after
        value = ca.substitute(rows, s, state)
        z, d = ca.vertcat(before, after, time), ca.vertcat(numbers, at)
        term = derived("rows", z, d, value, exact=motion.exact)
        shares = np.tile(np.arange(1, parts + 1) / parts, grid.intervals)
        columns = np.hstack([grid.s[:-1], grid.s[1:], np.repeat(grid.time, grid.intervals, axis=0)])
        fixed = np.tile(motion.numbers([0.0]), (len(shares), 1))
        return _Bound(entries, term, np.repeat(columns, parts, axis=0), np.hstack([fixed, shares[:, None]]), parts)

    def _between(self, before: ca.SX, after: ca.SX, time: ca.SX, at: ca.SX) -> ca.SX:
        """State at a share of an interval."""
        motion, names = self._motion, self._motion.prediction.x_names
        rates = {name.split(" ")[0]: k for k, name in enumerate(names)}
        h = time * motion.scales.time / self._grid.intervals
        values = []
        for k in range(motion.ns):
            rate = rates.get(f"{names[k].split(' ')[0]}_rate") if k < motion.nx else None
            change = after[k] - before[k]
            value = before[k] + at * change
            if rate is not None:
                size = h * float(motion.scales.x[rate] / motion.scales.x[k])
                first, last = size * before[rate] - change, size * after[rate] - change
                value += at * (1 - at) * ((1 - at) * first - at * last)
            values.append(value)
        return ca.vertcat(*values)

    def _soften(self, rows: Indices, linear: Array, quadratic: Array) -> None:
        """Slacks of rows, and their penalty."""
        z = ca.SX.sym("slack", rows.shape[1])
        penalty = ca.dot(ca.DM(linear), z) + 0.5 * ca.dot(ca.DM(quadratic), z * z)
        squared = ca.DM(np.sqrt(quadratic)) * z
        term = derived("penalty", z, ca.SX(0, 1), penalty, exact=self._motion.exact, squared=squared)
        for sign in (1.0, -1.0):
            slack = self._assembly.variables(len(rows), rows.shape[1], 0.0)
            self._assembly.add_linear(rows, slack, sign)
            self._assembly.add(term, slack, [OBJECTIVE], [])

    def values(self, w: Array, g: Array, block: Block) -> Array:
        """What a block of constraints bounds (count, size), without slacks."""
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
        label = name if name in zones else stem if number.isdigit() else name
        found.setdefault("speed" if label == "bending_rate" else label, []).append(k)
    return found
