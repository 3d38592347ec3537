"""Which surfaces can touch: every station of the finger, every support and the table against the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Self

import casadi as ca

from continuum_grasp.model.body import Body
from continuum_grasp.model.contact_law import friction_rate, friction_share, normal_force, stored_energy
from continuum_grasp.model.planar import ZERO, Scalar, Vec
from continuum_grasp.model.surfaces import nearest, surface_of
from continuum_grasp.scene.supports import Peg, Wall
from continuum_grasp.scene.surroundings import ContactLaw


@dataclass(frozen=True, kw_only=True)
class _Contact:
    """A place of the object's surface and what may touch it there; subclasses have the normal force and the slip.

    Vectors are the world's. Velocities are the object's against what touches it, at the point.
    """

    name: str
    gap: Scalar  # distance of the surfaces [m], negative where they overlap
    point: Vec  # where the force acts [m]
    velocity: Vec  # in the plane [m/s]
    climb: Scalar  # the same out of the plane [m/s]
    friction: float  # coefficient [1]
    grip: Scalar  # factor of it [1]
    law: ContactLaw
    z: ca.SX  # friction states, one per direction in which the object can slip
    press: ca.SX = field(default_factory=ca.SX)  # what the gap is made smaller by [m]; empty where it is what it is

    # Names of the directions of friction: along the normal turned by +90 degrees, then out of the plane.
    words: ClassVar[tuple[str, ...]] = ("slide", "climb")

    def pressed(self) -> Self:
        """The same with a gap that is smaller by a run-time number ``press``."""
        press = ca.SX.sym("press")
        return replace(self, gap=self.gap - press, press=press)

    @property
    def z_names(self) -> list[str]:
        """Name and unit of each friction state."""
        return [f"{self.name}.{word} [1]" for word in self.words[: self.z.numel()]]

    @property
    def z_rate(self) -> list[Scalar]:
        """Rates of the friction states [1/s]."""
        return friction_rate(self.law, self.gap, self._states, self._slip) if self.z.numel() else []

    @property
    def stored_energy(self) -> Scalar:
        """Of the normal spring [J]."""
        return stored_energy(self.law, self.gap)

    @property
    def _states(self) -> list[Scalar]:
        return [self.z[k] for k in range(self.z.numel())]

    @cached_property
    def _friction(self) -> list[Scalar]:
        """Forces against the slip, per direction [N]: Coulomb's limit times the share that the law gives."""
        if self.friction == 0.0:
            return [0.0 for _ in self._slip]
        limit = self.grip * self.friction * self.normal_force
        return [limit * share for share in friction_share(self.law, self._states, self._slip)]

    @cached_property
    def normal_force(self) -> Scalar:
        """[N]"""
        raise NotImplementedError

    @cached_property
    def _slip(self) -> list[Scalar]:
        """Velocity of the object along the directions of friction [m/s]."""
        raise NotImplementedError


class TablePair(_Contact):
    """The object's base on a table parallel to the plane.

    The normal force lifts the object; friction acts in the plane at the center of mass, along world x and y.
    """

    words = ("slide_x", "slide_y")

    @property
    def normal(self) -> Vec:
        """None in the plane."""
        return Vec(0.0, 0.0)

    @cached_property
    def normal_force(self) -> Scalar:
        """[N]"""
        return normal_force(self.law, self.gap, self.climb)

    @property
    def tangential(self) -> Scalar:
        """Friction on the table along world x [N]; see ``force`` for both components."""
        return self.force.x

    @property
    def lift(self) -> Scalar:
        """Force out of the plane, on the object [N]."""
        return self.normal_force

    @cached_property
    def force(self) -> Vec:
        """Force on the table in the plane, world [N]; the object bears the opposite."""
        return Vec(*self._friction)

    @cached_property
    def _slip(self) -> list[Scalar]:
        return [self.velocity.x, self.velocity.y]


def table_pair(body: Body, law: ContactLaw, friction: float) -> TablePair:
    """The table under an object that can slide out of the plane; its height is a run-time number."""
    center = body.position + body.arm
    has_state = friction > 0.0 and law.displacement is not None
    return TablePair(
        name="table",
        gap=body.pose[3] - body.wrench[3],
        point=center,
        velocity=body.velocity_at(center),
        climb=body.climb,
        friction=friction,
        grip=body.grip,
        law=law,
        z=ca.SX.sym("table", 2 if has_state else 0),
    )


