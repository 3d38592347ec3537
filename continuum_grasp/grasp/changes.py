"""Changes of a grasp: with other elements, by solving again, so that the model satisfies a tolerance; and with
friction, mass and pose, from the multipliers of the solution, without solving again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.modes import with_elements
from continuum_grasp.grasp.problem.values import Units, problem_values, tension_weight
from continuum_grasp.grasp.result import GraspResult, flawed
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.supports import touching_supports
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.grasp.tried import Tried
from continuum_grasp.grasp.values import REFUTED, Change, OutlineError, Sensitivity, tension_of
from continuum_grasp.nlp import Budget, SolverStatus
from continuum_grasp.scene import FAMILIES, GraspScene

FINE = 6
"""Elements per segment between base, middle contacts and tip of the model that a grasp is compared with:
with four matched clothoids the tip of a cantilever is off by 3e-7 to 9e-5 of its length (tip loads of 1 to
10 E I / L^2)."""
FIRST = 3
"""Elements per segment of a grasp next to which others are sought: with two, a finger that tapers is not found
(spirob_cup)."""
NONE = "no grasp next to this one"
"""Statistics where the fine model refutes a grasp."""


def with_fine(result: GraspResult, budget: Budget) -> GraspResult:
    """The result with what a fine model changes; as it is where that has no grasp next to it."""
    solved = _solve_again(_fine(result.scene), result, budget)
    if isinstance(solved, str):
        refuted = flawed(result, REFUTED) if solved == NONE else result
        return replace(refuted, statistics={**result.statistics, "fine_model": solved})
    change = _change(result.scene, result.arrays, solved.arrays)
    return replace(result, fine=change, statistics={**result.statistics, "fine_model": str(change)})


def with_finer_outline(
    result: GraspResult, error: OutlineError, budget: Budget, search: Callable[[GraspScene], GraspResult]
) -> GraspResult:
    """Add the change on a polygon nearer to the drawing, or larger by the noise of a measured outline, to a result.

    The other grasp is near this one; if there is none, a ``search`` finds it, because contacts do not slide far over
    corners.
    """
    scene = _redrawn(result.scene)
    here = result.arrays
    solved = _solve_again(scene, result, budget)
    if isinstance(solved, str):
        found = search(scene)
        arrays = found.arrays if found.solved else None
    else:
        arrays = solved.arrays
    change = None if arrays is None else _change(result.scene, here, arrays)
    # A contact that slides on the drawing stays on the edges beside its own.
    if change is None or change.displacement > _longest_edge(result.scene):
        missing = f"{error.other} no such grasp was found"
        return replace(result, outline=replace(error, missing=missing))
    return replace(result, outline=replace(error, change=change, missing=""))


def _redrawn(scene: GraspScene) -> GraspScene:
    """The scene with polygons nearer to the drawings of its object, which touches the same supports."""
    body = scene.object.redrawn()
    touching = touching_supports(scene, scene.object.pose) if body.free is None else frozenset()
    if 0 < len(touching) <= 2:
        body = scene.laid_against(body, touching)
    return scene.model_copy(update={"object": body})


def _longest_edge(scene: GraspScene) -> float:
    """Longest edge of the object's outlines [m]."""
    rings = (part.outline() for part in scene.object.parts)
    return max(math.dist(a, b) for ring in rings for a, b in pairwise([*ring, ring[0]]))


def asked_tolerance(scene: GraspScene) -> float | None:
    """The least tolerance that the scene or one of its fingers asks for."""
    fidelities = [finger.fidelity or scene.fidelity for finger in scene.named_fingers.values()]
    return min((f.tolerance for f in fidelities if f.tolerance is not None), default=None)


def resolve_elements(
    scene: GraspScene, first: GraspResult, tolerance: float, budget: Budget
) -> tuple[GraspScene, str, Change | None]:
    """The scene with the fewest elements whose grasp differs from a fine model's by no more than a tolerance, that
    choice in words, and what the fine model changes: tension (relative) and contact points (per length).

    ``first`` is the grasp of the scene with some elements.
    """
    reference = _solve_again(_fine(scene), first, budget)
    if isinstance(reference, str):
        return first.scene, f"the fine model: {reference}, so no tolerance can be checked", None
    note = ""
    change = None
    chosen = first.scene
    for count in range(1, FINE):
        chosen = with_elements(scene, count)
        solved = _solve_again(chosen, first, budget)
        if isinstance(solved, str):
            continue
        change = _change(scene, solved.arrays, reference.arrays)
        words = ", ".join(f"{setup.name} with {setup.elements} elements ({setup.family})" for setup in chosen.setups)
        if change.size <= tolerance:
            return chosen, f"{words}: {change}; tolerance {tolerance:.2%} satisfied", change
        note = f"{words}: {change}; tolerance {tolerance:.2%} NOT satisfied"
    return chosen, note, change


