"""The problem of ``Stages`` as one NLP for CasADi's solvers.

Variables are x_0, u_0, x_1, ..., x_N and, where rows are soft, their violations; parameters are those of the model and
the setpoints of all nodes. Constraints are the gaps of the dynamics and the rows that are no bound of one variable.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.mpc.cases import outside, whole_stage
from continuum_grasp.base import Array
from continuum_grasp.control import Stages


@dataclass
class Nlp:
    """The problem.

    Where it is not ``soft``, rows are hard, and those of a single variable are its bounds, which makes a smaller
    problem; ``variational`` tells CasADi the Jacobian of a stage's dynamics by the variational equations.
    """

    stages: Stages
    soft: bool
    variational: bool = False
    nodes: list[tuple[ca.MX, ca.MX]] = field(init=False)

    def __post_init__(self) -> None:
        s = self.stages
        self.p = ca.MX.sym("p", s.np + (s.stages + 1) * s.nr)
        self.w = ca.MX.sym("w", self.count + (len(self.row_nodes) if self.soft else 0))
        nz = s.nx + s.nu
        self.nodes = [(self.w[k * nz : k * nz + s.nx], self.w[k * nz + s.nx : (k + 1) * nz]) for k in range(s.stages)]
        self.nodes.append((self.w[s.stages * nz : self.count], ca.MX(0, 1)))

    @property
    def count(self) -> int:
        """Number of states and inputs."""
        s = self.stages
        return s.stages * (s.nx + s.nu) + s.nx

    # -- functions of a stage, with their structural zeros ------------------------------------------------------------

    @cached_property
    def _following(self) -> ca.Function:
        """(x, u, p) -> xn after a stage."""
        options: dict[str, Any] = {"never_inline": True}
        if self.variational:
            options |= {"custom_jacobian": self._jacobian, "jac_penalty": 0}
        return whole_stage("following", self.stages, self.stages.substeps, **options)

    @cached_property
    def _jacobian(self) -> ca.Function:
        """The Jacobian of ``following`` as CasADi asks for it."""
        s = self.stages
        x, u, p = (ca.MX.sym(name, size) for name, size in (("x", s.nx), ("u", s.nu), ("p", s.np)))
        slopes = [*self._slopes(x, u, p)[1:], ca.MX(s.nx, s.np)]
        names = [f"jac_xn_{name}" for name in "xup"]
        return ca.Function("jac_following", [x, u, p, ca.MX(s.nx, 1)], slopes, ["x", "u", "p", "out_xn"], names)

    @cached_property
    def _slopes(self) -> ca.Function:
        """(x, u, p) -> xn, A, B after a stage."""
        s = self.stages
        h = s.stage / s.substeps
        sizes = (s.nx, s.nu, s.np)
        one = _sx("slopes", sizes, lambda x, u, p: s.step(x, u, p, h))
        if s.substeps == 1:
            return one
        x, u, p = (ca.MX.sym(name, size) for name, size in zip("xup", sizes, strict=True))
        following, by_x, by_u = one(x, u, p)
        for _ in range(s.substeps - 1):
            following, a, b = one(following, u, p)
            by_x, by_u = ca.mtimes(a, by_x), ca.mtimes(a, by_u) + b
        return ca.Function("slopes_of_stage", [x, u, p], [following, by_x, by_u])

    @cached_property
    def _cost(self) -> ca.Function:
        s = self.stages
        return _sx("cost", (s.nx, s.nu, s.np, s.nr), lambda *a: s.cost(*a, s.weights))

    @cached_property
    def _terminal(self) -> ca.Function:
        s = self.stages
        return _sx("terminal", (s.nx, s.np, s.nr), lambda *a: s.terminal(*a, s.terminal_weights))

    def _only(self, function: ca.Function, *outputs: int) -> ca.Function:
        name = f"{function.name()}_{''.join(map(str, outputs))}"
        sizes = [function.size1_in(k) for k in range(function.n_in())]
        return _sx(name, sizes, lambda *a: [function(*a)[k] for k in outputs])

    # -- rows ---------------------------------------------------------------------------------------------------------

    @cached_property
    def single_rows(self) -> dict[int, tuple[int, float, float]]:
        """Rows that are a single variable: its place in z, factor and offset."""
        if self.soft:
            return {}
        s = self.stages
        x, u, p = (ca.SX.sym(name, size) for name, size in (("x", s.nx), ("u", s.nu), ("p", s.np)))
        given = ca.vertcat(x, u, p)
        rows, zeros = s.rows(x, u, p), [np.zeros(v.numel()) for v in (x, u, p)]
        offsets = np.array(s.rows(*zeros)).ravel()
        found = {}
        for i in range(s.nc):
            slope = ca.sparsify(ca.jacobian(rows[i], given))
            if slope.nnz() == 1 and slope.nonzeros()[0].is_constant():
                column = slope.sparsity().get_triplet()[1][0]
                if column < s.nx + s.nu:
                    found[i] = (column, float(slope.nonzeros()[0]), float(offsets[i]))
        return found

    @cached_property
    def _rows(self) -> list[int]:
        return [i for i in range(self.stages.nc) if i not in self.single_rows]

    @cached_property
    def row_nodes(self) -> list[tuple[int, int]]:
        """Node and row of every row, in the order of its violations."""
        s = self.stages
        return [
            (k + (i < s.ns), i) for k in range(s.stages) for i in self._rows
        ]  # those of the state alone hold at the end of the stage

    # -- functions of the problem -----------------------------------------------------------------------------------

    def _arguments(self, k: int) -> tuple[ca.MX, ...]:
        """x, u, p and r of a node; x, p and r of the last."""
        s = self.stages
        x, u = self.nodes[k]
        r = self.p[s.np + k * s.nr : s.np + (k + 1) * s.nr]
        return (x, u, self.p[: s.np], r) if k < s.stages else (x, self.p[: s.np], r)

    @cached_property
    def problem(self) -> dict[str, ca.MX]:
        """x, p, f and g."""
        s = self.stages
        cost, terminal = self._only(self._cost, 0, 3), self._only(self._terminal, 0, 3)
        values = [(cost if k < s.stages else terminal)(*self._arguments(k)) for k in range(s.stages + 1)]
        gaps = [self._following(*self.nodes[k], self.p[: s.np]) - self.nodes[k + 1][0] for k in range(s.stages)]
        rows = [values[k][1][i] for k, i in self.row_nodes]
        f = sum(value[0] for value in values)
        if not self.soft:
            per = len(self._rows)
            blocks = [[gaps[k], *rows[k * per : (k + 1) * per]] for k in range(s.stages)]
            return {"x": self.w, "p": self.p, "f": f, "g": ca.vertcat(*(e for block in blocks for e in block))}
        violation = self.w[self.count :]
        which = [i for _, i in self.row_nodes]
        f += ca.dot(s.linear[which], violation) + 0.5 * ca.dot(s.quadratic[which], violation**2)
        column = ca.vertcat(*rows)
        g = ca.vertcat(*gaps, column + violation, column - violation)
        return {"x": self.w, "p": self.p, "f": f, "g": g}

    @cached_property
    def jac_fg(self) -> ca.Function:
        """(x, p) -> f, its gradient, g, its Jacobian, by one call of the stage functions per node; hard rows only."""
        s = self.stages
        blocks: list[ca.MX] = []
        entries: list[Any] = []
        f, gradient, g = ca.MX(0.0), [], []
        place = 0

        def keep(value: ca.MX, row: int, column: int) -> None:
            nonlocal place
            rows, columns = value.sparsity().get_triplet()
            entries.extend((row + i, column + j, place + n) for n, (i, j) in enumerate(zip(rows, columns, strict=True)))
            blocks.append(ca.vec(value).nz[:])
            place += value.nnz()

        nz, height = s.nx + s.nu, s.nx + len(self._rows)
        found = [(self._cost if k < s.stages else self._terminal)(*self._arguments(k)) for k in range(s.stages + 1)]
        for k in range(s.stages):
            following, by_x, by_u = self._slopes(*self.nodes[k], self.p[: s.np])
            row = k * height
            keep(by_x, row, k * nz)
            keep(by_u, row, k * nz + s.nx)
            keep(-ca.MX.eye(s.nx), row, (k + 1) * nz)
            g.append(following - self.nodes[k + 1][0])
            for n, i in enumerate(self._rows):
                node = k + (i < s.ns)
                keep(found[node][4][i, :], row + s.nx + n, node * nz)
                g.append(found[node][3][i])
        for value in found:
            f += value[0]
            gradient.append(value[1])
        rows, columns, places = zip(*entries, strict=True)
        order = ca.DM.triplet(rows, columns, ca.DM([p + 1 for p in places]), s.stages * height, self.count)
        jacobian = ca.MX(order.sparsity(), ca.vertcat(*blocks)[[int(v) - 1 for v in order.nonzeros()]])
        outputs = [f, ca.densify(ca.vertcat(*gradient)), ca.vertcat(*g), jacobian]
        return ca.Function("nlp_jac_fg", [self.w, self.p], outputs, ["x", "p"], ["f", "grad_f_x", "g", "jac_g_x"])

    def hess_lag(self, *, triangle: bool = False) -> ca.Function:
        """(x, p, lam_f, lam_g) -> Gauss-Newton Hessian, whole or its upper triangle."""
        s = self.stages
        cost, terminal = self._only(self._cost, 2), self._only(self._terminal, 2)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.problem["g"].numel())
        blocks = [(cost if k < s.stages else terminal)(*self._arguments(k)) for k in range(s.stages + 1)]
        if self.soft:
            blocks.append(ca.diag(ca.DM(s.quadratic[[i for _, i in self.row_nodes]])))
        hessian = lam_f * ca.diagcat(*blocks)
        hessian = ca.triu(hessian) if triangle else hessian
        names = ["x", "p", "lam_f", "lam_g"]
        return ca.Function("nlp_hess_l", [self.w, self.p, lam_f, lam_g], [hessian], names, ["hess_gamma_x_x"])

    # -- numbers ------------------------------------------------------------------------------------------------------

    @cached_property
    def bounds(self) -> dict[str, Array]:
        """lbx, ubx, lbg, ubg; the first nx of lbx and ubx are to be replaced by the state."""
        s = self.stages
        low, high = np.full(self.w.numel(), -np.inf), np.full(self.w.numel(), np.inf)
        nz = s.nx + s.nu
        for k in range(s.stages):
            low[k * nz + s.nx : (k + 1) * nz], high[k * nz + s.nx : (k + 1) * nz] = s.u_min, s.u_max
        for i, (column, factor, offset) in self.single_rows.items():
            ends = sorted(((s.c_min[i] - offset) / factor, (s.c_max[i] - offset) / factor))
            for k in range(s.stages):
                place = (k + (i < s.ns)) * nz + column
                low[place], high[place] = max(low[place], ends[0]), min(high[place], ends[1])
        low[self.count :] = 0.0
        least = np.where(s.c_min <= -Stages.ABSENT, -np.inf, s.c_min)[[i for _, i in self.row_nodes]]
        most = np.where(s.c_max >= Stages.ABSENT, np.inf, s.c_max)[[i for _, i in self.row_nodes]]
        if self.soft:
            gaps, none = np.zeros(s.stages * s.nx), np.full(len(least), np.inf)
            below, above = np.concatenate([gaps, least, -none]), np.concatenate([gaps, none, most])
            return {"lbx": low, "ubx": high, "lbg": below, "ubg": above}
        per, zeros = len(self._rows), np.zeros((s.stages, s.nx))
        below, above = (np.hstack([zeros, v.reshape(s.stages, per)]).ravel() for v in (least, most))
        return {"lbx": low, "ubx": high, "lbg": below, "ubg": above}

    def parameters(self, p: Array, references: Array) -> Array:
        """Parameters of the problem."""
        return np.concatenate([p, references.ravel()])

    def guess(self, x: Array, u: Array, p: Array) -> Array:
        """Variables of a plan with states (N + 1, nx) and inputs (N, nu)."""
        s = self.stages
        column = np.concatenate([np.hstack([x[:-1], u]).ravel(), x[-1]])
        if not self.soft:
            return column
        held = np.vstack([u, u[-1:]])
        rows = np.array(s.rows.map(s.stages + 1)(x.T, held.T, p)).T
        left = outside(s, rows)
        return np.concatenate([column, [left[k, i] for k, i in self.row_nodes]])

    def plan(self, w: Array) -> tuple[Array, Array]:
        """States (N + 1, nx) and inputs (N, nu)."""
        s = self.stages
        z = w[: s.stages * (s.nx + s.nu)].reshape(s.stages, -1)
        return np.vstack([z[:, : s.nx], w[self.count - s.nx : self.count]]), z[:, s.nx :].copy()


def _sx(name: str, sizes: Any, build: Any) -> ca.Function:
    """A straight-line function of columns, without the entries that are always zero."""
    given = [ca.SX.sym(f"i{k}", size) for k, size in enumerate(sizes)]
    return ca.Function(name, given, [ca.sparsify(ca.SX(e)) for e in build(*given)])
