"""The search for a plan from several starts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np

from continuum_grasp.addons.planning.condensed import Condensed
from continuum_grasp.addons.planning.diagnosis import Diagnosis, diagnose, missed_goals
from continuum_grasp.addons.planning.fine import (
    LEFT,
    PARTS,
    distances,
    excess_over_intervals,
    missed_when_played,
    places,
    simulated,
)
from continuum_grasp.addons.planning.goal import MET
from continuum_grasp.addons.planning.grid import MOST_ELEMENTS
from continuum_grasp.addons.planning.guess import Path, Posture, final_postures, first_state_of_plan, smooth_path
from continuum_grasp.addons.planning.motion import PlannedMotion
from continuum_grasp.addons.planning.pressing import PressingPostures
from continuum_grasp.addons.planning.problem import PlanProblem
from continuum_grasp.addons.planning.result import MotionPlan
from continuum_grasp.addons.planning.scene import DurationRange, Goal, PlanScene
from continuum_grasp.addons.planning.sliding import SlidingStarts
from continuum_grasp.base import Array, InputError, NumericalError
from continuum_grasp.nlp import Attempt, Budget, Multipliers, Settings

FEASIBLE = 1e-6
"""Violation below which constraints count as satisfied [units of the problem]: 100 times the solver's tolerance."""
_FIRST = 3
"""Intervals in which a motion that begins beyond a hard bound has to come back [1]; bounds hold from a quarter on."""
_SIDES = (0.0, 0.5, -0.5, 1.0, -1.0, 0.25, -0.25, 1.5, -1.5)
"""Amplitudes of the paths, in half bending ranges, bent to one side or the other in between."""
_SHARES = (0.7, 0.9, 1.0)
"""Shares of the duration after which inputs of a first motion with contact rest: what closes and settles before the end
is near a plan. Rounding decides which one solves a plan of stiff contacts: of fourteen variants of
configs/plan/close_on_mug.yaml all three together reach the goal in nine, 1.0 alone in one of nine."""
_NEAR = 1e-3
"""First barrier parameter from a motion that is worth staying near: an earlier plan, one simulated with contact."""
_AT_PLAN = 1e-7
"""First barrier parameter from a plan that is to be followed in smaller steps: with 1e-4 and 1e-5 IPOPT left what
satisfies nearly all, and did not come back in 500 iterations of a plan that closes on a mug; with 1e-7 it took 26."""
_PATIENCE, _PATIENCE_IN_CONTACT = 25, 200
"""Iterations that may leave a violation as it is, until it is halved [1]: contacts that close hold steps up."""
_MOVING = {"mumps_pivtol": 1e-2, "perturb_always_cd": "yes"}
"""Options of IPOPT with an object that moves, whose equations are nearly dependent where little touches it: singular
values of the constraints' Jacobian span seven decades, and IPOPT reads the signs of rounding errors for curvature, and
adds to the Hessian until no step is left. With greater pivots, and regularized from the beginning (by 1e-8), four
pushes of a disc towards a gap took 58 to 173 iterations; by default none ended in 200. Plans that hold an object that
stands were not solved when regularized (none of six)."""
_SECOND = 2
"""Iterations of a second start of a press, per those that gave the first plan [1]."""


