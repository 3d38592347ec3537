"""Grasps whose tensions hold the object for all errors within bounds.

An exchange method for semi-infinite problems: J. W. Blankenship, J. E. Falk, J. Optim. Theory Appl. 19 (1976),
doi:10.1007/BF00934096:

1. Begin with the grasp of the scene as it is.
2. Hold its tensions, and find the greatest friction margin for each corner of the bounds.
3. If none is negative, end. Else the corners with the least ones join the grasp as copies that share its tensions.
4. Solve the grasp and its copies next to known solutions of each; go on with 2.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.robust.result import GraspTrials, Robustness
from continuum_grasp.grasp.rods.answers import AskedAnswers
from continuum_grasp.grasp.rods.carried import carried
from continuum_grasp.grasp.rods.clearance import CROSSED, Crossing, deep_places
from continuum_grasp.grasp.rods.copies import RodCopies, RodCopy
from continuum_grasp.grasp.rods.errors import ErrorSpace, PlanarErrors, SpatialErrors
from continuum_grasp.grasp.rods.numbers import GraspAims
from continuum_grasp.grasp.rods.places import StagePlace
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.solving import ROUNDS, TUNING, RodGrasp, StartedSearch, rods_solver
from continuum_grasp.nlp import ActiveSet, Attempt, Budget, Settings, Solver, SolverStatus
from continuum_grasp.scene import HandScene

HOLDS = -1e-6
"""Least friction margin with which all contacts hold, of copies that are solved to 1e-9 [1]."""
MOST, EXCHANGES = 2, 8
"""Most corners that join the grasp at once, and solves with further ones: two corners are enough for a mug, and one
more solve of six copies takes as long as two of three."""
SLIPS = 15.0
"""Greatest excess of friction that is looked for [1]."""
UNDECIDED = 1e-6
"""Sum of forces that nothing bears beyond which no posture balances [F0]."""
NEAR = 1e-6
"""First barrier parameter of a solve next to a known one: 6 iterations, 9 with 1e-4 and as many with 1e-8, of which
some take 16 (`mug_uncertain`, 40 errors)."""
SETS = 4
"""Most sets of limits with which a response is sought next to known ones, before a solver runs: one set takes a tenth
of the solver's time (`mug_uncertain`)."""
FRUITLESS = 12
"""Errors in a row at which a response that does not hold, next to known ones, is sought from the grasp too, and none
better is found: then it is sought next to known ones alone."""
DRAWS = 200
"""Most errors with which a grasp is tried that was not sought for them."""
BRANCHES = 3
"""Grasps of the scene next to which a robust one is sought."""


@dataclass(frozen=True, eq=False)
class RodResponse:
    """The posture for one error at tensions that are held.

    ``margin`` is the least friction margin of its contacts [1]: minus infinity where no posture balances, NaN where the
    solver has no answer.
    """

    error: Array
    copy: RodCopy
    attempt: Attempt
    margin: float

    @property
    def holds(self) -> bool:
        """Whether all contacts hold."""
        return self.margin >= HOLDS

    @property
    def weakest(self) -> str:
        """Contact that is nearest to slipping; empty where nothing balances."""
        problem, x = self.copy.problem, self.attempt.x
        if not np.isfinite(self.margin):
            return ""
        numbers = problem.numbers
        friction = {name: finger.friction for finger in numbers.fingers for name in finger.contacts}
        friction |= {support.name: support.friction for support in numbers.supports}
        used = {
            name: float(np.linalg.norm(x[held[1:]])) / max(friction[name] * float(x[held[0]]), 1e-12)
            for name, held in problem.contacts.items()
        }
        return max(used, key=lambda name: used[name])


def error_space(scene: Any, grasp: RodGrasp, bounds: Mapping[str, float]) -> ErrorSpace:
    """Errors of a grasp of a planar scene or of a hand."""
    kind = SpatialErrors if isinstance(scene, HandScene) else PlanarErrors
    return kind(scene, grasp, bounds)


