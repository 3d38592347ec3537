"""Solver runs on a grasp problem: one solver for all scenes of a structure, many starts, a common budget."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp import nlp
from continuum_grasp.grasp.problem.points import PointReader, starting_point
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, Relaxation
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.surroundings import Sight, Surroundings
from continuum_grasp.grasp.problem.values import Units, contact_features, problem_bounds, problem_values
from continuum_grasp.grasp.starts.values import Start
from continuum_grasp.model.surfaces.surface import Feature
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import GraspSolver

Array = NDArray[Any]

CONSTRAINT_TOLERANCE = 1e-7
"""Scaled violation below which a constraint counts as satisfied when violations are listed."""
EFFORT_WHEN_RELAXED = 1e-4
"""Weight of what is sought beside the amount of a relaxed limit."""
ROUNDS = 8
"""How often the places that must stay clear are moved to where fingers are deepest."""
DEEP = 2e-5
"""Penetration above which that is done again (problem's units)."""


@dataclass(frozen=True, eq=False)
class Attempt(nlp.Attempt):
    """What one start of the solver gave; iterations and seconds are those of all its runs.

    Attributes
    ----------
    start : Start
    features : dict of str to Feature
        Where each contact sits.
    numbers : ndarray
        Run-time numbers of the problem there.
    violations : list of Violation
        Constraints that are violated there, worst first.
    """

    start: Start
    features: dict[str, Feature]
    numbers: Array
    violations: list[nlp.Violation]

    @property
    def optimal(self) -> bool:
        """Whether it is a local optimum to the full tolerance."""
        return self.status is nlp.Status.SOLVED

    @property
    def badness(self) -> float:
        """Greatest scaled violation."""
        return self.violations[0].scaled if self.violations else 0.0


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
        parts, numbers = self.problem.parts, self.problem.numbers.symbol
        self.nlp = nlp.NLP("grasp", parts.x, self.problem.objective, parts.g, numbers)
        self._solvers: dict[tuple[Any, ...], nlp.Solver] = {}
        self.build_seconds = time.perf_counter() - began

    def prepare(self, scene: GraspScene) -> nlp.Solver:
        """The solver for the options of a scene; built once."""
        options = scene.solver
        key = (options.method, options.tolerance, options.max_iterations)
        if key not in self._solvers:
            began = time.perf_counter()
            self._solvers[key] = nlp.new_solver(_settings(options))
            self._solvers[key].prepare(self.nlp)
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
        self.prepare(scene)
        began = time.perf_counter()
        known = nlp.Start(np.clip(x, low, high), low, high, *problem.parts.bounds())
        with budget.share(iterations) as part:
            attempts, numbers = self._rounds(scene, known, values, part)
        last = attempts[-1]
        return Attempt(
            last.status,
            last.outcome,
            last.x,
            last.g,
            last.objective,
            last.multipliers,
            sum(a.iterations for a in attempts),
            time.perf_counter() - began,
            last.violation,
            start,
            features,
            numbers,
            problem.parts.violations(last.g, CONSTRAINT_TOLERANCE, units.amounts),
        )

    def _rounds(
        self, scene: GraspScene, known: nlp.Start, values: dict[str, Any], part: Budget
    ) -> tuple[list[nlp.Attempt], Array]:
        """Solve until no finger is deep between the places that must stay clear; all runs, and the last numbers."""
        method, pack = self.prepare(scene), self.problem.numbers.pack
        attempts: list[nlp.Attempt] = []
        acceptable = False
        sight = self._near.look(scene, known.x, pack(values, 0.0))
        for _ in range(ROUNDS):
            numbers = pack({**values, **sight.numbers})
            self._face(known.x, sight)
            known = replace(known, p=numbers)
            attempts.append(method.solve(self.nlp, known, part))
            if known.multipliers is not None and not attempts[-1].converged:
                attempts.append(method.solve(self.nlp, replace(known, multipliers=None), part))
            last = attempts[-1]
            if not last.converged or not np.isfinite(last.x).all():
                break
            sight = self._near.look(scene, last.x, numbers)
            # A solution to the acceptable tolerance gets one more round from its own multipliers.
            settled = last.status is nlp.Status.SOLVED or acceptable
            acceptable = last.status is nlp.Status.ACCEPTABLE
            if sight.deepest < DEEP and settled:
                break
            known = replace(known, x=last.x, multipliers=last.multipliers)
        return attempts, numbers

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


def _settings(options: GraspSolver) -> nlp.Settings:
    """What grasps ask of a solver.

    IPOPT: a small first barrier parameter that falls fast, since starts are good; no bound is relaxed, since contacts
    sit at the ends of faces; next to a solution, contacts stay as near to these ends as they are.
    """
    ipopt = {
        "bound_relax_factor": 0.0,
        "mu_strategy": "monotone",
        "mu_init": 1e-2,
        "mu_linear_decrease_factor": 0.1,
        "mu_superlinear_decrease_power": 1.7,
        "near_push": 1e-5,
    }
    tolerance = options.tolerance
    return nlp.Settings(options.method, tolerance, min(1e-9, tolerance), options.max_iterations, {"ipopt": ipopt})


def _amount_unit(relaxation: Relaxation, units: Units) -> float:
    return units.amounts.get(relaxation.unit, 1.0) if relaxation.additive else 1.0


@lru_cache(maxsize=24)
def solver_for(spec: ProblemSpec) -> GraspSolverRun:
    """The solver of a structure; built once in a process."""
    return GraspSolverRun(spec)
