"""Solver runs on a grasp that must hold for several errors and friction states at once.

Beside the nominal grasp there is a posture for each error that matters, at the same tensions or commands
(`continuum_grasp.grasp.robust.problem`). Where an error does not act, the forces on what both share are zero, so that
the change of the optimum with a number of the scene does not depend on it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp import nlp
from continuum_grasp.grasp.problem.points import starting_point
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.solver_run import (
    RUNGS,
    Attempt,
    GraspSolverRun,
    allowed_depth,
    settings_of,
    solve_clear,
    solver_for,
)
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.surroundings import Surroundings
from continuum_grasp.grasp.problem.values import Units, contact_features, moved_features, problem_values
from continuum_grasp.grasp.robust.errors import InError
from continuum_grasp.grasp.robust.problem import RobustProblem, robust_problem
from continuum_grasp.grasp.starts.values import ContactStart, Start, with_contacts
from continuum_grasp.model.surfaces.surface import Feature
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]
_Side = tuple[GraspScene, Start, dict[str, Feature]]

_EFFORT = 1e-6
"""Weight of what makes postures in error unique, beside what is sought [1]: at 1, tensions that locked drives change
with friction would take 3e-4 of the derivatives (mug with servo motors)."""
_ACTS = 1e-4
"""Part of the greatest force on what postures share, from which on an error acts [1]."""


class JointSolverRun:
    """Solver runs on a grasp and its postures in error; of the form of `GraspSolverRun`, whose unknowns, numbers and
    constraints come first.

    Parameters
    ----------
    scene : GraspScene
    start : Start
        Next to which grasps are sought; it decides which contacts are on.
    errors : ndarray, shape (K, 6 + S)
        As rows of `continuum_grasp.grasp.robust.errors`.
    touching : sequence of dict
        Which contacts are on in the posture of each error (K), and where on the object they are; None: those of the
        start.
    """

    def __init__(
        self,
        scene: GraspScene,
        start: Start,
        errors: Array,
        touching: Sequence[Mapping[str, ContactStart]] | None = None,
    ) -> None:
        in_error = _in_error(scene, start)
        self.errors = errors
        self.touching = [start.contacts] * len(errors) if touching is None else list(touching)
        self.nominal: GraspSolverRun = solver_for(ProblemSpec.of(scene, start.contacts))
        self.others: list[GraspSolverRun] = [
            solver_for(ProblemSpec.of(scene, dict(on)).in_error(landed=in_error.yields)) for on in self.touching
        ]
        self._whole: RobustProblem = robust_problem(self.nominal, tuple(self.others), in_error.left)
        self.nlp = self._whole.nlp
        self._near = [Surroundings(solver.problem) for solver in self._solvers]

    @property
    def problem(self) -> GraspProblem:
        """The nominal problem."""
        return self.nominal.problem

    @property
    def _solvers(self) -> list[GraspSolverRun]:
        return [self.nominal, *self.others]

    def run(
        self,
        scene: GraspScene,
        start: Start,
        budget: Budget,
        *,
        x0: Array | None = None,
        features: dict[str, Feature] | None = None,
    ) -> Attempt:
        """Solve from unknowns ``x0`` with contacts on ``features``, by default those of the start, moving the guarded
        places.
        """
        features = features or contact_features(scene, start.contacts)
        sides = self._sides(scene, start, features)
        values = [
            problem_values(solver.problem, each, begin, own)
            for solver, (each, begin, own) in zip(self._solvers, sides, strict=True)
        ]
        for one in values[1:]:
            one["effort weight"] = _EFFORT
        low, high = self.bounds(scene, start, features)

        def look(x: Array, numbers: Array) -> tuple[float, Array]:
            deepest, found = -np.inf, []
            parts = zip(self._solvers, self._near, sides, values, self._xs(x), self._ps(numbers), strict=True)
            for solver, near, (each, _, _), own, part, p in parts:
                sight = near.look(each, part, p)
                deepest = max(deepest, sight.deepest)
                found.append(solver.problem.numbers.pack({**own, **sight.numbers}))
            return deepest, np.concatenate([*found, offsets])

        offsets = self._offsets(scene, start)
        packed = [s.problem.numbers.pack(one, 0.0) for s, one in zip(self._solvers, values, strict=True)]
        if x0 is None:
            starts = zip(self._solvers, sides, strict=True)
            x0 = np.concatenate([starting_point(s.problem, *side) for s, side in starts])
        x = np.clip(x0, low, high)
        begin = nlp.Start(x, low, high, *self.row_bounds, look(x, np.concatenate([*packed, offsets]))[1])
        solve = partial(nlp.new_solver(settings_of(scene.solver)).solve, self.nlp)
        last, numbers = solve_clear(solve, self.nlp, begin, look, allowed_depth(scene), budget, RUNGS[-1][1])
        return Attempt(**vars(last), start=start, features=features, numbers=numbers, violations=[])

    def bounds(self, scene: GraspScene, start: Start, features: dict[str, Feature]) -> tuple[Array, Array]:
        """Bounds of all unknowns."""
        # What is linked needs no bounds of its own.
        linked = [f"{setup.name}.base" for setup in scene.setups if setup.finger.base_free is not None]
        linked += ["object pose"] * (scene.object.free is not None)
        lows, highs = [], []
        for k, (solver, side) in enumerate(zip(self._solvers, self._sides(scene, start, features), strict=True)):
            low, high = solver.bounds(*side)
            if k:
                at = solver.problem.x.at
                low[at["reserve"]] = high[at["reserve"]] = 0.0
                for name in linked:
                    low[at[name]], high[at[name]] = -np.inf, np.inf
            lows.append(low)
            highs.append(high)
        return np.concatenate(lows), np.concatenate(highs)

    @cached_property
    def row_bounds(self) -> tuple[Array, Array]:
        """Bounds of all constraints."""
        return self._whole.bounds()

    @property
    def guarded(self) -> NDArray[np.int64]:
        """Which constraints are those of guarded places (n,)."""
        counts = [solver.problem.rows.count for solver in self._solvers]
        starts = np.cumsum([0, *counts[:-1]])
        found = [start + solver.guarded for start, solver in zip(starts, self._solvers, strict=True)]
        return np.asarray(np.concatenate(found))

    def arrays(self, scene: GraspScene, attempt: Attempt) -> dict[str, Array]:
        """The physical numbers of the nominal grasp."""
        return self.nominal.arrays(scene, self._part(attempt, 0))

    def numbers_near(self, scene: GraspScene, attempt: Attempt, start: Start, features: dict[str, Feature]) -> Array:
        """Run-time numbers of a scene of the same structure at the unknowns of an attempt."""
        sides = self._sides(scene, start, features)
        found = [
            solver.numbers_near(each, self._part(attempt, k), begin, own)
            for k, (solver, (each, begin, own)) in enumerate(zip(self._solvers, sides, strict=True))
        ]
        return np.concatenate([*found, self._offsets(scene, start)])

    def acting(self, attempt: Attempt) -> Array:
        """The errors (A, 6 + S) that decide the optimum: those with forces on what all postures share."""
        links = attempt.multipliers.constraints[sum(solver.problem.rows.count for solver in self._solvers) :]
        each = np.split(links, np.cumsum(self._whole.links)[:-1]) if links.size else []
        forces = np.array([np.abs(own).max() for own in each])
        found: Array = self.errors[forces > _ACTS * forces.max(initial=0.0)]
        return found

    def _part(self, attempt: Attempt, k: int) -> Attempt:
        return replace(attempt, x=self._xs(attempt.x)[k], numbers=self._ps(attempt.numbers)[k])

    def _xs(self, x: Array) -> list[Array]:
        return self._whole.split(x)

    def _ps(self, numbers: Array) -> list[Array]:
        ends = np.cumsum([solver.problem.numbers.size for solver in self._solvers])
        return np.split(numbers, ends)[:-1]

    def _offsets(self, scene: GraspScene, start: Start) -> Array:
        """By how much the object's pose is off in each error, in units of the problem (3 K,)."""
        in_error, units = _in_error(scene, start), Units.of(scene)
        moved = (np.array(in_error.pose_in_error(error)) - in_error.pose for error in self.errors)
        return np.concatenate([np.zeros(0), *(np.array(units.pose(one.tolist())) for one in moved)])

    def _sides(self, scene: GraspScene, start: Start, features: dict[str, Feature]) -> list[_Side]:
        """Scene, start and features of the nominal grasp and of each error."""
        in_error, found = _in_error(scene, start), [(scene, start, features)]
        for error, on in zip(self.errors, self.touching, strict=True):
            own, sits = start, features
            if on.keys() != start.contacts.keys():
                own = with_contacts(scene, start, {name: start.contacts.get(name, at) for name, at in on.items()})
                sits = {name: features.get(name, at) for name, at in contact_features(scene, own.contacts).items()}
            each, begin = in_error.plant(own, error)
            found.append((each, begin, moved_features(scene, each, own.contacts, sits)))
        return found


def _in_error(scene: GraspScene, start: Start) -> InError:
    return InError(scene, {"contact_names": list(start.contacts), "object.pose": start.object_pose})