class RodResponder:
    """Finds postures for errors at the tensions of a grasp, each from the nearest one that is known."""

    def __init__(self, errors: ErrorSpace, stages: int, budget: Budget) -> None:
        self.errors, self._stages, self._budget = errors, stages, budget
        self._x = errors.grasp.attempt.x
        self._cold = rods_solver(100)
        self._warm = Settings(
            tolerance=1e-7,
            constraint_tolerance=1e-9,
            max_iterations=40,
            tuning={"ipopt": {**TUNING, "near": NEAR}},
        ).solver()
        self._known: list[RodResponse] = []
        self._acting: dict[RodResponse, ActiveSet] = {}
        self._fruitless = 0

    def to(self, error: Array) -> RodResponse:
        """The response to an error."""
        copy = self.errors.copy(error, self._stages, aims=GraspAims(0.0, 1.0))
        copy.hold(self._x)
        problem = copy.problem
        problem.bound(problem.margin, low=-SLIPS)
        attempt = self._next_to_known(error, problem)
        if attempt is None or (not self._holds(copy, attempt) and self._fruitless < FRUITLESS):
            first = problem.named(self.errors.grasp.problem, self._x)
            again = self._cold.solve(problem.nlp, problem.start(first), self._budget)
            better = attempt is None or not _margin(copy, attempt) >= _margin(copy, again) - NEAR
            self._fruitless = 0 if better else self._fruitless + 1
            attempt = again if better or attempt is None else attempt
        response = RodResponse(error, copy, attempt, _margin(copy, attempt))
        if attempt.converged and np.isfinite(response.margin):
            self._known.append(response)
        return response

    def _next_to_known(self, error: Array, problem: GraspRods) -> Attempt | None:
        """Solve from known responses: with the limits that act at the nearest ones, or in full from the nearest one."""
        order = self._by_distance(error)
        tried = set[bytes]()
        for k in order:
            acting = self._acting_at(self._known[k])
            if acting.key in tried:
                continue
            tried.add(acting.key)
            found = acting.near(problem.start(self._known[k].attempt.x))
            if found is not None or len(tried) == SETS:
                break
        else:
            found = None
        if found is not None or not order:
            return found
        known = self._known[order[0]].attempt
        start = replace(problem.start(known.x), multipliers=known.multipliers)
        return self._warm.solve(problem.nlp, start, self._budget)

    def _acting_at(self, response: RodResponse) -> ActiveSet:
        """Limits that act at a known response."""
        if response not in self._acting:
            problem, attempt = response.copy.problem, response.attempt
            self._acting[response] = ActiveSet(problem.nlp, problem.start(attempt.x), attempt)
        return self._acting[response]

    def descended(self, responses: Sequence[RodResponse]) -> Iterator[RodResponse]:
        """From each response on to the friction states that lower its margin, until none does."""
        if not self.errors.histories.size:
            return
        known = {response.error.tobytes() for response in responses}
        for response in responses:
            last = response
            while np.isfinite(last.margin) and (error := self._worse(last)).tobytes() not in known:
                known.add(error.tobytes())
                new = self.to(error)
                yield new
                if not new.margin < last.margin:
                    break
                last = new

    def _worse(self, response: RodResponse) -> Array:
        """An error with the friction states at which the margin is least, to first order."""
        errors, error = self.errors, response.error.copy()
        attempt = response.attempt
        states = errors.states(error)
        states[:] = errors.histories.worse(states, response.copy.problem, attempt.x, attempt.multipliers.constraints)
        return error

    @staticmethod
    def _holds(copy: RodCopy, attempt: Attempt) -> bool:
        return _margin(copy, attempt) >= HOLDS

    def _by_distance(self, error: Array) -> list[int]:
        """Known responses by the distance of their errors, per bounds."""
        if not self._known:
            return []
        away = (np.array([response.error for response in self._known]) - error) / self.errors.scales
        order: list[int] = (away**2).sum(axis=1).argsort(kind="stable").tolist()
        return order


def _margin(copy: RodCopy, attempt: Attempt) -> float:
    problem = copy.problem
    if attempt.converged:
        return float(attempt.x[problem.margin[0]]) if problem.unborne(attempt.x) < UNDECIDED else -np.inf
    return -np.inf if attempt.status is SolverStatus.INFEASIBLE else np.nan


@dataclass(frozen=True, eq=False)
class RobustGrasp:
    """A grasp that shares its tensions with copies in error.

    Attributes
    ----------
    grasp : RodGrasp
    errors : ErrorSpace
        Errors of this grasp.
    active : ndarray
        Errors of the copies (n, columns).
    copies : tuple of RodGrasp
        The grasp in error.
    responses : tuple of RodResponse
        Responses to all corners at its tensions.
    """

    grasp: RodGrasp
    errors: ErrorSpace
    active: Array
    copies: tuple[RodGrasp, ...] = ()
    responses: tuple[RodResponse, ...] = field(default=(), repr=False)

    @property
    def holds(self) -> bool:
        """Whether the grasp holds the object at all corners."""
        return bool(self.responses) and self.grasp.holds and all(response.holds for response in self.responses)

    @property
    def worst(self) -> RodResponse:
        """Response with the least margin."""
        return min(self.responses, key=lambda response: response.margin)


