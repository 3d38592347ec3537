"""A scene in plain numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from benchmarks.grasp_oracle.outline import Outline
from benchmarks.grasp_oracle.rod import Array
from continuum_grasp.scene import GraspScene, SuperellipsePart

TOUCH = 1e-6
"""Gap, as a part of the object's size, up to which it lies against a wall."""


@dataclass(frozen=True)
class Limits:
    """What may be changed to find out what a grasp takes."""

    friction: float
    """Coefficient of fingers and walls alike [1], unless a wall has its own."""
    normal: float
    """Greatest normal force [N]."""
    mass: float
    """Of the object [kg]."""
    strain: float = math.inf
    """Greatest bending strain [1]."""
    bend: float = 2.0 * math.pi
    """Greatest bend of an element [rad]."""
    tension: float | None = None
    """Greatest tension of every finger in place of its own [N]."""


@dataclass(frozen=True)
class Hand:
    """One finger."""

    name: str
    family: str
    count: int
    before: int
    middle: bool
    tip: bool
    length: float
    stiffness: float
    rest: float
    thickness: float
    radius: float
    """Half the rod's diameter, which the strain is of [m]; zero without."""
    offset: float
    least: tuple[float, float]
    """Least tensions [N]."""
    most: float
    """Greatest tension [N]."""
    used: tuple[bool, bool]
    """Which tendons there are."""
    base: tuple[float, float]
    angle: float
    linear_density: float
    masses: tuple[tuple[float, float], ...]
    bounds: tuple[float, float]

    @property
    def force_scale(self) -> float:
        """E I / L^2 [N]."""
        return self.stiffness / self.length**2


@dataclass(frozen=True)
class Rest:
    """A place where the object lies on a wall."""

    name: str
    point: tuple[float, float]
    normal: tuple[float, float]
    """Outward of the object."""
    friction: float | None


@dataclass(frozen=True)
class Numbers:
    """Everything that the oracles need of a scene with one fixed object of one part and fixed bases."""

    hands: tuple[Hand, ...]
    part: Any
    pose: tuple[float, float, float]
    com: tuple[float, float]
    size: float
    rests: tuple[Rest, ...]
    walls: tuple[tuple[tuple[float, float], tuple[float, float]], ...]
    """Points on them and their normals; fingers stay outside."""
    gravity: tuple[float, float]
    lift: float
    """Gravity out of the plane [m/s2]."""
    balance: bool
    limits: Limits
    _outlines: dict[float, Outline] = field(default_factory=dict, compare=False, repr=False)

    def outline(self, grown: float) -> Outline:
        """The object's outline, grown."""
        if grown not in self._outlines:
            self._outlines[grown] = Outline(self.part, self.pose, grown)
        return self._outlines[grown]

    @cached_property
    def scale(self) -> float:
        """A force that matters [N]."""
        return max(h.force_scale for h in self.hands)

    def most_tension(self, hand: Hand) -> float:
        """Greatest tension of a finger's tendons [N]."""
        return hand.most if self.limits.tension is None else self.limits.tension

    def limited(self, **changes: float) -> Numbers:
        """The same with other limits."""
        return replace(self, limits=replace(self.limits, **changes))


def numbers(scene: GraspScene) -> Numbers:
    """What a scene says, in numbers."""
    body = scene.object
    x, y, turn = body.pose
    c, s = math.cos(turn), math.sin(turn)
    com = (x + c * body.com[0] - s * body.com[1], y + s * body.com[0] + c * body.com[1])
    (part,) = body.parts
    hands = tuple(_hand(setup) for setup in scene.setups)
    gravity, lift, balance = scene.gravity[:2], -scene.gravity[2], 3 in scene.balances
    rests: list[Rest] = []
    for wall in scene.walls:
        if wall.touch != "off":
            rests += _rests(wall, part, body.pose, body.size)
    finger = scene.setups[0]
    strains = [s.finger.strain_limit for s in scene.setups if s.finger.strain_limit is not None]
    limits = Limits(
        friction=finger.friction,
        normal=scene.contacts.normal_force_max,
        mass=body.mass,
        strain=min(strains, default=math.inf),
        bend=finger.bending_range,
    )
    walls = tuple((wall.point, wall.normal) for wall in scene.walls)
    return Numbers(hands, part, body.pose, com, body.size, tuple(rests), walls, tuple(gravity), lift, balance, limits)


def _hand(setup: Any) -> Hand:
    finger = setup.finger
    tendons = finger.tendons
    used = (finger.tendons_used != "right", finger.tendons_used != "left")
    return Hand(
        name=setup.name,
        family=setup.family,
        count=setup.elements,
        before=setup.before[0],
        middle=setup.middles[0] == "on",
        tip=setup.tip == "on",
        length=finger.rod.length,
        stiffness=finger.rod.stiffness,
        rest=float(finger.profile.rest_curvature(finger.rod.length)),
        thickness=finger.thickness_radius,
        radius=0.5 * (finger.rod.diameter or 0.0),
        offset=tendons.offset,
        least=tuple(tendons.min_tension if u else 0.0 for u in used),
        most=tendons.max_tension,
        used=used,
        base=finger.base.position,
        angle=finger.base.angle,
        linear_density=finger.rod.mass_per_length,
        masses=tuple((m.at, m.mass) for m in finger.masses),
        bounds=setup.middle_bounds,
    )


def _rests(wall: Any, part: Any, pose: tuple[float, float, float], size: float) -> list[Rest]:
    """Where a wall touches: one point, or both ends of a flat face."""
    outline = Outline(part, pose, 0.0)
    inward = (-wall.normal[0], -wall.normal[1])
    turn = wall.normal_angle + math.pi - pose[2]
    if isinstance(part, SuperellipsePart):
        spots = [_extreme(outline, np.array(inward))]
    else:
        local = np.array([math.cos(turn), math.sin(turn)])
        heights = np.array(part.vertices) @ local
        c, s = math.cos(pose[2]), math.sin(pose[2])
        move = np.array([[c, -s], [s, c]])
        spots = [
            np.array(pose[:2]) + move @ (np.array(v) + part.radius * local)
            for v, high in zip(part.vertices, heights, strict=True)
            if high > heights.max() - 1e-9 * size
        ]
    # Of several feet in line the outer two carry whatever all of them do.
    ahead = [float(p @ [inward[1], -inward[0]]) for p in spots]
    spots = [spots[k] for k in dict.fromkeys((int(np.argmin(ahead)), int(np.argmax(ahead))))]
    found = [p for p in spots if abs(wall.height(tuple(p))) <= TOUCH * size]
    names = [wall.name] if len(found) == 1 else [f"{wall.name}.{k + 1}" for k in range(len(found))]
    return [Rest(n, tuple(p), inward, wall.friction) for n, p in zip(names, found, strict=True)]


def _extreme(outline: Outline, direction: Array) -> Array:
    """The point of a smooth outline farthest in a direction."""
    u = np.linspace(0.0, 1.0, 721)
    best = int(np.argmax(outline.at(u)[0] @ direction))
    low, high = u[best] - 1.0 / 720, u[best] + 1.0 / 720
    for _ in range(60):
        middle = 0.5 * (low + high)
        normal = outline.at(middle)[1]
        ahead = normal[0] * direction[1] - normal[1] * direction[0] > 0.0
        low, high = (middle, high) if ahead else (low, middle)
    return np.asarray(outline.at(0.5 * (low + high))[0])
