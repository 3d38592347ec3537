"""The object and its supports: contacts with walls and pegs at a pose, and the poses that are tried."""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from continuum_grasp.model import PartOutline, surface_of
from continuum_grasp.scene import FingerSetup, GraspScene, Peg, Wall

Interval = tuple[float, float]
Pose = tuple[float, float, float]
"""World x, y [m] and angle [rad]."""
EXACT = 1e-12
"""Residual, in sizes of the object, at which it touches a support: rounding after a few operations."""

_MORE_BASES = (4, 2)
"""Further poses of a free base: for the first pose of the object, and for the others."""


@dataclass(frozen=True)
class TouchedPlace:
    """Place of a contact on the object, in its frame."""

    part: int  # index of the object's part that is touched
    point: tuple[float, float]  # on its surface [m]
    normal_angle: float  # of the outward normal [rad]


def object_outlines(scene: GraspScene) -> tuple[PartOutline, ...]:
    """The object's parts in its own frame, not grown."""
    return tuple(surface_of(part).outline(part) for part in scene.object.parts)


def support_contacts(scene: GraspScene, pose: Pose, wanted: Collection[str]) -> dict[str, TouchedPlace]:
    """Contacts of the object with walls and pegs by name at a world pose [m, rad], whether it touches there or not.

    A wall touches the outermost point; a flat face that lies on it touches at its two ends, "<wall>.1" and "<wall>.2",
    as far as a finite wall reaches.
    """
    shapes = object_outlines(scene)
    contacts: dict[str, TouchedPlace] = {}
    for wall in scene.walls:
        if wall.name in wanted:
            ends = _wall_ends(shapes, wall, pose, scene.touching_gap)
            names = [wall.name] if len(ends) == 1 else [f"{wall.name}.1", f"{wall.name}.2"]
            contacts |= zip(names, ends, strict=True)
    for peg in scene.pegs:
        if peg.name in wanted:
            contacts[peg.name] = nearest_contact(scene, pose, complex(*peg.position))
    return contacts


def touching_supports(scene: GraspScene, pose: Pose) -> frozenset[str]:
    """Names of the walls and pegs that the object touches at a pose, to within a millionth of its size."""
    shapes = object_outlines(scene)
    near = scene.touching_gap
    return frozenset(
        body.name
        for body in scene.places
        if abs(_gap(shapes, body, pose)[0]) <= near and not _beside(shapes, body, pose, near)
    )


def _to_world(z: complex, pose: Pose) -> complex:
    return complex(pose[0], pose[1]) + z * cmath.exp(1j * pose[2])


def _along(wall: Wall, pose: Pose, point: complex) -> float:
    """Position of a point of the object's frame along a wall [m]."""
    rel = _to_world(point, pose) - complex(*wall.point)
    return (rel * cmath.exp(-1j * wall.normal_angle)).imag


def _lowest(shapes: tuple[PartOutline, ...], wall: Wall, pose: Pose, flat: float) -> list[tuple[int, complex]]:
    """Part and point in the object's frame of the lowest point above a wall; the leftmost and the rightmost one where
    several are level to within ``flat``.
    """
    down = cmath.exp(1j * (wall.normal_angle + math.pi - pose[2]))
    ends = [(part, point) for part, shape in enumerate(shapes) for point, _ in shape.extremes(down, flat)]
    heights = [wall.height((w.real, w.imag)) for w in (_to_world(point, pose) for _, point in ends)]
    level = [(h, *end) for h, end in zip(heights, ends, strict=True) if h <= min(heights) + flat]
    level.sort(key=lambda end: _along(wall, pose, end[2]))
    if len(level) > 1 and abs(level[0][2] - level[-1][2]) <= flat:
        # One corner, shared by two faces or two parts.
        level = [min(level, key=lambda end: end[0])]
    return [(part, point) for _, part, point in (level if len(level) == 1 else (level[0], level[-1]))]


def _wall_ends(shapes: tuple[PartOutline, ...], wall: Wall, pose: Pose, flat: float) -> list[TouchedPlace]:
    level = _lowest(shapes, wall, pose, flat)
    normal = math.remainder(wall.normal_angle + math.pi - pose[2], math.tau)
    if len(level) == 2 and np.isfinite(wall.half_length):
        # A face that reaches beyond a finite wall touches at the wall's end.
        low, high = (_along(wall, pose, point) for _, point in level)
        face = level[1][1] - level[0][1]
        clipped = []
        for (part, point), at in zip(level, (low, high), strict=True):
            aim = min(max(at, -wall.half_length), wall.half_length)
            clipped.append((part, point + (aim - at) / (high - low) * face))
        level = clipped if abs(clipped[0][1] - clipped[1][1]) > flat else clipped[:1]
    return [TouchedPlace(part, (point.real, point.imag), normal) for part, point in level]


