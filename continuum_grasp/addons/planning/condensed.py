"""Plans in the inputs alone: the states follow from a simulation, and so satisfy the equations of motion at any time.

Slack cables and dry friction have kinks every few micrometers. Where states are unknowns too, the linearized equations
of motion lead an interior-point method far from any motion, and whether it comes back is decided by rounding (IPOPT, a
finger on two winches, 20 intervals: 26 iterations or none in 500, by the flags of the compiler). Here each iterate is a
motion (R. Fletcher, Practical Methods of Optimization, 1987, section 14.4; J. Nocedal, S. J. Wright, Numerical
Optimization, section 18.5, doi:10.1007/978-0-387-40065-5):

1. Simulate under the inputs at hand, in steps that are fine enough for this motion.
2. Linearize; eliminate the states; a QP with the Hessian of Gauss and Newton gives a step within the trust region,
   whose rows are violated at a penalty.
3. Raise the penalty until the QP takes away its share of the violation.
4. Simulate the step; if curvature spoils it, correct it once by the rows that are violated there.
5. It counts if the objective plus the l1 norm of the violation falls by a share of the prediction; the region
   grows or shrinks by that share.
6. End where little is predicted, where the objective creeps, or where the region is too small.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from continuum_grasp.addons.planning.problem import PlanProblem
from continuum_grasp.base import Array
from continuum_grasp.nlp import (
    Attempt,
    Budget,
    Multipliers,
    Settings,
)

_LARGEST, _SMALLEST = 1e3, 1e-9
"""Greatest and least radius of the trust region [units of the problem]."""
_FIRST_PENALTY, _GREATEST_PENALTY = 3e3, 1e8
"""Penalty per violation: raised until the QP lowers the violation [units of the objective]."""
_ACCEPTED, _GOOD, _POOR = 1e-3, 0.75, 0.25
"""Shares of the predicted reduction from which on a step counts, the region grows, and shrinks."""

_PATIENCE, _PROGRESS = 10, 1e-2
"""Iterations in which the objective must fall by this share, where all is satisfied: along kinks it creeps for long."""


@dataclass
class _Point:
    """A motion: unknowns, their functions, and the violation in all, in units of the problem."""

    w: Array
    f: float
    g: Array
    violated: float


class Condensed:
    """A problem of multiple shooting, with Hessians of Gauss and Newton, whose states are eliminated, and its solver.

    It goes on while a QP predicts to reduce objective and violations by ``tolerance``, relative to the objective, where
    that is ``least`` at least; ``feasible`` is the greatest violation of a solution. Where a motion is too fast for the
    steps of the problem, these become finer.
    """

    def __init__(self, problem: PlanProblem, tolerance: float, feasible: float, least: float = 1.0) -> None:
        self.problem = problem
        self.tolerance = tolerance
        self.feasible = feasible
        self.least = least
        assembly, grid = problem.assembly, problem.grid
        low, high = assembly.limits
        self._states = grid.s[1:].ravel()
        free = low < high
        free[self._states] = False
        self._free = np.flatnonzero(free)
        motion = next(block for block in assembly.blocks if block.name == "motion").rows.ravel()
        self._motion = motion
        self._others = np.setdiff1d(np.arange(assembly.count), motion)
        # States that are limited: inputs that are straight lines over each interval.
        bounded = np.isfinite(low[self._states]) | np.isfinite(high[self._states])
        self._bounded = np.flatnonzero(bounded)

    def solve(self, w: Array, budget: Budget, most: int) -> Attempt:
        """Solve from unknowns, whose states are replaced by the motion's, in so many iterations at most."""
        began = time.perf_counter()
        assembly = self.problem.assembly
        start = assembly.start_within(*assembly.limits, w)
        self._start = start
        w = np.clip(w, start.low, start.high)
        outpaced = self.problem.outpaced(w)
        point = self._resolved(w, None if outpaced else self._moved(w))
        radius = 1.0  # inputs change by as much as their range
        penalty = _FIRST_PENALTY
        count = 0
        outcome = "Maximum_Iterations_Exceeded"
        passed: list[float] = []  # objectives of motions that satisfy all
        lam = Multipliers(np.zeros(start.x.size), np.zeros(start.lower.size))
        model = _Model(self, point) if point else None
        while point and model:
            step, slack, forces = model.step(radius, penalty)
            # The penalty is high enough if the step takes away a share of what can be taken away (section 18.5).
            best = point.violated - model.step(radius, _GREATEST_PENALTY)[1] if slack > self.feasible else 0.0
            # 0.3: share of the violation that a QP has to take away of what the radius lets it, lest the penalty is
            # raised
            while point.violated - slack < 0.3 * best - self.feasible and penalty < _GREATEST_PENALTY:
                penalty *= 10.0
                step, slack, forces = model.step(radius, penalty)
            lam = model.multipliers(forces)
            predicted = -model.change(step) + penalty * (point.violated - slack)
            satisfied = start.violation(point.w, point.g) <= self.feasible
            least = self.tolerance * max(self.least, abs(point.f))
            if predicted <= least or (satisfied and -model.change(step) <= least):
                outcome = "Solve_Succeeded" if satisfied else "Restoration_Failed"
                break
            passed.append(point.f)
            if satisfied and len(passed) > _PATIENCE and passed[-1 - _PATIENCE] - point.f <= _PROGRESS * abs(point.f):
                outcome = "Search_Direction_Becomes_Too_Small"
                break
            if count >= most or budget.stops:
                if count < most:
                    outcome = budget.outcome_of_stop
                break
            count = count + 1
            budget.left = budget.left - 1
            new, share = self._tried(point, model, step, predicted, radius, penalty)
            size = float(np.abs(step).max())
            if share < _POOR:
                radius = 0.3 * min(size, radius)
            elif share > _GOOD and size > 0.9 * radius:
                radius = min(2.5 * radius, _LARGEST)
            if new is not None:
                passed = passed if satisfied else []
                point = self._resolved(new.w, new)
                model = _Model(self, point) if point else None
            elif radius < _SMALLEST:
                outcome = "Search_Direction_Becomes_Too_Small"
                break
        else:
            outcome = "Invalid_Number_Detected"
        x, g, f = (start.x, np.full(start.lower.size, np.nan), np.nan) if point is None else (point.w, point.g, point.f)
        violation = start.violation(x, g)
        error = assembly.nlp.optimality_error(start, x, lam) if point else float("inf")
        status = Attempt.status_of(outcome)
        seconds = time.perf_counter() - began
        return Attempt(status, outcome, x, g, f, lam, count, seconds, violation, error)

    def _tried(
        self, point: _Point, model: _Model, step: Array, predicted: float, radius: float, penalty: float
    ) -> tuple[_Point | None, float]:
        """The motion after a step, if it counts, and the share of the predicted reduction that it brings."""
        merit = point.f + penalty * point.violated
        new = self._moved(self._ahead(point, step))
        share = -1.0 if new is None else (merit - new.f - penalty * new.violated) / predicted
        if new is not None and share < _POOR:
            # What is curved in the constraints, corrected once (section 18.3).
            again, _, _ = model.step(radius, penalty, self._residual(new) - model.slope @ step)
            corrected = self._moved(self._ahead(point, again))
            if corrected is not None:
                second = (merit - corrected.f - penalty * corrected.violated) / predicted
                if second > share:
                    new, share = corrected, second
        return (new if share > _ACCEPTED else None), share

    def _ahead(self, point: _Point, step: Array) -> Array:
        w = point.w.copy()
        w[self._free] += step
        return np.asarray(np.clip(w, self._start.low, self._start.high))

    def _resolved(self, w: Array, point: _Point | None) -> _Point | None:
        """The motion under the inputs of w, anew in finer steps where it is too fast for the problem's steps, or where
        there is none yet.
        """
        # 3: times that steps are made finer for one motion, at most: with other steps it is a little another one
        for _ in range(3):
            at = w if point is None else point.w
            if not self.problem.outpaced(at):
                break
            self.problem.refine(at)
            point = self._moved(w)
        return point

    def _moved(self, w: Array) -> _Point | None:
        """The motion under the inputs of w; None where it is not finite."""
        grid = self.problem.grid
        ns = self.problem.motion.ns
        w, term, data = w.copy(), *self.problem.interval
        for k in range(len(grid.v)):
            z = np.concatenate([w[grid.s[k]], w[grid.v[k]], w[grid.time[0]]])
            end = np.array(term.value(z, data[k])).ravel()[:ns]
            if not np.isfinite(end).all():
                return None
            w[grid.s[k + 1]] = end
        f, g = (np.array(v).ravel() for v in self.problem.assembly.values(w))
        point = _Point(w, float(f[0]), g, 0.0)
        point.violated = self.beyond(self._residual(point))
        return point if np.isfinite(point.f) and np.isfinite(point.violated) else None

    def beyond(self, rows: Array) -> float:
        """Sum of what rows are violated by."""
        low, high = self._limits()
        return float(np.maximum(np.maximum(low - rows, rows - high), 0.0).sum())

    def _limits(self) -> tuple[Array, Array]:
        """Bounds of the rows."""
        start = self._start
        chosen = self._states[self._bounded]
        return (
            np.concatenate([start.lower[self._others], start.low[chosen]]),
            np.concatenate([start.upper[self._others], start.high[chosen]]),
        )

    def _residual(self, point: _Point) -> Array:
        """Rows that are bounded: constraints but for the motion, and states."""
        return np.concatenate([point.g[self._others], point.w[self._states[self._bounded]]])


