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
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import Bounds, linprog, minimize
from scipy.stats.qmc import Halton

from continuum_grasp.addons.design.evaluation import HOLDS, DesignProblem, Evaluation, Signs
from continuum_grasp.addons.design.grasps import LostGrasp
from continuum_grasp.addons.design.result import DesignResult, DesignStatus, WorstCase
from continuum_grasp.addons.design.scene import Design
from continuum_grasp.addons.design.space import DesignSpace, design_space_of
from continuum_grasp.base import Array, SolverError, check_arguments, interruptible
from continuum_grasp.grasp import SAME, GraspResult
from continuum_grasp.scene import ConfigurationData, Overrides

_FINE = 0.02
"""Accuracy of an optimum, as a part [1]: of the cost, its slope over the range of a variable; of a range, half the
width of the box where the search ends; of what errors change in the cost, the excess of a worse combination of errors.
"""
_WIDEST, _NARROWEST = 0.1, 1e-5
"""Greatest and least half width of the box in which a kink is followed, per range of a variable [1]: planes of designs
within twice the width model the cost."""
_KINK = 1e-2
"""Distance of designs on both sides of a kink, per range of a variable [1]."""
_LOST = 1e2
"""Cost of a design without a grasp, in units of the first one: any other is better."""


@interruptible()
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
        Called with the share done so far and the current work in words.
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
    (0.00455, 'optimal')
    """
    space = design_space_of(ConfigurationData.given(design, Design, overrides))
    search = _DesignSearch(space, progress or (lambda share, text: None))
    result = search.result()
    if raise_on_failure and not result.solved:
        raise SolverError(result.message, status=result.status.value, result=result)
    return result


class _Box:
    """A box around a design as SLSQP sees it; where there are several costs, a bound of all is one more unknown."""

    def __init__(
        self, start: Evaluation, half: float, scale: float, evaluate: Callable[[Array], Evaluation | None]
    ) -> None:
        self.start = start
        self.scale = scale
        self.evaluate = evaluate
        self.n = start.coordinates.size
        self.low = np.maximum(start.coordinates - half, 0.0)
        self.high = np.minimum(start.coordinates + half, 1.0)
        self.bounded = len(start.costs) > 1
        self.known: dict[bytes, Evaluation | None] = {start.coordinates.tobytes(): start}

    @property
    def keywords(self) -> dict[str, Any]:
        """Start, bounds and constraints, as `scipy.optimize.minimize` takes them."""
        more = [np.inf] * self.bounded
        first = [self.start.cost / self.scale] * self.bounded
        limited = self.bounded or self.start.limits
        limits = {"type": "ineq", "fun": lambda z: self._rows(z)[2], "jac": lambda z: self._rows(z)[3]}
        return {
            "x0": np.append(self.start.coordinates, first),
            "bounds": Bounds(np.append(self.low, np.negative(more)), np.append(self.high, more)),
            "constraints": [limits] if limited else [],
        }

    @property
    def lost(self) -> int:
        """Number of designs without a grasp."""
        return sum(evaluation is None for evaluation in self.known.values())

    def cost(self, z: Array) -> float:
        return float(z[self.n] if self.bounded else self._rows(z)[0][0])

    def cost_slope(self, z: Array) -> Array:
        return np.append(np.zeros(self.n), 1.0) if self.bounded else self._rows(z)[1][0]

    def _rows(self, z: Array) -> tuple[Array, Array, Array, Array]:
        """Costs and limits, each with its slopes."""
        n, start = self.n, self.start
        u = np.clip(z[:n], self.low, self.high)
        key = u.tobytes()
        if key not in self.known:
            self.known[key] = self.evaluate(u)
            # 5: designs without a grasp after which a run of the optimizer ends: each takes a full search
            if self.known[key] is None and self.lost >= 5:
                raise LostGrasp("too many designs within the bounds lose a grasp")
        evaluation = self.known[key]
        if evaluation is None:
            count = len(start.limits) + self.bounded * len(start.costs)
            return np.array([_LOST]), np.zeros((1, n)), np.full(count, -_LOST), np.zeros((count, z.size))
        costs = np.array([row.value for row in evaluation.costs]) / self.scale
        by_cost = np.array([row.slope[:n] for row in evaluation.costs]) / self.scale
        limits = np.array([row.value for row in evaluation.limits])
        by_limits = np.array([row.slope[:n] for row in evaluation.limits]).reshape(-1, n)
        if not self.bounded:
            return costs, by_cost, limits, by_limits
        by_bound = np.append(np.ones(len(costs)), np.zeros(len(limits)))
        both = np.column_stack([np.vstack([-by_cost, by_limits]), by_bound])
        return costs, by_cost, np.append(z[n] - costs, limits), both


def _lowest(best: Evaluation, near: Sequence[Evaluation], half: float) -> Array:
    """Coordinates of the least cost by the planes of designs, within a box around the best one."""
    at, n = best.coordinates, best.coordinates.size
    rows, limits = list[Array](), list[Any]()
    for each in near:
        away = at - each.coordinates
        for cost in each.costs:
            rows.append(np.append(cost.slope[:n], -1.0))
            limits.append(-(cost.value + cost.slope[:n] @ away))
        for limit in each.limits:
            rows.append(np.append(-limit.slope[:n], 0.0))
            # A limit that is violated is so no more than at the best design.
            limits.append(max(limit.value + limit.slope[:n] @ away, best.violation))
    low, high = np.maximum(-half, -at), np.minimum(half, 1.0 - at)
    found = linprog(np.eye(n + 1)[n], rows, limits, bounds=[*zip(low, high, strict=True), (None, None)])
    return at + found.x[:n] if found.status == 0 else at


def _with_planes(best: Evaluation, known: Sequence[Evaluation]) -> Evaluation:
    """A design with the costs of those on the other side of a kink, by their planes."""
    n, costs = best.coordinates.size, list(best.costs)
    for each in known:
        away = best.coordinates - each.coordinates
        if 0.0 < np.abs(away).max() <= _KINK:
            costs += [
                replace(cost, value=min(cost.value + float(cost.slope[:n] @ away), best.cost)) for cost in each.costs
            ]
    return replace(best, costs=tuple(costs))


class _DesignSearch:
    """A search: trial designs, then rounds of improvement and full search."""

    def __init__(self, space: DesignSpace, progress: Callable[[float, str], None]) -> None:
        self.space = space
        self.options = space.design.solver
        self.problem = DesignProblem(space)
        self.progress = progress
        self.tried: list[tuple[Array, float, float, int]] = []
        """Coordinates, cost, violation and round of every design, in order."""
        self.switches: list[str] = []
        self.acting: dict[str, set[tuple[tuple[float, ...], ...]]] = {}
        """Per case, the sets of errors that decided it at one design or another."""
        self.began = time.monotonic()
        self.best: Evaluation | None = None
        self._first: Evaluation | None = None
        self._near: Sequence[Evaluation] = ()
        """Designs on both sides of the kink where the best design lies."""
        self._before: dict[str, GraspResult] = {}
        self._scale, self._grasps, self._why = 1.0, self.problem.snapshot(), ""
        self._round = 0
        self._converged = True
        self._ended = ""

    def result(self) -> DesignResult:
        """Search, and judge what was found."""
        self._start()
        if self.best is None:
            return self._result(
                DesignStatus.NO_GRASP, f"none of the designs tried has all its grasps and numbers: {self._why}", ()
            )
        settled = False
        worst = tuple[WorstCase, ...]()
        for number in range(self.options.max_rounds):
            self._round = number + 1
            self._improve()
            if self._switched():
                continue
            worst = self._worst_cases()
            settled = not self._missed(worst)
            if settled:
                break
        best = self.best = _with_planes(self._best, self._near)
        if best.violation > HOLDS:
            row = min(best.limits, key=lambda limit: limit.value)
            message = f"no design satisfies {row.name} ({row.case}): off by {-row.size * row.value:.3g} at the closest"
            return self._result(DesignStatus.LIMITS_VIOLATED, message, worst)
        status = DesignStatus.OPTIMAL if settled and self._converged else DesignStatus.FEASIBLE
        message = f"cost {best.cost:.6g}, from {(self._first or best).cost:.6g} at the start"
        if status is DesignStatus.OPTIMAL and best.left > _FINE * self._scale:
            # As at a kink, beside which other grasps are best.
            status = DesignStatus.FEASIBLE
            self._ended = f"with a slope of {best.left:.3g} over the range of a variable"
        if status is DesignStatus.FEASIBLE:
            message += f"; the search ended before it settled ({self._ended})"
        return self._result(status, message, worst)

    @property
    def _best(self) -> Evaluation:
        if self.best is None:
            raise LostGrasp("no design has been tried")
        return self.best

    # -- trial designs

    def _start(self) -> None:
        """Search the trial designs in full, and take the best."""
        count = self.options.starts - 1
        coordinates = self.space.coordinates
        trials = [np.array([coordinate.way.coordinate(coordinate.nominal) for coordinate in coordinates])]
        if count > 0:  # the first point of the sequence is the corner 0
            trials += list(Halton(len(coordinates), scramble=False).fast_forward(1).random(count))
        for k, at in enumerate(trials):
            self.progress(0.4 * k / len(trials), f"trial design {k + 1} of {len(trials)}")
            self.problem.restore({})
            try:
                evaluation = self._evaluate(at, search=True)
            except LostGrasp as error:
                self._why = self._why or str(error)
                continue
            if self._first is None:
                self._first = evaluation
                self._before = self.problem.results
            if self.best is None or self._better(evaluation, self.best):
                self._take(evaluation)
        if self.best is not None:
            self.problem.restore(self._grasps)
            self._scale = max(abs(self.best.cost), 1e-9)

    def _evaluate(self, at: Array, search: bool = False) -> Evaluation:
        try:
            evaluation = self.problem.evaluate(at, search=search)
        except LostGrasp:
            self.tried.append((np.array(at), np.nan, np.nan, self._round))
            raise
        self.tried.append((np.array(at), evaluation.cost, evaluation.violation, self._round))
        for case in evaluation.cases:
            if case.acting and not any(case.signs):
                self.acting.setdefault(case.case, set()).add(case.acting)
        return evaluation

    def _better(self, candidate: Evaluation, than: Evaluation) -> bool:
        """Whether a design is better: by the violation of limits, then by the cost."""
        if max(candidate.violation, than.violation) > HOLDS:
            return candidate.violation < than.violation
        return candidate.cost < than.cost

    def _take(self, evaluation: Evaluation) -> None:
        self.best, self._grasps = evaluation, self.problem.snapshot()

    # -- improvement

    def _improve(self) -> None:
        """Improve the best design until it stays; a step that loses the grasp makes the region smaller."""
        half = 1.0
        while self._descend(half):
            # 0.25: part of the box around the best design that is searched next where a step lost the grasp
            half *= 0.25
            if half < _FINE:
                self._ended = "beside this design grasps are lost"
                self._converged = False
                break
        if self._best.left > _FINE * self._scale:
            self._follow_kink()

    def _follow_kink(self) -> None:
        """Follow a kink of the cost, beside which other contacts or limits of a grasp act, by linear programs.

        Each takes the design that is best by the planes of all designs that were tried nearby, cost and limits, within
        a box; where it is not better, its plane joins and the box shrinks.
        """
        known, half = [self._best], _WIDEST
        # 3: designs per variable and halving
        for _ in range(3 * len(self.space.coordinates) * 14):
            best = self._best
            near = [e for e in known if np.abs(e.coordinates - best.coordinates).max() <= 2.0 * half]
            if half < _NARROWEST:
                break
            tried = self._followed(_lowest(best, near, half))
            if tried is not None:
                known.append(tried)
            half = min(2.0 * half, _WIDEST) if self._best is tried else 0.5 * half
        self._near = known

    def _descend(self, half: float) -> bool:
        """Run SLSQP once within a box around the best design; whether a grasp was lost."""
        box = _Box(self._best, half, self._scale, self._followed)
        options = {"maxiter": self.options.max_iterations, "ftol": self.options.tolerance}
        try:
            optimum = minimize(box.cost, jac=box.cost_slope, method="SLSQP", options=options, **box.keywords)
        except LostGrasp:
            return True
        # 8: no descent along the step any more, which ends a search at a kink or at rounding.
        self._converged = optimum.status in (0, 8)
        self._ended = str(optimum.message)
        self.problem.restore(self._grasps)
        return box.lost > 0

    def _followed(self, at: Array) -> Evaluation | None:
        """A design whose grasps are followed from the one before, taken where it is better; None without a grasp."""
        try:
            evaluation = self._evaluate(at)
        except LostGrasp:
            self.problem.restore(self._grasps)
            return None
        count = len(self.tried)
        self.progress(min(0.4 + 0.01 * count, 0.95), f"design {count}, cost {evaluation.cost:.6g}")
        if self._better(evaluation, self._best):
            self._take(evaluation)
        return evaluation

    # -- what a full search says

    def _switched(self) -> bool:
        """Search in full at the best design; whether other grasps are better there, from which to go on."""
        before = self._best
        self.progress(0.95, "full search at the best design")
        after = self._evaluate(before.coordinates, search=True)
        self._take(after)
        switched = before.cost - after.cost > SAME * self._scale or after.violation < before.violation - HOLDS
        if switched:
            costs = f"cost {before.cost:.6g} to {after.cost:.6g}"
            self.switches.append(f"round {self._round}: a full search found other grasps, {costs}")
        return switched

    # -- errors of manufacture

    def _worst_cases(self) -> tuple[WorstCase, ...]:
        """Cost and limits of the best design at the worst combinations of errors: to first order, and as they are at
        the corners; none without tolerances.
        """
        best = self._best
        problem = self.problem
        n = len(self.space.coordinates)
        if not self.space.tolerated:
            return ()
        nominal = [row for row in best.costs if not any(row.signs)]
        bound = max(row.value + float(np.abs(row.slope[n:]).sum()) for row in nominal)
        scenarios = problem.scenarios
        cases = list[WorstCase]()
        for signs in self._corners():
            problem.scenarios = [signs]
            try:
                there = problem.evaluate(best.coordinates)
            except LostGrasp as error:
                cases.append(WorstCase(signs, np.inf, np.inf, bound, str(error)))
            else:
                cases.append(WorstCase(signs, there.cost, there.violation, bound, ""))
        problem.scenarios = scenarios
        problem.restore(self._grasps)
        return tuple(sorted(cases, key=lambda case: (-case.violation if case.violation > HOLDS else 0.0, -case.cost)))

    def _corners(self) -> list[Signs]:
        """Combinations of greatest errors: all of them where these are few, else those that first order calls worst."""
        m = len(self.space.tolerated)
        n = len(self.space.coordinates)
        # 6: tolerated numbers up to which all combinations of their greatest errors are tried: 64
        if m <= 6:
            return list(product((-1.0, 1.0), repeat=m))
        rows = [*(row.slope[n:] for row in self._best.costs), *(-row.slope[n:] for row in self._best.limits)]
        return list(dict.fromkeys(tuple(np.where(slope >= 0.0, 1.0, -1.0).tolist()) for slope in rows))

    def _missed(self, worst: tuple[WorstCase, ...]) -> bool:
        """Take the combinations of errors with the greatest cost and the greatest violation into the search, where they
        are worse than the best design with those that are in it; whether there is one to add.
        """
        best = self._best
        known = self.problem.scenarios
        bad = [case for case in worst if case.signs not in known and np.isfinite(case.cost)]
        if not bad:
            return False
        costly = max(bad, key=lambda case: case.cost)
        broken = max(bad, key=lambda case: case.violation)
        change = max(abs(case.cost - best.cost) for case in bad)
        add = [costly.signs] if costly.cost > best.cost + max(_FINE * change, SAME * self._scale) else []
        add += [broken.signs] if broken.violation > max(best.violation, 0.0) + HOLDS else []
        if add:
            self.problem.scenarios = list(dict.fromkeys([*known, *add]))
            self._take(self._evaluate(best.coordinates))
        return bool(add)

    # -- the result

    def _result(self, status: DesignStatus, message: str, worst: tuple[WorstCase, ...]) -> DesignResult:
        effort = self.problem.effort
        self.problem.restore(self._grasps)
        coordinates, costs, violations, rounds = (np.array(column) for column in zip(*self.tried, strict=True))
        return DesignResult(
            scene=self.space.design,
            status=status,
            message=message,
            space=self.space,
            best=self.best,
            first=self._first,
            coordinates=coordinates,
            costs=costs,
            violations=violations,
            rounds=rounds,
            worst_cases=worst,
            switches=tuple(self.switches),
            acting={case: len(sets) for case, sets in self.acting.items()},
            grasps={} if self.best is None else self.problem.results,
            before=self._before,
            statistics={
                "designs": len(self.tried),
                "full_searches": effort.searches,
                "solver_runs": effort.solves,
                "solver_iterations": effort.iterations,
                "designs_without_grasp": effort.lost,
                "total_seconds": time.monotonic() - self.began,
            },
        )
