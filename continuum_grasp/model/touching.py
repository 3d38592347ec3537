"""Surfaces that can touch: stations of the finger, supports and the table against the object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca

from continuum_grasp.model.body import RigidBody
from continuum_grasp.model.contact_law import TouchLaw
from continuum_grasp.model.planar import ZERO, Scalar, Vec
from continuum_grasp.model.stations import Station
from continuum_grasp.model.surfaces import nearest, surface_of
from continuum_grasp.scene import Peg, Table, Wall

SHIFTED = ("shift_x [m]", "shift_y [m]", "shift_x_rate [m/s]", "shift_y_rate [m/s]", "turn_rate [rad/s]")
"""Run-time inputs of a round support that moves: its center's shift and velocity, and its angular velocity."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """A place of the object's surface and what may touch it there; vectors are the world's.

    Friction acts along the normal turned by +90 degrees, then out of the plane where the object can slide so. On the
    table the normal is out of the plane, and friction acts along world x and y.
    """

    name: str
    gap: Scalar  # distance of the surfaces [m], negative where they overlap
    gap_rate: Scalar  # [m/s]
    normal: Vec  # outward normal of the object; zero on the table
    point: Vec  # where the force acts [m]
    slip: tuple[Scalar, ...]  # velocity of the object per direction of friction [m/s]
    words: tuple[str, ...]  # for these directions
    friction: float  # coefficient [1]
    grip: Scalar  # factor of it [1]
    law: TouchLaw
    is_table: bool = False
    press: ca.SX = field(default_factory=ca.SX)  # what the gap is made smaller by [m]; empty where it is what it is
    share: Scalar | None = None  # of the limit that friction takes in the plane [1]; None: by the law
    load: Scalar | None = None  # normal force that a weight exerts [N]; None: by the law
    arm: float = 0.0  # greatest moment of friction per friction force [m]; the last direction of slip is then a turning

    def pressed(self) -> Pair:
        """A copy with a gap that is smaller by a run-time number ``press``."""
        press = ca.SX.sym("press")
        return replace(self, gap=self.gap - press, press=press)

    @cached_property
    def z(self) -> ca.SX:
        """Friction states, one per direction where the law has them."""
        has_states = self.friction > 0.0 and self.law.displacement is not None and self.share is None
        return ca.SX.sym(self.name, len(self.slip) if has_states else 0)

    @property
    def z_names(self) -> list[str]:
        """Name and unit of each friction state."""
        return [f"{self.name}.{word} [1]" for word in self.words[: self.z.numel()]]

    @property
    def z_rate(self) -> list[Scalar]:
        """Rates of the friction states [1/s]."""
        return self.law.friction_rate(self.gap, ca.vertsplit(self.z), self.slip) if self.z.numel() else []

    @property
    def slip_speed(self) -> Scalar:
        """Speed of the object along what may touch it [m/s]."""
        return self.law.speed_of(self.slip)

    @property
    def stored_energy(self) -> Scalar:
        """Energy in the normal spring [J]."""
        return self.law.stored_energy(self.gap) if self.load is None else 0.0

    @cached_property
    def normal_force(self) -> Scalar:
        """Normal force of each touch [N]."""
        return self.law.normal_force(self.gap, self.gap_rate) if self.load is None else self.load

    @cached_property
    def _friction(self) -> list[Scalar]:
        """Forces against the slip, per direction [N]."""
        film = self.law.viscous_friction(self.normal_force, self.slip)
        return [dry + wet for dry, wet in zip(self._dry_friction, film, strict=True)] if film else self._dry_friction

    @property
    def _dry_friction(self) -> list[Scalar]:
        """Coulomb's limit times the share that the law gives, per direction [N]."""
        if self.friction == 0.0:
            return [0.0 for _ in self.slip]
        limit = self.grip * self.friction * self.normal_force
        if self.share is not None:
            return [limit * self.share, *[0.0] * (len(self.slip) - 1)]
        return [limit * share for share in self.law.friction_share(ca.vertsplit(self.z), self.slip)]

    @property
    def tangential(self) -> Scalar:
        """Friction on what touches the object, along the normal turned by +90 degrees, on the table along x [N]."""
        return self._friction[0]

    @property
    def moment(self) -> Scalar:
        """Moment of friction against turning, on the object [N m]."""
        return -self.arm * self._friction[2]

    @property
    def lift(self) -> Scalar:
        """Force out of the plane, on the object [N]."""
        if self.is_table:
            return self.normal_force
        return -self._friction[1] if len(self.slip) > 1 else 0.0

    @cached_property
    def force(self) -> Vec:
        """Force in the plane on what touches the object, world [N]; the object bears the opposite."""
        if self.is_table:
            return Vec(*self._friction[:2])
        return self.normal.scaled(self.normal_force) + self.normal.perp().scaled(self.tangential)