class RobustSearch:
    """Finds a grasp that holds for all errors within bounds, next to grasps that a search has found.

    Parameters
    ----------
    search : StartedSearch
        After its run.
    bounds : mapping of str to float
        See `ErrorSpace`.
    """

    def __init__(self, search: StartedSearch, bounds: Mapping[str, float]) -> None:
        self._search, self._bounds = search, dict(bounds)
        self._solver: Solver = rods_solver(200)
        self.tried: list[RobustGrasp] = []

    @property
    def best(self) -> RobustGrasp | None:
        """The robust grasp with the least aim; of those that are as stable as the scene requires, if there are any."""
        held = [robust for robust in self.tried if robust.holds]
        steady = [robust for robust in held if self.is_steady(robust)]
        return min(steady or held, key=lambda robust: robust.grasp.attempt.objective, default=None)

    def is_steady(self, robust: RobustGrasp) -> bool:
        """Whether a robust grasp is as stable as the scene requires, without errors."""
        steady = self._search.steady
        return steady is None or robust.grasp.meets(steady)

    @property
    def nominal(self) -> RobustGrasp:
        """The best grasp of the search, with its responses to all corners."""
        best = self._search.best
        if best is None:
            raise ValueError("the search has found no grasp; run it first, and look whether it has one")
        errors = error_space(self._search.scene, best, self._bounds)
        responder = RodResponder(errors, self._search.stages, self._search.budget)
        responses = tuple(responder.to(corner) for corner in errors.corners)
        return RobustGrasp(best, errors, errors.corners[:0], (), responses)

    def run(self) -> None:
        """Seek next to the best grasp, and next to others that may lead to a better one."""
        held = sorted((g for g in self._search.tried if g.holds), key=lambda g: g.attempt.objective)
        for grasp in _apart(held)[:BRANCHES]:
            best = self.best
            if self._search.budget.over or (best and best.grasp.attempt.objective <= grasp.attempt.objective):
                break
            self.tried.append(self.next_to(self._plain(grasp)))
        if self.best is not None and not self.is_steady(self.best):
            self._steady(self.best)

    def _plain(self, grasp: RodGrasp) -> RodGrasp:
        """The grasp without the push that it must bear: one for all errors bears more, and its problem is smaller."""
        if not isinstance(grasp.variant, AskedAnswers) or grasp.variant.aimed:
            return grasp
        plain = self._search.solved(grasp.start, beside=grasp, fine=grasp.fine)
        return plain if plain.holds else grasp

    def _steady(self, robust: RobustGrasp) -> None:
        """Seek next to a grasp that is as stable as the scene requires, beside the one that a robust grasp is from."""
        nominal = next(grasp for grasp in self._search.tried if grasp.start is robust.grasp.start)
        steady = self._search.steadied(nominal)
        if steady is not None:
            self.tried.append(self.next_to(steady))

    def next_to(self, grasp: RodGrasp) -> RobustGrasp:
        """The robust grasp next to a grasp; the last one where none is found."""
        errors = error_space(self._search.scene, grasp, self._bounds)
        corners, chosen = list(errors.corners), list[int]()
        robust = RobustGrasp(grasp, errors, np.zeros((0, len(corners[0]))))
        for _ in range(EXCHANGES):
            responder = RodResponder(replace_grasp(errors, robust.grasp), self._search.stages, self._search.budget)
            responses = tuple(responder.to(corner) for corner in corners)
            responses += tuple(responder.descended(responses))
            corners = [response.error for response in responses]
            robust = replace(robust, errors=responder.errors, responses=responses)
            order = np.argsort([_rank(response) for response in responses], kind="stable").tolist()
            failing = [k for k in order if not responses[k].holds and k not in chosen][:MOST]
            if not failing or self._search.budget.over:
                return robust
            chosen += failing
            known = [responses[k].attempt.x for k in chosen]
            solved = self._solved(errors, np.array([corners[k] for k in chosen]), known, robust.grasp)
            if solved is None:
                return robust
            robust = solved
        return robust

    def _solved(
        self, errors: ErrorSpace, active: Array, known: Sequence[Array], beside: RodGrasp
    ) -> RobustGrasp | None:
        """The grasp and its copies, with rows where a copy is in the object between nodes."""
        xs = [beside.attempt.x, *known]
        places = [tuple[StagePlace, ...]() for _ in active]
        for _ in range(ROUNDS + 1):
            first = errors.grasp.problem
            copies = [
                errors.copy(error, self._search.stages, places=more) for error, more in zip(active, places, strict=True)
            ]
            problem = RodCopies(first, copies)
            attempt = self._solver.solve(problem.nlp, problem.start(problem.joined(xs)), self._search.budget)
            if not attempt.converged:
                return None
            xs = problem.split(attempt.x)
            if deeper := [place for place in deep_places(first, xs[0]) if place not in first.places]:
                # Copies have the rows of the first one.
                errors = replace_grasp(errors, _with_places(errors.grasp, deeper))
                xs[0] = carried(first, xs[0], errors.grasp.problem)
            deep = [deep_places(copy.problem, x) for copy, x in zip(copies, xs[1:], strict=True)]
            new = [tuple(p for p in found if p not in more) for found, more in zip(deep, places, strict=True)]
            if not any(new) and not deeper:
                break
            places = [(*more, *found) for more, found in zip(places, new, strict=True)]
        grasps = tuple(
            _grasp_of(part.problem, attempt, x, beside) for part, x in zip(problem.included, xs, strict=True)
        )
        if any(grasp.crosses for grasp in grasps):
            return None
        return RobustGrasp(grasps[0], errors, active, grasps[1:])


