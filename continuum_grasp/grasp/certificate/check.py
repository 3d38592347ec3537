"""The checks of contacts and clearances, one verified property each, and the limits of all checks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.base import amount_text
from continuum_grasp.grasp.certificate.recomputed import (
    RecomputedContact,
    RecomputedFinger,
    RecomputedGrasp,
    across,
    known_contacts,
)
from continuum_grasp.grasp.certificate.surfaces import SPREAD, PlacedObject, segment_distance
from continuum_grasp.scene import Wall

EXACT = 1e-6
"""Limit of residuals of moments and forces, as a part of the greatest moment or force in play; of contact gaps, stored
positions and slopes, as a part of the finger's length (slopes: rad); and part of it by which a limit may be exceeded.
Optima of IPOPT, recomputed independently, stay below 2e-7 (400 random scenes)."""
CURLED, CROSSED = "passes through itself", "overlap of fingers"
"""Name of the check of a finger against itself, before the finger's."""
GUARDED = 1e-4
"""Limit of what depends on the places at which the optimizer looks at clearance, some eight per element: penetration of
the dense backbone between them, as a part of the finger's length (10 um of 0.1 m); and friction cones with other
friction states, as a part of the greatest force, whose reserve these places change by up to 4e-5."""


@dataclass(frozen=True)
class Check:
    """A verified property.

    Attributes
    ----------
    name : str
        Name of the check.
    value, limit : float
        The value found and the greatest that passes [1].
    relative_to : str
        The quantity that the value was divided by.
    """

    name: str
    value: float
    limit: float
    relative_to: str = ""

    @classmethod
    def part(cls, name: str, off: float, size: float, unit: str, limit: float = EXACT) -> Check:
        """The check of a deviation as a part of a size with its unit."""
        return cls(name, off / size, limit, amount_text(size, unit, ".4g"))

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return bool(self.value <= self.limit)


def worst(*values: float) -> float:
    """The greatest; NaN where one is."""
    return float(np.max(np.array(values, dtype=float)))


def mode_check(grasp: RecomputedGrasp) -> Check:
    """Number of contacts that are missing, unknown, there twice, or there although they are off."""
    switches = {name: switch for setup in grasp.setups for name, switch in setup.switches.items()}
    present = Counter(grasp.names)
    wrong = sum(count - 1 for count in present.values())
    wrong += len(set(present) - set(known_contacts(grasp.scene)))
    for body in grasp.scene.places:
        ends = (f"{body.name}.1" in present) + (f"{body.name}.2" in present)
        whole = body.name in present
        wrong += ends == 1 or (ends == 2 and whole)  # a face lies on both of its ends; other bodies touch once
        wrong += _amiss(body.touch, whole or ends == 2)
    wrong += sum(_amiss(switch, name in present) for name, switch in switches.items())
    return Check("contacts match the scene", float(wrong), 0.0)


def contact_checks(grasp: RecomputedGrasp) -> Iterator[Check]:
    """Forces, gaps and normals of each contact."""
    scale = grasp.force_scale
    for c in grasp.contacts:
        n, f, lift = c.normal_force, c.friction_force, c.lift
        over = float(np.hypot(f, lift)) - c.held_friction * n
        yield Check.part(f"friction cone, {c.name}", over, scale, "N")
        limit = c.normal_force_max  # pulls count against the forces in play, however high the limit is
        yield Check(f"normal force, {c.name}", worst(-n / scale, n / limit - 1), EXACT, amount_text(limit, "N", ".4g"))
        yield from _geometry(grasp, c)


