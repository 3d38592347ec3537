"""A finger before an object, in numbers of the finger: lengths per its length, from its base, mirrored where the object
should lie on its right. And postures in these numbers, with their violation of clearances and limits.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Self, TypeVar

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.shape import skin
from continuum_grasp.grasp.starts.scan import kernel
from continuum_grasp.grasp.starts.scan.curves import EXACT, bends, sample
from continuum_grasp.grasp.starts.values import Pose
from continuum_grasp.model import Family, Frame, GrownOutline, surface_of
from continuum_grasp.scene import FingerSetup, GraspScene

ALLOWED = 2e-3
"""Penetration that a start may have, per length of the finger: thin feasible pieces of a branch survive the scan, and
IPOPT removes what is left of it."""
FRONT = 0.01
"""Cosine between tangent and normal up to which a tip touches with its front: a tip that touches with its side ends a
branch, and the best grasp often is there."""
TIP_REACH, TIPS = 8.0, 33
"""Greatest bend of a curve to the tip [rad], and how many end curvatures are tried: 0.5 rad apart."""
_STATIONS = 65
"""Places along a finger whose clearance is looked at: 1.5 % of the length apart."""
_EVEN = np.linspace(0.0, 1.0, _STATIONS)
LOOSER = 1.25
"""Curvature of a posture in the scan per its limits, of fingers with more elements than linear curvatures there, which
bend otherwise: a hexagon is held within a range of 3.4 rad that its posture exceeds by 14 %."""
FINE = 6
"""Most elements of a posture in the scan and in its balance: of more, IPOPT starts from the shape of fewer."""


@dataclass(frozen=True)
class FingerTask:
    """A finger, the object grown by its half thickness, and what else is in the way."""

    base: Pose  # of the finger in the world [m, rad]
    side: int  # +1: the object should lie on the finger's left; -1: on its right, and all is mirrored
    middles: tuple[bool, ...]  # which middle contacts are on, from the base
    tip: bool  # whether the tip touches
    shapes: tuple[GrownOutline, ...]
    half: float  # half the finger's thickness, where it is likely to touch
    halves: Array  # the same at the places whose clearance is looked at
    limits: Array  # greatest curvature there, `LOOSER` where the scan's curves are coarser than the finger's
    rest: float  # mean rest curvature
    counts: tuple[int, ...]  # elements between base, joints and tip
    nodes: tuple[float, ...]  # ends of its elements, or fewer positions where it has many
    arcs: bool  # whether its elements are circular arcs
    bending_range: float  # likewise
    bounds: tuple[float, float]  # of the positions of middle contacts
    walls: tuple[tuple[complex, complex, float], ...]  # point, normal and half length
    pegs: tuple[tuple[complex, float], ...]  # center and radius
    frame: Frame  # from the object's frame

    @property
    def one_arc_to_joint(self) -> bool:
        """Whether a single arc leads to the first contact, which leaves it no free parameter."""
        return self.arcs and sum(self.counts[: self.middles.index(True) + 1]) == 1

    def distance(self, points: Array) -> Array:
        """Signed distance from the object; where nothing of the finger can touch it, only that it is more than that."""
        out = np.full(points.shape, np.inf)
        for shape in self.shapes:
            away = np.abs(points - shape.center) - shape.extent
            near = away < self.halves.max()
            away[near] = shape.distance(points[near])
            out = np.minimum(out, away)
        return out

    def rough_distance(self, points: Array, part: int | None = None) -> Array:
        """Signed distance from the object, or from one part of it, to within 1e-5 of its size."""
        return rough_distance(self.shapes if part is None else self.shapes[part : part + 1], points)

    def gap(self, tips: Array, part: int | None = None) -> Array:
        """Gap between tips and the object, or one part of it, zero to rounding: a straight finger may just touch."""
        gap = self.rough_distance(tips, part) - self.half
        return np.where(np.abs(gap) < EXACT, 0.0, gap)

    def touched(self, points: Array) -> tuple[Array, Array, Array]:
        """The parts nearest to points (B,), and the places on their grown outlines: points, angles of the normals."""
        part = np.zeros(len(points), int)
        if len(self.shapes) > 1:
            part = np.argmin([self.rough_distance(points, k) for k in range(len(self.shapes))], axis=0)
        point, angle = np.zeros(len(points), complex), np.zeros(len(points))
        for k, shape in enumerate(self.shapes):
            mine = part == k
            if mine.any():
                at = shape.walk(shape.nearest(points[mine])[1])
                point[mine], angle[mine] = at.point, at.angle
        return part, point, angle


@dataclass(frozen=True)
class Rows:
    """Columns of equal length: fields are arrays with one axis of rows first, or such dataclasses."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def take(self, index: Any) -> Self:
        rows = {
            name: value.take(index) if isinstance(value, Rows) else value[index] for name, value in vars(self).items()
        }
        return replace(self, **rows)

    def followed_by(self, others: Sequence[Self]) -> Self:
        """All of its rows, then those of others."""

        def joined(name: str) -> Any:
            first, *more = (getattr(each, name) for each in (self, *others))
            return first.followed_by(more) if isinstance(first, Rows) else np.concatenate([first, *more])

        return replace(self, **{name: joined(name) for name in vars(self)})


