"""Which stations along the fingers touch: first all may, then those that press are taken as they are and exchanged.

A problem with complementarity constraints, relaxed and tightened step by step (S. Scholtes, "Convergence properties of
a regularization scheme for mathematical programs with complementarity constraints", SIAM J. Optim. 11, 2001, 918-936,
doi:10.1137/S1052623499361233), gives the set; an exact grasp with this set is solved and verified as any other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.problem.solver_run import Attempt, GraspSolverRun, solver_for
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.starts.supports import nearest_contact
from continuum_grasp.grasp.starts.values import FingerStart, Start, start_from
from continuum_grasp.scene.grasp import GraspScene

if TYPE_CHECKING:
    from continuum_grasp.grasp.search import Search, Tried

Array = NDArray[Any]

STEPS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
"""Bounds of pressing force times clearance, in units of the problem: the last leaves 1e-5 of the length under a force
of E I / L^2."""
TOUCHES = 1e-2
"""Normal force from which on a station counts as touching, per greatest."""
CAP = 300
"""Most iterations per bound."""
STARTS, EXCHANGES = 3, 24
"""Grasps with one middle contact from which sets of stations are sought, and sets that are tried next to the best."""


def without_stations(scene: GraspScene) -> GraspScene:
    """The scene with one middle contact, whose position is found, in place of stations."""
    fingers = {}
    for name, finger in scene.named_fingers.items():
        contacts = finger.contacts.model_copy(update={"stations": None, "middle_after": None})
        fingers[name] = finger.model_copy(update={"contacts": contacts})
    whole = scene.contacts.model_copy(update={"stations": None, "middle_after": None})
    return scene.model_copy(update={"contacts": whole}).with_fingers(fingers)


def search_stations(search: Search, before: Search) -> None:
    """Find grasps with stations next to those of a search ``before`` `without_stations`, then exchange stations."""
    search.run_before(before)
    if before.doubtful:
        before.exhaust()
    scene, plain = search.scene, before.scene
    for held in sorted(before.good, key=lambda t: t.attempt.objective)[:STARTS]:
        if search.budget.over:
            return
        start = _on_all(scene, start_from(plain, held.arrays), held.arrays)
        touching = {name for name, (n, *_) in start.forces.items() if n > 0.0}
        # Nearly exact: bold options stay next to it.
        _better(search, search.best, _with_only(scene, start, touching), rung=0)
        for found in _chosen(search, start):
            _better(search, search.best, found)
    for _ in range(EXCHANGES):
        best = search.best
        if best is None or not any(_better(search, best, start) for start in _exchanges(scene, best)):
            return


def _on_all(scene: GraspScene, plain: Start, arrays: dict[str, Array]) -> Start:
    """A start of a scene with one middle contact each as one at all stations."""
    fingers, forces, contacts = {}, dict(plain.forces), dict(plain.contacts)
    for setup in scene.setups:
        name, own = setup.name, plain.fingers[setup.name]
        if not setup.stations:
            fingers[name] = own
            continue
        line = arrays[f"{name}.backbone"]
        nearest = int(np.argmin(np.abs(np.array(setup.stations) - own.joints[0])))
        joints = tuple(own.joints[0] if k == nearest else at for k, at in enumerate(setup.stations))
        fingers[name] = FingerStart(own.base, joints, (own.sides[0],) * len(joints), own.knots, own.curvatures)
        contacts.pop(f"{name}.middle", None)
        held = forces.pop(f"{name}.middle", (0.0, 0.0, 0.0))
        for k, (contact, at) in enumerate(zip(setup.middle_names, joints, strict=True)):
            world = complex(*(float(np.interp(at, line[:, 0], line[:, c])) for c in (1, 2)))
            contacts[contact] = nearest_contact(scene, plain.object_pose, world)
            forces[contact] = held if k == nearest else (0.0, 0.0, 0.0)
    whole = replace(plain, fingers=fingers, contacts=contacts, forces=forces)
    return _with_only(scene, whole, set(contacts))


def _chosen(search: Search, start: Start) -> Iterator[Start]:
    """The start with those stations on that press where all may, as the bound of their product falls."""
    scene = search.scene
    spec = replace(ProblemSpec.of(scene, start.contacts), chosen=False)
    # Places beside a face have no clearance from it: exchanges alone find the set there.
    if not all(surface.is_smooth for surface in spec.surfaces):
        return
    solver = solver_for(spec)
    last: Attempt | None = None
    for bound in STEPS:
        x0 = None if last is None else last.x
        last = solver.run(
            scene, start, search.budget, rung=2, iterations=CAP, x0=x0, numbers={"complementarity": bound}
        )
        if not last.converged:
            return
        yield _pressing(scene, solver, last)


def _pressing(scene: GraspScene, solver: GraspSolverRun, attempt: Attempt) -> Start:
    """A point with all stations as a start with those that press."""
    arrays = solver.arrays(scene, attempt)
    start, forces = start_from(scene, arrays), arrays["contact_forces"][:, 0]
    pressed = dict(zip(arrays["contact_names"].tolist(), forces > TOUCHES * forces.max(), strict=True))
    stations = {name for setup in scene.setups if setup.stations for name in setup.middle_names}
    return _with_only(scene, start, {name for name in start.contacts if name not in stations or pressed[name]})


def _with_only(scene: GraspScene, start: Start, names: set[str]) -> Start:
    """The start with some of its contacts; stations that do not touch are where the scene has them."""
    fingers = dict(start.fingers)
    for setup in scene.setups:
        if setup.stations:
            own = fingers[setup.name]
            places = zip(setup.middle_names, own.joints, setup.stations, strict=True)
            joints = tuple(at if name in names else rest for name, at, rest in places)
            fingers[setup.name] = replace(own, joints=joints)
    # In one order, so that equal sets share one solver.
    order = dict.fromkeys((*(name for setup in scene.setups for name in setup.middle_names), *start.contacts))
    return replace(
        start,
        label="stations",
        fingers=fingers,
        contacts={name: start.contacts[name] for name in order if name in names},
        forces={name: force for name, force in start.forces.items() if name in names},
    )


def _exchanges(scene: GraspScene, best: Tried) -> Iterator[Start]:
    """Starts next to a grasp with one station less, one more beside those on, or one moved to its neighbor."""
    start = start_from(scene, best.arrays)
    for setup in scene.setups:
        names = setup.middle_names if setup.stations else ()
        on = [k for k, name in enumerate(names) if name in start.contacts]
        free = sorted({j for k in on for j in (k - 1, k + 1) if 0 <= j < len(names)} - set(on))
        line = best.arrays[f"{setup.name}.backbone"]

        def added(k: int, whole: Start, setup: Any = setup, line: Array = line) -> Start:
            world = complex(*(float(np.interp(setup.stations[k], line[:, 0], line[:, c])) for c in (1, 2)))
            at = nearest_contact(scene, whole.object_pose, world)
            name = setup.middle_names[k]
            more = {**whole.contacts, name: at}
            forces = {**whole.forces, name: (0.0, 0.0, 0.0)}
            return _with_only(scene, replace(whole, contacts=more, forces=forces), set(more))

        for k in free:
            yield added(k, start)
        for k in on:
            fewer = _with_only(scene, start, set(start.contacts) - {names[k]})
            yield fewer
            for j in (k - 1, k + 1):
                if j in free:
                    yield replace(added(j, fewer), forces={**fewer.forces, names[j]: start.forces[names[k]]})


def _better(search: Search, best: Tried | None, start: Start, rung: int = 2) -> bool:
    """Whether a start leads to a grasp that is better."""
    tried = {frozenset(t.attempt.start.contacts) for t in search.tried}
    if search.budget.over or not start.contacts or frozenset(start.contacts) in tried:
        return False
    search.attempt(start, rung=rung)
    now = search.best
    return now is not None and now is not best