def table_pair(body: RigidBody, law: TouchLaw, table: Table) -> Pair:
    """The table under an object that rests on it, or can slide out of the plane: its height is a run-time number then.

    Force and moment of friction are within one ellipsoid: R. D. Howe, M. R. Cutkosky, Practical force-motion models for
    sliding manipulation, Int. J. Robotics Research 15 (1996), doi:10.1177/027836499601500603.
    """
    center = body.position + body.arm
    velocity = body.velocity_at(center)
    turns = table.friction_radius > 0.0
    return Pair(
        name="table",
        # One that rests on it touches, whatever the law.
        gap=-law.rounding if table.stays else body.pose[3] - body.wrench[3],
        gap_rate=0.0 if table.stays else body.climb,
        load=body.weight if table.stays else None,
        arm=table.friction_radius,
        normal=Vec(0.0, 0.0),
        # At the center of mass: the object never tilts, and where on its base the pressure is makes no difference.
        point=center,
        slip=(velocity.x, velocity.y, *[table.friction_radius * body.omega] * turns),
        words=("slide_x", "slide_y", "turn"),
        friction=table.friction,
        grip=body.grip,
        law=law,
        is_table=True,
    )


def table_pairs(body: RigidBody, law: TouchLaw, table: Table) -> list[Pair]:
    """The table under an object, out of the plane or in it; its height is a run-time number."""
    if table.wall is None:
        return [table_pair(body, law, table)]
    return [replace(pair, gap=pair.gap - body.wrench[3]) for pair in support_pairs(body, law, [table.wall], [])]


def disc_pair(
    body: RigidBody, law: TouchLaw, disc: Station, friction: float | None = None, share: Scalar | None = None
) -> Pair:
    """A disc against the nearest part of the object; of its friction the ``share`` that is used may be given."""
    spot = nearest(body.object.parts, body.local(disc.center))
    normal = body.turn.apply(spot.normal)
    # The force acts on the disc's surface, where the turning of the disc moves it too.
    lever = normal.scaled(-disc.radius)
    point = disc.center + lever
    other = disc.velocity + lever.perp().scaled(disc.spin)
    pair = _pair(disc.name, body, law, friction, spot.distance - disc.radius, normal, point, other)
    return replace(pair, share=share)


def support_pairs(
    body: RigidBody,
    law: TouchLaw,
    walls: Sequence[Wall],
    pegs: Sequence[Peg],
    motions: Mapping[str, ca.SX] | None = None,
) -> list[Pair]:
    """The supports against the object.

    A wall meets the farthest point of a disc or a superellipse, and every corner of a polygon, since a face may lie on
    it. The ends of an edge are points. ``motions`` of pegs by name are ``SHIFTED``.
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
        disc = Station(peg.name, Vec(*peg.position), peg.radius)
        if motions and peg.name in motions:
            x, y, vx, vy, spin = ca.vertsplit(motions[peg.name])
            disc = replace(disc, center=disc.center + Vec(x, y), velocity=Vec(vx, vy), spin=spin)
        pairs.append(disc_pair(body, law, disc, peg.friction))
    return pairs


def _pair(
    name: str,
    body: RigidBody,
    law: TouchLaw,
    friction: float | None,
    gap: Scalar,
    normal: Vec,
    point: Vec,
    other: Vec = ZERO,
) -> Pair:
    velocity = body.velocity_at(point) - other
    slip = normal.perp().dot(velocity)
    return Pair(
        name=name,
        gap=gap,
        gap_rate=-normal.dot(velocity),  # the object's outward normal points at what it approaches
        normal=normal,
        point=point,
        slip=(slip, body.climb) if body.sinks else (slip,),
        words=("slide", "climb"),
        friction=law.law.friction if friction is None else friction,
        grip=body.grip,
        law=law,
    )
