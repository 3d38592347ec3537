"""IPOPT on a grasp problem: one solver for all scenes of a structure, many starts, a common budget."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp import interrupt
from continuum_grasp.grasp.budget import Budget
from continuum_grasp.grasp.problem.blocks import Violation
from continuum_grasp.grasp.problem.points import PointReader, starting_point
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, Relaxation
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.surroundings import Sight, Surroundings
from continuum_grasp.grasp.problem.values import Units, contact_features, problem_bounds, problem_values
from continuum_grasp.grasp.starts.starts import Start
from continuum_grasp.model.surfaces.surface import Feature
from continuum_grasp.scene.grasp import GraspScene

__all__ = ["Attempt", "GraspSolverRun", "solver_for"]

Array = NDArray[Any]

CONSTRAINT_TOLERANCE = 1e-7
"""Scaled violation below which a constraint counts as satisfied when violations are listed."""
EFFORT_WHEN_RELAXED = 1e-4
"""Weight of what is sought beside the amount of a relaxed limit."""
ROUNDS = 8
"""How often the places that must stay clear are moved to where fingers are deepest."""
DEEP = 2e-5
"""Penetration above which that is done again (problem's units)."""

_DONE = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
_PUSHES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")


@dataclass(frozen=True)
class Attempt:
    """What one start of the solver gave.

    Attributes
    ----------
    start : Start
    features : dict of str to Feature
        Where each contact sits.
    outcome : str
        The solver's own return status.
    iterations : int
    seconds : float
    x : ndarray
        Unknowns where it stopped.
    numbers : ndarray
        Run-time numbers of the problem there.
    objective : float
    multipliers : ndarray
        Of the constraints.
    violations : list of Violation
        Constraints that are broken there, worst first.
    """

    start: Start
    features: dict[str, Feature]
    outcome: str
    iterations: int
    seconds: float
    x: Array
    numbers: Array
    objective: float
    multipliers: Array
    violations: list[Violation]

    @property
    def converged(self) -> bool:
        """Whether the solver reports a local optimum to its full tolerance."""
        return self.outcome == "Solve_Succeeded"

    @property
    def infeasible(self) -> bool:
        """Whether the solver reports that it converged to a point of local infeasibility."""
        return self.outcome == "Infeasible_Problem_Detected"

    @property
    def badness(self) -> float:
        """Greatest scaled violation."""
        return self.violations[0].scaled if self.violations else 0.0


class _Stop(ca.Callback):
    """Stops the solver once its iterations are used up, Ctrl-C was pressed, or the time limit is reached."""

    def __init__(self, unknowns: int, constraints: int, numbers: int) -> None:
        ca.Callback.__init__(self)
        self._sizes = {
            "x": unknowns,
            "g": constraints,
            "lam_x": unknowns,
            "lam_g": constraints,
            "lam_p": numbers,
        }
        self.budget = Budget(0, float("inf"))
        self.left = 0
        self.construct("stop", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return str(ca.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes.get(ca.nlpsol_out(i), 1), 1)

    def eval(self, _: Any) -> list[int]:
        self.left -= 1
        return [int(interrupt.pressed() or self.left < 0 or self.budget.late)]


class GraspSolverRun:
    """IPOPT prepared for all scenes of one structure.

    Parameters
    ----------
    spec : ProblemSpec

    Attributes
    ----------
    problem : GraspProblem
    reader : PointReader
    build_seconds : float
    """

    def __init__(self, spec: ProblemSpec) -> None:
        began = time.perf_counter()
        self.problem = GraspProblem(spec)
        self.reader = PointReader(self.problem)
        self._near = Surroundings(self.problem)
        self._solvers: dict[tuple[Any, ...], tuple[ca.Function, ca.Function, _Stop]] = {}
        self.build_seconds = time.perf_counter() - began

    def prepare(self, scene: GraspScene) -> None:
        """Build IPOPT for the options of a scene, unless that was done."""
        self._solver(scene)

    def _solver(self, scene: GraspScene) -> tuple[ca.Function, ca.Function, _Stop]:
        """IPOPT for a start, for a point next to the answer, and what stops both."""
        wanted, parts = scene.solver, self.problem.parts
        key = (wanted.tolerance, wanted.max_iterations)
        if key not in self._solvers:
            began = time.perf_counter()
            x, g, p = parts.x, parts.g, self.problem.numbers.symbol
            stop = _Stop(x.numel(), g.numel(), p.numel())
            options: dict[str, Any] = {
                "print_time": False,
                "error_on_fail": False,
                "calc_lam_p": False,
                "iteration_callback": stop,
                "ipopt.print_level": 0,
                "ipopt.sb": "yes",
                "ipopt.mu_strategy": "monotone",
                "ipopt.mu_init": 1e-2,
                "ipopt.mu_linear_decrease_factor": 0.1,
                "ipopt.mu_superlinear_decrease_power": 1.7,
                "ipopt.tol": wanted.tolerance,
                "ipopt.constr_viol_tol": min(1e-9, wanted.tolerance),
                "ipopt.acceptable_tol": 100 * wanted.tolerance,
                "ipopt.bound_relax_factor": 0.0,
                "ipopt.max_iter": wanted.max_iterations,
            }
            nlp = {"x": x, "f": self.problem.objective, "g": g, "p": p}
            cold = ca.nlpsol("grasp", "ipopt", nlp, options)
            derivatives = {name: cold.get_function(f"nlp_{name}") for name in ("grad_f", "jac_g", "hess_l")}
            options |= {
                "grad_f": derivatives["grad_f"],
                "jac_g": derivatives["jac_g"],
                "hess_lag": derivatives["hess_l"],
            }
            near = {"ipopt.warm_start_init_point": "yes", "ipopt.mu_init": 1e-4}
            near |= {f"ipopt.warm_start_{name}": 1e-5 for name in _PUSHES}
            again = ca.nlpsol("grasp_again", "ipopt", nlp, options | near)
            self._solvers[key] = cold, again, stop
            self.build_seconds += time.perf_counter() - began
        return self._solvers[key]

    def run(
        self,
        scene: GraspScene,
        start: Start,
        budget: Budget,
        *,
        iterations: int | None = None,
        relaxed: Mapping[str, float] | None = None,
        given: Mapping[str, float] | None = None,
        features: dict[str, Feature] | None = None,
        x0: Array | None = None,
    ) -> Attempt:
        """Solve from a start, moving the guarded places to where fingers are deepest.

        Parameters
        ----------
        scene : GraspScene
        start : Start
        budget : Budget
            What this takes is taken from it.
        iterations : int, optional
            Most iterations of all solver runs together; all that the budget has by default.
        relaxed : mapping, optional
            Names of limits that may be relaxed and by how much at most (SI); the amount is minimized then.
        given : mapping, optional
            Amounts to begin with (SI).
        features : dict, optional
            Where the contacts sit; by default where the start has them.
        x0 : ndarray, optional
            Unknowns to begin with; by default those of the start.

        Raises
        ------
        KeyboardInterrupt
            Ctrl-C was pressed meanwhile; this start has no result then.
        """
        problem, units = self.problem, Units.of(scene)
        features = features or contact_features(scene, start.contacts)
        values = problem_values(problem, scene, start, features)
        low, high = problem_bounds(problem, scene, features)
        x = starting_point(problem, scene, start, features) if x0 is None else x0
        if relaxed:
            values["effort weight"] = EFFORT_WHEN_RELAXED
            self._relax(values, low, high, x, relaxed, given or {}, units)
        x = np.clip(x, low, high)
        cold, again, stop = self._solver(scene)
        granted = min(iterations or budget.left, budget.left)
        stop.budget, stop.left = budget, granted
        g_low, g_high = problem.parts.g_bounds
        bounds = {"lbx": low, "ubx": high, "lbg": g_low, "ubg": g_high}
        began, taken, outcome = time.perf_counter(), 0, ""
        sight = self._near.look(scene, x, problem.numbers.pack(values, 0.0))
        multipliers: dict[str, Any] = {}
        acceptable = False
        for _ in range(ROUNDS):
            numbers = problem.numbers.pack({**values, **sight.numbers})
            self._face(x, sight)
            for solver, duals in ((again, multipliers), (cold, {})) if multipliers else ((cold, {}),):
                with interrupt.held():
                    found = solver(x0=x, p=numbers, **bounds, **duals)
                stats = solver.stats()
                outcome, taken = str(stats["return_status"]), taken + int(stats["iter_count"])
                if outcome in _DONE:
                    break
            x, g = np.array(found["x"]).ravel(), np.array(found["g"]).ravel()
            if outcome not in _DONE or not np.isfinite(x).all():
                break
            sight = self._near.look(scene, x, numbers)
            multipliers = {"lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
            settled = outcome == "Solve_Succeeded" or acceptable
            acceptable = outcome != "Solve_Succeeded"
            if sight.deepest < DEEP and settled:
                break
        budget.left -= granted - max(stop.left, 0)
        return Attempt(
            start,
            features,
            outcome,
            taken,
            time.perf_counter() - began,
            x,
            numbers,
            float(found["f"]),
            np.array(found["lam_g"]).ravel(),
            problem.parts.violations(g, CONSTRAINT_TOLERANCE, units.amounts),
        )

    def given(self, scene: GraspScene, x: Array, relaxation: Relaxation) -> float:
        """By how much a limit is relaxed at a point (SI, or as a part of the limit)."""
        variable = self.problem.parts.variables[f"relaxed {relaxation.name}"]
        amount = float(np.linalg.norm(x[variable.start : variable.stop]))
        return amount * _amount_unit(relaxation, Units.of(scene))

    @cached_property
    def slope(self) -> ca.Function:
        """Derivative of the Lagrangian by the problem's numbers, from unknowns, numbers and multipliers."""
        parts, numbers = self.problem.parts, self.problem.numbers.symbol
        force = ca.SX.sym("force", parts.g.numel())
        lagrangian = self.problem.objective + ca.dot(force, parts.g)
        return ca.Function("slope", [parts.x, numbers, force], [ca.gradient(lagrangian, numbers)])

    def _face(self, x: Array, sight: Sight) -> None:
        """Turn the separating directions among the unknowns to where obstacles are nearest."""
        for name, values in sight.directions.items():
            variable = self.problem.parts.variables.get(name)
            if variable is not None:
                x[variable.start : variable.stop] = values

    def _relax(
        self,
        values: dict[str, Any],
        low: Array,
        high: Array,
        x: Array,
        relaxed: Mapping[str, float],
        given: Mapping[str, float],
        units: Units,
    ) -> None:
        weights = np.zeros(len(RELAXATIONS))
        for k, relaxation in enumerate(RELAXATIONS):
            if relaxation.name in relaxed:
                variable = self.problem.parts.variables[f"relaxed {relaxation.name}"]
                scale = _amount_unit(relaxation, units)
                at = slice(variable.start, variable.stop)
                high[at] = relaxed[relaxation.name] / scale
                if relaxation.size > 1:
                    low[at] = -high[at]
                x[at] = given.get(relaxation.name, 0.0) / scale
                weights[k] = 1.0
        values["relaxation weights"] = weights


def _amount_unit(relaxation: Relaxation, units: Units) -> float:
    return units.amounts.get(relaxation.unit, 1.0) if relaxation.additive else 1.0


@lru_cache(maxsize=24)
def solver_for(spec: ProblemSpec) -> GraspSolverRun:
    """The solver of a structure; built once in a process."""
    return GraspSolverRun(spec)
