"""The search for a grasp that holds for all errors: corners that fail become part of the problem until none fails.

An exchange method for semi-infinite problems: J. W. Blankenship, J. E. Falk, J. Optim. Theory Appl. 19 (1976),
doi:10.1007/BF00934096:

1. Begin with a grasp of the scene as it is, and the corners of the bounds.
2. Find the response of the grasp to each error; descend from each to the friction states that lower its reserve.
3. If all hold, end. Else the worst that fail, `MOST` at once, join the problem of one grasp for all of them.
4. Solve that from the grasp and its responses; go on with 2, `EXCHANGES` times at most.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.certificate import Certificate, certify_reached
from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.certificate.friction import state_cells
from continuum_grasp.grasp.certificate.recomputed import OF_CONTACTS
from continuum_grasp.grasp.problem.values import contact_features
from continuum_grasp.grasp.robust.errors import OBJECT, InError, corners, extremes, with_states
from continuum_grasp.grasp.robust.joint import JointSolverRun
from continuum_grasp.grasp.robust.response import Responder, Response
from continuum_grasp.grasp.starts.values import ContactStart
from continuum_grasp.nlp import Attempt, Budget, SolverStatus
from continuum_grasp.scene import GraspScene, Robust

MOST = 4
"""Corners that enter the problem at once."""
EXCHANGES = 6
"""Number of times that corners that fail enter the problem."""


def tried_errors(scene: GraspScene, bounds: Robust, arrays: Mapping[str, Any]) -> Array:
    """Corners of the bounds, each with tendons pulled all along and released (K, 6 + S)."""
    return with_states(InError(scene, arrays).distinct(corners(bounds)), extremes(scene, arrays))


class Exchange:
    """Errors that are tried, and the errors that the problem of a grasp must have: they grow until none fails.

    It begins with the grasp of ``arrays``, as a result holds them, and with ``errors`` (K, 6 + S) that the problem has
    already.
    """

    arrays: Mapping[str, Any]  # of the grasp that was tried last
    responder: Responder  # of that grasp
    responses: list[Response]  # of that grasp to all errors
    first: list[Response]  # of the grasp that it begins with
    chosen: list[int]  # errors that the problem must have
    touching: Sequence[Mapping[str, ContactStart]]  # contacts that are on in the posture of each of these, and where
    iterations: int  # of all runs of the solver
    optimal: bool  # whether the grasp is a local optimum to the full tolerance

    def __init__(
        self, scene: GraspScene, bounds: Robust, arrays: Mapping[str, Any], budget: Budget, errors: Sequence[Array] = ()
    ) -> None:
        self.scene = scene
        self.budget = budget
        self.arrays = arrays
        self.responses = []
        self.first = []
        self.touching = ()
        tried = {error.tobytes(): error for error in (*errors, *tried_errors(scene, bounds, arrays))}
        self._errors = list(tried.values())
        self.chosen = list(range(len(errors)))
        self.iterations = 0
        self.optimal = True

    def active(self, arrays: Mapping[str, Any]) -> list[Response]:
        """Responses of a grasp to what its problem must have, the worst that fail now included; none where none fails,
        or no more are taken in.
        """
        self.arrays = arrays
        self.responder = Responder(self.scene, arrays, self.budget)
        self.__dict__.pop("certificate", None)  # of the grasp before
        self.responses = [self.responder.to(error) for error in self._errors]
        self.responses += list(descended(self.responder, self.responses))
        self.first = self.first or self.responses
        self._errors = [response.error for response in self.responses]
        order = np.argsort([response.reserve for response in self.responses], kind="stable")
        worse = [int(k) for k in order if not self.responses[k].holds and k not in self.chosen]
        if not worse or len(self.chosen) >= EXCHANGES * MOST or self.budget.over:
            return []
        self.chosen += worse[:MOST]
        active = [self.responses[k] for k in self.chosen]
        self.touching = [response.begin.contacts for response in active]
        return active

    @property
    def errors(self) -> Array:
        """The errors (K, 6 + S) that are part of the problem."""
        return np.array([self.responses[k].error for k in self.chosen]).reshape(len(self.chosen), self._errors[0].size)

    @cached_property
    def certificate(self) -> Certificate:
        """Certificate of the grasp that was tried last."""
        return certify_reached(self.scene, self.arrays)

    @property
    def holds(self) -> bool:
        """Whether the grasp that was tried last passes its certificate and holds for all errors."""
        return all(response.holds for response in self.responses) and self.certificate.passed

    def with_postures(self) -> dict[str, Array]:
        """The arrays of the grasp that was tried last, with its postures; see `with_postures`."""
        return with_postures(self.scene, self.arrays, self.responses, self.budget)


def find_robust(scene: GraspScene, bounds: Robust, arrays: Mapping[str, Any], budget: Budget) -> Exchange:
    """The best grasp of a scene next to the grasp in ``arrays`` that holds for all corners of the bounds; where the
    solver finds none, the last one.
    """
    exchange = Exchange(scene, bounds, arrays, budget)
    while active := exchange.active(arrays):
        attempt, new = _solved(exchange.responder, active, budget)
        exchange.iterations += attempt.iterations
        if new is None:
            break
        arrays = new
        exchange.optimal = attempt.status is SolverStatus.SOLVED
    return exchange


def _solved(
    responder: Responder, responses: Sequence[Response], budget: Budget
) -> tuple[Attempt, Mapping[str, Array] | None]:
    """Run the solver once, from a grasp and its responses to some errors, and the grasp; None where it found none."""
    scene, start = responder.scene, responder.start
    touching = [response.begin.contacts for response in responses]
    run = JointSolverRun(scene, start, np.array([response.error for response in responses]), touching)
    features = contact_features(scene, start.contacts)
    points = run.starting_points(scene, start, features)
    for k, response in enumerate(responses, 1):
        # Where nothing balances, the solver's last point is anywhere.
        if np.isfinite(response.reserve):
            points[k] = response.attempt.x
    attempt = run.run(scene, start, budget, x0=np.concatenate(points))
    if not attempt.converged or not np.isfinite(attempt.x).all():
        return attempt, None
    return attempt, run.arrays(scene, attempt)


def worst_vertex(response: Response) -> Array:
    """An error with the states (6 + K,) at which the reserve is least, to first order; itself without slope."""
    error = response.error.copy()
    attempt = response.attempt
    solver = response.solver
    if not attempt.converged:
        return error
    # The search minimizes the negative reserve.
    slope = np.asarray(solver.nlp.slope(attempt.x, attempt.numbers, 1.0, attempt.multipliers.constraints)).ravel()
    for name, columns in response.scene.state_columns.items():
        by_state = slope[solver.problem.numbers.at[f"{name}.friction_history"]][:-1]
        states = error[OBJECT:][columns]
        error[OBJECT:][columns] = np.where(by_state > 0.0, 1.0, np.where(by_state < 0.0, -1.0, states))
    return error


def descended(responder: Responder, responses: Sequence[Response]) -> Iterator[Response]:
    """From each response on to the friction states that lower its reserve, until none does; last from the worst of all
    by turning one cell at a time, since a concave function has several such vertices. All that were turned are given:
    the certificate asks for those beside the worst.
    """
    if not responder.scene.state_columns:
        return
    known = {response.error.tobytes() for response in responses}
    reached = list(responses)

    def down(last: Response) -> Iterator[Response]:
        while (error := worst_vertex(last)).tobytes() not in known:
            known.add(error.tobytes())
            new = responder.to(error)
            reached.append(new)
            yield new
            if new.reserve >= last.reserve:
                break
            last = new

    for response in responses:
        yield from down(response)
    cells = [np.append(np.zeros(OBJECT, dtype=bool), cell) for cell in state_cells(responder.scene)]
    while True:
        worst = min(reached, key=lambda response: response.reserve)
        errors = [np.where(cell, -worst.error, worst.error) for cell in cells] if np.isfinite(worst.reserve) else []
        turned = [responder.to(error) for error in errors if error.tobytes() not in known]
        known |= {response.error.tobytes() for response in turned}
        reached += turned
        yield from turned
        new = min(turned, key=lambda response: response.reserve, default=worst)
        if not new.reserve < worst.reserve - EXACT:
            break
        yield from down(new)


def tried_states(scene: GraspScene, arrays: Mapping[str, Any], budget: Budget) -> list[Response]:
    """Responses of a grasp to the friction states of `extremes`, and to the worst ones from there."""
    responder = Responder(scene, arrays, budget)
    responses = [responder.to(error) for error in with_states(np.zeros((1, OBJECT)), extremes(scene, arrays))]
    return responses + list(descended(responder, responses))


def with_postures(
    scene: GraspScene, arrays: Mapping[str, Array], responses: Sequence[Response], budget: Budget
) -> dict[str, Array]:
    """The arrays of a grasp, and of its postures with the friction states of its ``responses`` for the certificate to
    verify: arrays of a grasp with the states as first axis, ``held.`` before their names.

    Each contact has one row in all of them, the grasp's contacts before others; where one is clear, its name is empty
    and its numbers are NaN.
    """
    if not scene.state_columns:
        return dict(arrays)
    if scene.robust:  # whose responses are to errors of the object, too
        responses = tried_states(scene, arrays, budget)
    each = [response.arrays for response in responses]
    names = list(dict.fromkeys(str(name) for posture in (arrays, *each) for name in posture["contact_names"]))
    each = [_with_all(posture, names) for posture in each]
    same = {f"{name}.family" for name in scene.named_fingers}
    return {
        **arrays,
        **{f"held.{key}": np.stack([posture[key] for posture in each]) for key in each[0] if key not in same},
    }


def _with_all(arrays: Mapping[str, Array], names: Sequence[str]) -> dict[str, Array]:
    """The arrays of a posture with a place for each of these contacts."""
    present = [str(name) for name in arrays["contact_names"]]
    clear = {"contact_names": "", "contact_parts": 0}
    padded = dict(arrays)
    for key in OF_CONTACTS:
        padded[key] = np.full((len(names), *arrays[key].shape[1:]), clear.get(key, np.nan), dtype=arrays[key].dtype)
        padded[key][[names.index(name) for name in present]] = arrays[key]
    return padded