def nearest_contact(scene: GraspScene, pose: Pose, world: complex) -> TouchedPlace:
    """The place on the object nearest to a world point [m]."""
    outlines = object_outlines(scene)
    at = np.array([(world - complex(pose[0], pose[1])) * cmath.exp(-1j * pose[2])])
    part = int(np.argmin([float(outline.distance(at)[0]) for outline in outlines]))
    place = outlines[part].walk(outlines[part].nearest(at)[1])
    point = complex(place.point[0])
    return TouchedPlace(part, (point.real, point.imag), math.remainder(float(place.angle[0]), math.tau))


def object_poses(scene: GraspScene, on: frozenset[str]) -> list[Pose]:
    """World poses [m, rad] of the object at which it touches the supports that are on, the one nearest to the scene's
    own first; the scene's own alone where it is fixed, or where none was found.
    """
    scene_pose, free = scene.object.pose, scene.object.free
    if free is None:
        return [scene_pose]
    shapes = object_outlines(scene)
    bounds = scene.object.pose_bounds
    is_round = len(shapes) == 1 and shapes[0].is_round
    flat = [] if free.angle is None else _flat_angles(scene, on, shapes, bounds[2], scene_pose[2])
    tries: list[tuple[Pose, list[Interval]]] = []
    # 4: most angles of a free object at which a face lies flat on a wall
    for angle in flat[:4]:
        tries.append(((scene_pose[0], scene_pose[1], angle), [bounds[0], bounds[1], (angle, angle)]))
    tries.insert(min(1, len(tries)), (scene_pose, bounds))
    # Of the further ones every other lies flat, too, where a face can.
    # 6: further poses of a free object
    for k, pose in enumerate(_spread(bounds, 6)):
        if is_round:
            angle = scene_pose[2]
        elif flat and k % 2:
            angle = flat[k % len(flat)]
        else:
            angle = pose[2]
        held = [bounds[0], bounds[1], (angle, angle) if flat and k % 2 else bounds[2]]
        tries.append(((pose[0], pose[1], angle), held))

    def apart(a: Pose, b: Pose) -> float:
        return math.dist(a[:2], b[:2]) + scene.object.size * abs(a[2] - b[2])

    poses: list[Pose] = []
    for pose, within in tries:
        settled = settle(scene, shapes, on, pose, within)
        if settled is not None and all(apart(settled, other) > 1e-6 * scene.object.size for other in poses):
            poses.append(settled)
    return poses or [scene_pose]


def base_poses(setup: FingerSetup, number: int) -> list[Pose]:
    """Poses of a finger's base that are tried with the ``number``-th pose of the object, its own first."""
    pose = setup.finger.base.pose
    if setup.finger.base_free is None:
        return [pose]
    return [pose, *_spread(setup.finger.base_bounds, _MORE_BASES[min(number, 1)], skip=number)]


def settle(
    scene: GraspScene, shapes: tuple[PartOutline, ...], on: frozenset[str], pose: Pose, within: list[Interval]
) -> Pose | None:
    """Move the object, within bounds, so that it touches the supports wanted and enters no other.

    Returns None where that fails.
    """
    size = scene.object.size
    low, high = np.array(within).T
    here = np.clip(np.array(pose), low, high)
    scale = np.array([size, size, 1.0])
    for _ in range(30):
        gaps, slopes = _gaps(scene, shapes, on, (float(here[0]), float(here[1]), float(here[2])))
        if not len(gaps) or np.abs(gaps).max() < EXACT * size:
            return float(here[0]), float(here[1]), float(here[2])
        # Newton's step of least length, as there are fewer gaps than freedoms; a coordinate that it drives against its
        # bound is taken out and the step computed again with the others.
        free = high > low
        for _ in range(3):
            matrix = slopes * scale * free
            step = -np.linalg.pinv(matrix, rcond=1e-9) @ gaps * scale
            step *= min(1.0, 1.0 / max(float(np.abs(step / scale).max()), 1e-300))
            aim = np.clip(here + step, low, high)
            stuck = (aim == here) & (np.abs(step) > 1e-15 * scale)
            if not (stuck & free).any():
                break
            free = free & ~stuck
        if np.array_equal(aim, here):
            return None
        here = aim
    return None


