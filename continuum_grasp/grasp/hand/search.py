"""The search for the grasp of a hand: postures, the forces that go with them, and the solver."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.base import interrupts_held
from continuum_grasp.grasp.hand.numbers import ForceRows
from continuum_grasp.grasp.hand.parts import RELAXED
from continuum_grasp.grasp.hand.problem import HandProblem, HandSpec, hand_problem
from continuum_grasp.grasp.hand.ranked import HandStart, HandStarts
from continuum_grasp.grasp.hand.starts import TouchingPosture
from continuum_grasp.grasp.problem.solver_run import allowed_depth, settings_of, solve_clear
from continuum_grasp.grasp.problem.values import Values
from continuum_grasp.nlp import Attempt, Budget, Start
from continuum_grasp.scene import HandScene

LEFT, LOST = 0.5, 1.0
"""Residual, scaled, that the best forces of a start may leave where a grasp is known, and where none is, but for the
first start of each set of contacts: of 30 random hands, starts that led to a grasp leave 0.002 to 0.20, and 14 with
0.5 to 3.2 led to none."""
SOLVED = {"quick": 1, "normal": 3, "thorough": 12}
"""Combinations of each set of contacts that are solved, by effort."""
PATIENCE = 20
"""Iterations that may leave a violation as it is until it is half of what it was; a run ends then. Those that lead to a
grasp take 5 to 45 in all."""
EFFORT = 1e-3
"""Weight of the tensions beside a limit that is relaxed, so that they are unique."""
FAR = 1e-3
"""Violation, in units of the problem, above which a run does not begin with the multipliers of the one before."""
SETTLED = 1e-7
"""By how much cubics may miss the object at contacts, per length or in its normals; the certificate allows ten
times that."""
IDLE = 1e-3
"""Normal force, per greatest, below which a contact holds nothing."""


@dataclass(frozen=True)
class HandTried:
    """A start that was solved."""

    on: frozenset[str]  # names of the contacts
    chosen: tuple[TouchingPosture, ...]
    attempt: Attempt
    numbers: Array  # of the last run
    arrays: dict[str, Array]
    problem: HandProblem

    @property
    def tension(self) -> float:
        """Sum of the tensions [N]."""
        return float(sum(value.sum() for name, value in self.arrays.items() if name.endswith(".tensions")))


class HandSearch:
    """Grasps of a scene, one set of contacts after the other."""

    def __init__(self, scene: HandScene, budget: Budget) -> None:
        self.scene = scene
        self.budget = budget
        self._starts = HandStarts(scene)
        self.points = self._starts.points
        self.units = self.points.units
        self._solver = settings_of(scene).solver()
        self._met = dict[HandSpec, list[Array]]()  # solutions of first runs by structure
        self._begun = set[tuple[frozenset[str], tuple[TouchingPosture, ...]]]()  # solved starts
        self.held = False  # whether a grasp was found that is as the scene asks

    @property
    def untouched(self) -> dict[frozenset[str], list[str]]:
        """Fingers that touch the object in no posture, by set of contacts."""
        return self._starts.untouched

    # -- sets of contacts ----------------------------------------------------------------------------------------

    def run(self, *, further: bool = True) -> Iterator[HandTried]:
        """Solve the likeliest start of each set of contacts, then the next of each, until ``held`` is set.

        If no start of a normal search gives a grasp, solve ``further`` likely starts of a thorough search.
        """
        effort = self.scene.solver.effort
        yield from self._run(effort)
        if effort == "normal" and further and not self.held:
            self.budget.tell("no grasp yet; trying more starts")
            yield from self._run("thorough", LEFT)

    @property
    def agreed(self) -> bool:
        """Whether a search of the greatest effort is complete."""
        return self.scene.solver.effort != "quick" and not self.budget.cut

    def _run(self, effort: str, most: float = np.inf) -> Iterator[HandTried]:
        """A search of some effort, from starts that leave no more than a residual."""
        thorough = self.scene.solver.effort == "thorough"
        for modes in self._starts.once_and_twice:
            if self.held and not thorough:
                return
            touching = {on: self._starts.candidates(on, effort) for on in modes}
            ranked = [self._starts.ranked([touching[on]]) for on in modes]
            mixed = list[HandStart]()
            for n in range(SOLVED[effort]):
                yield from self._round(ranked, n, most)
                if self.held and not thorough:
                    break
                if n == 0 and len(modes) > 1:
                    # Mix kinds of contacts across fingers if one kind alone holds nothing.
                    mixed = self._starts.ranked(list(touching.values()))
                yield from self._round([mixed], n, most)

    def _round(self, ranked: Sequence[Sequence[HandStart]], n: int, most: float) -> Iterator[HandTried]:
        """Solve the n-th start of some sets of contacts, the likeliest first, without those that are not likely or were
        solved before.
        """
        for start in sorted((each[n] for each in ranked if n < len(each)), key=lambda start: start.left):
            likely = LEFT if self.held else LOST if n else np.inf
            known = (start.on, start.chosen) in self._begun
            if not known and start.left <= most and (start.left <= likely or self.scene.solver.effort == "thorough"):
                self._begun.add((start.on, start.chosen))
                yield from self._tried(start)

    def _tried(self, start: HandStart) -> Iterator[HandTried]:
        """Grasps from a start, with all contacts and without those that are idle."""
        if self.budget.over:
            return
        on, chosen = start.on, start.chosen
        problem = hand_problem(HandSpec.of(self.scene, on))
        tried = self._solve(problem, on, chosen, *self.points.start(problem, chosen))
        if tried.attempt.known:
            return
        lighter = self._without_idle(tried) if tried.attempt.converged else None
        # Palm or table that carries nothing would count as what holds the object in place.
        if lighter is None or not lighter.attempt.converged or not tried.problem.spec.carried:
            yield tried
        if lighter is not None:
            yield lighter

    def _without_idle(self, tried: HandTried) -> HandTried | None:
        """A grasp without contacts that press nothing, where the scene leaves them to choose; None where all press."""
        auto = {name for setup in self.scene.setups for name, state in setup.switches.items() if state == "auto"}
        forces, normals = tried.arrays["contact_forces"], tried.arrays["contact_normals"]
        pressing = dict(zip(tried.arrays["contact_names"].tolist(), (forces * normals).sum(axis=1), strict=True))
        least = IDLE * max(pressing.values())
        idle = {name for name in auto & tried.on if pressing[name] <= least}
        for contact in self.scene.support_contacts:  # the rounded apex of a cone leaves a force that grows as 1 / mu
            friction = pressing.get(contact.name, 0.0) * contact.support.friction
            idle |= {contact.name} if friction <= max(least, IDLE * self.scene.weight) else set()
        on = tried.on - idle
        if on == tried.on:
            return None
        lighter = hand_problem(replace(HandSpec.of(self.scene, on), pairs=tried.problem.spec.pairs))
        x, p = self.points.start(lighter, tried.chosen)
        before, after = tried.problem, lighter
        for name in before.x.at.keys() & after.x.at.keys():
            x[after.x.at[name]] = tried.attempt.x[before.x.at[name]]
        return self._solve(lighter, on, tried.chosen, x, self.points.near(lighter, x, p))

    def left(self, tried: HandTried) -> float:
        """Residual that the best forces leave where a run began, with the limits of this scene."""
        rows = ForceRows.of(self.scene, tried.problem, *self.points.at(tried.problem, tried.chosen))
        return rows.best(self.scene)[0]

    def relaxed(self, tried: HandTried, limit: str, eased: HandSearch, amount: float) -> tuple[HandTried, float]:
        """The nearest point with a limit relaxed as little as can be, and by how much, in units of the problem.

        The search starts from the forces of another search whose limit is ``eased`` by an amount.
        """
        problem = tried.problem
        x, _ = eased.points.start(problem, tried.chosen)
        _, p = self.points.at(problem, tried.chosen)
        p[problem.numbers.at["effort weight"]] = EFFORT
        p[problem.numbers.at["relaxation weights"]] = np.array([1.0 if name == limit else 0.0 for name in RELAXED])
        at = problem.x.at[f"relaxed {limit}"]
        x[at] = amount
        found = self._solve(problem, tried.on, tried.chosen, x, p, limit)
        return found, float(found.attempt.x[at][0])

    def again(self, tried: HandTried) -> HandTried:
        """Solve from a point that was found, with the numbers of this scene."""
        problem = tried.problem
        _, p = self.points.at(problem, tried.chosen)
        x = tried.attempt.x.copy()
        for name in RELAXED:
            x[problem.x.at[f"relaxed {name}"]] = 0.0
        return self._solve(tried.problem, tried.on, tried.chosen, x, p)

    def next_to(self, tried: HandTried, problem: HandProblem, numbers: Values) -> HandTried:
        """Solve other equations of the same unknowns, with some numbers, from a point that was found."""
        _, p = self.points.at(problem, tried.chosen)
        p = self.points.near(problem, tried.attempt.x, p)
        for name, value in numbers.items():
            p[problem.numbers.at[name]] = value
        return self._solve(problem, tried.on, tried.chosen, tried.attempt.x, p)

    def arrays_at(self, tried: HandTried, x: Array) -> dict[str, Array]:
        """Stored arrays (SI) of a point beside one that was found."""
        return self.points.arrays(tried.problem, x, tried.numbers)

    # -- the solver ----------------------------------------------------------------------------------------------

    def _solve(
        self,
        problem: HandProblem,
        on: frozenset[str],
        chosen: tuple[TouchingPosture, ...],
        x: Array,
        p: Array,
        relaxed: str = "",
    ) -> HandTried:
        """Solve from a start, laying planes anew until no place of a finger is in the object."""
        depth = allowed_depth(self.scene)

        def look(x: Array, numbers: Array) -> tuple[float, Array]:
            near = self.points.near(problem, x, numbers)
            # Where contacts have moved, the cubics have to follow.
            settled = self.points.misses(problem, x, numbers, near) < SETTLED
            return self.points.depth(problem, x, near) if settled else np.inf, near

        lower, upper = problem.rows.bounds()
        bounds = self.points.bounds(problem, relaxed)
        start = Start(x, *bounds, lower, upper, p, patience=PATIENCE, standstill=PATIENCE // 2)
        known = [] if relaxed else self._met.setdefault(problem.spec, [])

        def run(start: Start, budget: Budget) -> Attempt:
            if start.p is p:
                found = self._solver.solve(problem.nlp, replace(start, known=tuple(known)), budget)
                if found.converged:
                    known.append(found.x)
                return found
            # Where places that were not looked at are in the object, multipliers mislead.
            if start.multipliers is not None and self._violated(problem, start) > FAR:
                start = replace(start, multipliers=None)
            return self._solver.solve(problem.nlp, start, budget)

        with interrupts_held(quietly=True):
            attempt, numbers = solve_clear(
                run,
                problem.nlp,
                start,
                look,
                depth,
                self.budget,
                self.scene.solver.max_iterations,
            )
        crossed = self.points.crossed(problem, attempt.x, numbers) if attempt.converged else ()
        if set(crossed) <= set(problem.spec.pairs):
            arrays = self.points.arrays(problem, attempt.x, numbers)
            return HandTried(on, chosen, attempt, numbers, arrays, problem)
        # Once more, with these fingers clear of each other.
        pairs = tuple(sorted({*problem.spec.pairs, *crossed}))
        wider = hand_problem(replace(problem.spec, pairs=pairs))
        x = wider.x.pack({name: attempt.x[at] for name, at in problem.x.at.items()}, 0.0)
        p = wider.numbers.pack({name: numbers[at] for name, at in problem.numbers.at.items()}, 0.0)
        return self._solve(wider, on, chosen, x, self.points.near(wider, x, p), relaxed)

    @staticmethod
    def _violated(problem: HandProblem, start: Start) -> float:
        """By how much a start violates the constraints."""
        return start.violation(start.x, np.array(problem.nlp.values(start.x, start.p)[1]).ravel())
