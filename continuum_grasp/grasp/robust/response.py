"""Response of a grasp to an object that is not as it should be: the posture at given tensions, and its reserve.

The grasp gives the tensions. An object that touches a support stays where it
lies; others yield to the fingers. A finger that touches along its length slides on the object as it closes, so that its
contacts settle anew; a tip that comes straight onto an object that yields stays where it lands: at the place next to
where it is in the grasp, seen from the object in error. Of all postures that balance, that is taken whose contacts are
farthest from slipping.

Contacts that the scene leaves open, stations and those that are ``auto``, touch or are clear in each posture as its
forces ask: one that would have to pull parts, and one that another contact would leave deep in the object touches.
"""

from __future__ import annotations

import cmath
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.check import GUARDED
from continuum_grasp.grasp.problem.solver_run import GraspAttempt, GraspSolverRun, allowed_depth
from continuum_grasp.grasp.problem.structure import DriveSpec
from continuum_grasp.grasp.problem.values import Units, held_values
from continuum_grasp.grasp.robust.errors import InError
from continuum_grasp.grasp.starts.supports import nearest_contact
from continuum_grasp.grasp.starts.values import ContactStart, GraspStart, with_contacts
from continuum_grasp.grasp.tried import Tried
from continuum_grasp.grasp.values import NEAR
from continuum_grasp.nlp import Budget, SolverStatus
from continuum_grasp.scene import GraspScene

HOLDS = -GUARDED
"""Least reserve, per force reference, with which all contacts hold, as in the certificate."""
SETS = 4
"""Sets of contacts, and other postures with the same ones, that are tried for one error: two or three are enough where
one holds."""
FRUITLESS = 12
"""Sets of contacts, and errors for which other postures are tried, in a row without one that holds: such a grasp has
other flaws; a set takes 0.6 s."""


@dataclass(frozen=True)
class Response(Tried):
    """The posture for one error, in the scene with it."""

    error: Array  # (6 + K,) as of `continuum_grasp.grasp.robust.errors`, with K friction states
    # By how much all friction cones could be narrower, per force reference [1]; minus infinity without a posture.
    reserve: float
    # Least friction margin [1]; minus infinity where a contact parts or no posture balances, NaN without an answer.
    margin: float
    weakest: str  # the contact with that margin; empty where nothing balances
    begin: GraspStart  # where the posture was sought from, without the error; it has the contacts of the posture

    @property
    def holds(self) -> bool:
        """Whether all contacts hold."""
        return self.reserve >= HOLDS


