"""The search: starts of every set of contacts, faces and corners next to those found, each answer verified.

Which contacts are on: every choice that the switches of a scene leave.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.certificate import Certificate, certify
from continuum_grasp.grasp.problem.solver_run import Attempt, GraspSolverRun, solver_for
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.starts.starts import make_starts
from continuum_grasp.grasp.starts.supports import touching_supports
from continuum_grasp.grasp.starts.values import Start, start_from
from continuum_grasp.model.surfaces.surface import Feature
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.supports import Switch

Array = NDArray[Any]

SAME = 1e-6
"""Relative difference up to which two objectives are the same grasp's: a thousand times what IPOPT leaves."""
NEAR = 1e-3
"""Relative difference of the objective for which a converged attempt is preferred: an interrupted one has no
sensitivities, and 0.1 % of tension is below the model's error."""
SECTOR = 0.8
"""Difference of a contact's direction from which on a start is of another branch [rad]: starts whose
contacts face alike to within it end in the same grasp as a rule."""
EDGE = 1e-4
"""Part of a face or corner, from its end, within which a contact counts as at its end: the barrier of IPOPT leaves a
gap to bounds."""
HELD = 3
"""Grasps with least tension from which other aims start: of nearby branches another may be best for them."""
ITERATION_CAP = 60
"""Iterations of a start once there is a grasp: from good starts IPOPT needs a median of 12 and
17 at the 95th percentile (400 random scenes)."""
PRUNE_FACTOR = 1.5
"""Estimated tension, per that of the best grasp, up to which a start is worth trying: the estimates are no
bounds, and those of rough starts are off by tens of percent."""
SLIDES = 12
"""How often contacts may pass on to the next face or corner: as often as a box has faces and corners, and more."""

MOST = 64
"""Sets of contacts that are tried, those with the most contacts first:
all choices of six contacts."""
_CHOICES = {"on": (True,), "off": (False,), "auto": (True, False)}


@dataclass(frozen=True)
class Tried:
    """An attempt, its physical numbers and its verification."""

    attempt: Attempt
    solver: GraspSolverRun
    arrays: dict[str, Array]
    certificate: Certificate

    @property
    def acceptable(self) -> bool:
        """Whether it is verified, and stable where the scene asks for that."""
        return self.certificate.acceptable


class Search:
    """Finds and verifies grasps of a scene within a budget."""

    def __init__(self, scene: GraspScene, budget: Budget) -> None:
        self.scene, self.budget = scene, budget
        self.tried: list[Tried] = []
        self.good: list[Tried] = []  # those that the certificate confirms
        self.fallback: Tried | None = None  # a grasp with least tension, where something else is sought
        # Spent on building solvers, and on starts.
        self.build_seconds = self.start_seconds = 0.0
        self._rng = np.random.default_rng(scene.solver.random_seed)

    @property
    def best(self) -> Tried | None:
        """The acceptable attempt with the least objective; one that converged, where that costs next to nothing."""
        return _least([t for t in self.good if t.acceptable])

    @property
    def unstable(self) -> Tried | None:
        """The same of the verified ones that are not acceptable."""
        return _least([t for t in self.good if not t.acceptable])

    def run(self) -> None:
        """Try the starts of all modes, one of each branch, then let contacts pass on to the next faces and corners.

        Once there is a grasp, starts that do not touch and those that look much worse are skipped, and the others get
        few iterations.
        """
        if self.scene.objective != "least_tension":
            self._from_least_tension()
        for mode in contact_modes(self.scene):
            # Modes come with the most contacts first: a branch that holds with all of them needs no try with fewer,
            # since a contact without force is as good as one that is off.
            starts = [tried.attempt.start for tried in self.good]
            held = {branch_of(start) for start in starts if frozenset(start.contacts) >= mode}
            for start in self.starts_of(mode):
                branch = branch_of(start)
                if branch in held or (self.good and not self._promises(start)):
                    continue
                if self.tried and self.budget.over:
                    return
                found = self.attempt(start, iterations=ITERATION_CAP if self.good else None)
                if found is not None and found in self.good:
                    held.add(branch)
        self.slide()

    def _from_least_tension(self) -> None:
        """Other aims start from grasps with least tension, which are found more surely."""
        before = Search(self.scene.replaced(objective="least_tension"), self.budget)
        try:
            before.run()
        finally:  # also on Ctrl-C
            self.build_seconds += before.build_seconds
            self.start_seconds += before.start_seconds
            self.fallback = before.best
        for held in sorted(before.good, key=lambda t: t.attempt.objective)[:HELD]:
            if self.budget.over:
                return
            self.attempt(start_from(self.scene, held.arrays))

    def _promises(self, start: Start) -> bool:
        """Whether a start may lead to something better than what there is."""
        best = self.best
        if start.label == "near" or best is None:
            return start.label != "near"
        if self.scene.objective != "least_tension" or not start.tensions:
            return True
        wanted = sum(sum(tensions) for tensions in start.tensions.values())
        there = sum(float(best.arrays[f"{name}.tensions"].sum()) for name in self.scene.named_fingers)
        return wanted <= PRUNE_FACTOR * there

    def starts_of(self, mode: frozenset[str]) -> list[Start]:
        """The starts of a mode."""
        began = time.perf_counter()
        starts = make_starts(self.scene, mode, self.scene.solver.seeds, self._rng)
        self.start_seconds += time.perf_counter() - began
        return starts

    def attempt(self, start: Start, solver: GraspSolverRun | None = None, **options: Any) -> Tried | None:
        """Solve from a start and verify; None where there are no numbers to verify."""
        solver = solver or self.solver(start)
        attempt = solver.run(self.scene, start, self.budget, **options)
        if not np.isfinite(attempt.x).all():
            return None
        arrays = solver.arrays(self.scene, attempt)
        found = Tried(attempt, solver, arrays, certify(self.scene, arrays))
        self.tried.append(found)
        if found.certificate.passed:
            self.good.append(found)
        return found

    def solver(self, start: Start) -> GraspSolverRun:
        """The solver for a start's contacts."""
        began = time.perf_counter()
        solver = solver_for(ProblemSpec.of(self.scene, start.contacts))
        solver.prepare(self.scene)
        self.build_seconds += time.perf_counter() - began
        return solver

    def slide(self) -> None:
        """From the best grasp, pass contacts on to the next face or corner as long as that helps."""
        for _ in range(SLIDES):
            best = self.best
            if best is None or self.budget.over:
                return
            least = best.attempt.objective - SAME * max(1.0, abs(best.attempt.objective))
            for features, x0 in _neighbors(self.scene, best):
                found = self.attempt(replace(best.attempt.start, label="next face"), features=features, x0=x0)
                if found is not None and found in self.good and found.attempt.objective < least:
                    break
            else:
                return


