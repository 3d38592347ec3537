"""One grasp for several errors at once: the nominal problem and, beside it, one problem for each error.

Every error has unknowns of its own, posture, places and forces, and all limits of a grasp; its friction cones are those
of its scene, without reserve. Shared are the tensions, the bases and, where it is sought, the object's pose. With
x the unknowns of the nominal grasp and x_k, e_k those of error k and the error itself:

    minimize  objective(x)   subject to   limits(x),  limits(x_k),  link(x, x_k, e_k) = 0 for all k

``link`` is linear in x_k, so that the Hessian of the Lagrangian has one block for x and one for each x_k.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp import nlp
from continuum_grasp.grasp.problem.blocks import rotation
from continuum_grasp.grasp.problem.equations import expressions
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.solver_run import GraspSolverRun

Array = NDArray[Any]


class _Link:
    """The functions of what an error's problem shares with the nominal one."""

    def __init__(self, nominal: GraspProblem, other: GraspProblem, left: tuple[int, ...]) -> None:
        error = ca.SX.sym("error", 3)
        args = [nominal.x.symbol, nominal.numbers.symbol, other.x.symbol, error]
        rows = link(nominal, other, error, left)
        force = ca.SX.sym("force", rows.numel())
        self.size = int(rows.numel())
        self.values = ca.Function("link", args, [rows])
        bend = ca.triu(ca.hessian(ca.dot(force, rows), args[0])[0])
        self.bends = ca.Function("bends", [*args[:2], error, force], [bend])


def link(nominal: GraspProblem, other: GraspProblem, error: ca.SX, left: tuple[int, ...]) -> ca.SX:
    """What an error's problem shares with the nominal one; ``error`` (3,) is by how much its object's pose is off where
    it lies, in units of the problem, and ``left`` are the coordinates that the supports leave.
    """
    rows = []
    for mine, its in zip(nominal.fingers, other.fingers, strict=True):
        rows.append(its.held - mine.held)
        if mine.spec.free:
            rows.append(its.base - mine.base)
    if nominal.spec.free and not other.spec.landed:
        rows += [other.pose[k] - nominal.pose[k] - error[k] for k in left]
    on = {contact.spec.name for contact in other.contacts}
    for contact in nominal.contacts:
        if contact.spec.name in on and other.spec.lands(contact.spec):
            shifted = contact.local.point - rotation(-nominal.pose[2]) @ error[:2]
            rows.append(other.x(f"landing, {contact.spec.name}", 2) - rotation(-error[2]) @ shifted)
    return ca.vertcat(*rows)


class RobustProblem:
    """The problem of a grasp and those of errors, whose postures may have other contacts.

    Attributes
    ----------
    nlp : continuum_grasp.nlp.NLP
        Its unknowns are those of the nominal problem and of each error, one below the other; its parameters their
        numbers likewise, and the errors (3,) of the pose.
    """

    def __init__(self, nominal: GraspSolverRun, others: tuple[GraspSolverRun, ...], left: tuple[int, ...]) -> None:
        self._parts = parts = [nominal, *others]
        count, numbers = len(others), [part.problem.numbers.size for part in parts]
        self.sizes = [part.problem.x.size for part in parts]
        x = ca.MX.sym("x", sum(self.sizes))
        p = ca.MX.sym("p", sum(numbers) + 3 * count)
        xs = ca.vertsplit(x, _starts(self.sizes))
        ps = ca.vertsplit(p, _starts([*numbers, *[3] * count]))
        ps, errors = ps[: count + 1], ps[count + 1 :]
        mine = expressions(nominal.problem.spec)
        made = {other: _Link(mine, expressions(other.problem.spec), left) for other in dict.fromkeys(others)}
        links = [made[other] for other in others]
        self.links = [each.size for each in links]

        values = [part.nlp.values(a, b) for part, a, b in zip(parts, xs, ps, strict=True)]
        linked = [each.values(xs[0], ps[0], a, e) for each, a, e in zip(links, xs[1:], errors, strict=True)]
        f = sum(value[0] for value in values)
        g = ca.vertcat(*(value[1] for value in values), *linked)

        # Of the parts, which may be compiled functions, and whose blocks CasADi would not see as soon.
        slopes = [part.nlp.functions["grad_f"](a, b)[1] for part, a, b in zip(parts, xs, ps, strict=True)]
        gradient = ca.Function("nlp_grad_f", [x, p], [f, ca.vertcat(*slopes)], ["x", "p"], ["f", "grad_f_x"])
        own = [part.nlp.functions["jac_g"](a, b)[1] for part, a, b in zip(parts, xs, ps, strict=True)]
        rows = ca.vertcat(ca.diagcat(*own), ca.jacobian(ca.vertcat(*linked), x))
        jacobian = ca.Function("nlp_jac_g", [x, p], [g, rows], ["x", "p"], ["g", "jac_g_x"])
        weight, forces = ca.MX.sym("weight"), ca.MX.sym("forces", g.numel())
        shares = ca.vertsplit(forces, _starts([*(part.problem.rows.count for part in parts), *self.links]))
        blocks = [
            part.nlp.functions["hess_lag"](a, b, weight, own)
            for part, a, b, own in zip(parts, xs, ps, shares, strict=False)
        ]
        own_forces = zip(links, errors, shares[count + 1 :], strict=True)
        blocks[0] += sum(each.bends(xs[0], ps[0], e, own) for each, e, own in own_forces)
        names = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
        hessian = ca.Function("nlp_hess_l", [x, p, weight, forces], [ca.triu(ca.diagcat(*blocks))], *names)
        along = [part.nlp.slope(a, b, weight, own) for part, a, b, own in zip(parts, xs, ps, shares, strict=False)]
        pull = ca.gradient(ca.dot(ca.vertcat(*shares[count + 1 :]), ca.vertcat(*linked)), p)
        by_numbers = ca.vertcat(*along, ca.MX.zeros(3 * count)) + pull
        slope = ca.Function("nlp_slope", [x, p, weight, forces], [by_numbers], names[0], ["grad_gamma_p"])
        derivatives = {"grad_f": gradient, "jac_g": jacobian, "hess_lag": hessian, "slope": slope}
        self.nlp = nlp.NLP("robust_grasp", x, f, g, p, derivatives=derivatives)

    def bounds(self) -> tuple[Array, Array]:
        """Bounds of all rows."""
        sets = [part.row_bounds for part in self._parts]
        sets.append((np.zeros(sum(self.links)), np.zeros(sum(self.links))))
        lower, upper = (np.concatenate(side) for side in zip(*sets, strict=True))
        return lower, upper

    def split(self, x: Array) -> list[Array]:
        """The unknowns of the nominal problem, and of each error."""
        return np.split(x, np.cumsum(self.sizes)[:-1])


def _starts(sizes: Sequence[int]) -> list[int]:
    return [0, *np.cumsum(sizes).tolist()]


@lru_cache(maxsize=8)
def robust_problem(nominal: GraspSolverRun, others: tuple[GraspSolverRun, ...], left: tuple[int, ...]) -> RobustProblem:
    """The problem of a grasp and those of some errors; built once in a process."""
    return RobustProblem(nominal, others, left)