class Responder:
    """Finds the postures of a grasp with errors; ``arrays`` describe the grasp, as a result holds them.

    ``anew`` counts errors for which no solution next to another one was found, so that it was sought from the grasp.
    """

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any], budget: Budget) -> None:
        self.scene = scene
        self.arrays = dict(arrays)
        self._budget = budget
        self.in_error = InError(scene, arrays)
        self.start = GraspStart.of(scene, self.arrays)
        self._known: list[Response] = []
        self.anew = self._fruitless = self._far = 0

    def to(self, error: Array) -> Response:
        """The response to an error (6 + K,)."""
        near = self._nearest(error)
        best = self._with(self.start if near is None else near.begin, error)
        tried = {frozenset(best.begin.contacts)}
        left = list(self._next(best))
        while left and not best.holds and len(tried) < SETS and self._fruitless < FRUITLESS:
            begin = left.pop(0)
            names = frozenset(begin.contacts)
            if names in tried:
                continue
            tried.add(names)
            other = self._with(begin, error)
            self._fruitless = 0 if other.holds else self._fruitless + 1
            if other.reserve > best.reserve:
                best = other
                left[:0] = self._next(other)
        return best

    def _with(self, begin: GraspStart, error: Array) -> Response:
        solver = self.in_error.solver(begin.contacts)
        scene, start = self.in_error.plant(begin, error)
        solve = partial(solver.run, scene, start, self._budget, pinned=self._pinned(solver, scene, start, error))
        known = self._nearest(error, begin)
        attempts = [] if known is None else [solve(beside=known.attempt)]
        # A local optimum that does not hold says nothing of others.
        reserve_of = partial(_reserve, solver, scene)
        if not any(reserve_of(attempt) >= HOLDS for attempt in attempts):
            self.anew += 1
            optima = [attempt for attempt in attempts if attempt.converged]
            attempts.append(solve(options_at=2, known=optima))
            # Nor does that: where a face lies on a support, its ends share friction in several ways.
            unlike = list(self._unlike(begin)) if self._far < FRUITLESS else []
            points = [response.attempt.x for response in unlike]
            # The last from between them: all of these may end at one local optimum.
            for x0 in [*points, np.mean(points, axis=0)] if points else []:
                if any(reserve_of(attempt) >= HOLDS for attempt in attempts):
                    break
                # Bold options stay near where they begin, and there nothing holds.
                attempts.append(solve(x0=x0, options_at=2))
            holds = any(reserve_of(attempt) >= HOLDS for attempt in attempts)
            self._far = 0 if holds else self._far + 1
        attempt = max(reversed(attempts), key=reserve_of)
        reserve = reserve_of(attempt)
        margin = np.nan
        weakest = ""
        if np.isfinite(reserve):
            margin, weakest = _least_margin(solver, scene, attempt)
            if reserve >= HOLDS:  # a cone at its edge, up to rounding
                margin = max(margin, 0.0)
        elif attempt.status is SolverStatus.INFEASIBLE:
            margin = -np.inf
        response = Response(attempt, solver, scene, error, reserve, margin, weakest, begin)
        if attempt.converged:
            self._known.append(response)
        return response

    def _next(self, response: Response) -> Iterator[GraspStart]:
        """Starts with the contacts that a posture which does not hold asks for, those most likely to hold first."""
        attempt, begin, solver = response.attempt, response.begin, response.solver
        if response.holds or not np.isfinite(attempt.x).all():
            return
        switches = {name: switch for setup in self.scene.setups for name, switch in setup.switches.items()}
        forces = {
            name: float(attempt.x[solver.problem.x.at[f"force, {name}"]][0])
            for name in begin.contacts
            if switches.get(name) == "auto"
        }
        order = sorted(forces, key=lambda name: forces[name])
        pulls = [name for name in order if forces[name] < 0.0]
        for names in ([pulls] if len(pulls) > 1 else []) + [[name] for name in pulls]:
            yield from self._parted(begin, names)
        off = [name for name, switch in switches.items() if switch == "auto" and name not in begin.contacts]
        for name, contact in self._near_object(response, off):
            yield with_contacts(self.scene, begin, {**begin.contacts, name: contact})
        # Where nothing balances, forces say little.
        for name in order if not attempt.converged else ():
            yield from self._parted(begin, [name])

    def _parted(self, begin: GraspStart, names: Sequence[str]) -> Iterator[GraspStart]:
        """The start without some contacts, if each finger still touches somewhere."""
        left = {name: at for name, at in begin.contacts.items() if name not in names}
        if all(any(name.startswith(f"{finger}.") for name in left) for finger in self.scene.named_fingers):
            yield with_contacts(self.scene, begin, left)

    def _near_object(self, response: Response, names: Sequence[str]) -> Iterator[tuple[str, ContactStart]]:
        """Contacts that are off and nearly touch the object or are deep in it, deepest first, and where."""
        scene = response.scene
        arrays = response.arrays
        near = []
        x, y, angle = arrays["object.pose"].tolist()
        for setup in scene.setups if names else ():
            line = arrays[f"{setup.name}.backbone"]
            length = setup.finger.rod.length
            for name, s in zip(setup.switches, (*setup.middle_places, length), strict=True):
                if name not in names:
                    continue
                world = complex(*(float(np.interp(s, line[:, 0], line[:, c])) for c in (1, 2)))
                at = nearest_contact(scene, (x, y, angle), world)
                away = (world - complex(x, y)) * cmath.exp(-1j * angle) - complex(*at.point)
                gap = (away * cmath.exp(-1j * at.normal_angle)).real - float(setup.finger.profile.half_thickness(s))
                if gap < NEAR * length:
                    size = 1.0 + float(response.error[3])
                    point = at.point[0] / size, at.point[1] / size
                    near.append((gap, name, replace(at, point=point)))
        yield from ((name, at) for _, name, at in sorted(near, key=lambda entry: entry[0]))

    def _pinned(self, solver: GraspSolverRun, scene: GraspScene, start: GraspStart, error: Array) -> dict[str, Array]:
        """Unknowns that are given, in units of the problem; NaN where one is not."""
        units = Units.of(scene)
        pinned = self.in_error.landings(solver.problem.spec, self.start, error)
        if not self.in_error.yields and scene.object.free is not None:
            # What the supports decide follows from their contacts.
            pose = np.array(units.pose(scene.object.pose))
            pinned["object pose"] = np.where(np.isin(range(3), self.in_error.left), pose, np.nan)
        for setup in scene.setups:
            key = "pulls" if DriveSpec.of(setup) is None else "command"
            pinned[f"{setup.name}.{key}"] = held_values(setup, self.arrays)
            if setup.finger.base_free is not None:
                pinned[f"{setup.name}.base"] = np.array(units.pose(start.fingers[setup.name].base))
        return pinned

    def _nearest(self, error: Array, begin: GraspStart | None = None) -> Response | None:
        """The solution for the error that is nearest to this one, lengths per size of the object; of those with the
        contacts of a start, where one is given.
        """
        known = self._known if begin is None else self._with_contacts(begin)
        if not known:
            return None
        away = np.array([response.error for response in known]) - error
        away[:, :2] /= self.scene.object.size
        return known[int((away**2).sum(axis=1).argmin())]

    def _unlike(self, begin: GraspStart) -> Iterator[Response]:
        """Postures that hold with the contacts of a start: the one with the greatest reserve, then each time that which
        is least like those before.
        """
        left = [response for response in self._with_contacts(begin) if response.holds]
        left.sort(key=lambda response: response.reserve)
        points = np.array([response.attempt.x for response in left])
        apart = np.full(len(left), np.inf)
        for _ in range(min(SETS, len(left))):
            chosen = len(left) - 1 - int(np.argmax(apart[::-1]))
            apart = np.minimum(apart, np.linalg.norm(points - points[chosen], axis=1))
            yield left[chosen]

    def _with_contacts(self, begin: GraspStart) -> list[Response]:
        return [response for response in self._known if response.begin.contacts.keys() == begin.contacts.keys()]


def _reserve(solver: GraspSolverRun, scene: GraspScene, attempt: GraspAttempt) -> float:
    """By how much all friction cones could be narrower; minus infinity where nothing balances.

    Where a solver was stopped next to no optimum, its last point is a posture all the same if it violates nothing: the
    reserve of another may be greater.
    """
    reserve = float(attempt.x[solver.problem.x.at["reserve"]][0])
    if not attempt.converged:
        stands = not attempt.violations and reserve >= HOLDS
        if not stands or solver.near.look(scene, attempt.x, attempt.numbers)[0] > allowed_depth(scene):
            return -np.inf
    return reserve


def _least_margin(solver: GraspSolverRun, scene: GraspScene, attempt: GraspAttempt) -> tuple[float, str]:
    """Least friction margin, and the contact that has it."""
    margins = []
    for contact in solver.problem.spec.contacts:
        n, *sideways = attempt.x[solver.problem.x.at[f"force, {contact.name}"]]
        friction = scene.friction(contact.name)
        if n < 0.0 or friction > 0.0:
            margin = 1.0 - float(np.linalg.norm(sideways)) / (friction * n) if friction * n > 0.0 else -np.inf
            margins.append((margin, contact.name))
    return min(margins, default=(1.0, ""))
