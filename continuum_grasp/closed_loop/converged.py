"""A controller whose every problem is solved to convergence by IPOPT.

A real-time iteration is measured against it. It needs the state: an estimator is no part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
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
from continuum_grasp.model.remade import Remade
from continuum_grasp.nlp import Budget, Settings, Start, new_solver
from continuum_grasp.planning.assembly import OBJECTIVE, Assembly
from continuum_grasp.planning.shooting import Term, compiled, derived
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
    adapted: Mapping[str, Any] = field(default_factory=dict)


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
        """Counts of solved and unsolved problems, and times."""
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

    Unknowns: x_0, u_0, ..., x_N, then a slack for every row of every node. Parameters: p, and the setpoints node by
    node. Constraints: gaps, rows from above, rows from below.
    """

    def __init__(self, stages: Stages) -> None:
        self.stages = s = stages
        n, count, free = s.stages, s.stages * s.nc, np.full(s.nx, np.inf)
        self._assembly = assembly = Assembly(semidefinite=True)
        nodes = assembly.variables(n, s.nx + s.nu, np.append(-free, s.u_min), np.append(free, s.u_max))
        end, slack = assembly.variables(1, s.nx), assembly.variables(count, 1, 0.0)
        self._first = nodes[0, : s.nx]
        assembly.parameters = p = ca.MX.sym("p", s.np + (n + 1) * s.nr)
        given = ca.vertcat(ca.repmat(p[: s.np], 1, n + 1), ca.reshape(p[s.np :], s.nr, n + 1))
        gaps = assembly.rows("gaps", "controller.horizon", "", n, np.ones(s.nx))
        assembly.add(self._interval(), nodes, gaps, given[: s.np, :n])
        assembly.add_linear(gaps, np.vstack([nodes[1:, : s.nx], end]), -1.0)
        # c_min - s <= c <= c_max + s with one slack for both sides: only one can be violated. Rows of the state alone
        # are those of nodes 1 to N, the others those of nodes 0 to N - 1.
        row = (np.arange(count)[:, None] + s.ns) % max(s.nc, 1)
        least, most = np.where(s.c_min <= -ABSENT, -np.inf, s.c_min), np.where(s.c_max >= ABSENT, np.inf, s.c_max)
        above = assembly.rows("from above", "controller.bounds", "", count, 1.0, -np.inf, most[row])
        below = assembly.rows("from below", "controller.bounds", "", count, 1.0, least[row], np.inf)
        assembly.add_linear(above, slack, -1.0)
        assembly.add_linear(below, slack, 1.0)
        at = np.arange(n)[:, None] * s.nc + np.arange(s.nc) - s.ns
        there = at >= 0
        into = [np.full((n, 1), OBJECTIVE), *(np.where(there, rows[at, 0], OBJECTIVE) for rows in (above, below))]
        factors = np.hstack([np.ones((n, 1)), there, there])
        assembly.add(self._node(s.cost, s.weights, s.nu), nodes, np.hstack(into), given[:, :n], factors)
        last = [OBJECTIVE, *above[count - s.ns :, 0], *below[count - s.ns :, 0]]
        assembly.add(self._node(s.terminal, s.terminal_weights), end, last, given[:, n:])
        if count:
            z, d = ca.SX.sym("z"), ca.SX.sym("d", 2)
            penalty = derived("penalty", z, d, d[0] * z + 0.5 * d[1] * z * z)
            assembly.add(penalty, slack, [OBJECTIVE], np.hstack([s.linear[row], s.quadratic[row]]))
        self.nlp = assembly.nlp

    def _interval(self) -> Term:
        """The end of a stage, its derivatives by the chain rule over the sub-steps."""
        s, step = self.stages, self.stages.step
        z, d, weights = (ca.MX.sym(name, size) for name, size in (("z", s.nx + s.nu), ("d", s.np), ("weights", s.nx)))
        following, a, b = step(z[: s.nx], z[s.nx :], d, s.stage / s.substeps)
        for _ in range(s.substeps - 1):
            following, by_x, by_u = step(following, z[s.nx :], d, s.stage / s.substeps)
            a, b = ca.mtimes(by_x, a), ca.mtimes(by_x, b) + by_u
        # Gauss-Newton leaves the curvature of the constraints out.
        return _term("interval", (z, d, weights), following, ca.horzcat(a, b), ca.MX.zeros(z.numel(), z.numel()))

    def _node(self, function: ca.Function, weights_of_cost: Array, nu: int = 0) -> Term:
        """The cost of a node, then its rows for either side of their bounds."""
        s = self.stages
        z, d = ca.MX.sym("z", s.nx + nu), ca.MX.sym("d", s.np + s.nr)
        parts = [z[: s.nx], z[s.nx :]] if nu else [z]
        value, g, h, c, slope = function(*parts, d[: s.np], d[s.np :], ca.DM(weights_of_cost))
        weights = ca.MX.sym("weights", 1 + 2 * c.numel())
        values, slopes = ca.vertcat(value, c, c), ca.vertcat(g.T, slope, slope)
        return _term(f"{function.name()}_term", (z, d, weights), values, slopes, weights[0] * h)

    def start(self, x: Array, u: Array, x0: Array, p: Array, refs: Array) -> Start:
        """Start from a guess of states (N + 1, nx) and inputs (N, nu)."""
        self._assembly.fix(self._first, x0)
        guess = np.concatenate([np.hstack([x[:-1], u]).ravel(), x[-1], np.zeros(self.stages.stages * self.stages.nc)])
        return replace(self._assembly.start(guess), p=np.concatenate([p, refs.ravel()]))

    def split(self, z: Array) -> tuple[Array, Array, float]:
        """States (N + 1, nx), inputs (N, nu) and the largest slack of a solution."""
        s = self.stages
        inner = s.stages * (s.nx + s.nu)
        body, end, slack = z[:inner].reshape(s.stages, -1), z[inner : inner + s.nx], z[inner + s.nx :]
        return np.vstack([body[:, : s.nx], end]), body[:, s.nx :].copy(), float(slack.max(initial=0.0))


def _term(name: str, given: tuple[ca.MX, ca.MX, ca.MX], value: ca.MX, slope: ca.MX, hessian: ca.MX) -> Term:
    """A compiled term of what it reads, numbers and the weights of its outputs, from its value and derivatives."""
    z, d, weights = given
    return compiled(
        Term(
            ca.Function(name, [z, d], [value]),
            ca.Function(f"{name}_jac", [z, d], [slope]),
            ca.Function(f"{name}_hess", [z, d, weights], [hessian]),
        )
    )
