"""Contacts of the object with walls and pegs at a given pose."""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection

import numpy as np

from continuum_grasp.grasp.starts.values import ContactStart
from continuum_grasp.model.surfaces import outline_of
from continuum_grasp.model.surfaces.outline import Outline
from continuum_grasp.scene.grasp import TOUCHING, GraspScene
from continuum_grasp.scene.supports import Peg, Wall

__all__ = ["nearest_contact", "object_outlines", "peg_gap", "support_contacts", "touching_supports", "wall_gap"]

Pose = tuple[float, float, float]


def object_outlines(scene: GraspScene) -> tuple[Outline, ...]:
    """The object's parts in its own frame, not grown."""
    return tuple(outline_of(part) for part in scene.object.parts)


def support_contacts(scene: GraspScene, pose: Pose, wanted: Collection[str]) -> dict[str, ContactStart]:
    """Contacts of the object with walls and pegs at a pose, whether it touches there or not.

    Parameters
    ----------
    scene : GraspScene
    pose : (float, float, float)
        World x, y [m] and angle [rad] of the object.
    wanted : collection of str
        Names of walls and pegs.

    Returns
    -------
    dict of str to ContactStart
        A wall touches the outermost point; a flat face that lies on it touches at its two ends, "<wall>.1" and
        "<wall>.2", as far as a finite wall reaches.
    """
    shapes, size = object_outlines(scene), scene.object.size
    found: dict[str, ContactStart] = {}
    for wall in scene.walls:
        if wall.name in wanted:
            ends = _wall_ends(shapes, wall, pose, TOUCHING * size)
            if len(ends) == 1:
                found[wall.name] = ends[0]
            else:
                found[f"{wall.name}.1"], found[f"{wall.name}.2"] = ends
    for peg in scene.pegs:
        if peg.name in wanted:
            found[peg.name] = nearest_contact(scene, pose, complex(*peg.position))
    return found


def touching_supports(scene: GraspScene, pose: Pose) -> frozenset[str]:
    """Names of the walls and pegs that the object touches at a pose, to within a millionth of its size."""
    shapes, near = object_outlines(scene), TOUCHING * scene.object.size
    walls = [wall.name for wall in scene.walls if abs(wall_gap(shapes, wall, pose, near)) <= near]
    pegs = [peg.name for peg in scene.pegs if abs(peg_gap(shapes, peg, pose)) <= near]
    return frozenset(walls + pegs)


def wall_gap(shapes: tuple[Outline, ...], wall: Wall, pose: Pose, flat: float) -> float:
    """Height of the object's lowest point above a wall [m]; infinite where it is beside a finite wall."""
    if np.isfinite(wall.half_length):
        ends = _lowest(shapes, wall, pose, flat)
        along = [_along(wall, pose, point) for _, point, _ in ends]
        slack = flat + 1e-9 * wall.half_length
        if max(along) < -wall.half_length - slack or min(along) > wall.half_length + slack:
            return float("inf")
    return min(height for _, _, height in _lowest(shapes, wall, pose, flat))


def peg_gap(shapes: tuple[Outline, ...], peg: Peg, pose: Pose) -> float:
    """Distance of the object from a peg [m]."""
    at = np.array([_to_object(complex(*peg.position), pose)])
    return min(float(shape.distance(at)[0]) for shape in shapes) - peg.radius


def _to_object(z: complex, pose: Pose) -> complex:
    return (z - complex(pose[0], pose[1])) * cmath.exp(-1j * pose[2])


def _to_world(z: complex, pose: Pose) -> complex:
    return complex(pose[0], pose[1]) + z * cmath.exp(1j * pose[2])


def _along(wall: Wall, pose: Pose, point: complex) -> float:
    """Position of a point of the object's frame along a wall [m]."""
    rel = _to_world(point, pose) - complex(*wall.point)
    return (rel * cmath.exp(-1j * wall.normal_angle)).imag


def _lowest(shapes: tuple[Outline, ...], wall: Wall, pose: Pose, flat: float) -> list[tuple[int, complex, float]]:
    """Part, point in the object's frame and height of the lowest points above a wall, the leftmost and rightmost of
    those that are level.
    """
    down = cmath.exp(1j * (wall.normal_angle + math.pi - pose[2]))
    ends = [(part, point) for part, shape in enumerate(shapes) for point, _ in shape.extremes(down, flat)]
    heights = [wall.height((w.real, w.imag)) for w in (_to_world(point, pose) for _, point in ends)]
    low = min(heights)
    level = [(part, point, h) for (part, point), h in zip(ends, heights, strict=True) if h <= low + flat]
    if len(level) == 1:
        return level
    level.sort(key=lambda end: _along(wall, pose, end[1]))
    if abs(level[0][1] - level[-1][1]) <= flat:
        return [min(level, key=lambda end: end[2])]
    return [level[0], level[-1]]


def _wall_ends(shapes: tuple[Outline, ...], wall: Wall, pose: Pose, flat: float) -> list[ContactStart]:
    level = _lowest(shapes, wall, pose, flat)
    normal = math.remainder(wall.normal_angle + math.pi - pose[2], math.tau)
    if len(level) == 2 and np.isfinite(wall.half_length):
        (first, a, height), (second, b, _) = level
        low, high = _along(wall, pose, a), _along(wall, pose, b)
        clipped = []
        for part, point, at in ((first, a, low), (second, b, high)):
            aim = min(max(at, -wall.half_length), wall.half_length)
            share = (aim - at) / (high - low)
            clipped.append((part, point + share * (b - a), height))
        level = clipped if abs(clipped[0][1] - clipped[1][1]) > flat else clipped[:1]
    return [ContactStart(part, (point.real, point.imag), normal) for part, point, _ in level]


def nearest_contact(scene: GraspScene, pose: Pose, world: complex) -> ContactStart:
    """The place on the object nearest to a world point [m]."""
    outlines, at = object_outlines(scene), np.array([_to_object(world, pose)])
    part = int(np.argmin([float(outline.distance(at)[0]) for outline in outlines]))
    place = outlines[part].walk(outlines[part].nearest(at)[1])
    point = complex(place.point[0])
    return ContactStart(part, (point.real, point.imag), math.remainder(float(place.angle[0]), math.tau))
