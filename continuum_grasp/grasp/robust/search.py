"""The search for a grasp that holds for all errors: corners that fail become part of the problem until none fails.

An exchange method for semi-infinite problems: J. W. Blankenship, J. E. Falk, J. Optim. Theory Appl. 19 (1976),
doi:10.1007/BF00934096. It begins with a grasp of the scene as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp import nlp
from continuum_grasp.grasp.certificate.certificate import Certificate, certify
from continuum_grasp.grasp.problem.points import starting_point
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.solver_run import allowed_depth, settings_of, solve_clear, solver_for
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.surroundings import Surroundings
from continuum_grasp.grasp.problem.values import Units, contact_features, problem_bounds, problem_values
from continuum_grasp.grasp.robust.errors import InError, corners
from continuum_grasp.grasp.robust.problem import robust_problem
from continuum_grasp.grasp.robust.response import Responder, Response
from continuum_grasp.grasp.robust.states import descended, extremes, with_states
from continuum_grasp.grasp.starts.values import Start
from continuum_grasp.model.surfaces.surface import Feature
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import Robust

Array = NDArray[Any]

MOST = 4
"""Corners that enter the problem at once."""
EXCHANGES = 6
"""How often corners that fail enter the problem."""
ITERATIONS = 150
"""Iterations of one solver run: with 4 to 8 corners 20 to 60 are enough (mug, pinch)."""


@dataclass(frozen=True)
class Found:
    """What the search gave.

    Attributes
    ----------
    arrays : mapping
        Of the grasp, or, where the solver found none, of the last one.
    certificate : Certificate
        Of that.
    optimal : bool
        Whether it is a local optimum to the full tolerance.
    iterations : int
        Of all runs of the solver.
    errors : ndarray, shape (K, 6 + S)
        The corners that are part of its problem.
    responses : sequence of Response
        Of that grasp to all corners.
    first : sequence of Response
        Of the grasp that the search began with.
    """

    arrays: Mapping[str, Array]
    certificate: Certificate
    optimal: bool
    iterations: int
    errors: Array
    responses: Sequence[Response]
    first: Sequence[Response]

    @property
    def holds(self) -> bool:
        """Whether it passes its certificate and holds at all corners."""
        return self.certificate.passed and all(response.holds for response in self.responses)


def find_robust(scene: GraspScene, bounds: Robust, arrays: Mapping[str, Any], budget: Budget) -> Found:
    """The best grasp of a scene next to that of ``arrays`` that holds for all corners of the bounds."""
    every = list(with_states(InError(scene, arrays).distinct(corners(bounds)), extremes(scene, arrays)))
    chosen: list[int] = []
    iterations, optimal = 0, True
    first: Sequence[Response] = ()
    while True:
        responder = Responder(scene, arrays, budget)
        responses = [responder.to(error) for error in every]
        responses += list(descended(responder, responses))
        every = [response.error for response in responses]
        first = first or responses
        order = np.argsort([response.reserve for response in responses], kind="stable")
        worse = [int(k) for k in order if not responses[k].holds and k not in chosen]
        if not worse or len(chosen) >= EXCHANGES * MOST or budget.over:
            break
        chosen += worse[:MOST]
        attempt, new = _Solve(responder, [responses[k] for k in chosen], budget).run()
        iterations += attempt.iterations
        if new is None:
            break
        arrays, optimal = new, attempt.status is nlp.Status.SOLVED
    active = np.array([every[k] for k in chosen]).reshape(len(chosen), every[0].size)
    return Found(arrays, certify(scene, arrays), optimal, iterations, active, responses, first)


@dataclass
class _Side:
    """The nominal grasp, or one error: its problem, and its own part of unknowns and numbers."""

    problem: GraspProblem
    near: Surroundings
    scene: GraspScene
    values: dict[str, Any]
    x: Array
    low: Array
    high: Array

    def look(self, x: Array, numbers: Array) -> tuple[float, Array]:
        """How deep fingers are at a point, and numbers with the guarded places of it."""
        sight = self.near.look(self.scene, x, numbers)
        return sight.deepest, self.problem.numbers.pack({**self.values, **sight.numbers})


class _Solve:
    """One run of the solver, from a grasp and its responses to some errors."""

    def __init__(self, responder: Responder, responses: Sequence[Response], budget: Budget) -> None:
        self.responder, self.budget, self.scene = responder, budget, responder.scene
        self.start = responder.start
        self.solver = solver_for(ProblemSpec.of(self.scene, self.start.contacts))
        self.features = contact_features(self.scene, self.start.contacts)
        self.whole = robust_problem(
            self.solver.problem, responder.solver.problem, len(responses), responder.in_error.left
        )
        nominal, other = Surroundings(self.whole.nominal), Surroundings(self.whole.other)
        self.sides = [self._side(self.whole.nominal, nominal, self.scene, self.start, self.features)]
        self.offsets: list[Array] = []
        for response in responses:
            side = self._side(
                self.whole.other, other, response.scene, response.start, response.attempt.features, response.attempt.x
            )
            at = side.problem.x.at
            side.x[at["reserve"]] = side.low[at["reserve"]] = side.high[at["reserve"]] = 0.0
            # What is linked needs no bounds of its own.
            linked = [f"{setup.name}.base" for setup in self.scene.setups if setup.finger.base_free is not None]
            linked += ["object pose"] * (self.scene.object.free is not None)
            for name in linked:
                side.low[at[name]], side.high[at[name]] = -np.inf, np.inf
            self.sides.append(side)
            lies = np.array(responder.in_error.pose_in_error(response.error)) - responder.in_error.pose
            self.offsets.append(np.array(Units.of(self.scene).pose(lies.tolist())))

    @staticmethod
    def _side(
        problem: GraspProblem,
        near: Surroundings,
        scene: GraspScene,
        start: Start,
        features: dict[str, Feature],
        x: Array | None = None,
    ) -> _Side:
        values = problem_values(problem, scene, start, features)
        low, high = problem_bounds(problem, scene, features)
        begin = starting_point(problem, scene, start, features) if x is None else x.copy()
        return _Side(problem, near, scene, values, begin, low, high)

    def run(self) -> tuple[nlp.Attempt, Mapping[str, Array] | None]:
        """The last run of the solver, with the iterations of all, and the grasp; None where it found none."""
        method = nlp.new_solver(settings_of(self.scene.solver))
        x, low, high = (np.concatenate([getattr(s, n) for s in self.sides]) for n in ("x", "low", "high"))
        numbers = [side.problem.numbers.pack(side.values, 0.0) for side in self.sides]
        p = self._look(x, np.concatenate([*numbers, *self.offsets]))[1]
        start = nlp.Start(np.clip(x, low, high), low, high, *self.whole.bounds(), p)
        depth = allowed_depth(self.scene)
        last, p = solve_clear(method, self.whole.nlp, start, self._look, depth, self.budget, ITERATIONS)
        if not last.converged or not np.isfinite(last.x).all():
            return last, None
        return last, self.solver.arrays_at(self.scene, self.start, self.whole.split(last.x)[0], p[: len(numbers[0])])

    def _look(self, x: Array, numbers: Array) -> tuple[float, Array]:
        """How deep fingers are anywhere, and the numbers with guarded places where they are deepest."""
        ends = np.cumsum([side.problem.numbers.symbol.numel() for side in self.sides])
        parts = zip(self.sides, self.whole.split(x), np.split(numbers, ends), strict=False)
        looks = [side.look(own, p) for side, own, p in parts]
        return max(depth for depth, _ in looks), np.concatenate([*(new for _, new in looks), *self.offsets])
