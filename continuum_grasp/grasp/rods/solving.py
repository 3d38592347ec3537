"""Starts are solved as problems of exact rods, until fingers are clear and contacts are as exact as the object."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from continuum_grasp.base import Array, amount_text
from continuum_grasp.grasp.rods.answers import AskedAnswers, steady_of, tangent_of
from continuum_grasp.grasp.rods.carried import carried, finer_pairs, finer_places
from continuum_grasp.grasp.rods.clearance import CROSSED, Crossing, deep_places, table_misses, touched_places
from continuum_grasp.grasp.rods.guess import FingerGuess, Held, filled
from continuum_grasp.grasp.rods.numbers import SceneNumbers
from continuum_grasp.grasp.rods.places import NearPair, StagePlace
from continuum_grasp.grasp.rods.problem import STAGES, GraspRods
from continuum_grasp.grasp.rods.supports import SupportNumbers, rested
from continuum_grasp.grasp.values import NEAR, PUSH_SHARE
from continuum_grasp.nlp import Attempt, Budget, Settings, Solver, SolverStatus

STARTS = 6
"""Starts that are solved."""
NEARLY = 0.5
"""Imbalance of a start, in a unit of its search, up to which it nearly balances the object."""
ROUNDS = 3
"""Most solves in which rows are added between nodes."""
FINER = 5
"""Most solves with finer tables at the contacts."""
SHRINKS = 0.2
"""Factor on the step of a table at a contact that still misses the object [1]."""
WIDER = 1.5
"""Factor on the step of a table with which a solve fails [1]: a jar of 72 chords converges with 0.03 per half
thickness, and not with 0.02 (`docs/grasp_an_object.md`)."""
RESTS = 6
"""Most solves in which supports touch the object anew."""
RESTED = 1e-8
"""Distance by which contacts with supports may move without being taken anew [object size]."""
BORNE = 1e-6
"""Sum of forces and moments that nothing bears, up to which a grasp holds [F0]."""
RESUMED = 0.01
"""Sum of forces and moments that nothing bears at the iteration limit, from which a solve is resumed [F0]: without it,
`gear` of the shipped scenes has no grasp."""
SAME_AIM = 1e-4
"""Share of an aim up to which two starts lead to the same grasp."""
AGREE = 0.01
"""Share of an aim by which the two choices of starts of three fingers may differ."""
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
    imbalance
        What nothing bears of it, in a unit of its search.
    aim
        Aim of the scene that it promises.
    """

    on: frozenset[str]
    imbalance: float
    aim: float

    @cached_property
    def places(self) -> Array:
        """Places of the contacts, or of what else says how far starts are apart [m]."""
        raise NotImplementedError

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
        return [guess.joints for guess in self.guesses]

    def supports_at(self, pose: Array) -> list[SupportNumbers]:
        """The supports of the scene as they touch the object at a pose."""
        return self.numbers.supports

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
    rough: float | None = None
    """Objective before the grasp was solved with fine tables; None: that was not tried."""
    variant: Callable[[GraspRods], None] | None = None
    """Change of the scene's problem whose solution this is; None: the problem as it is."""

    @property
    def compared(self) -> float:
        """Objective with which starts are compared: of one table for all, since tables change it by up to 1 %."""
        return self.attempt.objective if self.rough is None else self.rough

    @property
    def fine(self) -> bool:
        """Whether the grasp was solved with fine stages and tables."""
        return self.problem.fine

    @property
    def tension(self) -> float:
        """Sum of all tensions [N]."""
        return self.problem.tension(self.attempt.x)

    @property
    def unborne(self) -> float:
        """Sum of the forces and moments that nothing bears [N]; moments count per size of the object."""
        return self.problem.unborne(self.attempt.x) * self.problem.numbers.force

    @property
    def holds(self) -> bool:
        """Whether the grasp holds the object."""
        return self.attempt.converged and self.problem.unborne(self.attempt.x) < BORNE and not self.crosses

    @property
    def is_stable(self) -> bool:
        """Whether every small motion of the grasp raises the energy."""
        tangent = tangent_of(self.problem, self.attempt.x)
        return tangent is not None and tangent.stable

    @property
    def greatest_normal_force(self) -> float:
        """Greatest normal force of a contact [N]."""
        unit, x = self.problem.numbers.unit, self.attempt.x
        forces = (unit(name) * float(x[held[0]]) for name, held in self.problem.contacts.items())
        return self.problem.numbers.force * max(forces, default=0.0)

    def meets(self, asked: AskedAnswers) -> bool:
        """Whether the grasp holds the object, and answers loads as asked."""
        return self.holds and asked.met(self.problem, self.attempt.x)


