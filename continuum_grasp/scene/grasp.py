"""An object, a finger and a palm: what the grasp optimiser needs."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from continuum_grasp.scene.finger import Finger, PiecewiseCurvature
from continuum_grasp.scene.simulate import Fidelity
from continuum_grasp.scene.value import Extent, Length, NonNegative, Positive, Real, Value, Vector2

__all__ = [
    "Circle",
    "GraspContacts",
    "GraspGravity",
    "GraspObject",
    "GraspScene",
    "GraspSolver",
    "NoGravity",
    "OutOfPlaneGravity",
    "Palm",
    "PlanarGravity",
]

Switch = Literal["on", "off"]

_ONE_TURN = 6.3
"""Bending range up to which clothoid elements can be made [rad]."""


class Circle(Value):
    """A disc in the plane of the finger, for example a mug seen along its axis."""

    shape: Literal["circle"]
    diameter: Extent
    """Outer diameter [m]."""
    mass: NonNegative
    """Mass [kg]; the centre of mass is the centre."""
    position: Vector2
    """World position of the centre [m]."""

    @property
    def radius(self) -> float:
        """Half the diameter [m]."""
        return 0.5 * self.diameter


GraspObject = Circle
"""What can be grasped; grows into a union discriminated by ``shape``."""


class Palm(Value):
    """A fixed half plane that supports the object."""

    point: Vector2
    """A world point on its surface [m]."""
    normal_angle: Real
    """World angle of the surface normal, which points away from the palm's material [rad]; 0 is +x."""
    friction: NonNegative | None = None
    """Friction coefficient between palm and object [1]; None: ``contacts.friction``."""

    @property
    def normal(self) -> tuple[float, float]:
        """Unit normal, away from the palm's material."""
        return math.cos(self.normal_angle), math.sin(self.normal_angle)

    def height(self, point: Vector2) -> float:
        """Distance of a world point from the surface [m], positive outside the palm's material."""
        nx, ny = self.normal
        return nx * (point[0] - self.point[0]) + ny * (point[1] - self.point[1])


class GraspContacts(Value):
    """Where the finger touches the object, and what the touching surfaces bear."""

    friction: NonNegative
    """Coulomb friction coefficient between finger and object [1]."""
    normal_force_max: Positive
    """Greatest normal force at any one contact [N]. With no such limit a wedged object needs no friction at
    all."""
    middle: Switch = "on"
    """on: the finger touches the object, tangent to it, at a joint of two elements, whose position is
    found."""
    middle_after: Annotated[int, Field(ge=1)] | None = None
    """Number of elements between base and middle contact; None: half of them."""
    middle_range: Annotated[tuple[Length, Length], Field(strict=False)] | None = None
    """Positions along the finger between which the middle contact is sought [m]; None: 5 % to 95 % of the
    length."""
    tip: Switch = "on"
    """on: the rounded end of the finger touches the object."""

    @model_validator(mode="after")
    def _some(self) -> GraspContacts:
        if self.middle == "off" and self.tip == "off":
            raise ValueError("at least one of middle and tip must be on")
        if self.middle_range is not None and self.middle_range[0] >= self.middle_range[1]:
            raise ValueError(f"middle_range must increase, got {list(self.middle_range)}")
        return self


class PlanarGravity(Value):
    """Gravity in the plane of the finger; the finger's own weight acts too."""

    mode: Literal["planar"]
    vector: Vector2
    """World gravity [m/s2]."""


class OutOfPlaneGravity(Value):
    """Gravity perpendicular to the plane: the object's weight is carried by friction.

    The finger is taken to be stiff out of its plane; its own weight does not bend it.
    """

    mode: Literal["out_of_plane"]
    magnitude: Positive
    """[m/s2]"""
    tilt: Literal["balance", "ignore"] = "balance"
    """balance: the friction forces that carry the weight must not tilt the object, all contacts being at the
    height of its centre of mass; ignore: something else keeps it upright."""


class NoGravity(Value):
    """No weight at all."""

    mode: Literal["none"]


GraspGravity = Annotated[PlanarGravity | OutOfPlaneGravity | NoGravity, Field(discriminator="mode")]


