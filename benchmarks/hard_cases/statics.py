"""Shapes at rest that are hard to find, against the exact elastica and closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import Any

import numpy as np

from benchmarks.hard_cases import (
    FAMILIES,
    GRAVITY,
    LENGTH,
    MASS,
    RIGHT,
    STIFFNESS,
    Attempt,
    Found,
    nitinol,
    push,
)
from continuum_grasp.base import Array
from continuum_grasp.rod import Elastica, solve_elastica
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import Equilibrium, equilibrium
from tests.closed_forms.rods import TipPose, bent_by_moment, bent_by_tip_force, buckled_column, euler_load
from tests.rods import HANGING, UPRIGHT

ELEMENTS = {"arc": 16, "clothoid": 4, "matched_clothoid": 4}
"""With which each family is asked for the limit of its column."""
LIMITS = {"arc": 5e-3, "clothoid": 5e-4, "matched_clothoid": 5e-4}
"""Errors of the tip per length that so many elements may leave at bends of about two radians."""
EULER = euler_load(STIFFNESS, LENGTH)
MODEL = "equilibrium"


def at_rest(scene: Scene, truth: Callable[[], Any], **options: Any) -> Found:
    """Equilibrium and the error of its tip, per length."""
    found = equilibrium(scene, **options)
    return Found(_distance(found.tip, truth()), found.iterations, found.warnings)


def _distance(a: Any, b: Any) -> float:
    return float(np.hypot(*(np.asarray(a) - np.asarray(b))) / LENGTH)


@lru_cache(maxsize=64)
def exact(scene: Scene) -> Elastica:
    """The elastica of a scene."""
    return solve_elastica(scene)


# Scenes.


def sideways(family: str, elements: Any, load: float) -> Scene:
    """A dead force across the tip, ``load`` in units of EI/L2, towards +Y."""
    return nitinol(family, elements, bending_range=4.0, loads=[push(0.0, load * STIFFNESS / LENGTH**2)])


def heavy(family: str, elements: Any) -> Scene:
    """100 times the rod's mass at the hanging tip, pulled aside with a third of its weight."""
    pull = push(100 * MASS * 9.81 / 3, 0.0)
    return nitinol(family, elements, angle=HANGING, gravity=GRAVITY, tip_mass=100 * MASS, loads=[pull])


def coiled(family: str, elements: int, share: float) -> Scene:
    """A tip moment that bends every element to a share of a range of one radian."""
    moment = share * elements * STIFFNESS / LENGTH
    return nitinol(family, elements, bending_range=1.0, actuation={"tip_moment": moment})


def standing(family: str, elements: Any) -> Scene:
    """Upright under 1.5 times the tip mass that it can carry."""
    mass = 1.5 * EULER / 9.81
    return nitinol(family, elements, angle=UPRIGHT, gravity=GRAVITY, tip_mass=mass, bending_range=4.0)


def column(family: str, elements: Any, angle: float) -> Scene:
    """Upright under the dead load with which its tip turns by that angle."""
    load = buckled_column(angle)[0] * STIFFNESS / LENGTH**2
    return nitinol(family, elements, angle=UPRIGHT, bending_range=4.0, loads=[push(0.0, -load)])


def snapping(family: str, elements: Any, across: float) -> Scene:
    """Upright under 1.3 times the critical load, pushed across by a part of that load."""
    return nitinol(family, elements, angle=UPRIGHT, bending_range=4.0, loads=[push(across * EULER, -1.3 * EULER)])


# Measures with branches.


def straight_beyond_buckling(scene: Scene) -> Found:
    """The straight equilibrium is found where it is asked for, and called unstable."""
    found = equilibrium(scene, stable=False)
    said = float(found.stable) + _distance(found.tip, (0.0, LENGTH))
    return Found(said, found.iterations, found.warnings)


def both_sides(scene: Scene, truth: Callable[[], tuple[float, float]]) -> Found:
    """Both buckled shapes, stable and mirror images, each where the truth has it."""
    sides = [equilibrium(scene, side=side) for side in (1, -1)]
    across, along = truth()
    error = sum(not s.stable for s in sides) + abs(sides[0].tip[0] + sides[1].tip[0]) / LENGTH
    for found in sides:
        error += _distance((abs(found.tip[0]), found.tip[1]), (abs(across), along))
    return Found(error, sum(s.iterations for s in sides), tuple(w for s in sides for w in s.warnings))


def _last(follow: Callable[[float, Any], Any]) -> tuple[float, Any]:
    """Greatest load, to 1e-3, up to which a branch can be followed, and what is there; halving the step where it is
    lost.
    """
    load, step, state = 0.0, 0.05, follow(0.0, None)
    while state is not None and step > 5e-4:
        further = follow(load + step, state)
        if further is None:
            step *= 0.5
        else:
            load, state = load + step, further
        if load > 2.0:
            state = None
    return (math.nan if state is None else load), state


@lru_cache(maxsize=1)
def true_snap() -> float:
    """Force across, per critical load, at which the elastica leaves the side that it is pushed from."""

    def followed(across: float, before: Elastica | None) -> Elastica | None:
        scene = snapping("matched_clothoid", 2, across)
        found = solve_elastica(scene, side=1) if before is None else solve_elastica(scene, guess=before.angle)
        return found if found.tip[0] < 0.0 else None

    return _last(followed)[0]