def share_held(search: StartedSearch, bounds: Mapping[str, float], halvings: int = 4) -> float:
    """Greatest share of the bounds that a grasp next to grasps of a search holds, found to 2^-halvings."""
    low, high = 0.0, 1.0
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        part = RobustSearch(search, {name: middle * bound for name, bound in bounds.items()})
        part.run()
        low, high = (middle, high) if part.best else (low, middle)
    return low


def robustness_of(
    search: StartedSearch, robust: RobustSearch, count: int, seed: int, arrays: Mapping[str, Array]
) -> Robustness:
    """The best grasp of a search, of which there are arrays, and the robust one, tried with the same errors.

    The nominal grasp is tried with `DRAWS` of them at most: its share is then known to 7 percentage points at 95 %.
    """
    best, stages, budget = robust.best, search.stages, search.budget
    nominal = robust.nominal
    drawn = nominal.errors.drawn(count, seed)
    trials = trials_of(nominal, drawn[:DRAWS], stages, budget)
    own = None if best is None else trials_of(best, drawn, stages, budget)
    active = drawn[:0] if best is None else best.active
    reported = nominal.errors.reported
    return Robustness(reported(drawn), trials, own, reported(active), arrays)


def _with_places(grasp: RodGrasp, more: Sequence[StagePlace]) -> RodGrasp:
    """The grasp in a problem with rows at more places."""
    known = grasp.problem
    problem = GraspRods(
        known.numbers,
        joints=grasp.start.joints,
        stages=known.stages,
        places=(*known.places, *more),
        near=known.near,
        fine=known.fine,
    )
    if grasp.variant is not None:
        grasp.variant(problem)
    x = carried(known, grasp.attempt.x, problem)
    return replace(grasp, problem=problem, attempt=replace(grasp.attempt, x=x))


def replace_grasp(errors: ErrorSpace, grasp: RodGrasp) -> ErrorSpace:
    """The errors of another grasp of the same scene."""
    return type(errors)(errors.scene, grasp, errors.known)


def _grasp_of(problem: Any, attempt: Attempt, x: Array, beside: RodGrasp) -> RodGrasp:
    """A part of a solution with copies, as a grasp."""
    costs = problem.objective(x)
    own = replace(attempt, x=x, objective=costs)
    return RodGrasp(problem, own, beside.start, Crossing(problem, x).depth > CROSSED)


def _rank(response: RodResponse) -> float:
    """Margin, with no answer as the least."""
    return -np.inf if np.isnan(response.margin) else response.margin


def _apart(grasps: Sequence[RodGrasp]) -> list[RodGrasp]:
    """Grasps in their order without those that have the aim and the contacts of one before."""
    found = list[RodGrasp]()
    for grasp in grasps:
        # 1e-4: share of an aim by which grasps differ
        aim = grasp.attempt.objective
        same = (g.start.on == grasp.start.on and abs(g.attempt.objective - aim) <= 1e-4 * abs(aim) for g in found)
        if not any(same):
            found.append(grasp)
    return found


def trials_of(robust: RobustGrasp, drawn: Array, stages: int, budget: Budget) -> GraspTrials:
    """Try the tensions of a grasp with errors that are drawn, and with each bound alone."""
    errors = robust.errors
    responder = RodResponder(errors, stages, budget)
    reserve = errors.scene.contacts.reserve

    def free(response: RodResponse) -> float:
        """Share of the friction that is free, of which the problem leaves the reserve: zero at the edge of the cone."""
        margin = reserve + (1.0 - reserve) * response.margin
        return max(margin, 0.0) if margin >= HOLDS else margin

    responses = [responder.to(error) for error in drawn]
    margins = np.array([free(response) for response in responses])
    failing = (response for response, margin in zip(responses, margins, strict=True) if not margin >= 0.0)
    alone = {name: min(free(responder.to(error)) for error in ends) for name, ends in errors.alone.items()}
    return GraspTrials(
        robust.grasp.tension,
        margins,
        np.array([free(response) for response in robust.responses]),
        alone,
        Counter(response.weakest or "balance" for response in failing),
        errors.words(robust.worst.error),
    )
