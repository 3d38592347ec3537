"""Scenes without a grasp, made from ones that have some by tightening limits below what the oracle needs: one, or two.

Of two limits the first bounds the shape (strain or bend), and is below what the least of all touching shapes has,
whatever the forces; the second bounds forces, and is below what the best of all shapes needs. So no change of one limit
is enough.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.grasp_oracle.geometry import Posture
from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.rod import trace
from benchmarks.grasp_oracle.scenes import scene_of
from benchmarks.grasp_oracle.search import Search
from continuum_grasp.scene import GraspScene

CAUSES = ("tension", "friction", "mass", "strain", "reach", "clearance", "tension", "friction", "mass", "bend")
"""Taken in turn."""
PAIRS = (("strain", "tension"), ("strain", "friction"), ("strain", "tension"), ("strain", "mass"), ("bend", "tension"))
"""Taken in turn."""
TIGHT = (0.6, 0.92)
"""Of what is needed, the limit."""
ENOUGH = 1e5
"""Stands for no limit."""


def tighten(seed: int, number: int) -> dict[str, Any] | None:
    """What makes a scene infeasible: cause, what is needed, and the limit to set; None where the cause does not fit."""
    scene, cause = scene_of("one", seed), CAUSES[number % len(CAUSES)]
    random = np.random.default_rng([3, seed])
    search = Search(numbers(scene))
    found = _NEEDS[cause](search, scene, random)
    return None if found is None else {"cause": cause, **found}


def tighten_two(seed: int, number: int) -> dict[str, Any] | None:
    """The same by two limits: both causes, what each needs when the other is no limit, and the limits to set."""
    scene, (shape, force) = scene_of("one", seed), PAIRS[number % len(PAIRS)]
    random = np.random.default_rng([5, seed])
    search = Search(numbers(scene))
    if shape == "bend" and search.hand.family != "arc":
        return None
    free = search.numbers.limited(strain=math.inf, bend=2.0 * math.pi)
    second = _NEEDS[force](Search(free), scene, random)
    least = search.least_shape(search.strain if shape == "strain" else search.bend)
    if second is None or least is None:
        return None
    row: dict[str, Any] = {}
    if shape == "strain":
        row["diameter"] = _diameter(scene)
        least *= 0.5 * row["diameter"] / (search.hand.radius or search.hand.length)
        if least > 0.5:
            return None
    needs, limits = [least, second["needed"]], [least * random.uniform(*TIGHT), second["limit"]]
    return {"causes": [shape, force], "needed": needs, "limits": limits, **row}


def tightened(row: dict[str, Any]) -> GraspScene:
    """The scene of a row."""
    changes: dict[str, Any] = {}
    causes, limits = row.get("causes") or [row["cause"]], row.get("limits") or [row["limit"]]
    for cause, limit in zip(causes, limits, strict=True):
        if cause == "reach":
            changes["finger.base.position"] = row["base"]
        elif cause == "clearance":
            wall = {"type": "palm", "point": row["point"], "normal_angle": row["angle"], "touch": "off"}
            changes["supports.wall"] = wall
        else:
            changes[_KEYS[cause]] = limit
    if "diameter" in row:
        changes["finger.rod.diameter"] = row["diameter"]
    return scene_of("one", row["scene"]).changed(changes)


_KEYS = {
    "tension": "finger.tendons.max_tension",
    "friction": "contacts.friction",
    "mass": "object.mass",
    "strain": "finger.strain_limit",
    "bend": "fidelity.bending_range",
}
"""Limits of the scene that causes tighten."""


def _tension(search: Search, scene: GraspScene, random: Any) -> dict[str, Any] | None:
    best = search.best("tension", search.numbers.limited(tension=ENOUGH))
    limit = 0.0 if best is None else best.value * random.uniform(*TIGHT)
    if best is None or limit <= 1.02 * scene.setups[0].finger.tendons.min_tension:
        return None
    return {"needed": best.value, "limit": limit}


def _friction(search: Search, scene: GraspScene, random: Any) -> dict[str, Any] | None:
    if not any(scene.gravity):  # a touch without force needs none
        return None
    needed = search.least_friction(search.numbers)
    return {"needed": needed, "limit": needed * random.uniform(0.5, 0.92)} if 0.02 < needed < 10.0 else None


def _mass(search: Search, scene: GraspScene, random: Any) -> dict[str, Any] | None:
    if not any(scene.gravity):
        return None
    best = search.best("mass")
    return None if best is None else {"needed": best.value, "limit": best.value * random.uniform(1.1, 1.8)}


def _strain(search: Search, scene: GraspScene, random: Any) -> dict[str, Any] | None:
    best, diameter = search.best(measure=lambda p: float(np.abs(p.ends).max())), _diameter(scene)
    needed = math.inf if best is None else 0.5 * diameter * best.value
    if needed > 0.5:
        return None
    return {"needed": needed, "limit": needed * random.uniform(*TIGHT), "diameter": diameter}


def _diameter(scene: GraspScene) -> float:
    """The rod's diameter [m], or one for a rod without."""
    finger = scene.setups[0].finger
    return float(finger.rod.diameter or 0.3 * finger.thickness_radius)


