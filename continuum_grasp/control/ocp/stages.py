"""An optimal control problem as functions of a stage of its horizon: multiple shooting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.core import call, differentiated_step, straight_function


class Scenarios(NamedTuple):
    """Plants that a problem is posed for at once: the same functions with other parameters, from the same state.

    They have the inputs of the first stage in common. The objective is the weighted mean of theirs; constraints and
    their penalties count for each of them in full.
    """

    weights: Array
    """(S), with S as their sum."""
    scale: Array
    """(S, np): parameters of a scenario are ``scale p + shift``."""
    shift: Array
    """(S, np)."""


@dataclass(frozen=True)
class Stages:
    """An optimal control problem on a grid of equal stages, over which the input is constant.

    minimize  sum_k h/2 sum_i W_i (y_i(x_k, u_k) - r_ki)^2  +  1/2 sum_i T_i (y_i(x_N, u_N-1) - r_Ni)^2  +  penalties
    subject to  x_0 given,  x_{k+1} = F(x_k, u_k, p),  u_min <= u_k <= u_max,  c_min <= c(x_k, u_k, p) <= c_max.

    The rows of c are soft constraints, so that every QP is feasible: a violation s costs ``linear s + quadratic s^2 /
    2`` per node. Hard constraints have a ``linear`` so large that they are satisfied wherever they can be. The first
    ``ns`` rows are of the state alone and apply at the nodes 1 to N, the others at 0 to N - 1.

    The three functions that are written to C, the first ones, are straight-line functions or calls of such functions.

    Attributes
    ----------
    step : casadi.Function
        (x, u, p, h) -> xn (nx), A (nx, nx), B (nx, nu): one step of length h by ``method`` and its derivatives, by the
        variational equations. ``substeps`` of them make F.
    cost : casadi.Function
        (x, u, p, r, W) -> l, g (nz), H (nz, nz), c (nc), C (nc, nz): cost of a stage with its gradient and
        Gauss-Newton Hessian with respect to z = [x, u], and the rows with their Jacobian.
    terminal : casadi.Function
        (x, p, r, T) -> l, g (nx), H (nx, nx), c (ns), C (ns, nx): the same at the last node.
    outputs : casadi.Function
        (x, u, p) -> y (nr): the tracked quantities.
    dynamics : casadi.Function
        (x, u, p) -> xd (nd): time derivative of the continuous states, the first ``nd``.
    rows : casadi.Function
        (x, u, p) -> c (nc).
    stages, substeps : int
        N, and steps per stage.
    method : str
        Name of an integrator that is ``differentiates`` in ``INTEGRATORS``.
    stage : float
        Length of a stage h [s].
    nd, ns, nt : int
        Continuous states; rows of the state alone; outputs that the last node has too: of the state, which ends in the
        input before where they depend on the input.
    x_names, u_names, p_names, r_names, c_names : tuple of str
        Name and unit of each entry of a node; rows are relative to their bounds. ``nx``, ``nu`` and so on: how many.
    u_min, u_max, c_min, c_max, linear, quadratic, weights, terminal_weights, p_nominal : ndarray
        Nominal values, which may be changed at run time; +-`ABSENT` is no bound.
    scenarios : Scenarios or None
        None: the one plant that p describes.
    checks_gaps : bool
        Whether a controller checks the gaps of its plans, as contacts in the dynamics require: on these, full steps may
        repeat a plan that is no motion of the model, or lead away from one that is.
    """

    step: ca.Function
    cost: ca.Function
    terminal: ca.Function
    outputs: ca.Function
    dynamics: ca.Function
    rows: ca.Function
    stages: int
    stage: float
    substeps: int
    method: str
    nd: int
    ns: int
    nt: int
    x_names: tuple[str, ...]
    u_names: tuple[str, ...]
    p_names: tuple[str, ...]
    r_names: tuple[str, ...]
    c_names: tuple[str, ...]
    u_min: Array
    u_max: Array
    c_min: Array
    c_max: Array
    linear: Array
    quadratic: Array
    weights: Array
    terminal_weights: Array
    p_nominal: Array
    scenarios: Scenarios | None = None
    checks_gaps: bool = False
    ABSENT: ClassVar[float] = 1e30
    """Magnitude of a bound that means no bound, in the bound's unit: beyond any quantity, and below the largest number
    of single precision (3.4e38), so that sums of two do not overflow."""

    def __repr__(self) -> str:
        return (
            f"Stages({self.stages} of {self.stage:g} s, {self.substeps} {self.method} steps each: {self.nx} states, "
            f"{self.nu} inputs, {self.np} parameters, {self.nr} setpoints, {self.nc} rows)"
        )

    def ends(self, x: Array, u: Array, p: Array) -> Array:
        """Integrate stages, each from a state (count, nx) with an input (count, nu); return their ends (count, nx)."""
        count = len(u)
        h = self.stage / self.substeps
        for _ in range(self.substeps):
            x = np.array(self.step.map(count)(x.T, u.T, np.tile(p[:, None], count), np.full(count, h))[0]).T
        return x

    @property
    def plants(self) -> int:
        """Number of plants: 1 without scenarios."""
        return 1 if self.scenarios is None else len(self.scenarios.weights)

    @property
    def nx(self) -> int:
        return len(self.x_names)

    @property
    def nu(self) -> int:
        return len(self.u_names)

    @property
    def np(self) -> int:
        return len(self.p_names)

    @property
    def nr(self) -> int:
        return len(self.r_names)

    @property
    def nc(self) -> int:
        return len(self.c_names)


def step_function(dynamics: ca.Function, nx: int, method: str = "rk4") -> ca.Function:
    """Write one step of an integrator of a controller with its derivatives, (x, u, p, h) -> xn, A, B.

    ``dynamics`` is (x, u, p) -> xd of the first entries of x; the last ones, if any, become the first inputs.

    By the variational equations: the Jacobian of the dynamics is written once and called per slope, and propagated;
    CasADi's ``jacobian`` of the whole step takes 2.4 times as many instructions.
    """
    sizes = {"x": nx, "u": dynamics.size1_in(1), "p": dynamics.size1_in(2)}
    symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    x, u = symbols["x"], symbols["u"]
    rate = dynamics(*symbols.values())
    nd = rate.numel()
    jacobian = ca.jacobian(rate, ca.vertcat(x[:nd], u))
    slope = straight_function("stage_slope", symbols, {"rate": rate, "jacobian": jacobian})
    at = [ca.MX.sym(name, size) for name, size in (sizes | {"h": 1}).items()]
    reached = differentiated_step(method, "stage", slope, at[0], (at[1], at[2]), at[3])
    end = ca.SX.sym("end", nd)
    by = ca.SX.sym("by", reached[1].sparsity())
    outputs = {
        "xn": ca.vertcat(end, u[: nx - nd, :]),
        "A": ca.diagcat(by[:, :nd], ca.SX(nx - nd, nx - nd)),
        "B": ca.vertcat(by[:, nd:], ca.SX.eye(u.numel())[: nx - nd, :]),
    }
    dense = {name: ca.densify(value) for name, value in outputs.items()}
    collect = straight_function("stage_derivatives", {"u": u, "end": end, "by": by}, dense)
    return ca.Function("stage_step", at, call(collect, at[1], *reached), ["x", "u", "p", "h"], list(outputs))


_EXPANDED = ["l", "g", "H", "c", "C"]


def cost_functions(
    outputs: ca.Function, rows: ca.Function, stage: float, nt: int, ns: int
) -> tuple[ca.Function, ca.Function]:
    """Write cost and rows of a stage and of the last node; see ``Stages.cost`` and ``Stages.terminal``.

    Both call one function of tracked and bounded quantities with its Jacobian, whose first ``nt`` and ``ns`` rows the
    last node uses; the last node has one of its own where the first outputs depend on the input, which is there the
    one held: the last states.
    """
    nr, nc = outputs.numel_out(0), rows.numel_out(0)
    sizes = {name: outputs.size1_in(k) for k, name in enumerate("xup")}
    s = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    y = outputs(*s.values())
    c = rows(*s.values())
    z = ca.vertcat(s["x"], s["u"])
    expressions = {"y": y, "Y": ca.jacobian(y, z), "c": c, "C": ca.jacobian(c, z)}
    values = last = straight_function("stage_values", s, expressions)
    if expressions["Y"][:nt, sizes["x"] :].nnz():
        held = s["x"][-sizes["u"] :]
        y, c = (ca.substitute(value, s["u"], held) for value in (y, c))
        last = straight_function("last_values", s, {"y": y, "Y": ca.jacobian(y, z), "c": c, "C": ca.jacobian(c, z)})
    x, u, p, r, weights = (ca.MX.sym(name, size) for name, size in (sizes | {"r": nr, "W": nr}).items())
    expand = _expanded("stage_expanded", values, nr, z.numel(), nc, stage)
    cost = call(expand, *call(values, x, u, p), r, weights)
    expand_end = _expanded("terminal_expanded", last, nt, sizes["x"], ns, 1.0)
    # Without tracked quantities at the end, the results are zeros, and CasADi makes them sparse.
    found_end = call(expand_end, *call(last, x, ca.MX(ca.DM.zeros(sizes["u"])), p), r, weights)
    terminal = [ca.densify(value) for value in found_end]
    return (
        ca.Function("stage_cost", [x, u, p, r, weights], cost, ["x", "u", "p", "r", "W"], _EXPANDED),
        ca.Function("terminal_cost", [x, p, r, weights], terminal, ["x", "p", "r", "T"], _EXPANDED),
    )


def _expanded(name: str, values: ca.Function, nr: int, nz: int, nc: int, scale: float) -> ca.Function:
    """Half the weighted squares of the first errors, gradient, Gauss-Newton Hessian; first rows and their Jacobian.

    Gauss-Newton, since its Hessian is positive semidefinite, so that every QP is convex, and needs first derivatives
    only.
    """
    symbols = {key: ca.SX.sym(key, values.sparsity_out(k)) for k, key in enumerate(values.name_out())}
    symbols |= {key: ca.SX.sym(key, values.size1_out(0)) for key in ("r", "W")}
    error = symbols["y"][:nr, :] - symbols["r"][:nr, :]
    slope = symbols["Y"][:nr, :nz]
    scaled = scale * symbols["W"][:nr, :]
    weighted = scaled * error
    expressions = [
        0.5 * ca.dot(error, weighted),
        ca.mtimes(slope.T, weighted),
        ca.mtimes(slope.T, ca.mtimes(ca.diag(scaled), slope)),
        symbols["c"][:nc, :],
        symbols["C"][:nc, :nz],
    ]
    # Names of their own: C has no argument twice.
    dense = {f"{key}_out": ca.densify(value) for key, value in zip(_EXPANDED, expressions, strict=True)}
    return straight_function(name, symbols, dense)
