"""Random stages for the tests of the real-time iteration; from inside: cost functions of outputs that no scene has.

Random stages for the tests of the real-time iteration, and their QPs for other solvers.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.real_time_iteration import RealTimeIteration
from continuum_grasp.control import Stages
from continuum_grasp.control.ocp.stages import Scenarios, cost_functions

LOOSE = (
    "-fassociative-math",
    "-freciprocal-math",
    "-fno-signed-zeros",
    "-fno-trapping-math",
    "-ffinite-math-only",
    "-fno-math-errno",
)
"""-ffast-math but for what it does to the whole process when a library is loaded."""
SIZES = ((10, 4, 1, 4, 0), (6, 3, 2, 2, 2), (15, 2, 1, 0, 1), (5, 6, 3, 3, 0), (8, 5, 2, 0, 0), (12, 1, 1, 2, 1))
"""N, nx, nu, rows of the state alone, other rows."""


def random_stages(seed: int, size: tuple[int, ...], **changes) -> Stages:
    """Quadratic dynamics and outputs with random bounds, some of them absent, and penalty weights over many orders."""
    n, nx, nu, ns, others = size
    rng = np.random.default_rng(seed)
    x, u, p, h = ca.SX.sym("x", nx), ca.SX.sym("u", nu), ca.SX.sym("p", 1), ca.SX.sym("h")
    a = rng.normal(size=(nx, nx))
    a *= rng.uniform(0.5, 1.05) / np.abs(np.linalg.eigvals(a)).max()
    bent = ca.vertcat(*[x.T @ rng.normal(size=(nx, nx)) @ x for _ in range(nx)])
    following = h * p * (a @ x + rng.normal(size=(nx, nu)) @ u + 0.05 * bent)
    step = [ca.densify(e) for e in (following, ca.jacobian(following, x), ca.jacobian(following, u))]
    y = ca.vertcat(rng.normal(size=(nx, nx)) @ x + 0.1 * x**2, u + 0.1 * x[0])
    rows = [
        x[i % nx] * rng.normal() if rng.random() < 0.5 else rng.normal(size=(1, nx)) @ x + x[0] ** 2 for i in range(ns)
    ]
    rows += [rng.normal(size=(1, nx)) @ x + rng.normal(size=(1, nu)) @ u for _ in range(others)]
    c = ca.densify(ca.vertcat(*rows)) if rows else ca.SX(0, 1)
    outputs, row_function = (
        ca.Function(name, [x, u, p], [value], ["x", "u", "p"], [name]) for name, value in (("y", y), ("c", c))
    )
    weights = 10 ** rng.uniform(-2, 1, nx + nu) * (rng.random(nx + nu) > 0.2)
    weights[nx:] = 10 ** rng.uniform(-3, 0, nu)
    (u_min, u_max), (c_min, c_max) = _bounds(rng, nu, 0.1), _bounds(rng, ns + others, 0.3)
    count = ns + others
    cost, terminal = cost_functions(outputs, row_function, 1.0, nx, ns)
    given = {
        "step": ca.Function("stage_step", [x, u, p, h], step, ["x", "u", "p", "h"], ["xn", "A", "B"]),
        "cost": cost,
        "terminal": terminal,
        "outputs": outputs,
        "dynamics": outputs,
        "rows": row_function,
        "stages": n,
        "stage": 1.0,
        "substeps": 1,
        "method": "rk4",
        "nd": nx,
        "ns": ns,
        "nt": nx,
        **{f"{name}_names": tuple(f"{name}{k}" for k in range(k)) for name, k in (("x", nx), ("u", nu), ("p", 1))},
        **{f"{name}_names": tuple(f"{name}{k}" for k in range(k)) for name, k in (("r", nx + nu), ("c", count))},
        "u_min": u_min,
        "u_max": u_max,
        "c_min": c_min,
        "c_max": c_max,
        "linear": 10 ** rng.uniform(-1, 4, count) * (rng.random(count) > 0.3),
        "quadratic": 10 ** rng.uniform(-1, 6, count),
        "weights": weights,
        "terminal_weights": 3.0 * weights,
        "p_nominal": np.ones(1),
    }
    return Stages(**{**given, **changes})


def random_scenarios(plants: int, size: tuple[int, ...], weights: np.ndarray, shift: np.ndarray) -> Stages:
    """Random stages of several plants of one prediction, whose parameters are changed by ``shift``."""
    spread = Scenarios(weights * plants / weights.sum(), np.ones((plants, 1)), shift)
    return random_stages(plants, size, scenarios=spread)


def _bounds(rng: np.random.Generator, count: int, absent: float) -> tuple[np.ndarray, np.ndarray]:
    which, least, most = rng.random(count), -rng.uniform(0.05, 1, count), rng.uniform(0.05, 1, count)
    return np.where(which < absent, -Stages.ABSENT, least), np.where(which > 1 - absent, Stages.ABSENT, most)


def disturb(rti: RealTimeIteration, rng: np.random.Generator, spread: float = 0.3) -> np.ndarray:
    """A random plan and random setpoints, prepared; a random state, near or far."""
    s = rti.stages
    rti.reset(np.zeros(s.nx))
    for part in rti.plan:
        part[:] = spread * rng.normal(size=part.shape)
    rti.prepare(rng.normal(size=(s.stages + 1, s.nr)))
    return rng.normal(size=s.nx) * 10 ** rng.uniform(-1, 1)


@contextmanager
def changed(rti: RealTimeIteration, **settings: Any) -> Iterator[None]:
    """Settings of an iteration that others share, for a while."""
    before = {name: copy(getattr(rti.settings, name)) for name in settings}
    try:
        for name, value in settings.items():
            setattr(rti.settings, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(rti.settings, name, value)


@dataclass(frozen=True)
class QP:
    """min z'Hz/2 + g'z + penalties, s.t. E z = e, low <= z <= high, rows C z in c_min to c_max or with a penalty."""

    H: np.ndarray
    g: np.ndarray
    E: np.ndarray
    e: np.ndarray
    low: np.ndarray
    high: np.ndarray
    C: np.ndarray
    c_min: np.ndarray
    c_max: np.ndarray
    linear: np.ndarray
    quadratic: np.ndarray

    def cost(self, z: np.ndarray) -> float:
        """Penalties included."""
        y = self.C @ z
        over = np.maximum(0.0, np.maximum(self.c_min - y, y - self.c_max))
        return 0.5 * z @ self.H @ z + self.g @ z + self.linear @ over + 0.5 * self.quadratic @ over**2

    def solve(self, solver: str = "qpoases") -> np.ndarray:
        """By another solver, with slacks as variables."""
        m, n = self.C.shape
        slack = np.eye(m)
        h = ca.sparsify(ca.DM(np.block([[self.H, np.zeros((n, m))], [np.zeros((m, n)), np.diag(self.quadratic)]])))
        blocks = [[self.E, np.zeros((len(self.e), m))], [self.C, slack], [self.C, -slack]]
        a = ca.sparsify(ca.DM(np.block(blocks)))
        none = np.full(m, np.inf)
        options = {"printLevel": "none"} if solver == "qpoases" else {}
        solve = ca.conic("oracle", solver, {"h": h.sparsity(), "a": a.sparsity()}, options)
        found = solve(
            h=h,
            g=np.r_[self.g, self.linear],
            a=a,
            lba=np.r_[self.e, self.c_min, -none],
            uba=np.r_[self.e, none, self.c_max],
            lbx=np.r_[self.low, np.zeros(m)],
            ubx=np.r_[self.high, none],
        )
        return np.array(found["x"]).ravel()[:n]


class PlanOf:
    """A scenario of an iteration, which reads as the iteration of a problem without scenarios."""

    def __init__(self, rti: RealTimeIteration, number: int) -> None:
        n = rti.stages.stages
        self._rti, self.stages, self.settings = rti, rti.stages, rti.settings
        self._nodes, self._stages = (slice(number * size, (number + 1) * size) for size in (n + 1, n))

    @property
    def plan(self) -> tuple[np.ndarray, np.ndarray]:
        x, u = self._rti.plan
        return x[self._nodes], u[self._stages]

    def qp(self) -> dict[str, np.ndarray]:
        of_stages = ("u", "A", "B", "defect")
        found = self._rti.qp().items()
        return {name: value[self._stages if name in of_stages else self._nodes] for name, value in found}


def qp_of(rti: RealTimeIteration | PlanOf, x0: np.ndarray) -> QP:
    """That of the last preparation, in z = [x_0, u_0, .., x_N] from the plan."""
    s, q, o = rti.stages, rti.qp(), rti.settings
    n, nx, nz = s.stages, s.nx, s.nx + s.nu
    size = n * nz + nx
    at = [slice(k * nz, min(k * nz + nz, size)) for k in range(n + 1)]
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    equal, right = np.zeros(((n + 1) * nx, size)), np.zeros((n + 1) * nx)
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    equal[:nx, :nx], right[:nx] = np.eye(nx), x0 - q["x"][0]
    rows, entries = [], []
    for k in range(n + 1):
        width = at[k].stop - at[k].start
        hessian[at[k], at[k]], gradient[at[k]] = q["H"][k, :width, :width], q["g"][k, :width]
        for i in range(s.nc):
            penalized = o.linear[i] > 0 or o.quadratic[i] > 0
            if penalized and (k > 0 if i < s.ns else k < n):
                rows.append(np.zeros(size))
                rows[-1][at[k]] = q["C"][k, i, :width]
                entries.append((k, i))
        if k == n:
            break
        to = slice((k + 1) * nx, (k + 2) * nx)
        equal[to, at[k]] = np.hstack([q["A"][k], q["B"][k]])
        equal[to, at[k + 1].start : at[k + 1].start + nx] = -np.eye(nx)
        right[to] = -q["defect"][k]
        inputs = slice(at[k].start + nx, at[k].stop)
        low[inputs] = np.where(o.u_min > -Stages.ABSENT, o.u_min - q["u"][k], -np.inf)
        high[inputs] = np.where(o.u_max < Stages.ABSENT, o.u_max - q["u"][k], np.inf)
    i = np.array([i for _, i in entries], dtype=int)
    c = np.array([q["c"][k, i] for k, i in entries])
    c_min = np.where(o.c_min[i] > -Stages.ABSENT, o.c_min[i] - c, -np.inf)
    c_max = np.where(o.c_max[i] < Stages.ABSENT, o.c_max[i] - c, np.inf)
    matrix = np.reshape(rows, (-1, size))
    penalties = o.linear[i].copy(), o.quadratic[i].copy()
    return QP(hessian, gradient, equal, right, low, high, matrix, c_min, c_max, *penalties)


def change_of_plan(rti: RealTimeIteration | PlanOf) -> np.ndarray:
    """Change z of the last answer."""
    q, (x, u) = rti.qp(), rti.plan
    nodes = np.hstack([x[:-1] - q["x"][:-1], u - q["u"]])
    return np.r_[nodes.ravel(), x[-1] - q["x"][-1]]


def by_ipopt(s: Stages, x0: np.ndarray, reference: np.ndarray, guess=None, tolerance: float = 1e-12):
    """States and inputs, those of all scenarios one after the other, of the nonlinear problem, written anew: multiple
    shooting, with slacks as variables and the first inputs in common.
    """
    opti, objective, states, inputs = ca.Opti(), 0, [], []
    first = opti.variable(s.nu)
    of = s.scenarios
    plants = [(s.p_nominal, 1.0)] if of is None else zip(of.scale * s.p_nominal + of.shift, of.weights, strict=True)
    for p, weight in plants:
        x, path, own = ca.MX(x0), [ca.MX(x0)], []
        for k in range(s.stages):
            u = first if k == 0 else opti.variable(s.nu)
            own.append(u)
            opti.subject_to(opti.bounded(s.u_min, u, s.u_max))
            opti.set_initial(u, x0[-s.nu :] if guess is None else guess[1][k])
            error = s.outputs(x, u, p) - reference
            objective += weight / s.plants * 0.5 * s.stage * ca.dot(s.weights * error, error)
            here, end = s.rows(x, u, p), x
            for _ in range(s.substeps):
                end = s.step(end, u, p, s.stage / s.substeps)[0]
            x = opti.variable(s.nx)
            opti.set_initial(x, x0 if guess is None else guess[0][k + 1])
            opti.subject_to(x == end)
            path.append(x)
            after = s.rows(x, ca.MX.zeros(s.nu), p)
            for i in range(s.nc):
                c, slack = (after if i < s.ns else here)[i], opti.variable()
                opti.subject_to(slack >= 0.0)
                if s.c_min[i] > -Stages.ABSENT:
                    opti.subject_to(c >= s.c_min[i] - slack)
                if s.c_max[i] < Stages.ABSENT:
                    opti.subject_to(c <= s.c_max[i] + slack)
                objective += (s.linear[i] * slack + 0.5 * s.quadratic[i] * slack**2) / s.plants
        error = (s.outputs(x, ca.MX.zeros(s.nu), p) - reference)[: s.nt]
        objective += weight / s.plants * 0.5 * ca.dot(s.terminal_weights[: s.nt] * error, error)
        states.append(ca.hcat(path).T)
        inputs.append(ca.hcat(own).T)
    opti.minimize(objective)
    opti.solver("ipopt", {"ipopt.print_level": 0, "print_time": 0, "ipopt.tol": tolerance, "ipopt.sb": "yes"})
    solution = opti.solve()
    return tuple(solution.value(ca.vcat(parts)).reshape(-1, n) for parts, n in ((states, s.nx), (inputs, s.nu)))
