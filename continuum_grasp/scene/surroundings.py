"""Surroundings of a finger in motion: an object, its supports, and the law of contact between surfaces."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from pydantic import Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.magnitudes import CONTACT_STIFFNESS, ONSET
from continuum_grasp.scene.objects import GraspObject
from continuum_grasp.scene.placement import Supported
from continuum_grasp.scene.polygons import polygon_moments
from continuum_grasp.scene.supports import Palm, Place, Wall
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    Angle,
    Extent,
    Friction,
    ListOf,
    NonNegative,
    Position,
    Positive,
    Value,
)


class ContactLaw(Value):
    """Force law of two surfaces in contact.

    The normal force at a depth ``d`` is ``stiffness * s(d) * max(0, 1 + dissipation * d_rate)``; s(d) = d except for a
    smooth onset within ``rounding`` of the surface.
    """

    REFUSALS = Consumer.refusals(
        """
        presliding with slip_speed: has no effect beside slip_speed, which gives friction no state
        law_numbers without law: work only with the law of an add-on
        """
    )

    stiffness: Annotated[float, Field(ge=1e-3, le=1e9), Unit("N/m"), CONTACT_STIFFNESS]
    """Normal force per depth [N/m]."""
    friction: Friction
    """Coulomb friction coefficient [1]; a support may have a coefficient of its own."""
    dissipation: Annotated[NonNegative, Unit("s/m")] = 1.0
    """Relative growth of the normal force per speed of approach [s/m] (Hunt and Crossley); it also damps the tangential
    displacement before slip. A body that lands with a small speed v leaves with about v (1 - 2/3 dissipation v)."""
    rounding: Annotated[Extent, ONSET, Field(examples=[2e-4, "0.2 mm"])] | None = None
    """The force begins at a gap of this much and is linear from a depth of this much on [m]; in between its second
    derivative is continuous. None: the finger's length / 18000."""
    presliding: Annotated[Extent | None, Field(examples=[1e-4, "0.1 mm"])] = None
    """Displacement that would reach the friction cone, if it were elastic up to there [m]: a contact below it springs
    back and does not creep. None: the finger's length / 1800, where no ``slip_speed`` is given."""
    slip_speed: Annotated[float, Field(ge=1e-9, le=1e3), Unit("m/s")] | None = None
    """Alternative to ``presliding``: the friction force grows smoothly with the speed of slip, and reaches about 70 %
    of its limit at this speed [m/s]. It needs no state, but a held object creeps."""
    viscous: Annotated[NonNegative, Field(examples=[0.5]), Unit("s/m")] = 0.0
    """Increase of the friction coefficient per speed of slip by a film between the surfaces [s/m]; it adds to
    ``friction`` and also acts against the slip."""
    law: Annotated[str | None, Field(examples=["adhesive"])] = None
    """Contact law of an add-on, by its announced name. None: the law described here."""
    law_numbers: Annotated[ListOf[float], Field(examples=[[0.5]]), Unit(None)] = ()
    """Numbers of the add-on's law in the order that the add-on states, each in the unit of its statement."""


class Table(Value):
    """A table that carries an object until the table sinks.

    If gravity acts out of the plane, the table is parallel to the plane and its surface is at height zero. With a
    ``point`` it is an endless wall in the plane.
    """

    REFUSALS = Consumer.refusals(
        """
        {stays,friction_radius} with point: works only for a table parallel to the plane, without point and normal_angle
        point without normal_angle: point and normal_angle belong together: a table in the plane has both
        normal_angle without point: point and normal_angle belong together: a table in the plane has both
        """
    )

    friction: Friction
    """Coulomb friction coefficient between it and the object [1]."""
    friction_radius: Annotated[NonNegative, Field(examples=[0.02, "20 mm"]), Unit("m")] = 0.0
    """Greatest moment of friction against turning per greatest friction force [m], for a table parallel to the plane:
    2/3 of the radius of a disc that presses evenly, 0.38 of the side of a square, a quarter of the length of a bar.
    Force and moment lie within one ellipsoid, because the surface may slide and turn at once. 0: the object turns
    freely."""
    stays: bool = False
    """Whether the object rests on a table parallel to the plane for good: pressed on it by its weight, without a height
    that moves. False: the table can sink away."""
    point: Position | None = None
    """World point of the surface at height zero, for a table perpendicular to the plane [m]."""
    normal_angle: Angle | None = None
    """World angle of its normal, out of the table, along which it moves [rad]; needed with ``point``."""

    @property
    def support(self) -> Palm | None:
        """Table at height zero as a support; None for a table parallel to the plane."""
        if self.point is None or self.normal_angle is None:
            return None
        return Palm(point=self.point, normal_angle=self.normal_angle)

    @property
    def wall(self) -> Wall | None:
        """Surface of the table at height zero; None for a table parallel to the plane."""
        if self.point is None or self.normal_angle is None:
            return None
        return Wall("table", self.point, self.normal_angle, math.inf, self.friction, "auto")


