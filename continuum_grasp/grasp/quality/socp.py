"""Second-order cone problems (SOCP), solved exactly by linear problems (LP) to which tangent planes are added."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.grasp.quality.lp import LPOutcome, solve_lp

__all__ = ["Cones", "solve_socp"]

Array = NDArray[Any]

VIOLATION = 1e-8
"""Cones may be violated by this part of one and the greatest width of a cone: ten times what the LP's
tolerance lets through."""
ROUNDS = 200
"""Most LPs for one answer."""
_INWARD = 1e-7
"""What a point well inside a cone is worth beside the cost: where many points are best, corners of the planes, which
lie outside the cones, are not taken."""


@dataclass
class Cones:
    """Second-order cones |A_k x + a_k| <= b_k @ x + c_k for k = 1..K, vectors with two components.

    Attributes
    ----------
    matrix : ndarray, shape (K, 2, n)
    offset : ndarray, shape (K, 2)
    width : ndarray, shape (K, n)
    spare : ndarray, shape (K,)
    cuts : list of (int, ndarray)
        Cone and unit direction u of the planes u @ (A_k x + a_k) <= b_k @ x + c_k that stand for it so far. They
        hold for any width, so they stay valid while widths change.
    """

    matrix: Array
    offset: Array
    width: Array
    spare: Array
    cuts: list[tuple[int, Array]]

    @classmethod
    def made(cls, matrix: Array, offset: Array, width: Array, spare: Array, directions: int = 12) -> Cones:
        """Cones with tangent planes in evenly spread directions; where a component is always zero, both sides of the
        other, which is the cone itself.
        """
        turns = 2 * np.pi * np.arange(directions) / directions
        around = list(np.stack([np.cos(turns), np.sin(turns)], axis=1))
        cuts: list[tuple[int, Array]] = []
        for k in range(matrix.shape[0]):
            live = [bool(np.any(matrix[k, i]) or offset[k, i]) for i in (0, 1)]
            flat = [np.array([s, 0.0]) for s in (1, -1)] if live[0] else [np.array([0.0, s]) for s in (1, -1)]
            cuts += [(k, u) for u in (around if all(live) else flat)]
        return cls(matrix, offset, width, spare, cuts)

    def planes(self) -> tuple[Array, Array]:
        """Rows (P, n) and their upper limits (P,) of all tangent planes."""
        which = np.array([k for k, _ in self.cuts], dtype=int)
        directions = np.array([u for _, u in self.cuts]).reshape(-1, 2)
        rows = np.einsum("pi,pin->pn", directions, self.matrix[which]) - self.width[which]
        return rows, self.spare[which] - np.einsum("pi,pi->p", directions, self.offset[which])

    def cut(self, x: Array) -> bool:
        """Add tangent planes where a point lies outside; whether there were any."""
        vectors = self.matrix @ x + self.offset
        lengths = np.hypot(vectors[:, 0], vectors[:, 1])
        widths = self.width @ x + self.spare
        outside = np.flatnonzero(lengths - widths > VIOLATION * max(1.0, np.abs(widths).max(initial=0.0)))
        self.cuts += [(int(k), vectors[k] / lengths[k]) for k in outside if lengths[k] > 0.0]
        return outside.size > 0


def solve_socp(
    cost: ArrayLike,
    rows: ArrayLike,
    row_lower: ArrayLike,
    row_upper: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    cones: Cones,
) -> LPOutcome:
    """Minimize cost @ x as `solve_lp` does, x in addition within cones.

    The tangent planes contain the cones: ``infeasible`` is certain, and the optimum is not short of the true one by
    more than 1e-7 per cone. Give finite bounds: the planes are unbounded in more directions than the cones.

    Parameters
    ----------
    cost, rows, row_lower, row_upper, lower, upper
        As in `solve_lp`.
    cones : Cones
        Gets tangent planes added.
    """
    cost, rows = np.asarray(cost, dtype=float), np.asarray(rows, dtype=float)
    low, high = (np.broadcast_to(np.asarray(v, dtype=float), (rows.shape[0],)) for v in (row_lower, row_upper))
    least, most = (np.broadcast_to(np.asarray(v, dtype=float), cost.shape) for v in (lower, upper))
    count = cones.spare.size
    outcome = LPOutcome("failed", np.full(cost.size, np.nan), float("nan"), float("nan"))
    for _ in range(ROUNDS):
        planes, limit = cones.planes()
        depth = np.zeros((limit.size, count))
        depth[np.arange(limit.size), [k for k, _ in cones.cuts]] = 1.0
        found = solve_lp(
            np.concatenate([cost, np.full(count, -_INWARD)]),
            np.block([[rows, np.zeros((rows.shape[0], count))], [planes, depth]]),
            np.concatenate([low, np.full(limit.size, -np.inf)]),
            np.concatenate([high, limit]),
            np.concatenate([least, np.zeros(count)]),
            np.concatenate([most, np.ones(count)]),
        )
        x = found.x[: cost.size]
        if not found.optimal or not cones.cut(x):
            return replace(found, x=x, objective=float(cost @ x))
    return outcome
