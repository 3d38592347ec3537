"""Starts are solved as problems of exact rods, until fingers are clear and contacts are as exact as the object."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods.answers import AskedAnswers, tangent_of
from continuum_grasp.grasp.rods.carried import carried, finer_pairs, finer_places
from continuum_grasp.grasp.rods.clearance import CROSSED, Crossing, deep_places, table_misses, touched_places
from continuum_grasp.grasp.rods.guess import FingerGuess, Held, filled
from continuum_grasp.grasp.rods.numbers import SceneNumbers
from continuum_grasp.grasp.rods.problem import STAGES, GraspRods, NearPair, StagePlace
from continuum_grasp.grasp.values import PUSH_SHARE
from continuum_grasp.nlp import Attempt, Budget, Settings, Solver

STARTS = 6
"""Starts that are solved."""
ROUNDS = 3
"""Most solves in which rows are added between nodes."""
FINER = 3
"""Most solves with finer tables at the contacts."""
BORNE = 1e-6
"""Sum of forces and moments that nothing bears, up to which a grasp holds [F0]."""
TIED = 1e-6
"""Share of the aim up to which two grasps are the same."""
FINE = 0.1
"""Step of the tables at contacts, per half thickness of the thinnest finger."""
PRESSED = 0.01
"""Normal force with which contacts of an object without load press at first, per greatest one."""
_NEAR_BOUNDS = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
TUNING = {
    "mu_init": 1e-5,
    "acceptable_tol": 1e-7,
    "mumps_pivtol": 1e-6,
    **dict.fromkeys(_NEAR_BOUNDS, 1e-4),
}
"""Options of IPOPT: starts are near a solution, whose barrier and distance from bounds they keep."""


def rods_solver(iterations: int) -> Solver:
    """IPOPT, set up for rods."""
    settings = Settings(tolerance=1e-9, constraint_tolerance=1e-9, max_iterations=iterations, tuning={"ipopt": TUNING})
    return settings.solver()


class RodStart(ABC):
    """Start of a problem of rods.

    Attributes
    ----------
    on
        Names of the contacts.
    places
        Places of the contacts, or of what else says how far starts are apart [m].
    imbalance
        What nothing bears of it, in a unit of its search.
    aim
        Aim of the scene that it promises.
    """

    on: frozenset[str]
    places: Array
    imbalance: float
    aim: float

    @abstractmethod
    def changed(self, scene: Any) -> RodStart:
        """The start in a scene with other limits, or other places of its bases."""

    @property
    @abstractmethod
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""

    @property
    @abstractmethod
    def guesses(self) -> Sequence[FingerGuess]:
        """Knowledge about each finger."""

    @property
    @abstractmethod
    def supports(self) -> Held:
        """Forces of supports by name [F0]."""

    @property
    def joints(self) -> list[tuple[float, ...]]:
        """Approximate places of the middle contacts of each finger [L]."""
        return [guess.middles for guess in self.guesses]

    def x_of(self, problem: GraspRods) -> Array:
        """Unknowns of the start."""
        return filled(problem, self.guesses, self.supports)


@dataclass(frozen=True, eq=False)
class RodGrasp:
    """A solution of the problem of rods."""

    problem: GraspRods
    attempt: Attempt
    start: RodStart
    crosses: bool

    @property
    def fine(self) -> bool:
        """Whether the grasp was solved with fine stages and tables."""
        return self.problem.fine

    @property
    def tension(self) -> float:
        """Sum of all tensions [N]."""
        return self.problem.tension(self.attempt.x)

    @property
    def holds(self) -> bool:
        """Whether the grasp holds the object."""
        return self.attempt.converged and self.problem.unborne(self.attempt.x) < BORNE and not self.crosses


class StartedSearch(ABC):
    """Finds grasps as exact rods, from starts of any kind."""

    apart: float
    """Distance of places from which on starts are different [m]."""
    iterations: int = 120
    """Most iterations of a solve."""
    likely: float = np.inf
    """Imbalance of starts beyond which they are left out if there is a grasp already."""

    def __init__(self, budget: Budget, stages: int = STAGES) -> None:
        self.budget, self.stages = budget, stages
        self.tried: list[RodGrasp] = []
        self._promising: list[RodStart] = []
        self._solver = rods_solver(self.iterations)

    @cached_property
    @abstractmethod
    def starts(self) -> list[RodStart]:
        """All starts, the most promising first."""

    @property
    def further(self) -> list[RodStart]:
        """Starts where none of the others leads to a grasp."""
        return []

    @property
    def asked(self) -> AskedAnswers | None:
        """Answers to loads that the scene asks for; None where it asks for none."""
        return None

    @property
    def best(self) -> RodGrasp | None:
        """The grasp with the least aim."""
        held = [grasp for grasp in self.tried if grasp.holds]
        return min(held, key=lambda grasp: grasp.attempt.objective, default=None)

    def run(self, most: int = STARTS) -> None:
        """Solve from the most promising starts; from further ones if none of these leads to a grasp.

        The best grasp is solved again as exactly as it can be, and the next one if that is better then.
        """
        self._try(self.starts, most)
        if self.best is None:
            self._try(self.further, most)
        if (asked := self.asked) is not None:
            self.tried = self.answered(asked)
        while (best := self.best) is not None and not best.fine and not self.budget.over:
            self.tried[self.tried.index(best)] = self.solved(best.start, asked, best)

    def answered(self, asked: AskedAnswers, *, fine: bool = False) -> list[RodGrasp]:
        """Grasps that answer loads as asked: the ones that hold, where they do, and solutions beside them."""
        first = sorted((grasp for grasp in self.tried if grasp.holds), key=lambda grasp: grasp.attempt.objective)
        return [
            grasp if asked.met(grasp.problem, grasp.attempt.x) else self.solved(grasp.start, asked, grasp, fine=fine)
            for grasp in first
            if not self.budget.over
        ]

    def share_of_greatest_push(self, most: float) -> AskedAnswers | None:
        """Push that a grasp of an object without load bears: a share of the greatest one near the grasps found.

        ``most`` is the greatest normal force [N]. None where no grasp bears a push.
        """

        def press(problem: GraspRods) -> None:
            """Let no contact bear nothing: such a grasp has no answer to a push."""
            for name, held in problem.contacts.items():
                force = problem.numbers.unit(name) * problem.numbers.force
                problem.bound(held[0], low=PRESSED * most / force)

        self.tried = [self.solved(g.start, press, g, fine=False) for g in self.tried if g.holds]
        grasps = [grasp for grasp in self.answered(AskedAnswers(push_aim=1.0 / most, tension=1e-5)) if grasp.holds]
        tangents = [tangent_of(grasp.problem, grasp.attempt.x) for grasp in grasps]
        greatest = max((tangent.push for tangent in tangents if tangent is not None), default=0.0)
        return AskedAnswers(push=PUSH_SHARE * greatest) if greatest else None

    def agree(self, share: float) -> bool:
        """Whether the most promising starts and those of other places lead to the same aim, within a share."""
        ends = []
        for chosen in (True, False):
            aims = [g.attempt.objective for g in self.tried if g.holds and (g.start in self._promising) is chosen]
            ends.append(min(aims, default=np.inf))
        return bool(np.isfinite(ends).all() and abs(ends[0] - ends[1]) <= share * abs(min(ends)))

    def _try(self, starts: Sequence[RodStart], most: int) -> None:
        for start in self._chosen(starts, most):
            if self.budget.over:
                return
            if start.imbalance > self.likely and self.best is not None:
                continue
            self.tried.append(self.solved(start, fine=False))

    def _chosen(self, starts: Sequence[RodStart], most: int) -> Iterator[RodStart]:
        """The most promising starts; of different places of contacts where there are as many."""
        different, left = list[RodStart](), list[RodStart]()
        for start in starts:
            alike = (one.on == start.on and np.linalg.norm(one.places - start.places) < self.apart for one in different)
            (left if any(alike) else different).append(start)
        half = (most + 1) // 2
        best = starts[:half]
        self._promising = list(best)
        others = [start for start in different if not any(start is one for one in best)]
        yield from best
        yield from others[: most - len(best)]

    def solved(
        self,
        start: RodStart,
        widen: Callable[[GraspRods], None] | None = None,
        beside: RodGrasp | None = None,
        *,
        fine: bool = True,
    ) -> RodGrasp:
        """Solve from a start, or from a grasp with other limits ``beside`` it, with a limit widened if one is given.

        Solve again with rows where a finger is in the object between nodes, or crosses another, and, if the grasp is to
        be ``fine``, with finer tables where contacts are not as exact as the object.
        """
        places, near, known = list[StagePlace](), list[NearPair](), beside
        if beside is not None:
            times = beside.problem.geometry.finer if fine and not beside.fine else 1
            places, near = finer_places(beside.problem.places, times), finer_pairs(beside.problem.near, times)
        numbers, rounds, finer = start.numbers, 0, 0
        while True:
            problem = GraspRods(numbers, joints=start.joints, stages=self.stages, places=places, near=near, fine=fine)
            if widen is not None:
                widen(problem)
            first = start.x_of(problem) if known is None else carried(known.problem, known.attempt.x, problem)
            problem.fill(first)
            attempt = self._solver.solve(problem.nlp, problem.start(first), self.budget)
            crossing = Crossing(problem, attempt.x)
            grasp = RodGrasp(problem, attempt, start, crossing.depth > CROSSED)
            if not attempt.converged or problem.unborne(attempt.x) > BORNE:
                return grasp
            if grasp.crosses:
                if rounds == ROUNDS:
                    return grasp
                # From the sample: a solution that crosses does not come apart.
                sample = Crossing(problem, start.x_of(problem))
                near = list(dict.fromkeys([*near, *sample.near, *crossing.near]))
                known, rounds = None, rounds + 1
                continue
            deep = [place for place in deep_places(problem, attempt.x) if place not in places]
            if deep and rounds < ROUNDS:
                places += deep
                known, rounds = grasp, rounds + 1
                continue
            if not fine or finer == FINER or not table_misses(problem, attempt.x):
                return grasp
            thin = min(float(finger.half(0.0)) * finger.length for finger in numbers.fingers)
            table = numbers.table.refined(touched_places(problem, attempt.x), FINE * thin / numbers.size)
            numbers, known, finer = replace(numbers, table=table), grasp, finer + 1