@dataclass(frozen=True)
class Postures(Rows):
    """P postures of one finger with C contacts, in numbers of its task."""

    knots: Array  # (P, K)
    curvatures: Array  # (P, K)
    joints: Array  # (P, J) positions of all middle contacts, on or off
    parts: Array  # (P, C) part of the object that is touched
    points: Array  # (P, C) complex, on the grown outline
    angles: Array  # (P, C) of the outward normals
    violation: Array  # (P,) by how much something is in the way or a limit broken; 0: nothing is

    def on_to(self, knots: Array, curvatures: Array, part: Array, point: Array, angle: Array) -> Self:
        """The postures continued by more knots (P, M) to one more contact."""
        return replace(
            self,
            knots=np.concatenate([self.knots, knots], axis=1),
            curvatures=np.concatenate([self.curvatures, curvatures], axis=1),
            parts=np.concatenate([self.parts, part[:, None]], axis=1),
            points=np.concatenate([self.points, point[:, None]], axis=1),
            angles=np.concatenate([self.angles, angle[:, None]], axis=1),
        )


P = TypeVar("P", bound=Postures)


def rough_distance(shapes: tuple[GrownOutline, ...], points: Array) -> Array:
    """Signed distance from the nearest of some outlines, to within 1e-5 of its size."""
    if kernel.library():
        return kernel.called("distances", np.empty(points.shape), points.size, object_numbers(shapes), points)
    return np.asarray(np.min([shape.rough_distance(points) for shape in shapes], axis=0))


@lru_cache(maxsize=64)
def object_numbers(shapes: tuple[GrownOutline, ...]) -> Array:
    """Outlines of an object as the kernel of the scan has them."""
    return np.array([len(shapes), *(each for shape in shapes for each in shape.rough_numbers)])


def join(groups: list[P]) -> P | None:
    """All of several groups with the same contacts."""
    groups = [g for g in groups if len(g)]
    if not groups:
        return None
    width = max(g.knots.shape[1] for g in groups)

    def padded(values: Array) -> Array:
        return np.pad(values, ((0, 0), (0, width - values.shape[1])), mode="edge")

    # Knots without distance change nothing: the last one is repeated where a group has fewer.
    groups = [replace(g, knots=padded(g.knots), curvatures=padded(g.curvatures)) for g in groups]
    return groups[0].followed_by(groups[1:])


def unique(family: Postures) -> Postures:
    """Postures of a family without repetitions."""
    # Newton's method finds a posture to 1e-12; different ones differ by far more than 1e-5 L and 1e-4 / L.
    key = np.round(np.concatenate([family.knots, 0.1 * family.curvatures], axis=1), 5)
    _, index = np.unique(key, axis=0, return_index=True)
    return family.take(np.sort(index))