class _Model:
    """The problem at a motion: QP of the free unknowns."""

    def __init__(self, problem: Condensed, point: _Point) -> None:
        self._problem = problem
        self._point = point
        assembly = problem.problem.assembly
        states, free = problem._states, problem._free
        both = assembly.first_order(point.w).sparse().tocsr()
        slope = both[:1].toarray().ravel()
        rows = both[1:]
        upper = assembly.nlp.functions["hess_lag"](point.w, [], 1.0, np.zeros(rows.shape[0])).sparse()
        full = (upper + sparse.triu(upper, 1).T).tocsc()
        motion, others = rows[problem._motion], rows[problem._others]
        self._of_motion = splu(motion[:, states].tocsc())
        by_free = -self._of_motion.solve(motion[:, free].toarray())
        whole = np.zeros((point.w.size, free.size))
        whole[free, np.arange(free.size)] = 1.0
        whole[states] = by_free
        self._full_slope = slope
        self._others = others
        self._whole = whole
        self.hessian = whole.T @ (full @ whole)
        self.gradient = whole.T @ slope
        self.slope = np.vstack([others @ whole, by_free[problem._bounded]])

    def change(self, step: Array) -> float:
        """Predicted change of the objective."""
        return float(self.gradient @ step + 0.5 * step @ self.hessian @ step)

    def step(self, radius: float, penalty: float, at: Array | None = None) -> tuple[Array, float, Array]:
        """Solve the QP whose rows are violated at a penalty: step, what stays violated, forces of bounds and rows."""
        problem = self._problem
        point = self._point
        start = self._problem._start
        rows = problem._residual(point) if at is None else at
        low, high = problem._limits()
        # Rows that no step within the region can violate need no slack.
        reach = radius * np.abs(self.slope).sum(axis=1)
        near = (rows - reach < low) | (rows + reach > high)
        chosen = self.slope[near]
        n = problem._free.size
        m = int(near.sum())
        linear = np.concatenate([self.gradient, np.full(2 * m, penalty)])
        square = sparse.block_diag([self.hessian, sparse.csc_matrix((2 * m, 2 * m))], format="csc")
        a = sparse.hstack([sparse.csc_matrix(chosen), sparse.eye(m), -sparse.eye(m)], format="csc")
        x = point.w[problem._free]
        lbx = np.concatenate([np.maximum(start.low[problem._free] - x, -radius), np.zeros(2 * m)])
        ubx = np.concatenate([np.minimum(start.high[problem._free] - x, radius), np.full(2 * m, np.inf)])
        h, c = ca.DM(square), ca.DM(a)
        solver = ca.conic(
            "qp", Settings.qp_plugin("method"), {"h": h.sparsity(), "a": c.sparsity()}, {"error_on_fail": False}
        )
        solution = solver(h=h, g=linear, a=c, lba=(low - rows)[near], uba=(high - rows)[near], lbx=lbx, ubx=ubx)
        step = np.clip(np.array(solution["x"]).ravel()[:n], lbx[:n], ubx[:n])
        left = problem.beyond(rows + self.slope @ step)
        forces = np.zeros(near.size)
        forces[near] = np.array(solution["lam_a"]).ravel()
        return step, left, np.concatenate([np.array(solution["lam_x"]).ravel()[:n], forces])

    def multipliers(self, multipliers: Array) -> Multipliers:
        """Multipliers of the whole problem: forces of the motion make the objective stationary in the states."""
        problem = self._problem
        n, count = problem._free.size, problem._others.size
        bounds = np.zeros(self._point.w.size)
        forces = np.zeros(self._point.g.size)
        bounds[problem._free] = multipliers[:n]
        forces[problem._others] = multipliers[n : n + count]
        bounds[problem._states[problem._bounded]] = multipliers[n + count :]
        pushed = self._full_slope + self._others.T @ forces[problem._others] + bounds
        forces[problem._motion] = -self._of_motion.solve(pushed[problem._states], trans="T")
        return Multipliers(bounds, forces)