def _fine(scene: GraspScene) -> GraspScene:
    """The scene with many elements of the finest family that all fingers can have."""
    has_friction = any(setup.finger.has_friction for setup in scene.setups)
    return with_elements(scene, FINE, FAMILIES.default(free_tip=has_friction))


def _solve_again(scene: GraspScene, result: GraspResult, budget: Budget) -> Tried | str:
    """The grasp of a scene with other elements next to one that was found; in words why there is none."""
    search = GraspSearch(scene, budget)
    if not budget.over:
        search.attempt(GraspStart.of(result.scene, dict(result.arrays)))
    best = search.best or (search.unstable if result.opens else None)
    if best is not None and not budget.stopped:
        return best
    if budget.cut:
        return {"clock": "stopped by the clock", "iterations": "the iterations were used up"}[budget.cut]
    if search.unstable is not None:
        return NONE
    # A solver that fails shows nothing; one that converges without a grasp does.
    ended = {tried.attempt.status for tried in search.tried}
    return (
        NONE
        if ended & {SolverStatus.SOLVED, SolverStatus.ACCEPTABLE, SolverStatus.INFEASIBLE}
        else "no answer, the solver failed"
    )


def _change(scene: GraspScene, here: Mapping[str, Array], there: Mapping[str, Array]) -> Change:
    """Change from one model of a grasp to another."""
    tension_here, tension_there = (tension_of(scene, arrays) for arrays in (here, there))
    before, after = (dict(zip(a["contact_names"].tolist(), a["contact_positions"], strict=True)) for a in (here, there))
    moved = max((float(np.linalg.norm(before[name] - after[name])) for name in before if name in after), default=0.0)
    elements = {setup.name: int(there[f"{setup.name}.lengths"].size) for setup in scene.setups}
    length = min(setup.finger.rod.length for setup in scene.setups)
    return Change(elements, tension_there, tension_there / tension_here - 1.0 if tension_here else 0.0, moved, length)


def sensitivities(scene: GraspScene, tried: Tried) -> tuple[Sensitivity, ...]:
    """Derivatives of the answer of a converged attempt with respect to friction, mass, and the pose of the object
    before the hand.

    They hold as long as the same limits stay active. The pose moves the object with its supports against
    all fingers' bases together; bases that are free do not move.
    """
    attempt = tried.attempt
    problem = tried.solver.problem
    # At an optimum the objective changes with a number as the Lagrangian does: unknowns and multipliers stand still.
    slope = np.asarray(tried.solver.nlp.slope(attempt.x, attempt.numbers, 1.0, attempt.multipliers.constraints)).ravel()
    units = 1.0 / tension_weight(scene) if scene.objective == "least_tension" else 1.0
    at = problem.numbers.at
    touching = [at[f"{contact.name}.friction"] for contact in problem.spec.contacts if contact.finger >= 0]
    changes = [("friction between fingers and object", "1", sum(float(slope[rows].sum()) for rows in touching))]
    if scene.weight > 0.0:
        changes.append(("mass of the object", "kg", float(slope @ _by_mass(scene, tried))))
    moves = [slope @ _by_move(scene, tried, *move) for move in np.eye(3).tolist()]
    moved = ("object along x", "m"), ("object along y", "m"), ("object turned about its center of mass", "rad")
    changes += [(name, unit, float(move)) for (name, unit), move in zip(moved, moves, strict=True)]
    return tuple(Sensitivity(name, derivative * units, unit) for name, unit, derivative in changes)


def _by_mass(scene: GraspScene, tried: Tried) -> Array:
    """Derivative of the problem's numbers by the object's mass [1/kg]."""
    attempt = tried.attempt
    problem = tried.solver.problem
    # They are smooth in it, so that a difference of 1e-6 is good to six digits.
    mass = 1e-6 * scene.object.mass
    heavier = scene.object.model_copy(update={"mass": scene.object.mass + mass})
    now, then = (
        problem.numbers.pack(problem_values(problem, each, attempt.start, attempt.features), 0.0)
        for each in (scene, scene.model_copy(update={"object": heavier}))
    )
    return np.asarray((then - now) / mass)


def _by_move(scene: GraspScene, tried: Tried, x: float, y: float, turn: float) -> Array:
    """Derivative of the problem's numbers by a move of the object about its center of mass: all bases move back."""
    c = np.cos(scene.object.angle)
    s = np.sin(scene.object.angle)
    com = np.asarray(scene.object.position) + np.array([[c, -s], [s, c]]) @ scene.object.com
    at = tried.solver.problem.numbers.at
    out = np.zeros(tried.solver.problem.numbers.size)
    for name, finger in scene.named_fingers.items():
        if f"{name}.base" in at:
            arm = np.asarray(finger.base.position) - com
            shift = turn * np.array([arm[1], -arm[0]]) - [x, y]
            out[at[f"{name}.base"]] = Units.of(scene).pose([*shift.tolist(), -turn])
    return out
