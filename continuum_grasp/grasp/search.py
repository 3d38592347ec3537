"""The search: starts of every set of contacts, each answer verified.

1. Exact rods that hold the object are the first starts: of all equilibria of the fingers that touch (`finger_map`),
   settled to the least tension, the least first. Where they hold with less than the best grasp and the fingers'
   elements do not follow, the grasp is not called optimal.
2. Another objective is also sought from grasps with the least tension, where those starts do not lead to its optimum.
3. Where that gives no grasp, has no maps, or the fingers bend otherwise (two elements), basins of a scan of all
   postures that touch are solved for each set of contacts, the most contacts first, in the order of their estimates;
   with more than `COARSE` elements those of few elements first.
4. Sets that no scan covers, and all sets where basins gave nothing, are solved from rough starts, rank by rank; of sets
   that are scanned the first one alone, where a basin led nowhere.
5. Of three fingers and more, the best grasp is then tried again with one finger as another grasp has it.
6. Without a grasp the starts that came nearest are tried again without patience; the best grasp is solved to the end.

What ends it early: a proof by `bound` that nothing is better, or that there is nothing, and the budget.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import replace
from functools import cached_property
from itertools import zip_longest
from typing import Any

import numpy as np

from continuum_grasp.base import amount_text
from continuum_grasp.grasp.bound import cannot_balance, least_normal_force_bound
from continuum_grasp.grasp.effort import (
    BALANCED,
    CLOSEST,
    COARSE,
    DOUBTED,
    EFFORTS,
    EXCHANGE_CAP,
    FIRST_CAP,
    HELD,
    IMPATIENT,
    OPEN,
    PATIENCE,
    PRUNE_FACTOR,
    SKIP_FACTOR,
    STANDSTILL,
    SURE,
    UNFOLLOWED,
    UNLIKELY,
    WORSE,
)
from continuum_grasp.grasp.finger_map import SceneMaps, is_mapped, places_of
from continuum_grasp.grasp.modes import contact_modes, with_elements
from continuum_grasp.grasp.problem.solver_run import OPTION_SETS, GraspAttempt, GraspSolverRun
from continuum_grasp.grasp.starts.basins import Basins
from continuum_grasp.grasp.starts.starts import NEARLY_BALANCED, basin_starts, held_still, make_starts, starts_of
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.grasp.tried import Basin, Exploration, Tried, branch_of, exchanged, least_of
from continuum_grasp.grasp.values import NEAR, SAME, tension_of
from continuum_grasp.nlp import Budget, SolverStatus
from continuum_grasp.scene import GraspScene

ALIKE, IN_VAIN = "like one that was solved before", "after others that led to nothing better"
"""Reasons why starts are not tried."""


class GraspSearch:
    """Finds and verifies grasps of a scene within a budget."""

    def __init__(self, scene: GraspScene, budget: Budget, *, mapped: bool = True) -> None:
        self.scene, self.budget = scene, budget
        self._mapped = mapped  # whether exact rods are starts
        self.settled: list[Basin] = []  # of exact rods, those of least tension first
        self.tried: list[Tried] = []
        self.good: list[Tried] = []  # those that the certificate confirms
        self.fallback: Tried | None = None  # a grasp with least tension, where something else is sought
        # Spent on building solvers, and on starts.
        self.build_seconds = self.start_seconds = 0.0
        self._effort = EFFORTS[scene.solver.effort]
        self._first_left: float | None = None  # iterations when the first grasp was found
        self._modes = self._sampled = 0
        self._pruned = Counter[str]()  # starts that were not tried, by the reason
        # Whether postures of a scan, of two linear curvatures, are those of the fingers, and estimates tell.
        self._tells = all(setup.elements <= 2 for setup in scene.setups)
        self._scans: dict[frozenset[str], Basins] = {}  # of each mode
        self._rough: dict[frozenset[str], list[GraspStart]] = {}
        self._solvers: dict[tuple[tuple[str, int], ...], GraspSolverRun] = {}  # by names and parts of contacts
        self._curled = frozenset[str]()  # fingers that passed through themselves in an attempt
        self.basins: list[Basin] = []
        # Starts that led to no grasp, with violations and option sets.
        self._missed: list[tuple[float, GraspStart, int]] = []
        self.lost: list[Tried] = []  # where grasps of few elements led that are none with all

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

    def run(self) -> None:
        """Polish what exact rods hold; where that gives no grasp, or tells nothing, search from scans and rough starts;
        then go on from the best grasp where its solver was stopped.
        """
        if self._mapped:
            self._from_maps()
        if self.settled and not self._least_tension and not (self.best and self.best.attempt.optimal):
            self._from(self.scene.replaced(objective="least_tension"), "least tension")
        if not (self.best and self._settles):
            self._from_scans()
        if not self.proven:
            self._converge()

    @property
    def _settles(self) -> bool:
        """Whether settled exact rods are all the starts that a scene needs: its fingers bend as they do."""
        return bool(self.settled) and not self._tells

    def _from_scans(self) -> None:
        """Solve from scans and rough starts, of few elements first."""
        if self._few is not None:
            self._from_few(self._few)
        else:
            self._explore()
        # What few elements cannot hold, many may; and violations may fall late.
        if self.best is None:
            nearest = dict[int, tuple[GraspStart, int]]()
            for _, start, options_at in sorted(self._missed, key=lambda missed: missed[0]):
                nearest.setdefault(id(start), (start, options_at))
            for start, options_at in list(nearest.values())[: 1 if self._few is None else HELD]:
                self.attempt(start, options_at=options_at, standstill=STANDSTILL)
        for end in self.lost:
            if end.attempt.status is SolverStatus.STOPPED and not self.budget.over:
                self.attempt(end.start, options_at=0)

    def _explore(self) -> None:
        """Solve from the basins of all modes in order of their estimates, then from rough starts of modes that are not
        scanned (by the effort, of all).
        """
        # Modes come with the most contacts first: a branch that holds with all of them needs no try with fewer,
        # since a contact without force is as good as one that is off.
        modes = contact_modes(self.scene)
        if not self._least_tension and not self.settled:
            self._from(self.scene.replaced(objective="least_tension"), "least tension")
        elif modes and (held := held_still(self.scene, modes[0])) is not None:
            self._from(held, "held still")
        self._modes = len(modes)
        unscanned = [mode for mode in modes if not self._from_basins(mode)]
        # With more than two elements a posture bends away from the scanned one: where that leads nowhere, there may be
        # a grasp nearby that no scan shows.
        nowhere = [] if self._tells else [mode for mode in modes if self._led_nowhere(mode)]
        missed = self.best is None and not self._tells
        # Before an object that is not convex it may be on another face: of seven outlines three take up to 57 % less.
        faces = nowhere if len(self.scene.object.pieces) > 1 else []
        sampled = modes if missed else [mode for mode in modes if mode in unscanned or mode in faces]
        self._sampled = len(sampled)
        if not self.proven:
            rough = modes if self._effort.always_rough else sampled
            self._from_rough(rough or nowhere, self._effort.in_vain if rough else DOUBTED)
            if self._tries_all:
                self._exchange()

    def _from_maps(self) -> None:
        """Start from exact rods that hold the object, those of least tension first, as far as they are better."""
        if self.budget.over or not is_mapped(self.scene):
            return
        began = time.perf_counter()
        maps, modes = SceneMaps(self.scene), contact_modes(self.scene)
        self._modes, self._sampled = len(modes), len(modes) * self._moves
        places = [(mode, place) for mode in modes for place in places_of(self.scene, mode)[: self._effort.places]]
        starts = [start for mode, place in places for start in maps.settled(mode, place)]
        self.start_seconds += time.perf_counter() - began
        # Those that hold nearly come last.
        ranked = sorted(starts, key=lambda start: (start.imbalance >= BALANCED, start.estimate))
        self.settled = [Basin(start) for start in ranked]
        for basin in self.settled[: self._effort.settled]:
            if self.budget.over or self._promised(basin) > SURE:
                return
            basin.tried = True
            # Boldly first, since it is nearly exact.
            if self.attempt(basin.start, options_at=0) not in self.good:
                self.attempt(basin.start, iterations=FIRST_CAP)

    def _promised(self, basin: Basin) -> float:
        """Tension of a settled exact rod per that of the best grasp; zero where there is none, and where it does not
        tell as another objective is sought, or object or bases may move.
        """
        best = self.best
        if best is None or not self._least_tension or self._moves:
            return 0.0
        return basin.start.estimate / max(self._tension(best), self._least_difference)

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
        if any(setup.friction_states for setup in self.scene.setups):
            return math.nan
        less = [basin.start.estimate for basin in self._held_exactly if 0.0 < self._promised(basin) < UNFOLLOWED]
        return min(less, default=math.nan)

    @property
    def exact(self) -> bool:
        """Whether exact rods hold the object."""
        return bool(self._held_exactly)

    @property
    def _held_exactly(self) -> list[Basin]:
        return [basin for basin in self.settled if basin.start.imbalance < BALANCED]

    def _led_nowhere(self, mode: frozenset[str]) -> bool:
        """Whether a basin of a mode was tried, and gave nothing."""
        return any(basin.start.contacts.keys() == mode for basin in self.basins if basin.tried and not basin.solved)

    def _exchange(self) -> None:
        """Start from the best grasp with one finger as another grasp has it, those that take the least tension there
        first: tensions add up over the fingers, and another balance may be near. Of two fingers it has led to nothing.
        """
        vain, tried = 0, set[tuple[int, int, str]]()
        while (best := self.best) is not None and vain < self._effort.exchanges and not self.budget.over:
            grasps = {round(t.attempt.objective, 6): t for t in reversed(self.good)}.values()
            choices = [
                (self._saved(best.start, other.start, name), id(other), name, other.start)
                for other in grasps
                for name in best.start.fingers
                if (id(best), id(other), name) not in tried
                and other is not best
                and other.start.contacts.keys() == best.start.contacts.keys()
            ]
            if self.proven or not choices:
                return
            # The first of those that save as much, so that images of a scene take the same.
            _, other, name, start = max(choices, key=lambda choice: choice[0])
            tried.add((id(best), other, name))
            self._solve(Basin(exchanged(self.scene, best.start, start, name)), 0, EXCHANGE_CAP)
            vain = 0 if self.best is not best else vain + 1

    def _saved(self, start: GraspStart, other: GraspStart, name: str) -> int:
        """Tension that a finger, by name, takes less in another start, in units of a difference that matters."""
        return round((sum(start.tensions[name]) - sum(other.tensions[name])) / self._least_difference)

    @property
    def unscanned(self) -> list[frozenset[str]]:
        """The modes whose postures are not scanned."""
        return [mode for mode in contact_modes(self.scene) if mode not in self._scans]

    @property
    def exploration(self) -> Exploration:
        """Record of the search so far."""
        open_ = [basin.start.estimate for basin in self.basins if self.is_open(basin)]
        skipped = sum(not basin.tried and not self.is_open(basin) for basin in self.basins)
        worse = f"estimated to take more than {SKIP_FACTOR:g} times the tension found"
        few = 0 if self._few is None else len(self._missed)
        pruned = self._pruned + Counter({worse: skipped, f"without a grasp of {COARSE} elements": few})
        return Exploration(
            modes=self._modes or len({frozenset(tried.attempt.start.contacts) for tried in self.tried}),
            sampled=self._sampled,
            places=sum(scan.places for scan in self._scans.values()),
            postures=sum(scan.postures for scan in self._scans.values()),
            basins=len(self.basins),
            starts_solved=len(self.good),
            starts_failed=len(self.tried) - len(self.good),
            open=len(open_),
            best_open=min(open_, default=math.nan),
            settled=len(self.settled),
            untried=sum(not basin.tried and self._promised(basin) < 1.0 - OPEN for basin in self._held_exactly),
            exact_less=self.exact_less,
            pruned=dict(pruned),
        )

    def _from_basins(self, mode: frozenset[str]) -> bool:
        """Solve from the basins of a mode; whether it is scanned at all."""
        starts = self.basins_of(mode)
        # Behind the last contact a finger is as its tendons bend it, and its imbalance says little.
        tells = not self._tells and all(setup.tip_name in mode for setup in self.scene.setups)
        for start in (starts or [])[: self._effort.basins]:
            if tells and start.imbalance > UNLIKELY and len(self.basins) >= CLOSEST:
                self._pruned["far from balance"] += 1
            elif not any(_same(start, basin.start) for basin in self.basins):
                self.basins.append(basin := Basin(start))
                far = self._tells and start.imbalance > NEARLY_BALANCED and len(self.tried) >= CLOSEST
                if not far and self._is_worth(start, SKIP_FACTOR) and not self._is_over:
                    self._solve(basin)
        return starts is not None

    def _solve(self, basin: Basin, options_at: int = 0, iterations: int | None = None) -> None:
        """Solve from a basin and verify; what lost patience may be tried again."""
        patience = IMPATIENT if self.best and len(self.scene.setups) == 1 else PATIENCE
        ends: dict[str, Any] = {"patience": patience, "standstill": STANDSTILL, "enough": self._enough}
        tried = self.attempt(basin.start, options_at=options_at, iterations=iterations, **ends)
        basin.tried = True
        if tried is not None and tried.attempt.stalled:
            self._missed.append((tried.attempt.badness, basin.start, options_at))
        # What takes more than was estimated, where that tells, is another basin's.
        promised = basin.start.estimate + self._least_difference
        if tried is not None and tried in self.good:
            basin.solved = not (self._tells and (1.0 - OPEN) * self._tension(tried) > promised)

    def _from_few(self, few: GraspSearch) -> None:
        """Start from where the search of a scene with few elements ended, its grasps first, each once."""
        self.run_before(few)
        self.basins, self._scans, self._rough = few.basins, few._scans, few._rough
        self._modes, self._sampled, self._pruned = few._modes, few._sampled, few._pruned
        known = set[tuple[Any, float]]()
        for end in sorted(few.tried, key=lambda t: (t not in few.good, not t.attempt.converged, t.attempt.objective)):
            held, best, tried = end.attempt, self.best, None
            grasp = frozenset(held.start.contacts), round(held.objective, 6)
            most = math.inf if best is None else self._beyond(best, PRUNE_FACTOR)
            if held.objective > most or self.budget.over:
                self._pruned[IN_VAIN] += 1
            elif grasp in known:
                self._pruned[ALIKE] += 1
            else:
                if held.converged:
                    known.add(grasp)
                    tried = self.attempt(end.start, options_at=0)
                    # A bold solver may leave the branch, as from friction that is not used at all; a careful one stays.
                    if tried in self.good and tried.attempt.objective > self._beyond(end, WORSE):
                        tried = self.attempt(end.start)
                if tried is None or tried not in self.good:
                    self._missed.append((held.badness, held.start, 0))
                    if end in few.good and tried is not None:
                        self.lost.append(tried)

    @cached_property
    def _few(self) -> GraspSearch | None:
        """The search with few elements; None where the scene has no more."""
        if all(setup.elements <= COARSE for setup in self.scene.setups):
            return None
        segments = max(len(setup.middles) for setup in self.scene.setups) + 1
        few = with_elements(self.scene, max(COARSE // segments, 1), as_curved=True)
        return GraspSearch(few, self.budget, mapped=False)

    @property
    def _enough(self) -> float:
        """Objective that is clearly worse than the best, where tensions are sought, which are never negative."""
        best = self.best
        if best is None or not self._least_tension:
            return math.inf
        return WORSE * best.attempt.objective + SAME

    @property
    def _is_over(self) -> bool:
        """Whether no more starts are tried: the iterations of the effort are used up since there is a grasp, or all."""
        first = self._first_left
        enough = first is not None and first - self.budget.left > self._effort.iterations
        return enough or (bool(self.tried) and self.budget.over)

    def is_open(self, basin: Basin) -> bool:
        """Whether a basin may be better than what there is: not solved and estimated to be, or not tried where
        estimates do not tell.
        """
        open_ = not basin.solved if self._tells else not basin.tried
        return open_ and self.best is not None and self._is_worth(basin.start, 1.0 - OPEN)

    def _is_worth(self, start: GraspStart, factor: float) -> bool:
        """Whether the estimate of a start is at most a factor times what there is."""
        best = self.best
        if best is None or math.isnan(start.estimate) or not self._tells:
            return True
        if not self._least_tension:
            # Beyond the limits of the tensions, the estimate counts what is left of the balance.
            return factor > 1.0 and start.estimate <= 2.0 * sum(setup.max_tension for setup in self.scene.setups)
        return start.estimate < factor * self._tension(best) - self._least_difference * (factor < 1.0)

    def _converge(self) -> None:
        """Go on from the best grasp, where its solver was stopped before its optimum."""
        for options_at in range(1, len(OPTION_SETS)):
            best = self.best
            if best is None or best.attempt.optimal or self.budget.over:
                return
            attempt = best.attempt
            self.attempt(attempt.start, options_at=options_at, features=attempt.features, x0=attempt.x)

    def _from_rough(self, modes: list[frozenset[str]], in_vain: float) -> None:
        """Solve from rough starts of modes, the best of each first; of one finger until so many of a mode were in vain.

        Once there is a grasp, starts that do not touch and those that look much worse are skipped, and the others get
        few iterations. Those of one branch are all tried: of 40 scenes of two fingers one has a grasp with 24 % less
        tension from one that touches where another did. But beside a grasp of its branch a start that leads to nothing
        better does not count against those of others.
        """
        vain = Counter[frozenset[str]]()
        for rank in zip_longest(*map(self.rough_starts_of, modes)):
            for start in sorted(filter(None, rank), key=lambda candidate: candidate.doubt):
                best, contacts = self.best, frozenset(start.contacts)
                if best and not self._promises(start):
                    continue
                if best and len(self.scene.setups) == 1 and vain[contacts] >= in_vain:
                    self._pruned[IN_VAIN] += 1
                    continue
                if self._is_over or self.proven:
                    return
                # 6: starts without a grasp after which a proof is tried that there is none: it takes as long as one or
                # two of them
                if len(self.tried) >= 6 and not self.good and self.impossible:
                    return
                basin = Basin(start)
                if not math.isnan(start.estimate):
                    self.basins.append(basin)
                self._solve(basin, len(OPTION_SETS) - 1, OPTION_SETS[0][1] if best else FIRST_CAP)
                grasped = {branch_of(good.attempt.start) for good in self.good}
                vain[contacts] = 0 if self.best is not best else vain[contacts] + (branch_of(start) not in grasped)

    @cached_property
    def bound(self) -> float | None:
        """Lower bound of the greatest normal force of any grasp [N], where that is what is minimized."""
        return least_normal_force_bound(self.scene) if self.scene.objective == "least_normal_force" else None

    @property
    def excess(self) -> float:
        """By what part the best grasp's greatest normal force is above what no grasp is below; zero without a bound."""
        if self.bound is None or self.best is None or self.bound <= 0.0:
            return 0.0
        return float(self.best.arrays["contact_forces"][:, 0].max()) / self.bound - 1.0

    @cached_property
    def impossible(self) -> bool:
        """Whether it is proven that there is no grasp; where postures are scanned, their forces show it sooner."""
        return bool(self.unscanned) and cannot_balance(self.scene)

    @property
    def left_out(self) -> int:
        """Starts that were not tried or led to no grasp."""
        explored = self.exploration
        return explored.starts_failed + sum(explored.pruned.values())

    @property
    def proven(self) -> bool:
        """Whether no grasp is better than the best found by more than `NEAR`."""
        return bool(self.bound) and self.best is not None and self.excess <= NEAR

    def _from(self, scene: GraspScene, label: str) -> None:
        """Start from the grasps of a scene in which they are found more surely: other aims from those with least
        tension, objects and bases that may move from where they are held.
        """
        before = GraspSearch(scene, self.budget)
        self.run_before(before)
        for held in before.held:
            if not (self.budget.over or self.proven):
                self.attempt(replace(GraspStart.of(self.scene, held.arrays), label=label))

    @property
    def _tries_all(self) -> bool:
        """Whether no start is left out: of three fingers and more, neither estimates nor where contacts face tell where
        a start leads. Of 35 scenes of three, six have their best grasp from one that would have been left out.
        """
        return len(self.scene.setups) > 2

    def run_before(self, other: GraspSearch) -> None:
        """Run a search of another scene, whose time counts as one's own."""
        try:
            other.run()
        finally:  # also on Ctrl-C
            if other.scene.objective != self.scene.objective:
                self.fallback = other.best
            self.build_seconds += other.build_seconds
            self.start_seconds += other.start_seconds

    def _promises(self, start: GraspStart) -> bool:
        """Whether a start may lead to something better than what there is."""
        best = self.best
        if start.label == "near" or best is None:
            return start.label != "near"
        if not self._least_tension or not start.tensions or self._tries_all or not self._tells:
            return True
        wanted = sum(sum(tensions) for tensions in start.tensions.values())
        return wanted <= PRUNE_FACTOR * self._tension(best)

    def _tension(self, tried: Tried) -> float:
        return tension_of(self.scene, tried.arrays)

    def _beyond(self, tried: Tried, factor: float) -> float:
        """Objective that is worse than that of an attempt by a factor; some objectives are negative."""
        objective = tried.attempt.objective
        return objective + (factor - 1.0) * abs(objective) + self._least_difference

    @property
    def _least_difference(self) -> float:
        """Tension below which differences are rounding [N]: grasps may take none at all."""
        return SAME * sum(setup.max_tension for setup in self.scene.setups)

    def basins_of(self, mode: frozenset[str]) -> list[GraspStart] | None:
        """The starts of a mode's basins; None where it has none that are scanned."""
        began = time.perf_counter()
        scanned = basin_starts(self.scene, mode)
        self.start_seconds += time.perf_counter() - began
        if scanned is None:
            return None
        starts, scan = scanned
        self._scans[mode] = scan
        return starts

    def rebalanced(self, scene: GraspScene) -> list[list[GraspStart]]:
        """The starts that the postures scanned so far give for a scene that differs in mass or in limits of forces
        alone, per mode that is scanned.
        """
        began = time.perf_counter()
        starts = [starts_of(scan.with_forces(scene)) for scan in self._scans.values()]
        self.start_seconds += time.perf_counter() - began
        return starts

    def rough_starts_of(self, mode: frozenset[str]) -> list[GraspStart]:
        """Starts of a mode of all kinds of scenes."""
        if mode in self._rough:
            return self._rough[mode]
        began = time.perf_counter()
        # Where tips alone touch, none of 19 scenes of three fingers gets better beyond 11 starts, of 45 of two fingers
        # none beyond 8; with middle contacts none of 12 of two fingers beyond 4.
        count = self._effort.starts * max(1, len(self.scene.setups) - 1)
        self._rough[mode] = make_starts(self.scene, mode, count)
        self.start_seconds += time.perf_counter() - began
        return self._rough[mode]

    def attempt(
        self,
        start: GraspStart,
        solver: GraspSolverRun | None = None,
        *,
        options_at: int = len(OPTION_SETS) - 1,
        **options: Any,
    ) -> Tried | None:
        """Solve from a start and verify what is new; None where there are no numbers to verify."""
        own, solver = solver is None, solver or self.solver(start)
        fresh = "x0" not in options
        known = {t.attempt: t for t in self.tried if t.solver is solver and t.attempt.converged and fresh}
        attempt = solver.run(self.scene, start, self.budget, options_at=options_at, known=list(known), **options)
        if not np.isfinite(attempt.x).all():
            return None
        if attempt in known:
            self._pruned[ALIKE] += 1
            return known[attempt]
        tried = Tried(attempt, solver, self.scene)
        enough = attempt.converged and attempt.objective <= options.get("enough", math.inf)
        if fresh and enough and not tried.verified:  # what the solver rounded, once more from there
            again = solver.run(self.scene, tried.start, self.budget, options_at=0)
            tried = Tried(again, solver, self.scene) if again.converged else tried
        self._noted(tried)
        if attempt.converged and own and tried.curled - self._curled:
            # Few grasps are so curled: what keeps a finger clear of itself costs nothing before one is.
            self._curled |= tried.curled
            self._solvers.clear()
            return self.attempt(start, options_at=options_at, **options)
        return tried

    def adopt(self, relaxed: GraspAttempt) -> None:
        """Verify an attempt with limits relaxed by nothing, which is a grasp of the scene, though not its optimum."""
        solver = self.solver(relaxed.start)
        self._noted(Tried(solver.unrelaxed(self.scene, relaxed), solver, self.scene))

    def _noted(self, tried: Tried) -> Tried:
        self.tried.append(tried)
        if tried.verified:
            self.good.append(tried)
            if tried.acceptable and self._first_left is None:
                self._first_left = self.budget.left
        self.budget.tell(self._standing)
        return tried

    @property
    def _standing(self) -> str:
        """The best so far, what was tried, and how much longer it may take."""
        best, left, spent = self.best, self.budget.left, sum(tried.attempt.iterations for tried in self.tried)
        held = "no grasp yet" if best is None else f"{amount_text(self._tension(best), 'N', '.4g')} so far"
        if self._first_left is not None:
            left = min(left, self._effort.iterations - (self._first_left - left))
        seconds = max(left, 0.0) * sum(tried.attempt.seconds for tried in self.tried) / max(spent, 1)
        seconds = max(0.0, min(seconds, self.budget.until - time.monotonic()))
        return f"{held}; {len(self.tried)} starts tried, {seconds:.2g} s left at most"

    def solver(self, start: GraspStart) -> GraspSolverRun:
        """The solver for a start's contacts."""
        began = time.perf_counter()
        contacts = tuple((name, contact.part) for name, contact in start.contacts.items())
        if contacts not in self._solvers:
            self._solvers[contacts] = GraspSolverRun.of(self.scene, start.contacts, self._curled)
            self._solvers[contacts].prepare(self.scene)
        self.build_seconds += time.perf_counter() - began
        return self._solvers[contacts]


def _same(first: GraspStart, second: GraspStart) -> bool:
    """Whether two starts of basins are the same: equal contacts and nearly equal estimates."""
    return first.contacts.keys() == second.contacts.keys() and math.isclose(
        first.estimate, second.estimate, rel_tol=NEAR
    )