def _geometry(grasp: RecomputedGrasp, c: RecomputedContact) -> Iterator[Check]:
    off = [*np.abs(c.stored_position - c.point) / c.length, *np.abs(c.stored_normal - c.normal)]
    if c.finger is not None:
        off.append(abs(c.stored_station - c.finger.joint_position(c.joint)) / c.length)
    yield Check(f"stored contact, {c.name}", worst(*off), EXACT, f"{c.length:.4g} m")
    # The optimizer lets an object at rest lie that far from a support.
    limit = 2 * EXACT if c.finger is None else EXACT
    yield Check.part(f"contact gap, {c.name}", c.gap, c.length, "m", limit)
    yield Check.part(f"contact normal, {c.name}", c.tilt, c.length, "m", limit)
    if len(grasp.object.parts) > 1:
        yield Check.part(f"contact inside another part, {c.name}", c.buried, c.length, "m")
    if isinstance(c.support, Wall) and np.isfinite(c.support.half_length):
        beyond = abs(float(across(c.support.normal) @ (c.point - np.asarray(c.support.point)))) - c.support.half_length
        yield Check.part(f"within the line, {c.name}", beyond, c.length, "m", 2 * EXACT)


def _amiss(switch: str, present: bool) -> bool:
    return (switch == "on" and not present) or (switch == "off" and present)


def clearance_checks(grasp: RecomputedGrasp) -> Iterator[Check]:
    """Fingers against object, supports and each other, object against supports."""
    for finger in grasp.fingers:
        along = [c.joint for c in finger.contacts if c.kind != "tip"]
        emerges = int(finger.joint_edges[min(along, default=finger.setup.before[0])])
        depths = [("the object", depth_in_object(finger.points, grasp.object, finger.thickness))]
        depths += [(w.name, depth_in_wall(finger.points, w, finger.thickness, emerges)) for w in grasp.scene.walls]
        for peg in grasp.scene.pegs:
            away = segment_distance(np.asarray(peg.position), finger.points[:-1], finger.points[1:])
            thick = np.maximum(finger.thickness[:-1], finger.thickness[1:])
            depths.append((peg.name, float((thick + peg.radius - away).max())))
        for what, depth in depths:
            yield Check.part(f"penetration into {what}, {finger.name}", depth, finger.length, "m", GUARDED)
        yield Check.part(f"{CURLED}, {finger.name}", self_overlap(finger), finger.length, "m", GUARDED)
    length = min(finger.length for finger in grasp.fingers)
    depths = [(wall.name, depth_of_wall(grasp.object, wall)) for wall in grasp.scene.walls]
    for peg in grasp.scene.pegs:
        depths.append((peg.name, peg.radius - float(grasp.object.distance(np.asarray(peg.position)[None])[0])))
    for what, depth in depths:
        yield Check.part(f"penetration of the object into {what}", depth, length, "m", GUARDED)
    for first, other in combinations(grasp.fingers, 2) if grasp.scene.overlap == "forbid" else ():
        name = f"{CROSSED}, {first.name}, {other.name}"
        yield Check.part(name, overlap(first, other), other.length, "m", GUARDED)


def depth_in_object(points: Array, body: PlacedObject, thickness: float | Array) -> float:
    """Greatest depth of a finger in an object [m], negative where they are apart.

    ``points`` (K, 2) [m] are its backbone, densely; ``thickness`` is half the finger's [m], or (K,) there.
    """
    half = np.broadcast_to(thickness, len(points))
    depth = float((half - body.distance(points)).max())
    start = points[:-1]
    end = points[1:]
    step = float(np.hypot(*(end - start).T).max())
    # 20.0: radius of curvature, in distances of two samples, below which a surface may reach between them
    corners, radii = body.sharp_places(20.0 * step)
    if not len(corners):
        return depth
    # Between two samples a corner may reach deeper: panels that pass one are sampled finely.
    gaps = segment_distance(corners[:, None], start, end) - radii[:, None]
    close = np.flatnonzero((gaps < np.maximum(half[:-1], half[1:]) + step).any(axis=0))
    if close.size:
        fine = start[close, None] + SPREAD[:, None] * (end - start)[close, None]
        thick = half[close, None] + SPREAD * (half[close + 1] - half[close])[:, None]
        depth = worst(depth, float((thick.ravel() - body.distance(fine.reshape(-1, 2))).max()))
    return depth