class GraspSolver(Value):
    """Options of the search."""

    seeds: Annotated[int, Field(ge=1, le=1000)] = 4
    """Number of starts of different shape, from a geometric scan and, beyond what that gives, at random."""
    random_seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the random starts; equal seeds give equal results."""
    time_limit: Positive = 60.0
    """Time for the whole search, diagnosis included [s]."""
    max_iterations: Annotated[int, Field(ge=1, le=100_000)] = 500
    """Iterations of one solver run."""
    tolerance: Annotated[float, Field(ge=1e-15, le=1e-4)] = 1e-9
    """Relative tolerance of the solver, on optimality and constraints."""
    penetration_tolerance: Annotated[float, Field(ge=1e-12, le=1e-3)] = 1e-6
    """Allowed penetration of the backbone's samples into object and palm, as a part of the finger's length.
    Never zero: a finger that wraps the object would then leave the feasible set without an interior."""
    samples: Annotated[int, Field(ge=8, le=400)] = 32
    """Points along the finger, shared by the elements, at which penetration is excluded; doubled where too
    few."""


class GraspScene(Value):
    """A finger that holds an object against a palm."""

    schema_version: Literal[1]
    name: str | None = None
    finger: Finger
    object: GraspObject
    palm: Palm | None = None
    """None: the finger alone holds the object."""
    contacts: GraspContacts
    gravity: GraspGravity
    fidelity: Fidelity = Fidelity()
    objective: Literal["least_tension"] = "least_tension"
    """least_tension: least sum of the two tendon tensions."""
    solver: GraspSolver = GraspSolver()

    @property
    def palm_touches(self) -> bool:
        """Whether the object lies against the palm (within 1e-6 of its diameter)."""
        if self.palm is None:
            return False
        gap = self.palm.height(self.object.position) - self.object.radius
        return abs(gap) <= 1e-6 * self.object.diameter

    @property
    def palm_friction(self) -> float:
        """Friction coefficient between palm and object [1]."""
        given = None if self.palm is None else self.palm.friction
        return self.contacts.friction if given is None else given

    @property
    def element_count(self) -> int:
        """Number of elements of the finger; two where the scene says nothing."""
        elements = self.fidelity.elements
        return elements if isinstance(elements, int) else 2

    @property
    def bending_range(self) -> float:
        """Greatest bend of one element [rad]; 4 pi shared by all, but 2 pi / 3 at least, by default."""
        return self.fidelity.bending_range or max(4 * math.pi / self.element_count, 2 * math.pi / 3)

    @property
    def elements_before_middle(self) -> int:
        """Number of elements between base and middle contact."""
        return self.contacts.middle_after or self.element_count // 2

    @property
    def middle_bounds(self) -> tuple[float, float]:
        """Least and greatest position of the middle contact along the finger [m]."""
        length = self.finger.rod.length
        return self.contacts.middle_range or (0.05 * length, 0.95 * length)

    @model_validator(mode="after")
    def _sense(self) -> GraspScene:
        if self.finger.tendons is None:
            raise ValueError("finger.tendons is needed: the tendon tension is what is sought")
        length, thickness = self.finger.rod.length, self.finger.thickness_radius
        for name in ("tolerance", "frequencies"):
            if getattr(self.fidelity, name) != getattr(Fidelity(), name):
                raise ValueError(
                    f"fidelity.{name} is not for grasps: give elements; the certificate tells the model's error"
                )
        if isinstance(self.fidelity.elements, tuple):
            raise ValueError("fidelity.elements must be a number here: the lengths of the elements are sought")
        if self.element_count < 2:
            raise ValueError("fidelity.elements must be at least 2, one on each side of the middle contact")
        if self.elements_before_middle >= self.element_count:
            raise ValueError(
                f"contacts.middle_after = {self.elements_before_middle} leaves no element between middle "
                f"contact and tip; the finger has {self.element_count} elements"
            )
        if self.fidelity.family == "matched_clothoid" and self.finger.tendons.friction > 0.0:
            raise ValueError("fidelity.family: matched_clothoid cannot carry tendon friction; use clothoid or arc")
        if self.fidelity.family != "arc" and self.bending_range > _ONE_TURN:
            raise ValueError(
                f"fidelity.bending_range = {self.bending_range} rad is more than a clothoid element can follow (one "
                "turn): take more elements, or family: arc"
            )
        if isinstance(self.finger.rest_curvature, PiecewiseCurvature):
            raise ValueError(
                "finger.rest_curvature must be one number here: the lengths of the elements are sought, and the "
                "curvature of each could not follow"
            )
        if self.middle_bounds[1] >= length:
            raise ValueError(f"contacts.middle_range ends at {self.middle_bounds[1]} m; the finger is {length} m long")
        base = self.finger.base.position
        gap = math.dist(base, self.object.position) - self.object.radius - thickness
        if gap < 0:
            raise ValueError(f"finger.base lies {-gap:.4g} m inside the object (half thickness of the finger included)")
        if self.palm is not None:
            height = self.palm.height(self.object.position) - self.object.radius
            if height < -1e-6 * self.object.diameter:
                raise ValueError(f"the object lies {-height:.4g} m deep in the palm")
        return self