class StartedSearch(ABC):
    """Finds grasps as exact rods, from starts of any kind."""

    scene: Any
    """The scene whose grasps are sought."""
    apart: float
    """Distance of places from which on starts are different [m]."""
    iterations: int = 80
    """Most iterations of a solve: of 60 random scenes that hold, the best grasps take 5 to 40."""
    promised: float = np.inf
    """Share by which the aim that a start promises may be above the best one, once several starts agree."""
    likely: float = np.inf
    """Imbalance of starts beyond which they are left out if there is a grasp already."""

    def __init__(self, budget: Budget, stages: int = STAGES) -> None:
        self.budget, self.stages = budget, stages
        self.tried: list[RodGrasp] = []
        self._promising: list[RodStart] = []
        self._answering: AskedAnswers | None = None
        self.greatest_push: float | None = None  # where nothing loads the object [N]
        self.yielding = list[RodGrasp]()  # grasps where none bears the push that the scene states
        self.aimed = True  # whether grasps were found for the objective
        self._solver = rods_solver(self.iterations)

    @cached_property
    @abstractmethod
    def starts(self) -> list[RodStart]:
        """All starts, the most promising first."""

    @abstractmethod
    def again(self, scene: Any) -> StartedSearch:
        """A search of a changed scene."""

    def with_contacts(self, scene: Any) -> StartedSearch:
        """A search of the scene with other contacts."""
        return self.again(scene)

    def with_free_contacts(self) -> dict[str, Any]:
        """Changes of keys of the scene that leave all contacts of fingers to the search; none where they are."""
        changes = dict[str, Any]()
        for setup in self.scene.setups:
            own = setup.finger.contacts.stated()
            where = {key: f"{setup.where}.contacts" if key in own else "contacts" for key in ("middle", "tip")}
            if setup.tip != "auto":
                changes[f"{where['tip']}.tip"] = "auto"
            if not setup.stations and set(setup.middles) != {"auto"}:
                count = len(setup.middles)
                changes[f"{where['middle']}.middle"] = "auto" if count == 1 else ("auto",) * count
        return changes

    def needs_free(self, key: str, on: frozenset[str]) -> bool:
        """Whether a key of contacts must leave them to the search for a set of contacts."""
        for setup in self.scene.setups:
            if not key.startswith(("contacts", setup.where)):
                continue
            names = (setup.tip_name,) if key.endswith("tip") else setup.middle_names
            if any((name in on) != (setup.switches[name] == "on") for name in names):
                return True
        return False

    @property
    def further(self) -> list[RodStart]:
        """Starts where none of the others leads to a grasp."""
        return []

    @cached_property
    def steady(self) -> AskedAnswers | None:
        """Stability that the scene requires; None where it requires none."""
        return steady_of(self.scene)

    @property
    def bound(self) -> float | None:
        """Lower bound on the greatest normal force of all grasps [N]; None where that is not the objective."""
        return None

    @property
    def asked(self) -> AskedAnswers | None:
        """Answers to loads that the scene asks for; None where it asks for none."""
        return None

    @property
    def best(self) -> RodGrasp | None:
        """The grasp with the least aim; among fine ones, if there are any."""
        held = [grasp for grasp in self.tried if grasp.holds]
        return min([g for g in held if g.fine] or held, key=lambda grasp: grasp.attempt.objective, default=None)

    def run(self, most: int = STARTS) -> None:
        """Solve from the most promising starts; from further ones if none of these leads to a grasp.

        The best grasp is solved again as exactly as it can be, and the next one if that is better then.
        """
        self._try(self.starts, most)
        if self.best is None:
            self._try(self.further, most)
        while (best := self.best) is not None and self._improved(best):
            pass
        self._confirm(most)
        if self.best is None:
            return
        if self.scene.unloaded and not self._pushed():
            return
        if (asked := self.asked) is not None:
            answered = self.answered(asked)
            if asked.push and not any(grasp.holds for grasp in answered):
                self.yielding = [grasp for grasp in self.tried if grasp.holds]
            self.aimed = asked.required or any(grasp.holds for grasp in answered)
            if self.aimed:
                self.tried, self._answering = answered, asked
        self._refine()
        self._steadied()

    def _steadied(self) -> None:
        """Take stable grasps where the best one is not as stable as the scene requires; of the least tension if none
        is found for the objective.
        """
        best, steady = self.best, self.steady
        if best is None or steady is None or best.meets(steady):
            return
        answering = self._answering
        tries = [steady.joined(answering), *([steady] if answering is not None and answering.aimed else [])]
        for k, asked in enumerate(tries):
            stable = [grasp for grasp in self.answered(asked, fine=True) if grasp.meets(steady)]
            if stable:
                self.tried = [*stable, *(grasp for grasp in self.tried if not grasp.holds)]
                self._answering, self.aimed = asked, self.aimed and k == 0
                return

    def refined(self, grasp: RodGrasp) -> RodGrasp:
        """Solve a grasp again as exactly as it can be."""
        return self.solved(grasp.start, widen=self._answering, beside=grasp)

    def _refine(self) -> None:
        """Solve the best grasps again as exactly as they can be."""
        while (rough := self._rough) is not None and not self.budget.over:
            finer = self.refined(rough)
            # Where finer stages and tables lead nowhere, the certificate decides about the grasp as it is.
            better = finer if finer.holds else rough
            self.tried[self.tried.index(rough)] = replace(better, rough=rough.attempt.objective)

    @property
    def _rough(self) -> RodGrasp | None:
        """The grasp with the least aim that is not fine, if it may be better than all fine ones."""
        refined = [grasp.rough for grasp in self.tried if grasp.fine and grasp.rough is not None]
        rough = [g for g in self.tried if g.holds and g.rough is None and not any(_tied(g, aim) for aim in refined)]
        least = min(rough, key=lambda grasp: grasp.attempt.objective, default=None)
        best = self.best
        if least is None or best is None or (best.fine and best.attempt.objective <= least.attempt.objective):
            return None
        return least

    def beside(self, grasp: RodGrasp) -> Iterator[RodStart]:
        """Starts with other contacts than a grasp, next to it."""
        yield from ()

    def _improved(self, best: RodGrasp) -> bool:
        """Whether a start next to the best grasp leads to a better one, by more than a share of its aim."""
        known = {grasp.start.on for grasp in self.tried if isinstance(grasp.start, type(best.start))}
        for start in self.beside(best):
            if self.budget.over or start.on in known:
                continue
            grasp = self.solved(start, fine=False)
            self.tried.append(grasp)
            if grasp.holds and grasp.attempt.objective < best.attempt.objective - SAME_AIM * abs(
                best.attempt.objective
            ):
                return True
        return False

    def try_some(self, most: int) -> None:
        """Solve from the most promising starts that nearly balance the object, one after the other up to a grasp."""
        likely = [start for start in self.starts if start.imbalance < NEARLY]
        for start in self._chosen(likely, most):
            if self.best is None and not self.budget.over:
                self.tried.append(self.solved(start))

    def answered(self, asked: AskedAnswers, *, fine: bool = False) -> list[RodGrasp]:
        """Grasps that answer loads as asked: the ones that hold, where they do, and solutions beside them."""
        first = sorted((grasp for grasp in self.tried if grasp.holds), key=lambda grasp: grasp.attempt.objective)
        found, least = list[tuple[RodGrasp, RodGrasp]](), np.inf
        for grasp in first:
            # More requirements do not lower an aim.
            if self.budget.over or (not asked.aimed and grasp.attempt.objective > least):
                break
            alike = (answer for one, answer in found if one.start.on == grasp.start.on and _same(one, grasp))
            answer = next(alike, None)
            if answer is not None:
                answer = replace(answer, start=grasp.start)
            elif grasp.meets(asked) and not asked.aimed:
                answer = grasp
            else:
                answer = self.solved(grasp.start, widen=asked, beside=grasp, fine=fine)
            found.append((grasp, answer))
            if answer.meets(asked):
                least = min(least, answer.attempt.objective + SAME_AIM * abs(answer.attempt.objective))
        return [answer for _, answer in found]

    def _pushed(self) -> bool:
        """Ask for a push of an object that nothing loads: a share of the greatest one near the grasps found. Returns
        whether it is more than negligible.
        """
        self.budget.tell("nothing loads the object: searching for the greatest push that a grasp bears")
        self.greatest_push = self.most_push()
        # As small as a weight that is negligible.
        if self.greatest_push <= NEAR * max(setup.tip_force for setup in self.scene.setups):
            self.tried = []
            return False
        self.scene = self.scene.changed({"contacts.push": PUSH_SHARE * self.greatest_push})
        self.__dict__.pop("steady", None)
        return True

    def most_push(self) -> float:
        """Greatest push that a grasp near the ones found bears [N]."""
        self.tried = self.yielding or self.tried
        most = self.scene.contacts.normal_force_max

        def press(problem: GraspRods) -> None:
            """Let no contact bear nothing: such a grasp has no answer to a push."""
            for name, held in problem.contacts.items():
                force = problem.numbers.unit(name) * problem.numbers.force
                problem.bound(held[0], low=PRESSED * most / force)

        self.tried = [self.solved(g.start, widen=press, beside=g, fine=False) for g in self.tried if g.holds]
        grasps = [grasp for grasp in self.answered(AskedAnswers(push_aim=1.0 / most, tension=1e-5)) if grasp.holds]
        tangents = [tangent_of(grasp.problem, grasp.attempt.x) for grasp in grasps]
        return max((tangent.push for tangent in tangents if tangent is not None), default=0.0)

    def agree(self, share: float) -> bool:
        """Whether the most promising starts and starts at other places lead to the same aim, within a share."""
        ends = []
        for chosen in (True, False):
            aims = [g.compared for g in self.tried if g.holds and (g.start in self._promising) is chosen]
            ends.append(min(aims, default=np.inf))
        return bool(np.isfinite(ends).all() and abs(ends[0] - ends[1]) <= share * abs(min(ends)))

    @property
    def confirmed(self) -> bool:
        """Whether two starts lead to the best grasp."""
        best = self.best
        if best is None:
            return False
        most = best.compared + SAME_AIM * abs(best.compared)
        return sum(grasp.compared <= most for grasp in self.tried if grasp.holds) > 1

    def _confirm(self, most: int) -> None:
        """Solve from further starts until a second one leads to the best grasp, where no other start is left."""
        if self.best is None or self.confirmed or len(self.tried) < len(self.starts):
            return
        for start in self.further[:most]:
            if self.budget.over or self.confirmed:
                return
            self.tried.append(self.solved(start, fine=False))

    def _try(self, starts: Sequence[RodStart], most: int) -> None:
        for start in self._chosen(starts, most):
            if self.budget.over:
                return
            if start.imbalance > self.likely and self.best is not None:
                continue
            if self._promises_less(start):
                continue
            self.tried.append(self.solved(start, fine=False))
            self.budget.tell(self.standing)

    @property
    def standing(self) -> str:
        """The best so far, and what was tried."""
        best = self.best
        held = "no grasp yet" if best is None else f"{amount_text(best.tension, 'N', '.4g')} so far"
        return f"{held}; {len(self.tried)} starts tried"

    def _promises_less(self, start: RodStart) -> bool:
        """Whether a start promises less than the best grasp, to which several starts led: of either choice of three
        fingers.
        """
        best = self.best
        if best is None or sum(_tied(grasp, best.attempt.objective) for grasp in self.tried if grasp.holds) < 2:
            return False
        aim = best.attempt.objective
        # 1e-3: share of the greatest tensions that is as good as none
        less = start.aim > aim + max(self.promised * abs(aim), 1e-3)
        return less and (len(best.problem.parts) < 3 or self.agree(AGREE))

    def _chosen(self, starts: Sequence[RodStart], most: int) -> Iterator[RodStart]:
        """The most promising starts; of different places of contacts where there are as many."""
        half = (most + 1) // 2
        best = starts[:half]
        self._promising = list(best)
        yield from best
        different, others = list[RodStart](), 0
        for k, start in enumerate(starts):
            if others == most - len(best):
                return
            alike = (one.on == start.on and np.linalg.norm(one.places - start.places) < self.apart for one in different)
            if any(alike):
                continue
            different.append(start)
            if k >= len(best):
                others += 1
                yield start

    def solved(
        self,
        start: RodStart,
        *,
        widen: Callable[[GraspRods], None] | None = None,
        loosen: Callable[[SceneNumbers], SceneNumbers] = lambda numbers: numbers,
        beside: RodGrasp | None = None,
        fine: bool = True,
    ) -> RodGrasp:
        """Solve from a start, or from a grasp with other limits ``beside`` it, with numbers of the scene
        loosened and limits widened if these are given.

        Solve again with rows where a finger is in the object between nodes, or crosses another, and, if the grasp is to
        be ``fine``, with finer tables where contacts are not as exact as the object.
        """
        places, near, known = list[StagePlace](), list[NearPair](), beside
        if beside is not None:
            times = beside.problem.geometry.finer if fine and not beside.fine else 1
            places, near = finer_places(beside.problem.places, times), finer_pairs(beside.problem.near, times)
        numbers, rounds, finer, rests, stays = loosen(start.numbers), 0, 0, 0, False
        step, wider = 0.0, False
        while True:
            problem = GraspRods(numbers, joints=start.joints, stages=self.stages, places=places, near=near, fine=fine)
            if widen is not None:
                widen(problem)
            if stays and known is not None:
                problem.stay(known.attempt.x[known.problem.placed])
            if widen is None and known is not None and problem.is_same(known.problem):
                attempt = known.attempt
            else:
                first = start.x_of(problem) if known is None else carried(known.problem, known.attempt.x, problem)
                problem.fill(first)
                attempt = self._attempt(problem, first)
            crossing = Crossing(problem, attempt.x)
            grasp = RodGrasp(problem, attempt, start, crossing.depth > CROSSED, variant=widen)
            if not attempt.converged or problem.unborne(attempt.x) > BORNE:
                if finer and not wider and known is not None:
                    # A contact leaves a table that is too small.
                    step, wider = WIDER * step, True
                    table = numbers.table.refined(touched_places(known.problem, known.attempt.x), step)
                    numbers = replace(numbers, table=table)
                    continue
                if not finer or stays or known is None or not problem.moves:
                    return grasp
                # Facets of a drawing have optima of their own: object and bases stay where smoother tables had them.
                stays = True
                continue
            if grasp.crosses:
                if rounds == ROUNDS:
                    return grasp
                # From the sample: a solution that crosses does not come apart.
                sample = Crossing(problem, start.x_of(problem))
                near = list(dict.fromkeys([*near, *sample.near, *crossing.near]))
                known, rounds = None, rounds + 1
                continue
            pose = attempt.x[problem.pose]
            supports = rested(numbers, numbers.supports, start.supports_at(pose), pose, RESTED)
            if supports is not None and rests < RESTS:
                numbers, known, rests = replace(numbers, supports=supports), grasp, rests + 1
                continue
            deep = [place for place in deep_places(problem, attempt.x) if place not in places]
            if deep and rounds < ROUNDS:
                places += deep
                known, rounds = grasp, rounds + 1
                continue
            if not fine or finer == FINER or not table_misses(problem, attempt.x):
                return grasp
            thin = min(float(finger.half(0.0)) * finger.length for finger in numbers.fingers)
            # Where curvature jumps, a table is as wrong as its step is wide.
            step = FINE * SHRINKS**finer * thin / numbers.size
            table = numbers.table.refined(touched_places(problem, attempt.x), step)
            numbers, known, finer, wider = replace(numbers, table=table), grasp, finer + 1, False

    def _attempt(self, problem: GraspRods, x: Array) -> Attempt:
        """Solve from unknowns; once more from where the solver stopped, if that is almost a grasp.

        A new run has a new barrier and knows nothing of the points that the former run refused.
        """
        attempt = self._solver.solve(problem.nlp, problem.start(x), self.budget)
        if attempt.status is not SolverStatus.ITERATION_LIMIT or problem.unborne(attempt.x) > RESUMED:
            return attempt
        return self._solver.solve(problem.nlp, problem.start(attempt.x), self.budget)


def _same(first: RodGrasp, second: RodGrasp) -> bool:
    """Whether two grasps are the same one: their problems have the same unknowns, and the solutions agree."""
    x, y = first.attempt.x, second.attempt.x
    # 1e-3: ways from different starts end closer than that, other grasps do not
    return x.size == y.size and _tied(first, second.attempt.objective) and float(np.abs(x - y).max()) < 1e-3


def _tied(grasp: RodGrasp, aim: float) -> bool:
    """Whether the aim of a grasp is another one, but for a share."""
    return abs(grasp.attempt.objective - aim) <= SAME_AIM * abs(aim)
