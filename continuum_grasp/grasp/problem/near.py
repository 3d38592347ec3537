"""Solutions next to a known one: sequential quadratic programming in the null space of the equations.

At given tensions the equations of a grasp leave two or three directions, so that each QP is tiny, whatever limits get
active. With Y and Z, bases of the row space and of the null space of the equations' Jacobian, the step is Y u + Z w:

    minimize over w   (grad f + H Y u)' Z w + w' Z' H Z w / 2   subject to   all other limits to first order

J. Nocedal, S. J. Wright, Numerical Optimization, 2006, section 18.3, doi:10.1007/978-0-387-40065-5. Steps are whole, so
that it is for starts that are close.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from continuum_grasp.nlp import NLP, Attempt, Budget, Multipliers, Start, Status

Array = NDArray[Any]

_STEPS = 12
"""Steps after which a start was not close: 2 to 5 are enough for errors of millimeters (mug, pinch)."""
_SETTLED = 1e-3
"""Step from which on the next would be 1e-7 and less, since steps fall by squares [units of the problem]."""
_STATIONARY = 1e-5
"""Gradient of the Lagrangian up to which a point is a solution [units of the problem]."""
_FAR = 30.0
"""Most that a step goes along each direction of the null space, forces included [units of the problem]."""
_EXACT, _SLACK = 1e-8, 1e-6
"""Violation up to which equations and limits hold [units of the problem]: DAQP resolves active limits to 1e-7."""
_NONE = 1e-9
"""Curvature of a QP, per its greatest or 1, pivot of an equation and slope of a limit along the null space that are
rounding."""


def _called(function: ca.Function, *given: Any) -> list[Array]:
    """All results of a function, columns as (n,)."""
    found = [np.array(out) for out in function.call(given)]
    return [one.ravel() if one.shape[1] == 1 else one for one in found]


class NearSolver:
    """Solves a problem next to solutions that are known; of the form of `continuum_grasp.nlp.Solver`.

    Parameters
    ----------
    problem : NLP
    """

    def __init__(self, problem: NLP) -> None:
        self._functions = problem.functions
        self._qps: dict[tuple[int, int], ca.Function] = {}

    def restored(self, start: Start) -> Start | None:
        """The start moved to where all equations hold, within bounds; None where that is not near."""
        x, free, equal = np.clip(start.x, start.low, start.high), start.low < start.high, start.lower == start.upper
        for _ in range(_STEPS):
            g, jacobian = _called(self._functions["jac_g"], x, start.p)
            off = g[equal] - start.lower[equal]
            if np.abs(off).max(initial=0.0) < _EXACT:
                return replace(start, x=x)
            # Where Newton's method runs away, as to a finger that coils up, its numbers overflow.
            if not np.isfinite(off).all() or not np.isfinite(jacobian).all():
                return None
            x[free] -= np.linalg.lstsq(jacobian[equal][:, free], off)[0]
            x = np.clip(x, start.low, start.high)
        return None

    def solve(self, start: Start, until: Budget) -> Attempt:
        """The solution near a start with multipliers; ``failed`` where there is none near."""
        began, free, equal = time.perf_counter(), start.low < start.high, start.lower == start.upper
        begin = self.restored(start)
        start, steps = begin or start, _STEPS if begin else 0
        x, last, known = np.clip(start.x, start.low, start.high), np.inf, start.multipliers
        bounds, forces = np.zeros(x.size), np.zeros(start.lower.size)
        if known is not None:
            bounds, forces = known.bounds, known.constraints
        status, count = Status.FAILED, 0
        while True:
            f, slope = _called(self._functions["grad_f"], x, start.p)
            g, jacobian = _called(self._functions["jac_g"], x, start.p)
            over = np.maximum(start.lower - g, g - start.upper)
            bounds = np.where(free, bounds, -(slope + jacobian.T @ forces))
            error = float(np.abs(slope + jacobian.T @ forces + bounds).max(initial=0.0))
            holds = over[equal].max(initial=0.0) < _EXACT and over.max(initial=0.0) < _SLACK
            if last < _SETTLED and holds and error < _STATIONARY:
                status = Status.SOLVED
                break
            step = None
            if count < steps and not until.over:
                (half,) = _called(self._functions["hess_lag"], x, start.p, 1.0, forces)
                bend = half + np.triu(half, 1).T
                step = self._step(start, x, slope, g, jacobian, bend)
            if step is None:
                break
            along, forces, bounds = step
            x = np.clip(x + along, start.low, start.high)
            last, count = float(np.abs(along).max(initial=0.0)), count + 1
            until.left -= 1
        return Attempt(
            status,
            "Solved_Near" if status is Status.SOLVED else "Not_Near",
            x,
            g,
            float(f[0]),
            Multipliers(bounds, forces),
            count,
            time.perf_counter() - began,
            float(over.max(initial=0.0)),
            error,
        )

    def _step(
        self, start: Start, x: Array, slope: Array, g: Array, jacobian: Array, bend: Array
    ) -> tuple[Array, Array, Array] | None:
        """Step of the unknowns, with multipliers of constraints and of bounds; None where the QP has no solution."""
        free, equal = start.low < start.high, start.lower == start.upper
        slope, jacobian, bend = slope[free], jacobian[:, free], bend[np.ix_(free, free)]
        basis, right, order = qr(jacobian[equal].T, pivoting=True)
        # Equations that follow from others, as the balance of tilting on two contacts, hold with these or not at all.
        rank = int((np.abs(np.diag(right)) > _NONE).sum())
        rows, right, n = np.flatnonzero(equal)[order[:rank]], right[:rank, :rank], slope.size
        across, along = basis[:, :rank], basis[:, rank:]
        shift = across @ np.linalg.solve(right.T, start.lower[rows] - g[rows])
        limits = np.concatenate([jacobian[~equal], np.eye(n)])
        slopes = limits @ along
        size = np.linalg.norm(slopes, axis=1)
        acts = size > _NONE
        # To unit slopes: those of guarded places beside a contact are 1e-5 and less.
        limits, slopes, size = limits[acts], slopes[acts], size[acts]
        here = np.concatenate([g[~equal], x[free]])[acts] + limits @ shift
        low = (np.concatenate([start.lower[~equal], start.low[free]])[acts] - here) / size
        high = (np.concatenate([start.upper[~equal], start.high[free]])[acts] - here) / size
        values, vectors = np.linalg.eigh(along.T @ bend @ along)
        values = np.maximum(values, _NONE * max(float(np.abs(values).max(initial=0.0)), 1.0))
        found = self._qp(n - rank, len(size))(
            h=(vectors * values) @ vectors.T,
            g=along.T @ (slope + bend @ shift),
            a=slopes / size[:, None],
            lba=low,
            uba=high,
            lbx=-_FAR,
            ubx=_FAR,
        )
        move, pressed = np.array(found["x"]).ravel(), np.array(found["lam_a"]).ravel() / size
        # Without a solution, the numbers of the QP are at its bounds or beyond them.
        if not np.isfinite(move).all() or np.abs(move).max(initial=0.0) >= 0.999 * _FAR:
            return None
        within, every = shift + along @ move, np.zeros(acts.size)
        every[acts] = pressed
        count = int((~equal).sum())
        step, forces, bounds = np.zeros(x.size), np.zeros(g.size), np.zeros(x.size)
        step[free], bounds[free], forces[~equal] = within, every[count:], every[:count]
        forces[rows] = -np.linalg.solve(right, across.T @ (slope + bend @ within + limits.T @ pressed))
        return step, forces, bounds

    def _qp(self, free: int, rows: int) -> ca.Function:
        if (free, rows) not in self._qps:
            shape = {"h": ca.Sparsity.dense(free, free), "a": ca.Sparsity.dense(rows, free)}
            self._qps[free, rows] = ca.conic("qp", "daqp", shape, {"error_on_fail": False})
        return self._qps[free, rows]