def make_task(
    scene: GraspScene, setup: FingerSetup, base: Pose, pose: Pose, side: int, on: Collection[str]
) -> FingerTask:
    """The task of a finger at a pose of its base and one of the object [m, rad], with the contacts that are ``on``."""
    scale = 1.0 / setup.finger.rod.length
    at, tilt = complex(base[0], base[1]), cmath.exp(-1j * base[2])
    if side > 0:
        world = Frame(tilt, -at * tilt * scale, scale)
    else:
        world = Frame(-tilt.conjugate(), (at * tilt).conjugate() * scale, scale, True)
    turned = cmath.exp(1j * (-pose[2] if world.mirrored else pose[2]))
    frame = Frame(world.turn * turned, complex(world.point(complex(pose[0], pose[1]))), scale, world.mirrored)
    finger, profile = setup.finger, setup.finger.profile
    places = profile.length * _EVEN
    halves = skin(profile.half_thickness)(places) * scale
    # 0.75: place along the finger whose thickness a posture is found with: between middle contacts and the tip
    half = float(halves[int(0.75 * (_STATIONS - 1))])
    marks = (0, *setup.before, setup.elements)
    few = min(setup.elements, FINE)
    looser = LOOSER if setup.elements > len(setup.middles) + 1 else 1.0
    return FingerTask(
        base=base,
        side=side,
        middles=tuple(name in on for name in setup.middle_names),
        tip=setup.tip_name in on,
        shapes=tuple(surface_of(part).outline(part, frame, half) for part in scene.object.parts),
        half=half,
        halves=halves,
        limits=looser * finger.curvature_limit_at(places) / scale,
        rest=side * float(profile.rest_curvature(places).mean()) / scale,
        counts=tuple(b - a for a, b in pairwise(marks)),
        nodes=tuple(k / few for k in range(few + 1)),
        arcs=Family.named(setup.family).degree == 0,
        bending_range=looser * setup.bending_range,
        bounds=(setup.middle_bounds[0] * scale, setup.middle_bounds[1] * scale),
        walls=tuple(
            (
                complex(world.point(complex(*wall.point))),
                cmath.exp(1j * world.angle(wall.normal_angle)),
                wall.half_length * scale,
            )
            for wall in scene.walls
        ),
        pegs=tuple((complex(world.point(complex(*peg.position))), peg.radius * scale) for peg in scene.pegs),
        frame=frame,
    )


def violation(
    task: FingerTask, knots: Array, curvatures: Array, joints: Array, start: tuple[Array, Array] | None = None
) -> Array:
    """By how much each curve penetrates beyond what is allowed, or breaks a limit (B,).

    The curves begin at the base, or at the points and angles ``start`` (B,).
    """
    worst = np.maximum(obstruction(task, knots, curvatures, joints, start) - ALLOWED, 0.0)
    # A curvature counts a tenth: IPOPT lowers it more easily than it moves a finger out of an object.
    if math.isfinite(task.limits[0]):
        over = np.abs(curvatures) - np.interp(knots, _EVEN, task.limits)
        worst = np.maximum(worst, 0.1 * over.max(axis=1))
    return np.asarray(
        np.maximum(worst, 0.1 * (bends(knots, curvatures, joints, task.counts) - task.bending_range) - 1e-9)
    )


def obstruction(
    task: FingerTask, knots: Array, curvatures: Array, joints: Array, start: tuple[Array, Array] | None = None
) -> Array:
    """Greatest penetration of each curve (B,) into the object and the supports; negative where there is none."""
    at, half = np.broadcast_to(_EVEN, (len(knots), _STATIONS)), task.halves
    points = sample(knots, curvatures, at)
    if start is not None:
        points = start[0][:, None] + np.exp(1j * start[1])[:, None] * points
    worst = (np.minimum(half, task.half) - task.rough_distance(points)).max(axis=1)
    beyond = at >= (joints[:, :1] if joints.shape[1] else 0.5)
    for point, normal, half_length in task.walls:
        rel = (points - point) * np.conj(normal)
        height = rel.real
        if math.isinf(half_length):
            inside = height[:, :1] < (1.0 - 1e-9) * half[0]
            need = np.where(beyond | ~inside, half, np.minimum(height[:, :1], 0.0))
            short = need - height
        else:
            over = np.maximum(np.abs(rel.imag) - half_length, 0.0)
            short = np.where(beyond, half, 0.0) - np.hypot(over, height)
        worst = np.maximum(worst, short.max(axis=1))
    for center, radius in task.pegs:
        short = np.where(beyond, radius + half, radius) - np.abs(points - center)
        worst = np.maximum(worst, short.max(axis=1))
    return np.asarray(worst)
