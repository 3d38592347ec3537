"""The search: combinations of all fingers' equilibria are the starts; each is solved as a problem of exact rods."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.finger_map import Place, SceneMaps, places_of
from continuum_grasp.grasp.finger_map.balance import ObjectBalance, Settled
from continuum_grasp.grasp.finger_map.fill import FingerMap
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.rods.clearance import CROSSED, Crossing, deep_places
from continuum_grasp.grasp.rods.numbers import SceneNumbers, table_of
from continuum_grasp.grasp.rods.problem import GraspRods, NearPair, StagePlace
from continuum_grasp.nlp import Attempt, Budget, Settings, Solver
from continuum_grasp.scene import GraspScene

STARTS = 6
"""Starts that are solved."""
PLACES = 5
"""Places of object and bases that are sampled with a set of contacts."""
ROUNDS = 3
"""Most solves in which rows are added between nodes."""
BORNE = 1e-6
"""Sum of forces and moments that nothing bears, up to which a grasp holds [F0]."""
TIED = 1e-6
"""Share of the aim up to which two grasps are the same."""
_NEAR_BOUNDS = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
TUNING = {
    "mu_init": 1e-5,
    "acceptable_tol": 1e-7,
    "mumps_pivtol": 1e-6,
    **dict.fromkeys(_NEAR_BOUNDS, 1e-4),
}
"""Options of IPOPT: starts are near a solution, whose barrier and distance from bounds they keep."""


def rods_solver() -> Solver:
    """IPOPT, set up for rods."""
    settings = Settings(tolerance=1e-9, constraint_tolerance=1e-9, max_iterations=120, tuning={"ipopt": TUNING})
    return settings.solver()


@dataclass(frozen=True, eq=False)
class RodStart:
    """A settled combination of samples, with what it promises."""

    case: Case
    x: Array
    imbalance: float
    aim: float
    places: Array  # of the contacts [m]


@dataclass(frozen=True, eq=False)
class RodGrasp:
    """A solution of the problem of rods."""

    problem: GraspRods
    attempt: Attempt
    start: RodStart
    crosses: bool

    @property
    def tension(self) -> float:
        """Sum of all tensions [N]."""
        return self.problem.tension(self.attempt.x)

    @property
    def holds(self) -> bool:
        """Whether it holds the object."""
        return self.attempt.converged and self.problem.unborne(self.attempt.x) < BORNE and not self.crosses


class Case:
    """A set of contacts at one place of the object and of the bases."""

    def __init__(self, search: RodSearch, on: frozenset[str], place: Place) -> None:
        self.search, self.on, self.place = search, on, place
        self._scene = search.scene

    def changed(self, scene: GraspScene, place: Place) -> Case:
        """The case in a scene with other limits at another place, with the same starts."""
        made = Case(self.search, self.on, place)
        made._scene, made.balance = scene, self.balance
        return made

    @cached_property
    def _maps(self) -> list[FingerMap]:
        """Maps of the fingers."""
        pose, bases = self.place
        pairs = zip(self.search.scene.setups, bases, strict=True)
        return [self.search.maps.map_of(setup.name, base, pose, self.on, exact=True) for setup, base in pairs]

    @cached_property
    def balance(self) -> ObjectBalance:
        """The balance of the object, as samples of the maps are combined."""
        return ObjectBalance(self.search.scene, self.on, [one.finger for one in self._maps], self.place[0])

    @cached_property
    def numbers(self) -> SceneNumbers:
        """The scene in plain numbers."""
        return SceneNumbers.of(self._scene, self.on, self.place, self.balance.force, self.search.table)

    @property
    def starts(self) -> list[RodStart]:
        """Settled combinations: those that hold, or the ones that come nearest to it."""
        x = self.balance.candidates(self._maps)
        if not len(x):
            return []
        settled = self.balance.settle(x)
        size = self.search.scene.object.size
        rows = settled.holding(size)
        nearest = [] if rows else settled.nearest(size)[:STARTS]
        return [self._start(settled, row) for row in (*rows, *nearest)]

    def _start(self, settled: Settled, row: int) -> RodStart:
        aims, x = self.search.scene.weights, settled.x[row]
        aim = max(aims.least_tension, 1e-5) * float(settled.tension[row]) / self.balance.greatest
        if aims.greatest_friction_margin:
            traced = self.balance.traced(x[None], slopes=False)
            normal, along = (part[0] for part in self.balance.forces(x[None], traced))
            friction = np.array([self.search.scene.held_friction(name) for name in self.names])
            free = 1.0 - np.abs(along) / np.maximum(friction * normal, 1e-9 * self.balance.force)
            aim -= aims.greatest_friction_margin * float(np.clip(free, 0.0, 1.0).min())
        return RodStart(self, x, float(settled.off[row]), aim, settled.places[row])

    @property
    def names(self) -> list[str]:
        """Contacts in the order of `ObjectBalance.forces`."""
        return [*(name for names in self.balance.names for name in names), *self.balance.supports]

    def x_of(self, problem: GraspRods, start: RodStart) -> Array:
        """Unknowns of a start."""
        at, x = self.balance.at, start.x
        shots = [x[i:j] for i, j in itertools.pairwise(at)]
        return problem.x_of(shots, x[at[-1] : self.balance.first_lift])


class RodSearch:
    """Finds grasps of a planar scene as exact rods."""

    def __init__(self, scene: GraspScene, budget: Budget, stages: int = 24) -> None:
        self.scene, self.budget, self.stages = scene, budget, stages
        self.maps = SceneMaps(scene)
        self.tried: list[RodGrasp] = []
        self._solver = rods_solver()

    @cached_property
    def table(self) -> DistanceTable:
        """Distances of the object."""
        return table_of(self.scene)

    @property
    def best(self) -> RodGrasp | None:
        """The grasp with the least aim."""
        held = [grasp for grasp in self.tried if grasp.holds]
        return min(held, key=lambda grasp: grasp.attempt.objective, default=None)

    @cached_property
    def starts(self) -> list[RodStart]:
        """All starts, the most promising first."""
        cases = (
            Case(self, on, place) for on in contact_modes(self.scene) for place in places_of(self.scene, on)[:PLACES]
        )
        found = [start for case in cases for start in case.starts]
        # 4e-3: imbalance up to which a combination holds
        return sorted(
            found, key=lambda start: (start.imbalance > 4e-3, start.imbalance if start.imbalance > 4e-3 else start.aim)
        )

    def run(self, most: int = STARTS) -> None:
        """Solve from the most promising starts."""
        for start in self._chosen(most):
            if self.budget.over:
                return
            self.tried.append(self.solved(start))

    def _chosen(self, most: int) -> Iterator[RodStart]:
        """The most promising starts; of different places of contacts where there are as many."""
        apart = 0.25 * self.scene.object.size
        chosen, left = list[RodStart](), list[RodStart]()
        for start in self.starts:
            alike = (
                one.case.on == start.case.on and np.linalg.norm(one.places - start.places) < apart for one in chosen
            )
            (left if any(alike) else chosen).append(start)
        half = (most + 1) // 2
        best = self.starts[:half]
        others = [start for start in chosen if not any(start is one for one in best)]
        yield from best
        yield from others[: most - len(best)]

    def solved(self, start: RodStart, widen: Callable[[GraspRods], None] | None = None) -> RodGrasp:
        """Solve from a start, with a limit widened where that is given.

        Where a finger is in the object between nodes, or crosses another, it is solved again with rows there.
        """
        places, near = list[StagePlace](), list[NearPair]()
        case, x = start.case, None
        for _ in range(ROUNDS + 1):
            problem = GraspRods(case.numbers, stages=self.stages, places=places, near=near)
            if widen is not None:
                widen(problem)
            first = case.x_of(problem, start) if x is None else x
            attempt = self._solver.solve(problem.nlp, problem.start(first), self.budget)
            crossing = Crossing(problem, attempt.x)
            grasp = RodGrasp(problem, attempt, start, crossing.depth > CROSSED)
            if not attempt.converged or problem.unborne(attempt.x) > BORNE:
                break
            if grasp.crosses:
                # From the sample: a solution that crosses does not come apart.
                sample = Crossing(problem, case.x_of(problem, start))
                near = list(dict.fromkeys([*near, *sample.near, *crossing.near]))
                x = None
                continue
            deep = [place for place in deep_places(problem, attempt.x) if place not in places]
            if not deep:
                break
            places += deep
            x = attempt.x
        return grasp
