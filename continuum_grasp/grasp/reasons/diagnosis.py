"""Why a scene has no grasp: each limit is relaxed alone, and the amount that then suffices is the reason."""

from __future__ import annotations

import math
from collections.abc import Iterator

from continuum_grasp.grasp.problem.relaxations import RELAXATIONS, Relaxation
from continuum_grasp.grasp.reasons.repairs import Repair, Repairs
from continuum_grasp.grasp.result import Reason
from continuum_grasp.grasp.search import Search
from continuum_grasp.grasp.starts.starts import Start
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity
from continuum_grasp.scene.objects import Freedom

__all__ = ["find_reasons", "out_of_reach"]

FIRST, MORE = 4, 8
"""Starts per limit, and per limit that gives a grasp, or per limit again if none does."""
RARE = 1.0
"""Friction coefficient that few surfaces have: reasons that ask for more are listed last."""


def out_of_reach(scene: GraspScene) -> Reason | None:
    """The exact test of distance: no shape at all can touch."""
    worst: tuple[float, float, float] | None = None
    for setup in scene.setups:
        needed = "on" in (*setup.middles, setup.tip) or len(scene.setups) == 1
        distance, reach = _distance(scene, setup), _reach(setup)
        if needed and distance > reach and (worst is None or distance - reach > worst[0]):
            worst = distance - reach, distance, reach
    if worst is None:
        return None
    missing, distance, reach = worst
    text = f"the object is out of reach: it is {distance:.4g} m from the base, {reach:.4g} m can be reached"
    repair = f"bring object and base nearer to each other, by {missing:.4g} m at least"
    return Reason("reach", "object.position", "m", distance, reach, text, repair)


def _reach(setup: FingerSetup) -> float:
    """How far from its base a finger can touch at most [m]."""
    length = setup.finger.rod.length
    middle = setup.middle_bounds[1] if "on" in setup.middles else length
    return min(middle, length) + setup.finger.thickness_radius


def _distance(scene: GraspScene, setup: FingerSetup) -> float:
    """Least distance between a base and the object's surface [m]; a lower bound where a pose is free."""
    x, y = setup.finger.base.position
    body = scene.object
    if body.free is None and setup.finger.base_free is None:
        return body.distance((x, y))
    c, s = math.cos(body.angle), math.sin(body.angle)
    com = (
        body.position[0] + c * body.com[0] - s * body.com[1],
        body.position[1] + s * body.com[0] + c * body.com[1],
    )
    turns = body.free is not None and body.free.angle is not None
    away = math.dist((x, y), com) - body.size if turns else body.distance((x, y))
    slack = math.dist(com, body.position) if turns else 0.0
    return away - slack - _shift(body.free, body.position) - _shift(setup.finger.base_free, (x, y))


def _shift(free: Freedom | None, at: tuple[float, float]) -> float:
    """How far a pose may move at most [m]."""
    if free is None:
        return 0.0
    spans = [max(b[1] - v, v - b[0]) if b else 0.0 for b, v in zip((free.x, free.y), at, strict=True)]
    return math.hypot(*spans)


def find_reasons(scene: GraspScene, search: Search) -> list[Reason]:
    """Find the limits each of which, relaxed alone, gives a grasp that the certificate confirms.

    Parameters
    ----------
    scene : GraspScene
    search : Search
        A search without success; its starts are used, and grasps that turn up after all are added to it.

    Returns
    -------
    list of Reason
        Those that the scene has a number for first, by how small a factor is missing.
    """
    repairs = Repairs(scene, search)
    starts: dict[str, list[Start]] = {}
    for relaxation in _sensible(scene):
        if search.budget.over:
            break
        starts[relaxation.name] = repairs.starts(relaxation)
        repairs.try_starts(relaxation, starts[relaxation.name][:FIRST])
    for relaxation in repairs.relaxations or [r for r in RELAXATIONS if r.name in starts]:
        repairs.go_on(relaxation)
        repairs.try_starts(relaxation, starts[relaxation.name][FIRST:MORE])
        if relaxation.name in repairs.found:
            repairs.try_starts(relaxation, repairs.starts(relaxation)[:MORE])
        repairs.go_on(relaxation)
    reasons = [_reason(scene, relaxation, repairs.settled(relaxation)) for relaxation in repairs.relaxations]
    return sorted(reasons, key=_rank)


def _reason(scene: GraspScene, relaxation: Relaxation, repair: Repair) -> Reason:
    limit, needed = relaxation.limit(scene), relaxation.value(scene, repair.amount)
    text, confirmed = relaxation.sentence(scene, repair.amount), None
    if repair.confirmed is not None:
        confirmed = relaxation.value(scene, repair.confirmed)
        text += f" ({confirmed:.4g} by linear programming at that posture)"
    advice = relaxation.advice(scene, repair.amount)
    return Reason(relaxation.name, relaxation.key, relaxation.unit, limit, needed, text, advice, confirmed)


def _rank(reason: Reason) -> tuple[bool, float, int]:
    """Limits that the scene has a number for come first, by the factor that they are off, and then in order of trial;
    a friction that few surfaces have comes after them.
    """
    order = [relaxation.name for relaxation in RELAXATIONS].index(reason.name)
    rare = reason.name == "friction" and reason.needed > RARE
    if rare or reason.limit <= 0.0 or reason.needed <= 0.0:
        return True, 0.0, order
    return False, round(abs(math.log(reason.needed / reason.limit)), 2), order


def _sensible(scene: GraspScene) -> Iterator[Relaxation]:
    for relaxation in RELAXATIONS:
        if relaxation.name == "mass" and scene.weight == 0.0:
            continue
        if relaxation.name == "tilt balance" and not _balances_tilt(scene):
            continue
        if relaxation.name == "clearance at the supports" and not scene.supports:
            continue
        if relaxation.name == "strain" and all(f.strain_limit is None for f in scene.named_fingers.values()):
            continue
        yield relaxation


def _balances_tilt(scene: GraspScene) -> bool:
    gravity = scene.gravity
    return isinstance(gravity, OutOfPlaneGravity) and gravity.tilt == "balance" and scene.object.mass > 0
