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
from continuum_grasp.grasp.certificate.certificate import Certificate, certify_reached
from continuum_grasp.grasp.problem.points import starting_point
from continuum_grasp.grasp.problem.values import contact_features
from continuum_grasp.grasp.robust.errors import InError, corners
from continuum_grasp.grasp.robust.joint import JointSolverRun
from continuum_grasp.grasp.robust.response import Responder, Response
from continuum_grasp.grasp.robust.states import descended, extremes, with_states
from continuum_grasp.grasp.starts.values import ContactStart
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import Robust

Array = NDArray[Any]

MOST = 4
"""Corners that enter the problem at once."""
EXCHANGES = 6
"""Number of times that corners that fail enter the problem."""


def tried_errors(scene: GraspScene, bounds: Robust, arrays: Mapping[str, Any]) -> Array:
    """Corners of the bounds, each with tendons pulled all along and released (K, 6 + S)."""
    return with_states(InError(scene, arrays).distinct(corners(bounds)), extremes(scene, arrays))


@dataclass(frozen=True)
class Found:
    """Result of the search.

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
    touching : sequence of mapping
        Which contacts are on in the posture of each of these (K), and where.
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
    touching: Sequence[Mapping[str, ContactStart]]
    responses: Sequence[Response]
    first: Sequence[Response]

    @property
    def holds(self) -> bool:
        """Whether it passes its certificate and holds at all corners."""
        return self.certificate.passed and all(response.holds for response in self.responses)


class Exchange:
    """Errors that are tried, and those of them that the problem of a grasp must have: they grow until none fails.

    Parameters
    ----------
    scene : GraspScene
    bounds : Robust
    arrays : mapping
        Of the grasp that it begins with, as a result holds them.
    budget : Budget
    errors : ndarray, shape (K, 6 + S), optional
        Those that the problem has already.

    Attributes
    ----------
    responder : Responder
        Of the grasp that was tried last.
    responses : sequence of Response
        Of that grasp to all errors.
    chosen : list of int
        Which of these the problem must have.
    """

    responder: Responder

    def __init__(
        self, scene: GraspScene, bounds: Robust, arrays: Mapping[str, Any], budget: Budget, errors: Sequence[Array] = ()
    ) -> None:
        self.scene, self.budget, self.responses = scene, budget, list[Response]()
        tried = {error.tobytes(): error for error in (*errors, *tried_errors(scene, bounds, arrays))}
        self._errors, self.chosen = list(tried.values()), list(range(len(errors)))

    def active(self, arrays: Mapping[str, Any]) -> list[Response]:
        """Responses of a grasp to what its problem must have, the worst that fail now included; none where none fails,
        or no more are taken in.
        """
        self.responder = Responder(self.scene, arrays, self.budget)
        self.responses = [self.responder.to(error) for error in self._errors]
        self.responses += list(descended(self.responder, self.responses))
        self._errors = [response.error for response in self.responses]
        order = np.argsort([response.reserve for response in self.responses], kind="stable")
        worse = [int(k) for k in order if not self.responses[k].holds and k not in self.chosen]
        if not worse or len(self.chosen) >= EXCHANGES * MOST or self.budget.over:
            return []
        self.chosen += worse[:MOST]
        return [self.responses[k] for k in self.chosen]

    @property
    def holds(self) -> bool:
        """Whether the grasp that was tried last holds for all errors."""
        return all(response.holds for response in self.responses)


def find_robust(scene: GraspScene, bounds: Robust, arrays: Mapping[str, Any], budget: Budget) -> Found:
    """The best grasp of a scene next to that of ``arrays`` that holds for all corners of the bounds."""
    exchange = Exchange(scene, bounds, arrays, budget)
    touching: Sequence[Mapping[str, ContactStart]] = ()
    iterations, optimal = 0, True
    first: Sequence[Response] = ()
    while active := exchange.active(arrays):
        first = first or exchange.responses
        touching = [response.begin.contacts for response in active]
        attempt, new = _solved(exchange.responder, active, budget)
        iterations += attempt.iterations
        if new is None:
            break
        arrays, optimal = new, attempt.status is nlp.Status.SOLVED
    responses = exchange.responses
    errors = np.array([responses[k].error for k in exchange.chosen]).reshape(len(touching), responses[0].error.size)
    certificate = certify_reached(scene, arrays)
    return Found(arrays, certificate, optimal, iterations, errors, touching, responses, first or responses)


def _solved(
    responder: Responder, responses: Sequence[Response], budget: Budget
) -> tuple[nlp.Attempt, Mapping[str, Array] | None]:
    """Run the solver once, from a grasp and its responses to some errors, and the grasp; None where it found none."""
    scene, start = responder.scene, responder.start
    touching = [response.begin.contacts for response in responses]
    run = JointSolverRun(scene, start, np.array([response.error for response in responses]), touching)
    features = contact_features(scene, start.contacts)
    begin = [starting_point(run.problem, scene, start, features), *(response.attempt.x for response in responses)]
    attempt = run.run(scene, start, budget, x0=np.concatenate(begin))
    if not attempt.converged or not np.isfinite(attempt.x).all():
        return attempt, None
    return attempt, run.arrays(scene, attempt)
