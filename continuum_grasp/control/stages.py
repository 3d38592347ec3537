"""What the solvers of a receding-horizon problem are made of."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

__all__ = ["ABSENT", "Stages"]

Array = NDArray[np.float64]

ABSENT = 1e30
"""A bound of this size is none."""


@dataclass(frozen=True)
class Stages:
    """An optimal control problem on a grid of equal stages, over which the input is constant.

    minimise  sum_k h/2 sum_i W_i (y_i(x_k, u_k) - r_ki)^2  +  1/2 sum_i T_i (y_i(x_N) - r_Ni)^2  +  penalties
    subject to  x_0 given,  x_{k+1} = F(x_k, u_k, p),  u_min <= u_k <= u_max,  c_min <= c(x_k, u_k, p) <= c_max.

    The rows of c are soft: a row that leaves its bounds by s costs ``linear s + quadratic s^2 / 2`` per node; hard rows
    have ``linear`` so large that they are kept wherever they can be. The first ``ns`` rows are of the state alone and
    hold at the nodes 1 to N, the others at 0 to N - 1.

    Attributes
    ----------
    step : casadi.Function
        (x, u, p, h) -> xn (nx), A (nx, nx), B (nx, nu): one step of length h by ``method`` and its derivatives, by the
        variational equations; a straight-line function. ``substeps`` of them make F.
    cost : casadi.Function
        (x, u, p, r, W) -> l, g (nz), H (nz, nz), c (nc), C (nc, nz): cost of a stage with its gradient and
        Gauss-Newton Hessian with respect to z = [x, u], and the rows with their Jacobian.
    terminal : casadi.Function
        (x, p, r, T) -> l, g (nx), H (nx, nx), c (ns), C (ns, nx): the same at the last node.
    outputs : casadi.Function
        (x, u, p) -> y (nr): what the cost tracks.
    dynamics : casadi.Function
        (x, u, p) -> xd (nd): time derivative of the continuous states, the first ``nd``.
    rows : casadi.Function
        (x, u, p) -> c (nc).
    stages, substeps : int
        N, and steps per stage.
    method : str
        Name in ``CONTROL_METHODS``.
    stage : float
        Length of a stage h [s].
    nd, ns, nt : int
        Continuous states; rows of the state alone; outputs of the state alone, which the last node has too.
    x_names, u_names, p_names, r_names, c_names : tuple of str
        Name and unit of each entry; rows are shares of their bounds' scale.
    u_min, u_max, c_min, c_max, linear, quadratic, weights, terminal_weights, p_nominal : ndarray
        Nominal values, which may be changed at run time; +-1e30 is no bound.
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

    def __repr__(self) -> str:
        return (
            f"Stages({self.stages} of {self.stage:g} s, {self.substeps} {self.method} steps each: {self.nx} states, "
            f"{self.nu} inputs, {self.np} parameters, {self.nr} set-points, {self.nc} rows)"
        )

    @property
    def nx(self) -> int:
        """Number of states."""
        return len(self.x_names)

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return len(self.u_names)

    @property
    def np(self) -> int:
        """Number of parameters."""
        return len(self.p_names)

    @property
    def nr(self) -> int:
        """Number of set-points of a node."""
        return len(self.r_names)

    @property
    def nc(self) -> int:
        """Number of rows of a node."""
        return len(self.c_names)