class Surroundings(Supported):
    """An object, fixed or free to move in the plane, and the supports that it can touch.

    The finger touches the object; supports touch the object only, the finger passes through them.
    """

    REFUSALS: ClassVar[tuple[Consumer, ...]] = Consumer.refusals(
        """
        object.free: is for grasps; here the object starts where position and angle say
        {contact_law,object_moves,moment_of_inertia,out_of_plane_gravity,table,supports} without object:
            has no effect without an object
        {moment_of_inertia,out_of_plane_gravity,table,supports} without object_moves:
            has no effect on a fixed object: set object_moves
        out_of_plane_gravity with table.wall:
            is carried by a table parallel to the plane, without point and normal_angle
        table without out_of_plane_gravity table.wall: needs out_of_plane_gravity, or without it point and normal_angle
        """
    )

    object: GraspObject | None = None
    """Object that the finger can touch; None: no object."""
    contact_law: ContactLaw | None = None
    """The force law of the object's surface; needed with an object."""
    object_moves: bool = False
    """Whether the object moves, as a rigid body in the plane; it is fixed where not."""
    out_of_plane_gravity: Annotated[NonNegative, Unit("m/s2")] = 0.0
    """Gravity perpendicular to the plane [m/s2]: friction alone then carries the weight of a moving object. If friction
    does not suffice, the object slides out of the plane, but it never tilts; the finger is stiff in this direction."""
    table: Table | None = None
    """Table that carries an object that moves, until the table is lowered; None: contacts alone do."""
    moment_of_inertia: Annotated[Positive, Unit("kg m2")] | None = None
    """Moment of inertia of a moving object about its center of mass [kg m2]; None: with its mass spread evenly over
    its shape (over each part by its area, for a union)."""

    def _check(self) -> None:
        for name in ("finger",) if self.table is None else ("finger", "table"):
            if name in self.supports:
                raise ValueError(f"supports.{name}: contacts of the {name} have this name: use another")
        body = self.object
        if body is None:
            return
        if self.contact_law is None:
            raise ValueError("contact_law is missing: an object needs its stiffness and friction")
        if self.object_moves and body.mass < 1e-9:
            raise ValueError("object.mass must be positive for an object that moves")

    @property
    def places(self) -> tuple[Place, ...]:
        """All walls and pegs, and the table unless it is parallel to the plane."""
        table = None if self.table is None else self.table.wall
        return super().places if table is None else (*super().places, table)

    @property
    def body(self) -> GraspObject:
        """The object; ValueError in a scene without one."""
        if self.object is None:
            raise ValueError("this needs an object")
        return self.object

    @property
    def moving_supports(self) -> tuple[str, ...]:
        """Names of round supports whose motion is a run-time input."""
        return ()

    @property
    def surroundings(self) -> Surroundings | None:
        """Object and supports, if there is an object."""
        return None if self.object is None else self

    @property
    def start_pose(self) -> tuple[float, ...]:
        """Pose of a moving object at the start: x, y [m], angle [rad]. If the object can slide out of the plane, also
        its height [m], at which the spring of a table carries the weight.
        """
        body, table, law = self.object, self.table, self.contact_law
        if body is None or not self.object_moves:
            return ()
        if self.out_of_plane_gravity == 0.0 or (table is not None and table.stays):
            return body.pose
        sunk = 0.0 if table is None or law is None else body.mass * self.out_of_plane_gravity / law.stiffness
        return (*body.pose, -sunk)

    @property
    def inertia(self) -> float:
        """Moment of inertia of the object about its center of mass [kg m2]; zero without an object."""
        if self.moment_of_inertia is not None or self.object is None:
            return self.moment_of_inertia or 0.0
        # Overlaps of a union count twice. Outlines of 720 points have round shapes' gyration to 2e-5.
        area = second = 0.0
        for part in self.object.parts:
            signed_area, _, moment = polygon_moments(part.outline(720), self.object.com)
            area, second = area + abs(signed_area), second + abs(moment)
        return self.object.mass * (second / area)
