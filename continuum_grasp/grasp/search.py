"""The search: starts of every set of contacts, each answer verified.

1. Fingers that hold the object are the starts: of all their equilibria that touch (`finger_map`), settled to the least
   tension, the least first; many elements as exact rods, few by their own equilibria. Where none holds it, the one
   that comes nearest is; where maps are empty, postures that nearly touch are. Once fingers crossed in an attempt,
   those that keep apart are.
2. Where exact rods hold with less than the best grasp and its elements do not follow, it is not called optimal.
3. Another objective is also sought from grasps with the least tension, where those starts do not lead to its optimum.
4. The best grasp is solved to the end.

What ends it early: a proof by `bound` that nothing is better, or that there is nothing, and the budget.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from continuum_grasp.base import amount_text
from continuum_grasp.grasp.bound import cannot_balance, least_normal_force_bound
from continuum_grasp.grasp.certificate.certificate import Certificate
from continuum_grasp.grasp.effort import BALANCED, EFFORTS, FIRST_CAP, HELD, OPEN, STANDSTILL, SURE, UNFOLLOWED
from continuum_grasp.grasp.finger_map import FEW, ROUGH, SETTLED, Place, SceneMaps, is_mapped, places_of
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.problem.solver_run import OPTION_SETS, GraspAttempt, GraspSolverRun
from continuum_grasp.grasp.starts.rough import rough_starts
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.grasp.tried import Candidate, Exploration, Tried, least_of
from continuum_grasp.grasp.values import NEAR, SAME, tension_of
from continuum_grasp.nlp import Budget, SolverStatus
from continuum_grasp.scene import GraspScene

ALIKE = "like one that was tried before"
"""Reason why a start is not solved again."""


class GraspSearch:
    """Finds and verifies grasps of a scene within a budget."""

    def __init__(self, scene: GraspScene, budget: Budget) -> None:
        self.scene = scene
        self.budget = budget
        self.settled: list[Candidate] = []  # fingers that hold the object, least tension first
        self._settled_before: list[Candidate] = []  # those that were, before fingers crossed in an attempt
        self.held_before: list[Candidate] = []  # exact rods that hold it in a search with another model
        self.tried: list[Tried] = []
        self.good: list[Tried] = []  # those that the certificate confirms
        self.fallback: Tried | None = None  # a grasp with least tension, where something else is sought
        self.strongest: Tried | None = None  # that bears the greatest push, if no grasp bears the required push
        # Spent on building solvers, and on starts.
        self.build_seconds = self.start_seconds = 0.0
        self._effort = EFFORTS[scene.solver.effort]
        self._pruned = Counter[str]()  # starts that were not tried, by the reason
        self._solvers: dict[tuple[tuple[str, int], ...], GraspSolverRun] = {}  # by names and parts of contacts
        self.maps = SceneMaps(scene)
        self._sampled = False  # whether postures were tried that maps do not lead to
        # Fingers that passed through each other in an attempt, or of the same name through themselves.
        self.apart = frozenset[tuple[str, str]]()

    @property
    def best(self) -> Tried | None:
        """The acceptable attempt with the least objective; one that converged, where that costs next to nothing."""
        return least_of([t for t in self.good if t.acceptable])

    @property
    def held(self) -> list[Tried]:
        """The verified grasps from which a search of another scene starts."""
        return sorted(self.good, key=lambda t: t.attempt.objective)[:HELD]

    @property
    def unstable(self) -> Tried | None:
        """The least of the verified grasps that are not acceptable."""
        return least_of([t for t in self.good if not t.acceptable])

    @cached_property
    def modes(self) -> list[frozenset[str]]:
        """The sets of contacts that are tried."""
        return contact_modes(self.scene)

    def run(self) -> None:
        """Polish what fingers hold; then go on from the best grasp where its solver was stopped."""
        self._from_settled()
        if self.scene.contacts.push and self.best is None:
            # Without a least push, so that the greatest push becomes known.
            scene = self.scene.replaced(contacts=self.scene.contacts.replaced(push=None), objective="greatest_push")
            strongest = GraspSearch(scene, self.budget)
            self._from(strongest, "greatest push")
            self.strongest = strongest.best
        if not self._least_tension and not (self.best and self.best.attempt.optimal):
            self._from(GraspSearch(self.scene.replaced(objective="least_tension"), self.budget), "least tension")
        if not self.proven:
            self._converge()

    # -- starts ------------------------------------------------------------------------------------------------

    def settle(self, maps: SceneMaps, *, exact: bool = False) -> list[Candidate]:
        """Fingers that hold the object, by increasing tension, then the ones that come nearest to it: as they bend
        with few elements, or as ``exact`` rods.
        """
        began = time.perf_counter()
        starts = [start for mode, place in self._places for start in maps.settled(mode, place, exact=exact)]
        self.start_seconds += time.perf_counter() - began
        return [Candidate(start) for start in sorted(starts, key=_promise)]

    def _from_settled(self) -> None:
        """Start from fingers that hold the object, as far as they are better than the best grasp; without a grasp also
        from spare ones, and from those that come nearest to it.
        """
        if not self.budget.over:
            before = [Candidate(each.start) for each in self.held_before]
            self.settled = sorted([*self.settle(self.maps), *before], key=lambda each: _promise(each.start))
        most = self._effort.settled
        solved = 0
        while (candidate := self._next_settled) is not None and solved < most:
            if self.budget.over or self.proven or self._promised(candidate) > SURE:
                return
            candidate.tried = True
            alike = self._pruned[ALIKE]
            maps = self.maps
            self._attempt_twice(candidate.start)
            if self.maps is not maps:
                self._settled_before += self.settled
                self.settled = self.settle(self.maps)
            # Starts that lead to the same grasp tell nothing of the others.
            solved += self._pruned[ALIKE] == alike
        for start in self._others(most):
            if self.budget.over or self.best is not None:
                return
            self._sampled |= start.is_rough
            # Few of these lead to a grasp: a run that stands still does not.
            self._attempt_twice(start, standstill=STANDSTILL)

    @property
    def _next_settled(self) -> Candidate | None:
        """The best fingers that hold the object and were not tried."""
        return next((each for each in self.settled if each.holds and not each.tried), None)

    def _attempt_twice(self, start: GraspStart, standstill: int | None = None) -> None:
        """Solve from a start boldly, since it is nearly exact, then carefully."""
        if self.attempt(start, options_at=0, standstill=standstill) not in self.good:
            self.attempt(start, iterations=FIRST_CAP, standstill=standstill)

    def _others(self, most: int) -> Iterator[GraspStart]:
        """Further starts where those that hold the object lead to no grasp, at most so many of a kind: what comes
        before an optimum, or nearest to it; fingers that hold it, but may cross; postures that nearly touch, where maps
        are empty or none; exact rods that hold though few elements do not.
        """
        others = [each.start for each in self.settled if not each.holds]
        near = [start for start in others if start.imbalance <= SETTLED or not is_mapped()]
        yield from (near or others[:1])[:most]
        yield from [each.start for each in self._settled_before if each.holds and not each.tried][:most]
        if not self.settled:
            for mode, place in self._places:
                yield from rough_starts(self.scene, mode, *place, ROUGH)
        elif any(setup.elements <= FEW for setup in self.scene.setups):
            yield from [each.start for each in self._settled_exactly if each.holds][:most]

    @property
    def _places(self) -> list[tuple[frozenset[str], Place]]:
        """Sets of contacts, and places of object and bases that are tried with them."""
        return [(mode, place) for mode in self.modes for place in places_of(self.scene, mode)[: self._effort.places]]

    def _from(self, before: GraspSearch, label: str) -> None:
        """Start from the grasps of a scene in which they are found more surely."""
        self.run_before(before)
        for held in before.held:
            if not (self.budget.over or self.proven):
                self.attempt(replace(GraspStart.of(self.scene, held.arrays), label=label))

    def run_before(self, other: GraspSearch) -> None:
        """Run a search of another scene, whose time counts as one's own."""
        try:
            other.run()
        finally:  # also on Ctrl-C
            if other.scene.objective != self.scene.objective and not self.pushed:
                self.fallback = other.best
            self.build_seconds += other.build_seconds
            self.start_seconds += other.start_seconds

    def _promised(self, candidate: Candidate) -> float:
        """Tension of a settled exact rod per tension of the best grasp; zero where there is none, and where it does not
        tell as another objective is sought, or object or bases may move.
        """
        best = self.best
        if best is None or not self._tensions_tell:
            return 0.0
        # Both may be none, but for rounding.
        return (candidate.start.estimate + self._least_difference) / (self._tension(best) + self._least_difference)

    @property
    def _tensions_tell(self) -> bool:
        """Whether tensions of settled fingers predict grasps: no other objective, no push, no free pose."""
        return self._least_tension and not self._moves and not self.pushed

    @property
    def pushed(self) -> bool:
        """Whether the object bears a push."""
        return bool(self.scene.contacts.push) or "greatest_push" in self.scene.aims

    @property
    def _least_tension(self) -> bool:
        return self.scene.objective == "least_tension"

    @property
    def _moves(self) -> bool:
        """Whether the object or a base may move."""
        return self.scene.object.free is not None or any(s.finger.base_free is not None for s in self.scene.setups)

    @property
    def exact_less(self) -> float:
        """Sum of the tensions [N] with which exact rods hold, where that is clearly less than the best grasp's; NaN: it
        is not, was not asked, or rods do not tell as they know no histories of friction.
        """
        histories = any(setup.friction_states for setup in self.scene.setups)
        if histories or self.best is None or not self._tensions_tell:
            return math.nan
        less = [held.start.estimate for held in self.held_exactly if 0.0 < self._promised(held) < UNFOLLOWED]
        return min(less, default=math.nan)

    @property
    def exact(self) -> bool:
        """Whether exact rods hold the object."""
        return bool(self.held_exactly)

    @property
    def held_exactly(self) -> list[Candidate]:
        """Exact rods that hold the object; empty if it must bear a push, which these rods do not cover."""
        return [] if self.pushed else _in_balance(self._settled_exactly)

    @cached_property
    def _settled_exactly(self) -> list[Candidate]:
        if not self.settled or all(setup.elements > FEW for setup in self.scene.setups):
            return self.settled
        return self.settle(self.maps, exact=True)

    # -- what is known -----------------------------------------------------------------------------------------

    @property
    def exploration(self) -> Exploration:
        """Record of the search so far."""
        sampled = self._moves or self._sampled
        return Exploration(
            modes=len(self.modes),
            sampled=len(self.modes) if sampled else 0,
            starts_solved=len(self.good),
            starts_failed=len(self.tried) - len(self.good),
            settled=sum(candidate.holds for candidate in self.settled),
            untried=sum(not held.tried and self._promised(held) < 1.0 - OPEN for held in _in_balance(self.settled)),
            exact_less=self.exact_less,
            pruned=dict(self._pruned),
        )

    @cached_property
    def bound(self) -> float | None:
        """Lower bound of the greatest normal force of any grasp [N], where the objective minimizes this force."""
        return least_normal_force_bound(self.scene) if self.scene.objective == "least_normal_force" else None

    @property
    def excess(self) -> float:
        """By what part the best grasp's greatest normal force is above what no grasp is below; zero without a bound."""
        if self.bound is None or self.best is None or self.bound <= 0.0:
            return 0.0
        return float(self.best.arrays["contact_forces"][:, 0].max()) / self.bound - 1.0

    @cached_property
    def impossible(self) -> bool:
        """Whether forces provably cannot balance the object, wherever fingers may touch it."""
        return cannot_balance(self.scene)

    @property
    def left_out(self) -> int:
        """Starts that were not tried or led to no grasp."""
        explored = self.exploration
        return explored.starts_failed + explored.untried + sum(explored.pruned.values())

    @property
    def proven(self) -> bool:
        """Whether no grasp is better than the best found by more than `NEAR`."""
        return bool(self.bound) and self.best is not None and self.excess <= NEAR

    def _tension(self, tried: Tried) -> float:
        return tension_of(self.scene, tried.arrays)

    @property
    def _least_difference(self) -> float:
        """Tension below which differences are rounding [N]: grasps may take none at all."""
        return SAME * sum(setup.max_tension for setup in self.scene.setups)

    # -- attempts ----------------------------------------------------------------------------------------------

    def _converge(self) -> None:
        """Go on from the best grasp, where its solver was stopped before its optimum; without a grasp from what came
        nearest to one when its iterations were used up.
        """
        cut = [tried.attempt for tried in self.tried if tried.attempt.spent and not self.good]
        for attempt in sorted(cut, key=lambda attempt: attempt.badness)[: self._effort.settled]:
            if self.budget.over:
                return
            self.attempt(attempt.start, features=attempt.features, x0=attempt.x, standstill=STANDSTILL)
        for options_at in range(1, len(OPTION_SETS)):
            best = self.best
            if best is None or best.attempt.optimal or self.budget.over:
                return
            attempt = best.attempt
            self.attempt(attempt.start, options_at=options_at, features=attempt.features, x0=attempt.x)

    def attempt(
        self,
        start: GraspStart,
        solver: GraspSolverRun | None = None,
        *,
        options_at: int = len(OPTION_SETS) - 1,
        **options: Any,
    ) -> Tried | None:
        """Solve from a start and verify a new result; None where there are no numbers to verify."""
        own = solver is None
        solver = solver or self.solver(start)
        fresh = "x0" not in options
        ended = (t for t in self.tried if t.attempt.converged or t.attempt.status is SolverStatus.INFEASIBLE)
        known = {t.attempt: t for t in ended if t.solver is solver and fresh}
        attempt = solver.run(self.scene, start, self.budget, options_at=options_at, known=list(known), **options)
        if not np.isfinite(attempt.x).all():
            return None
        if attempt in known:
            self._pruned[ALIKE] += 1
            return known[attempt]
        tried = Tried(attempt, solver, self.scene)
        if fresh and attempt.converged and not tried.verified:  # what the solver rounded, once more from there
            again = solver.run(self.scene, tried.start, self.budget, options_at=0)
            tried = Tried(again, solver, self.scene) if again.converged else tried
        self._noted(tried)
        if attempt.converged and own and self.keep_clear(tried.certificate):
            return self.attempt(start, options_at=options_at, **options)
        return tried

    def keep_clear(self, certificate: Certificate) -> bool:
        """From now on, keep fingers apart that are not in a grasp; whether there are new ones."""
        crossed = certificate.crossed - self.apart
        # Few grasps cross: what keeps fingers apart costs nothing before one does.
        self._keep_apart(crossed)
        if crossed:
            self.maps = SceneMaps(self.scene, self.maps, crossed)
            self.__dict__.pop("_settled_exactly", None)
        return bool(crossed)

    def keep_all_apart(self) -> None:
        """From now on, keep all fingers apart that could meet."""
        names = [setup.name for setup in self.scene.setups]
        self._keep_apart(frozenset((names[k], names[m]) for k, m in self.scene.pairs))

    def _keep_apart(self, names: frozenset[tuple[str, str]]) -> None:
        if not names <= self.apart:
            self.apart |= names
            self._solvers.clear()

    def adopt(self, relaxed: GraspAttempt) -> None:
        """Verify an attempt with limits relaxed by nothing, which is a grasp of the scene, though not its optimum."""
        solver = self.solver(relaxed.start)
        self._noted(Tried(solver.unrelaxed(self.scene, relaxed), solver, self.scene))

    def _noted(self, tried: Tried) -> Tried:
        self.tried.append(tried)
        if tried.verified:
            self.good.append(tried)
        self.budget.tell(self._standing)
        return tried

    @property
    def _standing(self) -> str:
        """The best so far, what was tried, and how much longer it may take."""
        best = self.best
        left = self.budget.left
        spent = sum(tried.attempt.iterations for tried in self.tried)
        held = "no grasp yet" if best is None else f"{amount_text(self._tension(best), 'N', '.4g')} so far"
        seconds = max(left, 0.0) * sum(tried.attempt.seconds for tried in self.tried) / max(spent, 1)
        seconds = max(0.0, min(seconds, self.budget.until - time.monotonic()))
        return f"{held}; {len(self.tried)} starts tried, {seconds:.2g} s left at most"

    def solver(self, start: GraspStart) -> GraspSolverRun:
        """The solver for a start's contacts."""
        began = time.perf_counter()
        contacts = tuple((name, contact.part) for name, contact in start.contacts.items())
        if contacts not in self._solvers:
            self._solvers[contacts] = GraspSolverRun.of(self.scene, start.contacts, self.apart)
            self._solvers[contacts].prepare(self.scene)
        self.build_seconds += time.perf_counter() - began
        return self._solvers[contacts]


def _promise(start: GraspStart) -> tuple[bool, bool, bool, float]:
    """Order of starts: those that hold exactly, those that nearly do, spare ones, and the others by what they leave."""
    missed = start.imbalance > SETTLED
    return missed, start.is_spare, start.imbalance >= BALANCED, start.imbalance if missed else start.estimate


def _in_balance(candidates: list[Candidate]) -> list[Candidate]:
    """Candidates that hold the object, to rounding."""
    return [candidate for candidate in candidates if candidate.holds and candidate.start.imbalance < BALANCED]
