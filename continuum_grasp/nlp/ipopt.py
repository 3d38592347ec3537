"""IPOPT, an interior-point method with a filter line search.

A. Waechter, L. T. Biegler, Math. Program. 106 (2006), doi:10.1007/s10107-004-0559-y.
"""

from __future__ import annotations

from typing import Any

from continuum_grasp.nlp.attempt import Approach, OptionSet
from continuum_grasp.nlp.problem import NLP
from continuum_grasp.nlp.solver import Solver

_PUSHES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")
_NEAR = 1e-4
"""Barrier parameter, and distance from bounds, of a start next to a solution [units of the problem]: IPOPT's defaults,
0.1 and 0.01, would leave it for the middle of the feasible set."""


_REFINED = {"mu_init": 1e-3, "bound_mult_init_method": "mu-based", **dict.fromkeys(_PUSHES[:4], 1e-3)}
"""Options for starts within 1e-3 of a solution: no farther from it than they are."""
_SETS: dict[OptionSet, dict[str, Any]] = {
    "default": {},
    # From refined starts of 73 grasps: 72 verified after a median of 7 iterations; monotone 71 after 13; the defaults
    # of grasps, monotone from 1e-2, 68 after 15.
    "refined": {"mu_strategy": "adaptive", **_REFINED},
    "refined_monotone": {"mu_strategy": "monotone", **_REFINED},
}
"""Options of a cold start, beyond the settings' options."""


class Ipopt(Solver):
    """Options of IPOPT; ``tuning`` may set any of them, and ``near`` instead of 1e-4."""

    plugin = "ipopt"

    def options(self, problem: NLP, approach: Approach) -> dict[str, Any]:
        """See `Solver`."""
        settings = self.settings
        tuning = dict(self.settings.tuning.get("ipopt", {}))
        near = tuning.pop("near", _NEAR)
        options = {
            "print_level": 0,
            "sb": "yes",  # no banner
            "tol": settings.tolerance,
            "constr_viol_tol": settings.constraint_tolerance,
            "acceptable_tol": 100.0 * settings.tolerance,
            "max_iter": settings.max_iterations,
            **tuning,
        }
        if approach.warm:
            # The first barrier parameter counts for the monotone strategy alone.
            options |= {"warm_start_init_point": "yes", "mu_strategy": "monotone", "mu_init": near}
            options |= {f"warm_start_{name}": near for name in _PUSHES}
        elif approach.barrier is not None:
            options |= {"mu_strategy": "monotone", "mu_init": approach.barrier}
            # 1e-6: distance from bounds of a start that is worth staying near [units of the problem]
            options |= dict.fromkeys(_PUSHES[:4], 1e-6)
        else:
            options |= _SETS[approach.option_set]
        return {**{f"ipopt.{name}": value for name, value in options.items()}, **problem.functions}
