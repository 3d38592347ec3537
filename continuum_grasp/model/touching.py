"""Which surfaces can touch: every station of the finger, every support and the table against the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import casadi as ca

from continuum_grasp.model.body import Body
from continuum_grasp.model.contact_law import friction_rate, friction_share, normal_force, stored_energy
from continuum_grasp.model.planar import ZERO, Scalar, Vec
from continuum_grasp.model.surfaces import nearest, surface_of
from continuum_grasp.scene.supports import Peg, Wall
from continuum_grasp.scene.surroundings import ContactLaw


@dataclass(frozen=True, kw_only=True)
class _Contact:
    """What touches the object, as of a ``Pair``; subclasses have the normal force and the slip."""

    name: str
    gap: Scalar
    point: Vec
    velocity: Vec
    climb: Scalar
    friction: float
    grip: Scalar
    law: ContactLaw
    z: ca.SX
    press: ca.SX = field(default_factory=ca.SX)

    def pressed(self) -> Self:
        """The same with a gap that is smaller by a run-time number ``press``."""
        press = ca.SX.sym("press")
        return replace(self, gap=self.gap - press, press=press)

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
    def _slip(self) -> list[Scalar]:
        """Velocity of the object along the directions of friction."""
        raise NotImplementedError


class TablePair(_Contact):
    """The object's base on a table parallel to the plane; the attributes are those of a ``Pair``.

    The normal force lifts the object; friction acts in the plane at the center of mass, along world x and y.
    """

    @property
    def z_names(self) -> list[str]:
        """Name and unit of each friction state."""
        return [f"{self.name}.slide_{axis} [1]" for axis in "xy"[: self.z.numel()]]

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
        if self.friction == 0.0:
            return Vec(0.0, 0.0)
        limit = self.grip * self.friction * self.normal_force
        x, y = friction_share(self.law, self._states, self._slip)
        return Vec(limit * x, limit * y)

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
        press=ca.SX(0, 1),
    )


@dataclass(frozen=True)
class Station:
    """A disc of the finger: world center, its velocity, angular velocity, and radius [m]."""

    name: str
    center: Vec
    velocity: Vec
    spin: Scalar
    radius: float


@dataclass(frozen=True, kw_only=True)
class Pair(_Contact):
    """A place of the object's surface and what may touch it there.

    Attributes
    ----------
    name : str
    gap : scalar
        Distance of the surfaces [m], negative where they overlap.
    normal : Vec
        Outward normal of the object, world.
    point : Vec
        Where the force acts, world [m].
    velocity : Vec
        Of the object against what touches it, at the point, world [m/s].
    climb : scalar
        The same out of the plane [m/s].
    friction : float
        Coefficient [1].
    grip : scalar
        Factor of it [1].
    law : ContactLaw
    z : casadi.SX
        Friction states: along the normal turned by +90 degrees, then out of the plane, where the object can move so.
    sinks : bool
        Whether there is friction out of the plane.
    press : casadi.SX
        What the gap is made smaller by [m]; empty where it is what it is.
    """

    normal: Vec
    sinks: bool

    @property
    def z_names(self) -> list[str]:
        """Name and unit of each friction state."""
        return [f"{self.name}.{word} [1]" for word in ("slide", "climb")[: self.z.numel()]]

    @cached_property
    def normal_force(self) -> Scalar:
        """[N]"""
        return normal_force(self.law, self.gap, -self.normal.dot(self.velocity))

    @cached_property
    def _slip(self) -> list[Scalar]:
        """Velocity of the object along the surface, and out of the plane."""
        along = self.normal.perp().dot(self.velocity)
        return [along, self.climb] if self.sinks else [along]

    @cached_property
    def _friction(self) -> list[Scalar]:
        """Forces against the slip, per direction [N]."""
        if self.friction == 0.0:
            return [0.0 for _ in self._slip]
        limit = self.grip * self.friction * self.normal_force
        return [limit * share for share in friction_share(self.law, self._states, self._slip)]

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
    lever = normal.scaled(-disc.radius)
    point = disc.center + lever
    other = disc.velocity + lever.perp().scaled(disc.spin)
    gap = found.distance - disc.radius
    return _pair(disc.name, body, law, gap, normal, point, body.velocity_at(point) - other, friction)


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
            if wall.half_length < float("inf"):
                gap = ca.fmax(gap, ca.fabs(ca.SX(down.perp().dot(offset))) - wall.half_length)
            name = wall.name if len(points) == 1 else f"{wall.name}.{k + 1}"
            pairs.append(_pair(name, body, law, gap, down, point, body.velocity_at(point), wall.friction))
        if wall.half_length < float("inf"):
            for word, end in zip(("end", "start"), wall.ends, strict=True):
                disc = Station(f"{wall.name}.{word}", Vec(*end), ZERO, 0.0, 0.0)
                pairs.append(disc_pair(body, law, disc, wall.friction))
    for peg in pegs:
        disc = Station(peg.name, Vec(*peg.position), ZERO, 0.0, peg.radius)
        pairs.append(disc_pair(body, law, disc, peg.friction))
    return pairs


def _pair(
    name: str,
    body: Body,
    law: ContactLaw,
    gap: Scalar,
    normal: Vec,
    point: Vec,
    velocity: Vec,
    friction: float | None,
) -> Pair:
    own = law.friction if friction is None else friction
    has_state = own > 0.0 and law.displacement is not None
    z = ca.SX.sym(name, (2 if body.sinks else 1) if has_state else 0)
    return Pair(
        name=name,
        gap=gap,
        normal=normal,
        point=point,
        velocity=velocity,
        climb=body.climb,
        friction=own,
        grip=body.grip,
        law=law,
        z=z,
        sinks=body.sinks,
    )