def _least(tried: list[Tried]) -> Tried | None:
    """The one with the least objective; one that converged, where that costs next to nothing."""
    least = min((t.attempt.objective for t in tried), default=0.0)
    near = least + NEAR * max(1.0, abs(least))
    converged = [t for t in tried if t.attempt.optimal and t.attempt.objective <= near]
    return min(converged or tried, key=lambda t: round(t.attempt.objective, 9), default=None)


def branch_of(start: Start) -> tuple[Any, ...]:
    """What starts that most likely lead to the same grasp have in common: sides, and where contacts face."""
    sides = tuple(finger.sides for finger in start.fingers.values())
    faces = tuple(round(contact.normal_angle / SECTOR) for contact in start.contacts.values())
    places = tuple(contact.part for contact in start.contacts.values())
    return sides, faces, places


def _neighbors(scene: GraspScene, tried: Tried) -> Iterator[tuple[dict[str, Feature], Array]]:
    """Features and unknowns with one contact passed on to the face or corner that it is at the end of."""
    attempt, parts = tried.attempt, scene.object.parts
    for contact in tried.solver.problem.spec.contacts:
        if contact.surface.is_smooth or contact.finger < 0:
            continue
        place = tried.solver.problem.x.at[f"place, {contact.name}"]
        part = parts[attempt.start.contacts[contact.name].part]
        ring, now = contact.surface.features(part), attempt.features[contact.name]
        if len(ring) < 2:
            continue
        # A contact's place is its position along a face and the angle of its normal, of which on a face the first is
        # free, on a corner the second.
        at, index = attempt.x[place], ring.index(now)
        face = now.upper[0] > now.lower[0]
        share = at[0] if face else (at[1] - now.lower[1]) / (now.upper[1] - now.lower[1])
        for end, step in ((0.0, -1), (1.0, 1)):
            if abs(share - end) < EDGE:
                new = ring[(index + step) % len(ring)]
                x = attempt.x.copy()
                if face:  # on to a corner
                    x[place] = 0.0, new.upper[1] if step < 0 else new.lower[1]
                else:
                    x[place] = 1.0 - end, new.lower[1]
                yield {**attempt.features, contact.name: new}, x


def contact_modes(scene: GraspScene) -> list[frozenset[str]]:
    """The sets of contacts that may be on, those with the most contacts first, at most `MOST`.

    They name contacts of fingers, of which every one touches somewhere, and supports that the object touches.
    """
    choices: list[list[frozenset[str]]] = []
    for setup in scene.setups:
        chosen = _chosen(zip((*setup.middle_names, setup.tip_name), (*setup.middles, setup.tip), strict=True))
        choices.append([names for names in chosen if names])
    supports = [(body.name, body.touch) for body in scene.places]
    if scene.object.free is None:
        touching = touching_supports(scene, scene.object.pose)
        choices.append([frozenset(name for name, touch in supports if touch != "off" and name in touching)])
    else:
        choices.append(_chosen(supports))
    modes = [frozenset[str]().union(*sets) for sets in product(*choices)]
    return sorted(modes, key=lambda mode: (-len(mode), sorted(mode)))[:MOST]


def _chosen(switches: Iterable[tuple[str, Switch]]) -> list[frozenset[str]]:
    """The sets of names that switches leave to choose."""
    each = [[frozenset({name}) if on else frozenset() for on in _CHOICES[state]] for name, state in switches]
    return [frozenset[str]().union(*chosen) for chosen in product(*each)]