class PlanSearch:
    """Starts of the solver, and the best of what they gave.

    ``warm`` is a plan from which to begin, ``near`` a posture near which the last one is sought. ``attempts`` and
    ``relaxed`` are what was tried, by name, at the problem and at the relaxed one that seeks the least distance from
    the goal; ``diagnosis`` is what stops the nearest one of these.
    """

    def __init__(self, scene: PlanScene, warm: MotionPlan | None = None, near: Posture | None = None) -> None:
        self.scene = scene
        self.warm = warm
        self.near = near
        self.attempts: list[tuple[str, Attempt]] = []
        self.relaxed: list[tuple[str, Attempt]] = []
        self.best: Attempt | None = None
        self.diagnosis: Diagnosis | None = None
        self.interrupted = False
        self.motion = PlannedMotion(scene)
        # Where inputs alone are unknowns as of a goal: a micrometer on 1 m, and rates of 1e-5 of their range.
        self.feasible = MET if scene.transcription == "single_shooting" else FEASIBLE
        self.x0, self.first = first_state_of_plan(scene, self.motion.prediction)
        self.pressing = PressingPostures(self.motion, self.x0, self.first)
        self.problem = self._usual = PlanProblem(self.motion, self.x0)
        """Problem of the best attempt, or of the last one."""
        options = scene.solver
        self.budget = Budget.of(options)
        size = self.problem.assembly.size
        if scene.transcription == "single_shooting":
            size = scene.intervals * int(np.prod(self.motion.steps))
        if "max_total_iterations" not in options.model_fields_set:
            # 18_000_000: Unknowns, or stages of the steps of single shooting, times states and iterations: some 50 s of
            # one core
            self.budget.left = min(self.budget.left, max(18_000_000 // (size * self.motion.ns), 50))
        self.allowed = int(self.budget.left)
        # Plans start far from their solution, where the adaptive barrier is the more robust one; no bound is relaxed,
        # since the limits of a plan are reported as satisfied.
        ipopt = {"acceptable_iter": 20, "bound_relax_factor": 0.0, "mu_strategy": "adaptive"}
        if scene.object_moves:
            ipopt |= _MOVING
        # Constraints are met to 1e-8 also where the optimum is asked for less accurately.
        tolerance, iterations = options.tolerance, options.max_iterations
        self._solver = Settings(options.method, tolerance, min(1e-8, tolerance), iterations, {"ipopt": ipopt}).solver()

    def run(self) -> None:
        """Try all starts.

        Once one has failed, the least distance from the goal is sought first, from that start and the others; where
        there is none left, the problem is solved from there.
        """
        if self._begins_outside():
            return
        # A motion that goes on has no rest to come to, and a reference may go to and fro.
        rests = self.scene.goal.end != "moving" and self.scene.objective != "tracking"
        if self.motion.friction_states and rests:
            self._try_sliding()
        if self.best is None and self.warm is not None and not self.over:
            w, multipliers = self._warm_start(self.warm)
            self._try("warm", w, _NEAR, multipliers)
        if self.best is None:
            self._try_paths()
        if self.scene.transcription == "collocation":
            self._refine()

    def _refine(self) -> None:
        """While a fine simulation departs from the plan, misses its goal, or leaves its bounds between the places where
        the problem has them, follow the motion in more elements on the intervals where it does.

        Inputs have their nodes as before. The search goes on from the motion that the inputs lead to, or else from the
        plan's motion; a step that gives no plan, or misses a goal, leaves the plan of before.
        """
        motion = self.motion
        model = self.motion.prediction
        tolerance = self.scene.check.tolerance * self.motion.length
        while self.best is not None and not self.over:
            problem = self.problem
            best = self.best
            missed = self._misses(self.best)
            path = problem.path(best.x)
            try:
                states = simulated(self.scene, model, path, self.x0)
                ends = simulated(self.scene, model, path, self.x0, 1, afresh=True)
            except NumericalError:
                return
            planned, *followed = (places(model, x, path.u) for x in (path.x, states[::PARTS], ends))
            whole, own = (distances(planned, at).max(axis=1) for at in followed)
            planned_states = problem.states(best.x, PARTS)
            left, inside = (
                excess_over_intervals(motion, x)[:, motion.bounded.hard].max(axis=1, initial=0.0) > LEFT
                for x in (states, planned_states)
            )
            coarse = left
            played = missed or not missed_when_played(motion, problem.goal, states[-1], path.u[-1])
            if whole.max() > tolerance or (left & ~inside).any() or not played:
                # Errors of all intervals would together be as much as the plan may depart. A bound that the planned
                # motion does not leave itself is left by errors of intervals before.
                coarse = left | (own[1:] > own[1:].mean() * tolerance / max(whole.max(), tolerance))
            counts = np.where(coarse, np.minimum(2 * problem.grid.counts, MOST_ELEMENTS), problem.grid.counts)
            if (counts == problem.grid.counts).all():
                return
            self.budget.left *= problem.assembly.size  # iterations take longer
            finer = PlanProblem(motion, self.x0, counts=counts, presses=problem.presses)
            self.budget.left //= finer.assembly.size
            # A bound that did not count before may lead elsewhere; else the plan is there already.
            barriers = (_NEAR, _AT_PLAN) if left.any() else (_AT_PLAN, _NEAR)
            starts = [("simulated", states, barrier) for barrier in barriers]
            for name, x, barrier in (*starts, ("as planned", planned_states, _AT_PLAN)):
                self.best = None
                title = f"{counts.sum()} elements, {name}"
                start = finer.start(replace(path, x=x))
                found = not self.over and self._try(title, start, barrier, problem=finer)
                if found and (missed or not self._misses(self.attempts[-1][1])):
                    break
            else:
                self.problem = problem
                self.best = best
                return

    def _try_sliding(self) -> None:
        """Start with tendons that slide one way, up to rest."""
        warm = None if self.warm is None else self._warm_start(self.warm)[0]
        trials = SlidingStarts(self._usual, self.x0, self.first, self.last, self.feasible).trials(warm)
        with suppress(StopIteration):
            trial = next(trials)
            while True:
                if trial.is_plan:
                    self._try(trial.name, trial.w, problem=trial.problem, most=trial.most)
                else:
                    self.problem = trial.problem
                    self.attempts.append((trial.name, self._solved(trial.problem, trial.w)))
                if self.over:
                    return
                trial = trials.send(self.attempts[-1][1])

    def _try_paths(self) -> None:
        """Start from paths, up to a plan that misses no goal; as long as none gave a plan, seek the least distance too.

        Without an object every path is tried: a way past a zone may be shorter than the first one that leads past it.
        With one, the distance is sought after all paths: it takes as long as a path, and seldom ends. Where presses
        end, rounding decides: a second start follows the first one that gave a plan.
        """
        contact = self.scene.object is not None
        most = None
        for name, path, barrier in self._paths():
            if self.over and self.attempts:
                return
            planned = self._try(name, self._usual.start(path), barrier, most=most) or self.best is not None
            if not (planned or self.over) and self._pressed is not None:
                planned = self._try(
                    f"{name}, comes into balance", self._pressed.start(path), barrier, problem=self._pressed
                )
            if not (planned or contact) and self._approach(name, path, barrier):
                return
            if contact and self.best is not None and not self._misses(self.best):
                if self.scene.goal.contact_force is None or most is not None:
                    return
                most = _SECOND * self.best.iterations
        for start in self._paths() if contact and self.best is None else ():
            if self._approach(*start) or (self.best is not None and not self._misses(self.best)):
                return

    def _paths(self) -> Iterator[tuple[str, Path, float | None]]:
        """Paths from which to start, with their names and first barriers: with an object what the finger does under
        inputs that rest sooner or later, which keeps off the object or presses on it as the solver should; else bent
        to either side.
        """
        given = self.scene.solver.starts
        motion = self.motion
        if self.scene.object is None:
            # 5: the direct path, and two to either side, so that both ways past a zone are tried
            for side in _SIDES[: given or (5 if self.scene.bounds.keep_out else 1)]:
                name = "direct" if side == 0.0 else f"detour {side:+g}"
                yield name, smooth_path(motion, self.x0, self.first, self.last, side), None
            return
        for share in _SHARES[:given]:
            path = smooth_path(motion, self.x0, self.first, self.last, share=share)
            name = f"at rest after {share:.0%}"
            barrier = None
            with suppress(NumericalError):
                states = simulated(self.scene, motion.prediction, path, self.x0, 1)
                name = f"{name}, simulated"
                path = replace(path, x=states)
                barrier = _NEAR
            yield name, path, barrier

    def _rank(self, problem: PlanProblem, attempt: Attempt) -> tuple[bool, bool, float]:
        """Order of plans: those that miss no goal first, then those that are solved, then by what they cost."""
        missed, _ = missed_goals(problem, attempt.x, weighted=True)
        return bool(missed), not attempt.converged, attempt.objective

    def _misses(self, attempt: Attempt) -> bool:
        """Whether a plan misses a goal that has a weight."""
        return bool(missed_goals(self.problem, attempt.x, weighted=True)[0])

    def _begins_outside(self) -> bool:
        """Whether the motion begins beyond a hard bound, and cannot come back within its first intervals, whatever the
        goal: all paths would say so after a minute.
        """
        motion = copy(self.motion)
        bounded = self.motion.bounded
        scene = self.scene
        u = np.tile(scene.initial_input, (_FIRST + 1, 1))
        p = motion.numbers([0.0])[0, : motion.prediction.np]
        rows = np.array(motion.rows(self.x0, u[0], p)).ravel()
        beyond = np.maximum(bounded.least - rows, rows - bounded.most)
        if not (beyond[motion.bounded.hard] > 0.0).any():
            return False
        share = _FIRST / scene.intervals
        least, most = (t * share for t in scene.duration_range)
        # Not validated again: a goal that asks for nothing is none.
        duration = DurationRange(least=least, most=most) if least < most else most
        first = {"intervals": _FIRST, "goal": Goal(end="moving"), "duration": duration}
        motion.scene = scene.model_copy(update=first)
        problem = PlanProblem(motion, self.x0, relaxed=True)
        path = Path(np.tile(self.x0, (_FIRST + 1, 1)), u, motion.first_duration * share)
        attempt = self._solved(problem, problem.start(path))
        if self.interrupted:
            raise KeyboardInterrupt
        self.diagnosis = diagnose(problem, attempt) if attempt.converged else None
        if self.diagnosis is not None:
            self.relaxed = [("first intervals", attempt)]
            self._near_goal = problem
        return self.diagnosis is not None

    @property
    def over(self) -> bool:
        """Whether there is nothing left to spend, or Ctrl-C was pressed."""
        return self.interrupted or self.budget.over

    def _warm_start(self, earlier: MotionPlan) -> tuple[Array, Multipliers | None]:
        """Unknowns and, where everything has its place as before, multipliers of an earlier plan."""
        known = earlier.x_names
        wanted = list(self.motion.prediction.x_names)
        if earlier.n != self.motion.prediction.system.n or earlier.u.shape[1] != self.motion.nu:
            raise InputError("the plan has other bending coordinates or inputs than this model", key="warm")
        state = earlier.solver_state
        assembly = self._usual.assembly
        if (
            np.array_equal(state.get("units", []), self.motion.units)
            and len(state["w"]) == assembly.size
            and len(state["constraints"]) == assembly.count
        ):
            return state["w"], Multipliers(state["bounds"], state["constraints"])
        t = np.linspace(0.0, earlier.duration, self.scene.intervals + 1)
        states = earlier.states_at(t)
        x = np.tile(self.x0, (len(t), 1))
        for k, name in enumerate(wanted):
            if name in known:
                x[:, k] = states[:, known.index(name)]
        path = Path(x, earlier.inputs_at(t), float(np.clip(earlier.duration, *self.scene.duration_range)))
        return self._usual.start(path), None

    @cached_property
    def last(self) -> Posture:
        """A posture that meets the goal; of contacts that are to press one to which its inputs lead."""
        postures = final_postures(self.motion, self._usual.goal, self.first, self.near)
        if self.scene.goal.contact_force is None:
            return postures[0]
        part = next(part for part in self._usual.goal if part.key == "goal.contact_force")
        direct = smooth_path(self.motion, self.x0, self.first, postures[0], share=_SHARES[0])
        return self.pressing.nearest(postures, part, direct)

    def _try(
        self,
        name: str,
        w: Array,
        barrier: float | None = None,
        multipliers: Multipliers | None = None,
        *,
        problem: PlanProblem | None = None,
        most: int | None = None,
    ) -> bool:
        """Solve a problem from a start, in ``most`` iterations at most; whether that gave a plan."""
        problem = problem or self._usual
        best = self.best
        attempt = self._solved(problem, w, barrier, multipliers, most=most)
        self.attempts.append((name, attempt))
        feasible = attempt.violation <= self.feasible
        if best is None or (feasible and self._rank(problem, attempt) < self._rank(self.problem, best)):
            self.problem = problem
            self.best = attempt if feasible else None
        return feasible

    def _solved(
        self,
        problem: PlanProblem,
        w: Array,
        barrier: float | None = None,
        multipliers: Multipliers | None = None,
        *,
        most: int | None = None,
    ) -> Attempt:
        """Run the solver; Ctrl-C leaves the last iterate."""
        assembly = problem.assembly
        with self.budget.last_iterates() as pressed:
            if self.scene.transcription == "single_shooting":
                options = self.scene.solver
                tolerance = max(self.scene.solver.tolerance, 1e-5)
                # Of a distance nothing may be left that counts as one.
                least = 0.5 * MET**2 / tolerance if problem.relaxed else 1.0
                attempt = Condensed(problem, tolerance, self.feasible, least).solve(
                    w, self.budget, min(most or options.max_iterations, options.max_iterations)
                )
            else:
                patience = _PATIENCE if self.scene.object is None else _PATIENCE_IN_CONTACT
                start = assembly.start_within(
                    *assembly.limits, w, multipliers=multipliers, barrier=barrier, patience=patience
                )
                with self.budget.share(most) as budget:
                    attempt = self._solver.solve(assembly.nlp, start, budget)
        self.interrupted |= pressed()
        return attempt

    @cached_property
    def _pressed(self) -> PlanProblem | None:
        """Problem of a finger that presses without rates and comes into balance after the end, for one to be held."""
        goal = self.scene.goal
        held = goal.end == "held" and goal.contact_force is not None and self.scene.transcription == "collocation"
        return PlanProblem(self.motion, self.x0, presses=True) if held else None

    @cached_property
    def _near_goal(self) -> PlanProblem:
        return PlanProblem(self.motion, self.x0, relaxed=True)

    def _approach(self, name: str, path: Path, barrier: float | None) -> bool:
        """Seek the least distance from the goal; where it is none, go on with the search from there.

        Whether nothing else is worth a trial: the starts to either side came where the direct one had.
        """
        if self.over:
            return True
        problem = self._near_goal
        attempt = self._solved(problem, problem.start(path), barrier)
        self.relaxed.append((name, attempt))
        if not self._ended(attempt):
            return False
        diagnosis = diagnose(problem, attempt)
        if diagnosis is None and not self.over:
            w = self._usual.like(problem, attempt.x)
            if not self._try(f"{name}, from the goal", w, barrier) and self.best is None:
                # A plan all the same, if not the cheapest: its goal is met, its bounds and its motion hold.
                f, g = (np.array(v).ravel() for v in self._usual.assembly.values(w))
                self.best = self.attempts[-1][1].moved(w, g, float(f[0]))
        elif attempt.objective <= self.nearest[1].objective:
            self.diagnosis = diagnosis
        ends = [a.objective for _, a in self.relaxed if self._ended(a)]
        # 1e-3: relative difference of distances from the goal of two starts that came to the same end
        return len(ends) > 2 and max(ends) - min(ends) <= 1e-3 * min(ends)

    @property
    def nearest(self) -> tuple[PlanProblem, Attempt]:
        """The attempt that comes nearest to the goal, and its problem."""
        return self._near_goal, min((a for _, a in self.relaxed), key=lambda a: (not self._ended(a), a.objective))

    def _ended(self, attempt: Attempt) -> bool:
        """Whether an attempt came to an end, as motions do too that creep to theirs along kinks."""
        creeps = attempt.outcome == "Search_Direction_Becomes_Too_Small"
        return (attempt.converged or creeps) and attempt.violation <= self.feasible