def _gaps(
    scene: GraspScene, shapes: tuple[PartOutline, ...], on: frozenset[str], pose: Pose
) -> tuple[np.ndarray, np.ndarray]:
    """Gaps of wanted supports, and of others where the object enters them, with slopes along the pose."""
    gaps: list[float] = []
    slopes: list[tuple[float, float, float]] = []
    for body in scene.places:
        gap, normal, arm = _gap(shapes, body, pose)
        wanted = body.name in on
        # An unwanted support stays a thousandth of the size away, so that it does not count as touching.
        if wanted or (gap < 0.0 and not _beside(shapes, body, pose, 0.0)):
            gaps.append(gap if wanted else gap - 1e-3 * scene.object.size)
            slopes.append((normal.real, normal.imag, (normal.conjugate() * 1j * arm).real))
    return np.array(gaps), np.array(slopes).reshape(-1, 3)


def _gap(shapes: tuple[PartOutline, ...], body: Wall | Peg, pose: Pose) -> tuple[float, complex, complex]:
    """Gap between object and support [m], normal along which it grows, and world arm of the object's nearest point."""
    turn = cmath.exp(1j * pose[2])
    origin = complex(pose[0], pose[1])
    if isinstance(body, Wall):
        normal = complex(*body.normal)
        arms = [point * turn for shape in shapes for point, _ in shape.extremes(-normal / turn, 0.0)]
        arm = min(arms, key=lambda z: (z * normal.conjugate()).real)
        world = origin + arm
        return body.height((world.real, world.imag)), normal, arm
    local = np.array([(complex(*body.position) - origin) / turn])
    gap, walk, shape = min(
        ((float(g[0]), w, s) for s in shapes for g, w in [s.nearest(local)]), key=lambda candidate: candidate[0]
    )
    at = shape.walk(walk)
    return gap - body.radius, -cmath.exp(1j * (float(at.angle[0]) + pose[2])), complex(at.point[0]) * turn


def _beside(shapes: tuple[PartOutline, ...], body: Wall | Peg, pose: Pose, flat: float) -> bool:
    """Whether the object's lowest points are beyond the ends of a finite wall."""
    if not isinstance(body, Wall) or math.isinf(body.half_length):
        return False
    along = [_along(body, pose, point) for _, point in _lowest(shapes, body, pose, flat)]
    slack = flat + 1e-9 * body.half_length
    return max(along) < -body.half_length - slack or min(along) > body.half_length + slack


def _flat_angles(
    scene: GraspScene, on: frozenset[str], shapes: tuple[PartOutline, ...], bounds: Interval, current: float
) -> list[float]:
    """Angles of the object at which a face lies on a wall that is wanted, the nearest to its own first."""
    angles: list[float] = []
    for wall in scene.walls:
        if wall.name not in on:
            continue
        for shape in shapes:
            for normal in shape.face_normals:
                angle = wall.normal_angle + math.pi - normal
                angle = current + math.remainder(angle - current, math.tau)
                inside = bounds[0] <= angle <= bounds[1]
                if inside and all(abs(angle - other) > 1e-9 for other in angles):
                    angles.append(angle)
    return sorted(angles, key=lambda angle: abs(angle - current))


def _spread(bounds: list[Interval], count: int, skip: int = 0) -> list[Pose]:
    """Points spread evenly within bounds, every second one opposite the one before: mirror images agree where one
    coordinate is free; none where nothing is.
    """
    dims = [k for k, (low, high) in enumerate(bounds) if high > low]
    poses: list[Pose] = []
    for shares in evenly(len(dims), count, skip * count)[::2] if dims else ():
        for each in (shares, [1.0 - share for share in shares]):
            pose = [low for low, _ in bounds]
            for share, k in zip(each, dims, strict=True):
                low, high = bounds[k]
                pose[k] = low + (high - low) * share
            poses.append((pose[0], pose[1], pose[2]))
    return poses[:count]


def evenly(dims: int, count: int, skip: int = 0) -> list[list[float]]:
    """Points of the unit cube in so many dimensions, spread evenly, after some that are skipped.

    Powers of the inverse of the real root of x^(d + 1) = x + 1 are added again and again (additive recurrence; M.
    Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dims + 1.0))
    steps = [root ** -(n + 1.0) for n in range(dims)]
    return [[(0.5 + j * step) % 1.0 for step in steps] for j in range(1 + skip, 1 + skip + count)]
