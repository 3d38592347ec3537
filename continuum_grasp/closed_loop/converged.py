"""The same controller with every problem solved to convergence by IPOPT.

A real-time iteration is measured against it. It needs the state: an estimator is no part of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.arguments import check_arguments
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.closed_loop.run import run_closed_loop
from continuum_grasp.control.command import Estimate, Plan
from continuum_grasp.control.ocp.bounds import ABSENT
from continuum_grasp.control.ocp.scene_problem import stages_of
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.status import Health, Status
from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import find_compiler
from continuum_grasp.core.source import function_source
from continuum_grasp.model.remade import Remade
from continuum_grasp.nlp import NLP, Budget, Settings, Start, new_solver
from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.families import PAPER_FAMILY
from continuum_grasp.scene.simulate import Fidelity

Array = NDArray[np.float64]

_SETTINGS = Settings(tolerance=1e-8, max_iterations=200, tuning={"ipopt": {"mu_strategy": "adaptive"}})
"""A period that takes more iterations counts as a failure; the tolerance is that of the real-time iteration's QP."""

_CONVERGED = Consumer(
    "mpc --compare, NMPC to convergence",
    refused={
        "estimator": "NMPC to convergence is given the state: leave the estimator out",
        "controller.scenarios": "NMPC to convergence is for one plant: leave scenarios out",
    },
    unneeded={
        **dict.fromkeys(
            [
                f"controller.{key}"
                for key in ("iterations", "sqp_iterations", "start_calls", "start_iterations", "supervisor")
            ],
            "of the real-time iteration, in whose place every problem is solved to convergence",
        ),
        **dict.fromkeys(("plant.noise", "plant.seed", "plant.delay"), "the state is given exactly, and at once"),
        "name": "a title alone",
    },
)


class _Times(NamedTuple):
    total: float


@dataclass(frozen=True)
class _Command:
    u: Array
    status: Status
    plan: Plan
    estimate: Estimate
    time: _Times
    iterations: int
    violation: float
    anomalies: tuple[str, ...] = ()
    health: Health = Health.OK
    health_text: str = ""
    mismatch: float = 0.0
    activity: float = 0.0
    contact_forces: None = None