def depth_in_wall(points: Array, wall: Wall, thickness: float | Array, emerges: int) -> float:
    """Greatest depth of a finger's body in a wall [m]; negative where they are apart.

    A finger whose base is closer to the wall than half its thickness comes out of it: it then needs space only
    behind the point ``emerges``, its first contact along it, and before that must not lie deeper than its base.
    """
    normal = np.asarray(wall.normal)
    middle = np.asarray(wall.point)
    height = (points - middle) @ normal
    spare = height
    crossing = -np.inf
    if np.isfinite(wall.half_length):
        along = across(normal)
        reach = wall.half_length * along
        spare = segment_distance(points, middle - reach, middle + reach)
        for end in (middle - reach, middle + reach):  # may lie between two samples
            nearer = segment_distance(end, points[:-1], points[1:])
            spare[1:] = np.minimum(spare[1:], nearer)
        # A finger that passes through the line is as deep as the side that reaches less far from it.
        beside = np.abs((points - middle) @ along) <= wall.half_length
        passes = beside[:-1] & beside[1:] & (height[:-1] * height[1:] < 0.0)
        if passes.any():
            crossing = float(np.max(thickness)) + min(float(height[beside].max()), -float(height[beside].min()))
    needed = np.array(np.broadcast_to(thickness, len(points)), dtype=float)
    # 1e-9: a base that stands exactly off the wall is free, whatever rounding says.
    if not spare[0] >= needed[0] * (1.0 - 1e-9):
        needed[: emerges + 1] = min(0.0, float(spare[0]))
    return worst(float((needed - spare).max()), crossing)


def depth_of_wall(body: PlacedObject, wall: Wall) -> float:
    """Depth of an object in a wall, or a finite line in the object [m]; negative where they are apart.

    The distance along a line is searched closer and closer. A corner that pokes through it counts as deep as it
    reaches.
    """
    normal = np.asarray(wall.normal)
    middle = np.asarray(wall.point)
    tips = body.farthest(-normal) - middle
    if np.isinf(wall.half_length):
        return -float((tips @ normal).min())
    along = across(normal)
    deepest = -np.inf
    for part, tip in enumerate(tips):
        low = -wall.half_length
        high = wall.half_length
        # The distance from a convex part is convex along a line: each round leaves a 20th, five 3e-7 of the line. A
        # polygon is nearest at an end of the line or at one of its own corners.
        corners = np.clip((body.corners(part) - middle) @ along, low, high)
        for first in (True, *(False,) * 4):
            places = np.unique(np.append(np.linspace(low, high, 41), corners if first else []))
            away = body.nearest(middle + places[:, None] * along, body.parts[part]).distance
            k = int(away.argmin())
            low = places[max(k - 1, 0)]
            high = places[min(k + 1, len(places) - 1)]
        depth = -float(away[k])
        if depth > 0.0 and abs(float(along @ tip)) <= wall.half_length:
            depth = worst(depth, -float(normal @ tip))
        deepest = worst(deepest, depth)
    return deepest


def overlap(finger: RecomputedFinger, other: RecomputedFinger) -> float:
    """Depth of two fingers in each other in the plane [m]; negative: their distance.

    Where their backbones cross, by both half thicknesses and as much as a tip is beyond the other backbone.
    """
    a, b = finger.points, other.points
    apart = np.hypot(a[:, None, 0] - b[:, 0], a[:, None, 1] - b[:, 1])
    gap = apart - finger.thickness[:, None] - other.thickness
    # Panels are straight: the nearest places lie on two that end where the points are nearly nearest.
    reach = float(np.hypot(*np.diff(a, axis=0).T).max() + np.hypot(*np.diff(b, axis=0).T).max())
    p, q = _panels(gap <= gap.min() + reach)
    ends = (a[p], b[q], b[q + 1]), (a[p + 1], b[q], b[q + 1]), (b[q], a[p], a[p + 1]), (b[q + 1], a[p], a[p + 1])
    closest = np.min([segment_distance(*each) for each in ends], axis=0)
    deepest = float((_half(finger, p) + _half(other, q) - closest).max())
    p, q = _panels(apart <= reach)
    crossing = _apart(a[p], a[p + 1], b[q], b[q + 1]) & _apart(b[q], b[q + 1], a[p], a[p + 1])
    if crossing.any():
        beyond = (float(segment_distance(tip, line[:-1], line[1:]).min()) for tip, line in ((a[-1], b), (b[-1], a)))
        deepest = worst(deepest, float((_half(finger, p) + _half(other, q))[crossing].max()) + min(beyond))
    return deepest