@dataclass(frozen=True)
class Station:
    """A disc of the finger: world center, its velocity, angular velocity, and radius [m]."""

    name: str
    center: Vec
    radius: float
    velocity: Vec = ZERO
    spin: Scalar = 0.0


@dataclass(frozen=True, kw_only=True)
class Pair(_Contact):
    """A place of the object's surface and what may touch it in the plane."""

    normal: Vec  # outward normal of the object
    sinks: bool  # whether there is friction out of the plane

    @cached_property
    def normal_force(self) -> Scalar:
        """[N]"""
        # The gap closes with the object's velocity along its own outward normal.
        return normal_force(self.law, self.gap, -self.normal.dot(self.velocity))

    @cached_property
    def _slip(self) -> list[Scalar]:
        """Velocity of the object along the surface, and out of the plane."""
        along = self.normal.perp().dot(self.velocity)
        return [along, self.climb] if self.sinks else [along]

    @property
    def tangential(self) -> Scalar:
        """Friction on what touches the object, along the normal turned by +90 degrees [N]."""
        return self._friction[0]

    @property
    def lift(self) -> Scalar:
        """Friction out of the plane, on the object [N]."""
        return -self._friction[1] if self.sinks else 0.0

    @cached_property
    def force(self) -> Vec:
        """Force on what touches the object, world [N]; the object bears the opposite."""
        return self.normal.scaled(self.normal_force) + self.normal.perp().scaled(self.tangential)


def disc_pair(body: Body, law: ContactLaw, disc: Station, friction: float | None = None) -> Pair:
    """A disc against the nearest part of the object."""
    found = nearest(body.object.parts, body.local(disc.center))
    normal = body.turn.apply(found.normal)
    # The force acts on the disc's surface, where the turning of the disc moves it too.
    lever = normal.scaled(-disc.radius)
    point = disc.center + lever
    other = disc.velocity + lever.perp().scaled(disc.spin)
    return _pair(disc.name, body, law, friction, found.distance - disc.radius, normal, point, other)


def support_pairs(body: Body, law: ContactLaw, walls: Sequence[Wall], pegs: Sequence[Peg]) -> list[Pair]:
    """The supports against the object.

    A wall meets the farthest point of a disc or a superellipse, and every corner of a polygon, since a face may lie on
    it. The ends of an edge are points.
    """
    pairs = []
    for wall in walls:
        down = Vec(*(-v for v in wall.normal))
        local = body.turn.transposed().apply(down)
        points = [p for part in body.object.parts for p in surface_of(part).lowest_points(part, local)]
        for k, place in enumerate(points):
            point = body.position + body.turn.apply(place)
            offset = point - Vec(*wall.point)
            gap = -down.dot(offset)
            # Beyond an edge's ends there is no wall: the gap is that along the edge.
            if wall.half_length < float("inf"):
                gap = ca.fmax(gap, ca.fabs(ca.SX(down.perp().dot(offset))) - wall.half_length)
            name = wall.name if len(points) == 1 else f"{wall.name}.{k + 1}"
            pairs.append(_pair(name, body, law, wall.friction, gap, down, point))
        if wall.half_length < float("inf"):
            for word, end in zip(("end", "start"), wall.ends, strict=True):
                disc = Station(f"{wall.name}.{word}", Vec(*end), 0.0)
                pairs.append(disc_pair(body, law, disc, wall.friction))
    for peg in pegs:
        pairs.append(disc_pair(body, law, Station(peg.name, Vec(*peg.position), peg.radius), peg.friction))
    return pairs


def _pair(
    name: str,
    body: Body,
    law: ContactLaw,
    friction: float | None,
    gap: Scalar,
    normal: Vec,
    point: Vec,
    other: Vec = ZERO,
) -> Pair:
    own = law.friction if friction is None else friction
    count = (2 if body.sinks else 1) if own > 0.0 and law.displacement is not None else 0
    return Pair(
        name=name,
        gap=gap,
        normal=normal,
        point=point,
        velocity=body.velocity_at(point) - other,
        climb=body.climb,
        friction=own,
        grip=body.grip,
        law=law,
        z=ca.SX.sym(name, count),
        sinks=body.sinks,
    )
