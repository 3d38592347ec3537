"""The best design: a sequential QP method on grasps that are followed, and full searches between.

1. Search trial designs in full: the start, and points of a Halton sequence; go on from the best.
2. Descend by SLSQP in a box around it. Its grasps are followed from design to design; of several costs the greatest is
   minimized, as a bound of all. Where a step loses a grasp, the box shrinks, and this begins anew.
3. Search in full at the best design: where other grasps are better there, take these, and go on with 2.
4. With tolerances, find the errors of manufacture that are worst there; one that is new joins the costs, and 2 follows.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import Bounds, minimize
from scipy.stats.qmc import Halton

from continuum_grasp import interrupt
from continuum_grasp.arguments import check_arguments
from continuum_grasp.arrays import Array
from continuum_grasp.design.evaluation import DesignProblem, Evaluation, Signs
from continuum_grasp.design.grasps import LostGrasp
from continuum_grasp.design.result import DesignResult, Status, WorstCase
from continuum_grasp.errors import SolverError
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.values import SAME
from continuum_grasp.scene.assembly import Overrides
from continuum_grasp.scene.design import Design
from continuum_grasp.scene.design_space import DesignSpace, design_space_of
from continuum_grasp.scene.load import placed_scene_of

HOLDS = 1e-6
"""Violation up to which a limit holds, as a part of it."""


def worst_cases(problem: DesignProblem, best: Evaluation) -> tuple[WorstCase, ...]:
    """Cost and limits at the worst combinations of errors: to first order, and as they are at the corners; none without
    tolerances. The grasps of the problem are those of the last corner then.
    """
    space = problem.space
    if not space.tolerated:
        return ()
    n = len(space.coordinates)
    nominal = [row for row in best.costs if not any(row.signs)]
    bound = max(row.value + float(np.abs(row.slope[n:]).sum()) for row in nominal)
    scenarios = problem.scenarios
    cases: list[WorstCase] = []
    for signs in _corners(problem, best):
        problem.scenarios = [signs]
        try:
            there = problem.evaluate(best.coordinates)
        except LostGrasp as error:
            cases.append(WorstCase(signs, np.inf, np.inf, bound, str(error)))
            continue
        cases.append(WorstCase(signs, there.cost, there.violation, bound, ""))
    problem.scenarios = scenarios
    return tuple(sorted(cases, key=lambda case: (-case.violation if case.violation > HOLDS else 0.0, -case.cost)))


def _corners(problem: DesignProblem, best: Evaluation) -> list[Signs]:
    """Combinations of greatest errors: all of them where these are few, else those that first order calls worst."""
    m, n = len(problem.space.tolerated), len(problem.space.coordinates)
    # 6: tolerated numbers up to which all combinations of their greatest errors are tried: 64
    if m <= 6:
        return [tuple(signs) for signs in product((-1.0, 1.0), repeat=m)]
    rows = [*(row.slope[n:] for row in best.costs), *(-row.slope[n:] for row in best.limits)]
    return list(dict.fromkeys(tuple(np.where(slope >= 0.0, 1.0, -1.0).tolist()) for slope in rows))


def worse_than_known(worst: Sequence[WorstCase], known: Sequence[Signs], best: Evaluation, same: float) -> list[Signs]:
    """The combination of errors with the greatest cost and that with the greatest violation, each where it is worse
    than the best design with those that are ``known``; costs closer than ``same`` are equal.
    """
    bad = [case for case in worst if case.signs not in known and np.isfinite(case.cost)]
    if not bad:
        return []
    costly, broken = max(bad, key=lambda case: case.cost), max(bad, key=lambda case: case.violation)
    change = max(abs(case.cost - best.cost) for case in bad)
    # 0.02: cost by which a combination of errors must exceed those at hand to count, as a part of what errors change
    add = [costly.signs] if costly.cost > best.cost + max(0.02 * change, same) else []
    return [*add, broken.signs] if broken.violation > max(best.violation, 0.0) + HOLDS else add


Acting = tuple[tuple[float, ...], ...]

_LOST = 1e2
"""Cost of a design without a grasp, in units of the first one: any other is better."""


@dataclass
class _Trace:
    """Trials, in order."""

    coordinates: list[Array] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    violations: list[float] = field(default_factory=list)
    rounds: list[int] = field(default_factory=list)
    switches: list[str] = field(default_factory=list)
    acting: dict[str, set[Acting]] = field(default_factory=dict)
    """Per case, the sets of errors that decided it at one design or another."""


@interrupt.computing()
@check_arguments
def optimize_design(
    design: Design | str | os.PathLike[str] | Mapping[str, Any],
    *,
    progress: Callable[[float, str], None] | None = None,
    raise_on_failure: bool = True,
    overrides: Overrides = (),
) -> DesignResult:
    """Choose numbers of a grasp scene so that the grasps of one or many objects are best.

    Costs and limits are differentiated through the optimal grasps: by the envelope theorem where they are optimal
    values, else by the sensitivities of the optimality conditions. A sequential QP method (SLSQP of SciPy) improves the
    design with grasps that are followed from one design to the next; full searches before and after find the branch of
    grasps that is best there.

    Parameters
    ----------
    design : Design, path-like or mapping
        A design, its YAML file, or the same as a mapping; paths in a mapping are relative to the working directory.
    progress : callable, optional
        Called with the share that is done and what is being done.
    raise_on_failure : bool, optional
        Raise where no design has all grasps; False: return the result with its ``status``.
    overrides : iterable of str, or mapping, optional
        Changes to the configuration, as in `load`.

    Returns
    -------
    DesignResult
        Values of the variables, cost, quantities of every case, sensitivities, and the grasps.

    Raises
    ------
    InputError
        The configuration is wrong.
    SolverError
        No design was found whose grasps satisfy all limits; ``result`` of the error holds the closest.

    Examples
    --------
    How far the tendons should lie from the backbone, where every millimeter costs:

    >>> import continuum_grasp as cg
    >>> found = cg.optimize_design(
    ...     {
    ...         "scene": "configs/grasp/mug_arcs.yaml",
    ...         "variables": {"finger.tendons.offset": {"min": 0.003, "max": 0.006, "name": "e"}},  # m
    ...         "minimize": "tension + 1e6 * e**2",
    ...         "solver": {"starts": 1},
    ...     }
    ... )
    >>> round(found.values["finger.tendons.offset"], 5), found.status.value  # m
    (0.00465, 'optimal')
    """
    space = design_space_of(*placed_scene_of(design, Design, overrides))
    search = _DesignSearch(space, progress or (lambda share, text: None))
    result = search.result()
    if raise_on_failure and not result.solved:
        raise SolverError(result.message, status=result.status.value, result=result)
    return result


class _DesignSearch:
    """A search: trial designs, then rounds of improvement and full search."""

    def __init__(self, space: DesignSpace, progress: Callable[[float, str], None]) -> None:
        self.space, self.options = space, space.design.solver
        self.problem = DesignProblem(space)
        self.progress = progress
        self.trace = _Trace()
        self.began = time.monotonic()
        self.best: Evaluation | None = None
        self._first: Evaluation | None = None
        self._before: dict[str, GraspResult] = {}
        self._scale, self._grasps, self._why = 1.0, self.problem.snapshot(), ""
        self._round, self._converged, self._ended = 0, True, ""

    def result(self) -> DesignResult:
        """Search, and judge what was found."""
        first = self._start()
        if first is None:
            return self._result(None, Status.NO_GRASP, f"no grasp at any of the designs tried: {self._why}", ())
        self._take(first)
        settled = False
        worst: tuple[WorstCase, ...] = ()
        for number in range(self.options.max_rounds):
            self._improve(number)
            settled = not self._switched()
            if settled:
                worst = self._worst_cases()
                settled = not self._missed(worst)
            if settled:
                break
        best = self._best
        if best.violation > HOLDS:
            row = min(best.limits, key=lambda limit: limit.value)
            message = f"no design satisfies {row.name} ({row.case}): off by {best.violation:.3g} of it at the closest"
            return self._result(best, Status.LIMITS_VIOLATED, message, worst)
        status = Status.OPTIMAL if settled and self._converged else Status.FEASIBLE
        before = best if self._first is None else self._first
        message = f"cost {best.cost:.6g}, from {before.cost:.6g} at the start"
        # 0.02: slope that is left at an optimum over the range of a variable, as a part of the cost
        if status is Status.OPTIMAL and best.left > 0.02 * self._scale:
            # As at a kink, beside which other grasps are best.
            status, self._ended = Status.FEASIBLE, f"with a slope of {best.left:.3g} over the range of a variable"
        if status is Status.FEASIBLE:
            message += f"; the search ended before it settled ({self._ended})"
        return self._result(best, status, message, worst)

    @property
    def _best(self) -> Evaluation:
        if self.best is None:
            raise LostGrasp("no design has been tried")
        return self.best

    # -- trial designs

    def _start(self) -> Evaluation | None:
        """The best of the trial designs, each searched in full."""
        start = np.array([coordinate.coordinate(coordinate.start) for coordinate in self.space.coordinates])
        trials, best = [start, *self._others()], None
        grasps = self.problem.snapshot()
        for k, at in enumerate(trials):
            self.progress(0.4 * k / len(trials), f"trial design {k + 1} of {len(trials)}")
            self.problem.forget()
            try:
                evaluation = self._evaluate(at, search=True)
            except LostGrasp as error:
                self._why = self._why or str(error)
                continue
            if self._first is None:
                self._first, self._before = evaluation, self.problem.results
            if best is None or self._better(evaluation, best):
                best, grasps = evaluation, self.problem.snapshot()
        if best is not None:
            self.problem.restore(grasps)
            self._scale = max(abs(best.cost), 1e-9)
        return best

    def _others(self) -> list[Array]:
        count = self.options.starts - 1
        if count < 1:
            return []
        # The first point of the sequence is the corner 0.
        return list(Halton(len(self.space.coordinates), scramble=False).fast_forward(1).random(count))

    def _evaluate(self, at: Array, search: bool = False) -> Evaluation:
        trace = self.trace
        trace.coordinates.append(np.array(at))
        trace.rounds.append(self._round)
        try:
            evaluation = self.problem.evaluate(at, search=search)
        except LostGrasp:
            trace.costs.append(np.nan)
            trace.violations.append(np.nan)
            raise
        for case in evaluation.cases:
            if case.acting and not any(case.signs):
                trace.acting.setdefault(case.case, set()).add(case.acting)
        trace.costs.append(evaluation.cost)
        trace.violations.append(evaluation.violation)
        return evaluation

    def _better(self, candidate: Evaluation, than: Evaluation) -> bool:
        """Whether a design is better: by the violation of limits, then by the cost."""
        if max(candidate.violation, than.violation) > HOLDS:
            return candidate.violation < than.violation
        return candidate.cost < than.cost

    def _take(self, evaluation: Evaluation) -> None:
        self.best, self._grasps = evaluation, self.problem.snapshot()

    # -- improvement

    def _improve(self, number: int) -> None:
        """Improve the best design until it stays; a step that loses the grasp makes the region smaller."""
        self._round, half = number + 1, 1.0
        while self._descend(half):
            # 0.25: part of the box around the best design that is searched next where a step lost the grasp
            half *= 0.25
            # 0.02: half width of that box, in coordinates, below which the search ends
            if half < 0.02:
                self._ended, self._converged = "beside this design grasps are lost", False
                return

    def _descend(self, half: float) -> bool:
        """Run SLSQP once within a box around the best design; whether a grasp was lost."""
        start = self._best
        n = start.coordinates.size
        low, high = np.maximum(start.coordinates - half, 0.0), np.minimum(start.coordinates + half, 1.0)
        epigraph = len(start.costs) > 1
        memo: dict[bytes, Evaluation | None] = {start.coordinates.tobytes(): start}
        lost = False

        def at(z: Array) -> Evaluation | None:
            nonlocal lost
            u = np.clip(z[:n], low, high)
            key = u.tobytes()
            if key not in memo:
                try:
                    memo[key] = evaluation = self._evaluate(u)
                    self.progress(
                        min(0.4 + 0.01 * len(self.trace.costs), 0.95),
                        f"design {len(self.trace.costs)}, cost {evaluation.cost:.6g}",
                    )
                    if self._better(evaluation, self._best):
                        self._take(evaluation)
                except LostGrasp:
                    memo[key], lost = None, True
                    self.problem.restore(self._grasps)
                    # 5: designs without a grasp after which a run of the optimizer ends: each takes a full search
                    if sum(known is None for known in memo.values()) >= 5:
                        raise
            return memo[key]

        def rows(z: Array) -> tuple[Array, Array, Array, Array]:
            """Cost and limits with their slopes; where there are several costs, z has a bound of them behind it."""
            evaluation, count = at(z), len(start.limits) + epigraph * len(start.costs)
            if evaluation is None:
                return np.array([_LOST]), np.zeros((1, n)), np.full(count, -_LOST), np.zeros((count, z.size))
            costs = np.array([row.value for row in evaluation.costs]) / self._scale
            by_cost = np.array([row.slope[:n] for row in evaluation.costs]) / self._scale
            limits = np.array([row.value for row in evaluation.limits])
            by_limits = np.array([row.slope[:n] for row in evaluation.limits]).reshape(-1, n)
            if not epigraph:
                return costs, by_cost, limits, by_limits
            by_bound = np.append(np.ones(len(costs)), np.zeros(len(limits)))
            both = np.column_stack([np.vstack([-by_cost, by_limits]), by_bound])
            return costs, by_cost, np.append(z[n] - costs, limits), both

        def cost(z: Array) -> float:
            return float(z[n] if epigraph else rows(z)[0][0])

        def cost_slope(z: Array) -> Array:
            return np.append(np.zeros(n), 1.0) if epigraph else rows(z)[1][0]

        z0 = np.append(start.coordinates, start.cost / self._scale) if epigraph else start.coordinates
        ends = Bounds(np.append(low, [-np.inf] * epigraph), np.append(high, [np.inf] * epigraph))
        keywords: dict[str, Any] = {}
        if epigraph or start.limits:
            keywords["constraints"] = [{"type": "ineq", "fun": lambda z: rows(z)[2], "jac": lambda z: rows(z)[3]}]
        options = {"maxiter": self.options.max_iterations, "ftol": self.options.tolerance}
        try:
            optimum = minimize(cost, z0, jac=cost_slope, bounds=ends, method="SLSQP", options=options, **keywords)
        except LostGrasp:
            return True
        # 8: no descent along the step any more, which ends a search at a kink or at rounding.
        self._converged = optimum.status in (0, 8)
        self._ended = str(optimum.message)
        self.problem.restore(self._grasps)
        return lost

    # -- what a full search says

    def _switched(self) -> bool:
        """Search in full at the best design; whether other grasps are better there, from which to go on."""
        before, self._round = self._best, self._round
        self.progress(0.95, "full search at the best design")
        after = self._evaluate(before.coordinates, search=True)
        self._take(after)
        gain = before.cost - after.cost
        if gain > SAME * self._scale or after.violation < before.violation - HOLDS:
            name = f"round {self._round}: a full search found other grasps, cost {before.cost:.6g} to {after.cost:.6g}"
            self.trace.switches.append(name)
            return True
        return False

    # -- errors of manufacture

    def _worst_cases(self) -> tuple[WorstCase, ...]:
        """Cost and limits of the best design at the greatest errors."""
        cases = worst_cases(self.problem, self._best)
        self.problem.restore(self._grasps)
        return cases

    def _missed(self, worst: tuple[WorstCase, ...]) -> bool:
        """Take the worst combination of errors into the search, unless it is there; whether there is one to add."""
        add = worse_than_known(worst, self.problem.scenarios, self._best, SAME * self._scale)
        if not add:
            return False
        self.problem.scenarios = list(dict.fromkeys([*self.problem.scenarios, *add]))
        self._take(self._evaluate(self._best.coordinates))
        return True

    # -- the result

    def _result(
        self, best: Evaluation | None, status: Status, message: str, worst: tuple[WorstCase, ...]
    ) -> DesignResult:
        effort = self.problem.effort
        self.problem.restore(self._grasps)
        return DesignResult(
            scene=self.space.design,
            status=status,
            message=message,
            space=self.space,
            best=best,
            first=self._first,
            coordinates=np.array(self.trace.coordinates),
            costs=np.array(self.trace.costs),
            violations=np.array(self.trace.violations),
            rounds=np.array(self.trace.rounds),
            worst_cases=worst,
            switches=tuple(self.trace.switches),
            acting={case: len(sets) for case, sets in self.trace.acting.items()},
            grasps={} if best is None else self.problem.results,
            before=self._before,
            statistics={
                "designs": len(self.trace.costs),
                "full_searches": effort.searches,
                "solver_runs": effort.solves,
                "solver_iterations": effort.iterations,
                "designs_without_grasp": effort.lost,
                "total_seconds": time.monotonic() - self.began,
            },
        )
