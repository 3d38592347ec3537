"""Sequential quadratic programming with a line search: CasADi's ``sqpmethod``, its QPs by PIQP.

J. Nocedal, S. J. Wright, Numerical Optimization, chapter 18, doi:10.1007/978-0-387-40065-5; PIQP: R. Schwan et al.,
doi:10.48550/arXiv.2304.00290. Of CasADi's QP solvers, PIQP alone solved configs/plan/tip_to_point.yaml
(7 iterations): qrqp and OSQP had not ended after a minute, with DAQP the line search ended after one step.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from continuum_grasp.nlp.attempt import Approach
from continuum_grasp.nlp.problem import NLP
from continuum_grasp.nlp.solver import Solver


class Sqp(Solver):
    """Options of ``sqpmethod``; ``tuning`` may set any of them.

    QPs must be convex: damped BFGS updates replace a Hessian that is not positive semidefinite. Shifting its
    eigenvalues to positive ones (``convexify_strategy``) took 200 iterations on configs/grasp/mug.yaml instead of 13.
    The solver checks the budget and Ctrl-C before each QP. It has no barrier parameter and one set of options, and an
    infeasible problem ends as ``failed``.
    """

    plugin = "sqpmethod"

    def options(self, problem: NLP, approach: Approach) -> dict[str, Any]:
        """See `Solver`."""
        settings = self.settings
        return {
            "qpsol": settings.qp_plugin(),
            "qpsol_options": {"error_on_fail": False},
            "print_header": False,
            "print_iteration": False,
            "print_status": False,
            "tol_pr": settings.constraint_tolerance,
            "tol_du": settings.tolerance,
            "max_iter": settings.max_iterations,
            **_derivatives(problem),
            **settings.tuning.get("sqp", {}),
        }

    def statistics(self, function: ca.Function) -> dict[str, Any]:
        """See `Solver`."""
        try:
            return super().statistics(function)
        except RuntimeError:  # a QP without a solution leaves no return status behind, which CasADi trips over
            return {"return_status": "QP_Failed"}


def _derivatives(problem: NLP) -> dict[str, Any]:
    """The problem's derivatives in the form of this plugin: f and g together, and both triangles of the Hessian."""
    n, m, np = (int(part.numel()) for part in (problem.x, problem.g, problem.p))
    x, p, lam_f, lam_g = (ca.MX.sym(name, size) for name, size in (("x", n), ("p", np), ("lam_f", 1), ("lam_g", m)))
    functions = problem.functions
    values = [*functions["grad_f"](x, p), *functions["jac_g"](x, p)]
    slopes = ca.Function("nlp_jac_fg", [x, p], values, ["x", "p"], ["f", "grad_f_x", "g", "jac_g_x"])
    if not problem.semidefinite:
        return {"jac_fg": slopes, "hessian_approximation": "limited-memory"}
    symbols = [x, p, lam_f, lam_g]
    names = ["x", "p", "lam_f", "lam_g"]
    hessian = ca.triu2symm(functions["hess_lag"](*symbols))
    return {"jac_fg": slopes, "hess_lag": ca.Function("nlp_hess_l", symbols, [hessian], names, ["hess_gamma_x_x"])}