def self_overlap(finger: RecomputedFinger) -> float:
    """Depth of a finger in itself [m]; negative: the distance of its parts.

    Parts are apart along the finger by more than half a circle of its own half thickness: what bends no sharper than
    its skin allows cannot touch itself closer by. Where the backbone crosses itself, as deep as the tip is beyond.
    """
    # What turns by less than half a circle in all, no sharper than its skin, has no parts that come back to each other.
    turns = np.abs(np.diff(finger.angles))
    sharp = turns * np.maximum(finger.thickness[1:], finger.thickness[:-1]) > np.diff(finger.rod.edges)
    if float(turns.sum()) < np.pi and not sharp.any():
        return -finger.length
    z = finger.points
    s = finger.rod.edges
    half = finger.thickness
    thick = np.maximum(half[:-1], half[1:])
    between = s[None, :-1] - s[1:, None]  # of the end of one panel and the begin of another
    parts = between > np.pi * np.maximum.outer(thick, thick)
    apart = np.hypot(z[:, None, 0] - z[:, 0], z[:, None, 1] - z[:, 1])
    gap = apart - half[:, None] - half
    nodes = np.zeros(gap.shape, dtype=bool)
    nodes[:-1, :-1] |= parts
    if not parts.any():
        return -finger.length
    reach = 2.0 * float(np.hypot(*np.diff(z, axis=0).T).max())
    p, q = _panels(gap <= gap[nodes].min() + reach, parts)
    ends = (z[p], z[q], z[q + 1]), (z[p + 1], z[q], z[q + 1]), (z[q], z[p], z[p + 1]), (z[q + 1], z[p], z[p + 1])
    deepest = float((_half(finger, p) + _half(finger, q) - np.min([segment_distance(*e) for e in ends], axis=0)).max())
    p, q = _panels(apart <= reach, parts)
    crossing = _apart(z[p], z[p + 1], z[q], z[q + 1]) & _apart(z[q], z[q + 1], z[p], z[p + 1])
    if crossing.any():
        before = int(p[crossing].min()) + 1
        beyond = float(segment_distance(z[-1], z[:before], z[1 : before + 1]).min())
        deepest = worst(deepest, float((_half(finger, p) + _half(finger, q))[crossing].max()) + beyond)
    return deepest


def _half(finger: RecomputedFinger, panels: Array) -> Array:
    """Half the thickness of panels, where it is greatest [m]."""
    return np.asarray(np.maximum(finger.thickness[panels], finger.thickness[panels + 1]))


def _panels(near: Array, among: Array | bool = True) -> tuple[Array, Array]:
    """Pairs of panels (m,), (m,) ``among`` some (A - 1, B - 1) that end at nodes which are near each other (A, B)."""
    touched = near[:-1, :-1] | near[1:, :-1] | near[:-1, 1:] | near[1:, 1:]
    p, q = np.nonzero(touched & among)
    return p, q


def _apart(start: Array, end: Array, one: Array, other: Array) -> Array:
    """Whether points lie on different sides of the lines through two others (m,)."""
    span = end - start
    sides = [span[:, 0] * (z - start)[:, 1] - span[:, 1] * (z - start)[:, 0] for z in (one, other)]
    return np.asarray(sides[0] * sides[1] < 0.0)