def snap_through(family: str) -> Found:
    """Snap load of the model against the elastica's, and the stable shape on the other side after it."""
    elements = ELEMENTS[family]
    side = 1 if equilibrium(snapping(family, elements, 0.0)).tip[0] < 0.0 else -1

    def followed(across: float, before: Equilibrium | None) -> Equilibrium | None:
        options: dict[str, Any] = {"side": side} if before is None else {"guess": before.q}
        found = equilibrium(snapping(family, elements, across), **options)
        return found if found.tip[0] < 0.0 else None

    load, last = _last(followed)
    after = equilibrium(snapping(family, elements, load + 0.01), guess=last.q)
    true = solve_elastica(snapping("matched_clothoid", 2, load + 0.01), guess=_angles(after))
    error = abs(load - true_snap()) / true_snap() + (not after.stable) + (after.tip[0] <= 0.0)
    return Found(error + _distance(after.tip, true.tip), after.iterations, after.warnings)


def both_under_one_load(family: str) -> Found:
    """Both stable shapes under 0.7 of the snap load, each where the elastica has it."""
    across = round(0.7 * true_snap(), 6)
    scene, same = snapping(family, ELEMENTS[family], across), snapping("matched_clothoid", 2, across)
    start = equilibrium(snapping(family, ELEMENTS[family], 0.0), side=1)
    error, steps = 0.0, 0
    tips = []
    for guess in (start.q, -start.q):
        found = equilibrium(scene, guess=guess)
        true = solve_elastica(same, guess=_angles(found))
        error += _distance(found.tip, true.tip) + (not found.stable) + (not true.stable)
        steps += found.iterations
        tips.append(found.tip[0])
    return Found(error + (tips[0] * tips[1] >= 0.0), steps)


def _angles(found: Equilibrium) -> Array:
    """World angles of a shape at equal places, from its backbone."""
    steps = np.diff(found.backbone(201), axis=0)
    middle = np.unwrap(np.arctan2(-steps[:, 0], steps[:, 1]))
    return np.concatenate([[0.0], 0.5 * (middle[1:] + middle[:-1]), [middle[-1]]])


# Attempts.


def static_attempts() -> Iterator[Attempt]:
    """All attempts at shapes at rest."""
    for family in FAMILIES:
        yield from _of(family)


def _of(family: str) -> Iterator[Attempt]:
    count, limit = ELEMENTS[family], LIMITS[family]

    def add(case: str, run: Callable[[], Found], bound: float = limit, *verdicts: str) -> Attempt:
        return Attempt(case, family, MODEL, run, bound, verdicts or (RIGHT,))

    none = nitinol(family)
    yield add("at rest without loads", partial(at_rest, none, lambda: (LENGTH, 0.0)), 1e-15)
    case, slight = "at rest, pushed by 1e-9 EI/L2", sideways(family, count, 1e-9)
    yield add(case, partial(_deflected, slight, 1e-9 / 3.0), limit if family == "arc" else 1e-6)
    case, lopsided = "at rest, one element 1 % of the other", sideways(family, (0.594, 0.006), 0.5)
    run = partial(at_rest, lopsided, partial(_level, bent_by_tip_force, 0.5))
    yield add(case, run, 5e-2 if family == "arc" else 5e-4)
    case, pushed = "at rest, pushed by 10 EI/L2", sideways(family, count, 10.0)
    yield add(case, partial(at_rest, pushed, partial(_level, bent_by_tip_force, 10.0)))
    case, weight = "at rest, 100-fold tip mass", heavy(family, count)
    yield add(case, partial(at_rest, weight, partial(_tip, weight)), 4 * limit)
    for share in (1.0, 1.05, 2.9, 3.1):
        scene = coiled(family, 4, share)
        run = partial(at_rest, scene, partial(_level, bent_by_moment, 4 * share))
        yield add(f"at rest, coiled to {share:g} times the range", run, 1e-3, RIGHT)
    upright = standing(family, count)
    yield add("standing, straight and unstable", partial(straight_beyond_buckling, upright), 1e-9)
    yield add("standing, buckled to both sides", partial(both_sides, upright, partial(_tip, upright)), 3 * limit)
    for angle in (0.5, 1.5, 2.5):
        scene = column(family, count, angle)
        case = f"column, tip turned by {angle:g} rad, both sides"
        yield add(case, partial(both_sides, scene, partial(_buckled, angle)), 6 * limit)
    yield add("both shapes under 0.7 of the snap load", partial(both_under_one_load, family), 4 * limit)
    yield add("snap-through under a rising load", partial(snap_through, family), 0.01 + 4 * limit)


def _deflected(scene: Scene, deflection: float) -> Found:
    """Relative error of a tiny deflection, per length."""
    found = equilibrium(scene)
    return Found(abs(found.tip[1] / LENGTH / deflection - 1.0), found.iterations, found.warnings)


def _level(form: Callable[[float], TipPose], load: float) -> tuple[float, float]:
    """Place of the tip of a closed form whose rod begins along world +X [m]."""
    pose = form(load)
    return pose.along * LENGTH, pose.across * LENGTH


def _tip(scene: Scene) -> tuple[float, float]:
    tip = exact(scene).tip
    return float(tip[0]), float(tip[1])


def _buckled(angle: float) -> tuple[float, float]:
    pose = buckled_column(angle)[1]
    return pose.across * LENGTH, pose.along * LENGTH