def _bend(search: Search, scene: GraspScene, random: Any) -> dict[str, Any] | None:
    if search.hand.family != "arc":
        return None
    best = search.best(measure=search.bend)
    return None if best is None else {"needed": best.value, "limit": best.value * random.uniform(*TIGHT)}


def _reach(search: Search, scene: GraspScene, random: Any) -> dict[str, Any] | None:
    """The base is moved straight away from the object; needed is how far it is then beyond the finger's reach."""
    hand, outline = search.hand, search.numbers.outline(search.hand.thickness)
    most = hand.bounds[1] if hand.middle else hand.length
    away = np.array(hand.base) - np.array(search.numbers.com)
    walls = [np.array(n) for _, n in search.numbers.walls]
    away /= np.linalg.norm(away)
    for normal in walls:  # not into the palm
        away -= min(0.0, float(away @ normal)) * normal
    far = hand.length * random.uniform(1.05, 2.0)
    base = np.array(hand.base) + away / np.linalg.norm(away) * far
    over = float(outline.gap(base)) - most
    return {"needed": over, "limit": 0.0, "base": base.tolist()} if over > 0.02 * hand.length else None


def _clearance(search: Search, scene: GraspScene, random: Any) -> dict[str, Any] | None:
    """A wall beside the object, where the finger has to pass between the two."""
    best = search.best()
    if best is None:
        return None
    hand = search.hand
    outline = search.numbers.outline(0.0)
    spot = best.posture.lengths[0] if hand.middle else hand.length
    points, _ = trace(hand.base, hand.angle, best.posture.ends[None], best.posture.lengths[None], 50)
    place = points[0, 0, -1] if hand.middle else points[0, 1, -1]
    normal = -search.numbers.outline(hand.thickness).nearest(place)[1]

    def low(posture: Posture) -> float:
        walked, _ = trace(hand.base, hand.angle, posture.ends[None], posture.lengths[None], 400)
        return -float((walked @ normal).min())

    found = search.best(measure=low)
    if found is None or spot <= 0.0:
        return None
    depth = hand.thickness * random.uniform(0.3, 1.2)
    height = -found.value - hand.thickness + depth
    rim = float((outline.at(np.linspace(0.0, 1.0, 2000))[0] @ normal).min())
    at_base = float(np.array(hand.base) @ normal)
    if at_base < height + hand.thickness or rim < height + 1e-3 * hand.length:
        return None
    point = np.array(search.numbers.com) + (height - float(np.array(search.numbers.com) @ normal)) * normal
    angle = math.atan2(normal[1], normal[0])
    return {"needed": depth, "limit": 0.0, "point": point.tolist(), "angle": angle}


_NEEDS = {
    "tension": _tension,
    "friction": _friction,
    "mass": _mass,
    "strain": _strain,
    "bend": _bend,
    "reach": _reach,
    "clearance": _clearance,
}
