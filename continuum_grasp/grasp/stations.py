"""Grasps beyond the first optimum: other stations along the fingers, and stable grasps next to unstable ones.

Stations: a grasp with one middle contact per finger is a grasp with one station each. From there single stations are
added, left out or exchanged with a neighbor as long as that takes less tension or, where no grasp is found, less of a
limit that is relaxed; each set is solved and verified as any other grasp.

Stability: the least eigenvalue of the second-order test becomes a constraint. The eigenvalue is the certificate's own,
of rods cut into many cells. It enters the NLP to first order, and the point that solves it is where it is taken anew,
until the grasp found is stable and hardly changes (successive linearization: J. Nocedal, S. J. Wright, Numerical
Optimization, 2006, chapter 18).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.out_of_plane import stability_out_of_plane
from continuum_grasp.grasp.certificate.recomputed import RecomputedGrasp
from continuum_grasp.grasp.certificate.stability import contact_stability
from continuum_grasp.grasp.changes import FIRST
from continuum_grasp.grasp.effort import FIRST_CAP, LEAST_IN_SPACE, LINKS
from continuum_grasp.grasp.modes import with_elements
from continuum_grasp.grasp.problem.solver_run import OPTION_SETS, solver_for
from continuum_grasp.grasp.reasons.diagnosis import Repairs, ordered
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.supports import nearest_contact
from continuum_grasp.grasp.starts.values import ContactStart, FingerStart, GraspStart, with_contacts
from continuum_grasp.grasp.tried import Tried
from continuum_grasp.grasp.values import NEAR, SAME, Reason
from continuum_grasp.scene import FingerSetup, GraspScene


def without_stations(scene: GraspScene) -> GraspScene:
    """The scene with one middle contact, whose position is found, in place of stations."""
    fingers = {}
    for name, finger in scene.named_fingers.items():
        contacts = finger.contacts.model_copy(update={"stations": None})
        fingers[name] = finger.model_copy(update={"contacts": contacts})
    whole = scene.contacts.model_copy(update={"stations": None})
    return with_elements(scene.model_copy(update={"contacts": whole}).with_fingers(fingers), FIRST)


def search_stations(search: GraspSearch, before: GraspSearch) -> None:
    """Find grasps with stations next to the grasps of a search ``before`` `without_stations`, then exchange
    stations.
    """
    for held in before.held:
        start = _on_nearest(search.scene, before.scene, held.arrays)
        # Nearly exact: bold options stay next to it.
        if not _better(search, start, options_at=0) and search.best is None:
            search.attempt(start)
    while (best := search.best) is not None:
        if not any(_better(search, start) for start in _exchanges(search.scene, best.arrays)):
            return


def find_station_reasons(search: GraspSearch, before: GraspSearch, known: Repairs) -> list[Reason]:
    """Find the limits which, relaxed, give a grasp, next to those that give one `without_stations`, which are enough;
    none where that search finds a grasp after all.
    """
    scene = search.scene
    # Which tries the posture without the repair, too.
    enough = {reason.title: reason for reason in known.reasons()}
    if before.good:
        return []
    repairs = Repairs(scene, search)
    for limits, repair in known.found.items():
        repairs.attempt(limits, _on_nearest(scene, before.scene, repair.arrays))
        while (best := repairs.found.get(limits)) is not None and best.total > 0.0 and not search.budget.over:
            for start in _exchanges(scene, best.arrays):
                repairs.attempt(limits, start)
                if repairs.found[limits].total < (1.0 - NEAR) * best.total:
                    break
            else:
                break
    # Grasps of the scene without stations have other contacts than this one.
    without = {title: replace(reason, arrays={}) for title, reason in enough.items()}
    return ordered((without | {reason.title: reason for reason in repairs.reasons()}).values())


def _on_nearest(scene: GraspScene, before: GraspScene, arrays: Mapping[str, Array]) -> GraspStart:
    """A grasp of a scene ``before`` with other stations, or one middle contact each, as a start with the stations
    nearest to those that touch.
    """
    plain = GraspStart.of(before, dict(arrays))
    fingers = dict(plain.fingers)
    contacts = dict(plain.contacts)
    forces = dict(plain.forces)
    for old, setup in zip(before.setups, scene.setups, strict=True):
        if not setup.stations:
            continue
        finger_start = plain.fingers[setup.name]
        joints = list(setup.stations)
        # Other stations have the names of old ones now.
        contacts = {name: start for name, start in contacts.items() if name not in old.middle_names}
        forces = {name: force for name, force in forces.items() if name not in old.middle_names}
        for name, at in zip(old.middle_names, finger_start.joints, strict=True):
            if name not in plain.contacts:
                continue
            nearest = int(np.argmin(np.abs(np.array(setup.stations) - at)))
            station = setup.middle_names[nearest]
            joints[nearest], contacts[station] = at, plain.contacts[name]
            forces[station] = plain.forces[name]
        sides = (finger_start.sides[0],) * len(joints)
        fingers[setup.name] = FingerStart(
            finger_start.base, tuple(joints), sides, finger_start.knots, finger_start.curvatures
        )
    return _with_only(scene, replace(plain, fingers=fingers, forces=forces), contacts)


def _with_only(scene: GraspScene, start: GraspStart, contacts: Mapping[str, ContactStart]) -> GraspStart:
    return replace(with_contacts(scene, start, contacts), label="stations")


def _exchanges(scene: GraspScene, arrays: Mapping[str, Array]) -> Iterator[GraspStart]:
    """Starts next to a grasp with one station less, one more beside those on, or one moved to its neighbor."""
    start = GraspStart.of(scene, dict(arrays))
    for setup in scene.setups:
        names = setup.middle_names if setup.stations else ()
        on = [k for k, name in enumerate(names) if name in start.contacts]
        beside = {j for k in on for j in (k - 1, k + 1) if 0 <= j < len(names)} or set(range(len(names)))
        free = sorted(beside - set(on))
        line = arrays[f"{setup.name}.backbone"]

        def added(k: int, whole: GraspStart, setup: FingerSetup = setup, line: Array = line) -> GraspStart:
            world = complex(*(float(np.interp(setup.stations[k], line[:, 0], line[:, c])) for c in (1, 2)))
            at = nearest_contact(scene, whole.object_pose, world)
            name = setup.middle_names[k]
            more = replace(whole, forces={**whole.forces, name: (0.0, 0.0, 0.0)})
            return _with_only(scene, more, {**whole.contacts, name: at})

        for k in free:
            yield added(k, start)
        for k in on:
            fewer = _with_only(scene, start, {name: at for name, at in start.contacts.items() if name != names[k]})
            yield fewer
            for j in (k - 1, k + 1):
                if j in free:
                    yield replace(added(j, fewer), forces={**fewer.forces, names[j]: start.forces[names[k]]})


def _better(search: GraspSearch, start: GraspStart, options_at: int = 2) -> bool:
    """Whether a start leads to a grasp that is better."""
    tried = {frozenset(t.attempt.start.contacts) for t in search.tried}
    best = search.best
    if search.budget.over or not start.contacts or frozenset(start.contacts) in tried:
        return False
    search.attempt(start, options_at=options_at, iterations=None if best is None else FIRST_CAP)
    return search.best is not best


LEAST = 1e-2
"""Least eigenvalue [E I / L] that is asked for: well above what changes of the last digits can undo."""
ROUNDS = 12
"""Linearizations from one unstable grasp."""
_STEP = 1e-6
"""Step of a difference (problem's units): rounding of the eigenvalue is 1e-12 of the stiffest spring."""


def stabilize(search: GraspSearch) -> None:
    """Seek stable grasps next to the unstable ones that are better than the best stable one."""
    unstable = sorted((t for t in search.good if not t.acceptable), key=lambda t: t.attempt.objective)
    tried: list[float] = []
    for at in unstable:
        best = search.best
        objective = at.attempt.objective
        # 2: unstable grasps from which a stable one is sought
        if search.budget.over or len(tried) == 2 or (best and best.attempt.objective <= objective):
            return
        if not any(abs(objective - other) <= NEAR * abs(other) for other in tried):
            tried.append(objective)
            _stabilize(search, at)


def _stabilize(search: GraspSearch, at: Tried) -> None:
    """Raise the least eigenvalue of an unstable grasp, by smaller steps where the solver does not follow."""
    solver = solver_for(replace(at.solver.problem.spec, steadied=True))
    share = 1.0
    before = np.inf
    in_space = at.certificate.stability.in_plane
    slope = _slope(search.scene, at, in_space)
    for _ in range(ROUNDS):
        value = _eigenvalue(at, in_space)
        # No choice matters where two points leave the object a turn about the line between them.
        if search.budget.over or not np.isfinite(slope).all() or not np.abs(slope).max() > _STEP:
            return
        wanted = value + share * ((LEAST_IN_SPACE if in_space else LEAST) - value)
        numbers = solver.problem.steadying(slope, wanted - value + float(slope @ at.attempt.x))
        start = replace(at.attempt.start, label="stable")
        features = at.attempt.features
        tried = search.attempt(
            start, solver, features=features, x0=at.attempt.x, numbers=numbers, iterations=OPTION_SETS[0][1]
        )
        if tried is None or not tried.attempt.converged or _eigenvalue(tried, in_space) < value:
            share *= 0.4
            # 0.3: part of the way to stability of a step that the solver must at least follow
            if share < 0.3:
                return
            continue
        at = tried
        share = min(1.0, 2.0 * share)
        objective = tried.attempt.objective
        if at.acceptable and abs(objective - before) <= SAME * max(1.0, abs(objective)):
            return
        in_space = in_space or bool(at.certificate.stability.why)
        before = objective
        slope = _slope(search.scene, at, in_space)


def _eigenvalue(at: Tried, in_space: bool) -> float:
    """Least eigenvalue of motions in the plane or out of it [E I / L]; of the latter none where the former fail."""
    stability = at.certificate.stability
    if not in_space or stability.in_space is None:
        return stability.eigenvalue
    return stability.in_space.eigenvalue if stability.in_plane else -np.inf


def _slope(scene: GraspScene, at: Tried, in_space: bool = False) -> Array:
    """Derivative of the eigenvalue by the unknowns, by differences; what leaves the edge of a friction cone jumps."""
    solver, attempt = at.solver, at.attempt

    def value(x: Array) -> float:
        grasp = RecomputedGrasp(scene, solver.arrays(scene, replace(attempt, x=x)))
        verdict = stability_out_of_plane(grasp, LINKS) if in_space else None
        return contact_stability(grasp).eigenvalue if verdict is None else verdict.eigenvalue

    slope = np.zeros(attempt.x.size)
    here = value(attempt.x)
    shape = {f"{setup.name}.{key}" for setup in scene.setups for key in ("q", "pulls", "base")}
    for name, place in solver.problem.x.at.items():
        moves = name in shape or name == "object pose" or name.startswith(("force, ", "place, ")) or ".joint_" in name
        for k in range(place.start, place.stop) if moves else ():
            off = np.zeros(attempt.x.size)
            off[k] = _STEP
            slope[k] = (value(attempt.x + off) - here) / _STEP
    return slope