class Converged(Remade):
    """Nonlinear model predictive control without a time limit, of a scene without an estimator."""

    estimated_names: tuple[str, ...] = ()
    _last: tuple[Array, Array] | None

    @check_arguments
    def __init__(self, scene: ControlScene) -> None:
        _CONVERGED.check(scene)
        self.prediction = Prediction(scene)
        self.stages = stages_of(scene, self.prediction)
        self.period = scene.controller.step
        self._problem, self._solver = ShootingProblem(self.stages), new_solver(_SETTINGS)
        self.failures = 0
        self.times: list[float] = []
        self.reset()

    def __getstate__(self) -> tuple[Any, ...]:
        return self._held, self._last, self.failures, self.times.copy()

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._held, self._last, self.failures, self.times = state

    @property
    def statistics(self) -> dict[str, Any]:
        """How often it was solved, how often not, and how long that took."""
        return {"steps": len(self.times), "failures": self.failures, "median_s": float(np.median(self.times or [0.0]))}

    def reset(self, state: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Forget the last plan; ``u`` (nu) is the input so far, zero or the nearest bound by default."""
        s = self.stages
        self._last = None
        self._held = np.clip(np.zeros(s.nu), s.u_min, s.u_max) if u is None else np.array(u, dtype=float)

    def step(self, measurement: ArrayLike, reference: ArrayLike, *, p: ArrayLike | None = None) -> _Command:
        """Solve for one command from the state (nx), setpoints of the nodes (N + 1, nr) and parameters (np).

        Where the solver does not converge, the status is ``ITERATION_LIMIT`` and the last iterate is applied within
        limits.
        """
        s, began = self.stages, perf_counter()
        state = np.asarray(measurement, dtype=float)
        x0 = np.concatenate([state, self._held[: s.nx - s.nd]])
        parameters = s.p_nominal if p is None else np.asarray(p, dtype=float)
        x, u = self._guess(x0)
        start = self._problem.start(x, u, x0, parameters, np.asarray(reference, dtype=float))
        found = self._solver.solve(self._problem.nlp, start, Budget())
        x, u, violation = self._problem.split(found.x)
        self._last = x, u
        self._held = np.clip(u[0], s.u_min, s.u_max)
        self.failures += not found.converged
        self.times.append(perf_counter() - began)
        return _Command(
            u=self._held,
            status=Status.SOLVED if found.converged else Status.ITERATION_LIMIT,
            plan=Plan(*self._last),
            estimate=Estimate(state, parameters),
            time=_Times(self.times[-1]),
            iterations=found.iterations,
            violation=violation,
        )

    def _guess(self, x0: Array) -> tuple[Array, Array]:
        """The last plan, moved on by a period; at first the state as it is."""
        s = self.stages
        if self._last is None:
            return np.tile(x0, (s.stages + 1, 1)), np.tile(self._held, (s.stages, 1))
        x, u = self._last
        ahead = self.period / s.stage
        at = np.minimum(np.arange(s.stages + 1) + ahead, s.stages)
        # States lie between the nodes, inputs hold from one to the next.
        moved = np.array([np.interp(at, np.arange(s.stages + 1), column) for column in x.T]).T
        return moved, u[np.minimum(at[:-1].astype(int), s.stages - 1)]


def compared(scene: ControlScene, progress: Callable[[float], None] | None = None) -> dict[str, ControlRun]:
    """Run the closed loops of other controllers; ``progress`` is called with the share that is done.

    ``two arcs``: the same problem on the paper's elements, or as many as there are contacts to part. Then, both given
    the state so that nothing but the solver differs, ``with the state`` and ``converged``.
    """

    def part(k: int) -> Callable[[float], None]:
        return lambda share: progress((k + share) / 3.0) if progress else None

    arcs = Fidelity(family=PAPER_FAMILY, elements=max(2, len(scene.contacts) + 1))
    on_arcs, known = scene.model_copy(update={"fidelity": arcs}), scene.model_copy(update={"estimator": None})
    converged = Converged(known)  # first: what it refuses need not wait for two runs
    return {
        "two arcs": run_closed_loop(on_arcs, progress=part(0)),
        "with the state": run_closed_loop(known, progress=part(1)),
        "converged": run_closed_loop(known, controller=converged, progress=part(2)),
    }


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
        gaps, gap_slopes, gradient, hessian, rows = [nodes[0][: s.nx] - self._p[: s.nx]], [], [], [], []
        cost = ca.MX(0)
        row_slopes: list[tuple[int, ca.MX]] = []
        for k in range(n):
            x, u = nodes[k][: s.nx], nodes[k][s.nx :]
            following, a, b = self._shoot(x, u, p)
            gaps.append(following - nodes[k + 1][: s.nx])
            gap_slopes.append(ca.horzcat(a, b))
            value, g, h, c, slope = self._cost(x, u, p, refs[:, k], weights)
            cost += value
            gradient.append(g)
            hessian.append(h)
            # Rows of the state alone do not bound the first node, which is given.
            first = 0 if k else s.ns
            rows.append(c[first:])
            row_slopes.append((k, slope[first:, :]))
        value, g_end, h, c, slope = self._terminal(nodes[n], p, refs[:, n], end_weights)
        rows.append(c)
        row_slopes.append((n, slope))
        linear, quadratic = ca.DM(s.linear[self._order]), ca.DM(s.quadratic[self._order])
        penalty = ca.dot(linear, slack) + 0.5 * ca.dot(quadratic, slack * slack)
        row = ca.vertcat(*rows)
        # c_min - s <= c <= c_max + s with one slack for both sides: only one can be violated.
        f, g = cost + value + penalty, ca.vertcat(*gaps, row - slack, row + slack)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
        # Gauss-Newton leaves the curvature of the constraints out, so lam_g does not enter.
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
        lines += [placed(ca.horzcat(slope, -eye), k * self._nz) for k, slope in enumerate(gaps)]
        row = ca.vertcat(*[placed(slope, k * self._nz) for k, slope in rows])
        own = placed(ca.MX(ca.DM.eye(self._row_count)), self._count)
        return ca.vertcat(*lines, row - own, row + own)

    @cached_property
    def _order(self) -> list[int]:
        """Which row of a node stands where: of the state alone at nodes 1 to N, the others at 0 to N - 1."""
        s = self.stages
        return [*range(s.ns, s.nc), *[*range(s.nc)] * (s.stages - 1), *range(s.ns)]

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
    """Return the function in C, where there is a compiler."""
    compiler = find_compiler()
    if compiler is None:
        return function
    return ca.external(function.name(), str(library_for(function_source(function), compiler, "the NLP")))
