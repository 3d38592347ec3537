"""The problem of ``Stages`` as a nonlinear problem, with the derivatives that the stage functions give."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.ocp.bounds import ABSENT
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import find_compiler
from continuum_grasp.core.source import function_source
from continuum_grasp.nlp import NLP, Start

__all__ = ["ShootingProblem"]

Array = NDArray[np.float64]


class ShootingProblem:
    """Multiple shooting on the grid of the stages; the Hessian is the Gauss-Newton one.

    Variables: x_0, u_0, ..., x_N, then a slack for every row of every node. Parameters: the initial state, p, and the
    setpoints node by node. Constraints: initial state, gaps, rows from above, rows from below.
    """

    def __init__(self, stages: Stages) -> None:
        self.stages = s = stages
        self._step, self._cost, self._terminal = (compiled(f) for f in (s.step, s.cost, s.terminal))
        self._nz = s.nx + s.nu
        self._count = s.stages * self._nz + s.nx
        self._row_count = s.stages * s.nc
        self._z = ca.MX.sym("z", self._count + self._row_count)
        self._p = ca.MX.sym("p", s.nx + s.np + (s.stages + 1) * s.nr)
        self.nlp = self._assembled()

    def _assembled(self) -> NLP:
        s, n = self.stages, self.stages.stages
        p = self._p[s.nx : s.nx + s.np]
        refs = ca.reshape(self._p[s.nx + s.np :], s.nr, n + 1)
        nodes = [self._z[k * self._nz : min((k + 1) * self._nz, self._count)] for k in range(n + 1)]
        slack = self._z[self._count :]
        weights, end_weights = ca.DM(s.weights), ca.DM(s.terminal_weights)
        early, gaps, gap_slopes = [nodes[0][: s.nx] - self._p[: s.nx]], [], []
        cost = ca.MX(0)
        gradient: list[ca.MX] = []
        hessian: list[ca.MX] = []
        rows: list[ca.MX] = []
        row_slopes: list[tuple[int, ca.MX]] = []
        for k in range(n):
            x, u = nodes[k][: s.nx], nodes[k][s.nx :]
            following, a, b = self._shoot(x, u, p)
            gaps.append(following - nodes[k + 1][: s.nx])
            gap_slopes.append(ca.horzcat(a, b))
            value, g, h, c, slope = self._cost(x, u, p, refs[:, k], weights)
            cost, gradient, hessian = cost + value, [*gradient, g], [*hessian, h]
            if k:
                rows.append(c[: s.ns])
                row_slopes.append((k, slope[: s.ns, :]))
            rows.append(c[s.ns :])
            row_slopes.append((k, slope[s.ns :, :]))
        value, g_end, h, c, slope = self._terminal(nodes[n], p, refs[:, n], end_weights)
        rows.append(c)
        row_slopes.append((n, slope))
        linear, quadratic = self._penalties
        penalty = ca.dot(linear, slack) + 0.5 * ca.dot(quadratic, slack * slack)
        row = ca.vertcat(*rows)
        f, g = cost + value + penalty, ca.vertcat(*early, *gaps, row - slack, row + slack)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
        upper_half = ca.triu(lam_f * ca.diagcat(*hessian, h, ca.diag(quadratic)))
        given, names = [self._z, self._p], ["x", "p"]
        every_gradient = ca.vertcat(*gradient, g_end, linear + quadratic * slack)
        jacobian = self._jacobian(gap_slopes, row_slopes)
        derivatives = {
            "grad_f": ca.Function("nlp_grad_f", given, [f, every_gradient], names, ["f", "grad:f:x"]),
            "jac_g": ca.Function("nlp_jac_g", given, [g, jacobian], names, ["g", "jac:g:x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l", [*given, lam_f, lam_g], [upper_half], [*names, "lam:f", "lam:g"], ["triu:hess:gamma:x:x"]
            ),
        }
        return NLP("converged", self._z, f, g, self._p, derivatives, semidefinite=True)

    def _shoot(self, x: ca.MX, u: ca.MX, p: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """A stage, and its derivatives by the chain rule over its sub-steps."""
        s = self.stages
        following, a, b = self._step(x, u, p, s.stage / s.substeps)
        for _ in range(s.substeps - 1):
            following, by_x, by_u = self._step(following, u, p, s.stage / s.substeps)
            a, b = ca.mtimes(by_x, a), ca.mtimes(by_x, b) + by_u
        return following, a, b

    def _jacobian(self, gaps: list[ca.MX], rows: list[tuple[int, ca.MX]]) -> ca.MX:
        s, total = self.stages, self._count + self._row_count

        def placed(block: ca.MX, column: int) -> ca.MX:
            height, width = block.shape
            return ca.horzcat(ca.MX(height, column), block, ca.MX(height, total - column - width))

        eye = ca.MX(ca.DM.eye(s.nx))
        lines = [placed(eye, 0)]
        for k, slope in enumerate(gaps):
            lines.append(placed(ca.horzcat(slope, -eye), k * self._nz))
        row = ca.vertcat(*[placed(slope, k * self._nz) for k, slope in rows])
        own = placed(ca.MX(ca.DM.eye(self._row_count)), self._count)
        return ca.vertcat(*lines, row - own, row + own)

    @cached_property
    def _order(self) -> list[int]:
        """Which row of a node stands where."""
        s = self.stages
        state, both = list(range(s.ns)), list(range(s.ns, s.nc))
        return [*both, *(state + both) * (s.stages - 1), *state]

    @property
    def _penalties(self) -> tuple[ca.DM, ca.DM]:
        return ca.DM(self.stages.linear[self._order]), ca.DM(self.stages.quadratic[self._order])

    def start(self, x: Array, u: Array, x0: Array, p: Array, refs: Array) -> Start:
        """Start from a guess of states (N + 1, nx) and inputs (N, nu)."""
        s, rows = self.stages, self._row_count
        guess = np.concatenate([np.hstack([x[:-1], u]).ravel(), x[-1], np.zeros(rows)])
        free, none = np.full(s.nx, np.inf), np.full(rows, np.inf)
        low = np.concatenate([np.tile(np.concatenate([-free, s.u_min]), s.stages), -free, np.zeros(rows)])
        high = np.concatenate([np.tile(np.concatenate([free, s.u_max]), s.stages), free, none])
        least = np.where(s.c_min <= -ABSENT, -np.inf, s.c_min)
        most = np.where(s.c_max >= ABSENT, np.inf, s.c_max)
        equal = np.zeros(s.nx * (s.stages + 1))
        lower = np.concatenate([equal, -none, least[self._order]])
        upper = np.concatenate([equal, most[self._order], none])
        return Start(guess, low, high, lower, upper, np.concatenate([x0, p, refs.ravel()]))

    def split(self, z: Array) -> tuple[Array, Array, float]:
        """States (N + 1, nx), inputs (N, nu) and the largest slack of a solution."""
        s = self.stages
        body = z[: self._count - s.nx].reshape(s.stages, self._nz)
        x = np.vstack([body[:, : s.nx], z[self._count - s.nx : self._count]])
        return x, body[:, s.nx :].copy(), float(z[self._count :].max(initial=0.0))


def compiled(function: ca.Function) -> ca.Function:
    """The function in C, where there is a compiler."""
    compiler = find_compiler()
    if compiler is None:
        return function
    return ca.external(function.name(), str(library_for(function_source(function), compiler)))
