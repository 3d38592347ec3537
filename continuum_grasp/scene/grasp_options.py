"""Options of a grasp: contacts, gravity, objective, disturbances, solver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.finger_section import FingerSection
from continuum_grasp.scene.magnitudes import ACCELERATION, FORCE
from continuum_grasp.scene.methods import SolverOptions
from continuum_grasp.scene.objects.shapes import Freedom
from continuum_grasp.scene.simulate import Fidelity
from continuum_grasp.scene.supports import Switch
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    Distance,
    Extent,
    Friction,
    Increasing,
    Length,
    ListOf,
    NonNegative,
    Positive,
    Ratio,
    Real,
    Value,
)

Middles = Switch | Annotated[ListOf[Switch], Field(min_length=1, max_length=4)]
Stations = Annotated[int, Field(ge=2, le=16)]
Range = Annotated[tuple[Length, Length], Field(strict=False)]
_Force = Annotated[Real, Unit("N")]
_Wrench = Annotated[tuple[_Force, _Force, Annotated[Real, Unit("N m")]], Field(strict=False)]


class FingerContacts(Value):
    """Contacts of one finger with the object; keys that are not given are as in ``contacts``."""

    friction: Friction | None = None
    """Coulomb friction coefficient between this finger and the object [1]."""
    normal_force_max: Annotated[Positive, Unit("N"), FORCE] | None = None
    """Greatest normal force at any one contact of this finger [N]."""
    middle: Middles | None = None
    """Middle contacts of this finger, instead of those of the scene's ``contacts``."""
    middle_range: Annotated[Range, Increasing] | None = None
    """Positions along the finger between which middle contacts are sought [m]; None: 5 % to 95 % of the
    length."""
    stations: Stations | None = None
    """Number of possible contacts instead of ``middle``, spread evenly over ``middle_range``; each may move by up to
    half of their distance. The search finds which of them touch, and where."""
    tip: Switch | None = None
    """Tip contact of this finger, instead of the scene's in ``contacts``."""


class GraspContacts(FingerContacts):
    """Contacts of fingers with the object, and limits of the touching surfaces."""

    friction: Friction
    """Coulomb friction coefficient between fingers and object [1]."""
    normal_force_max: Annotated[Positive, Unit("N"), FORCE]
    """Greatest normal force at any one contact, supports included [N]. With no such limit a wedged object needs no
    friction at all."""
    middle: Middles = "on"
    """on: the finger touches the object tangentially at a place that the search finds. auto: the search decides whether
    it touches. A list: several such contacts, from base to tip."""
    tip: Switch = "on"
    """on: the rounded end of the finger touches the object. auto: the search decides whether it touches."""
    reserve: Annotated[Ratio, Field(lt=1.0, examples=[0.2])] = 0.0
    """Share of every friction cone that stays free [1]: with 0.2, the grasp holds even if all friction coefficients are
    20 % smaller. Its resistance to disturbances counts with the whole cones."""
    push: Annotated[NonNegative, Unit("N"), FORCE] | None = None
    """Push on the object [N] that the grasp bears in any direction: to first order, at constant tensions, no contact
    slips, parts or exceeds its greatest normal force. None: no push, but for an unloaded object (for example without
    gravity) 10 % of the greatest push that the search finds; 0: no push at all, a touch is enough."""


class GraspFinger(Finger):
    """A finger with its own keys in a grasp."""

    contacts: FingerContacts = FingerContacts()
    """Contacts of this finger that differ from the scene's ``contacts``."""
    fidelity: Fidelity | None = None
    """Resolution of this finger's model; None: as the scene says."""
    tendons_used: Literal["both", "left", "right"] = "both"
    """Tendons that pull: both (antagonists), only that on the finger's left (-X side, tendon 1), or only that on its
    right (tendon 2)."""
    base_free: Freedom | None = None
    """Bounds within which the base's pose may be chosen; None: it is fixed."""
    section: FingerSection | None = None
    """Cross-section of the backbone, similar all along, for its stiffness out of the plane; None: stability is tested
    against motions in the plane alone."""

    def _check(self) -> None:
        if self.base_free is not None:
            self.base_free.check(*self.base.pose)

    @property
    def base_bounds(self) -> list[tuple[float, float]]:
        """Least and greatest x, y [m] and angle [rad] of the base; the two are equal for a fixed coordinate."""
        return (self.base_free or Freedom()).bounds(self.base.pose)

    @property
    def base_shift(self) -> float:
        """Greatest distance that the base may move [m]."""
        return (self.base_free or Freedom()).greatest_shift(self.base.pose)


def _as_grasp_finger(value: Any) -> Any:
    # A finger built in Python has been checked, and warned of, when it was made: it is not made again.
    if isinstance(value, Finger) and not isinstance(value, GraspFinger):
        return GraspFinger.model_construct(**{name: getattr(value, name) for name in Finger.model_fields})
    return value


AnyFinger = Annotated[GraspFinger, BeforeValidator(_as_grasp_finger)]


def _in_space(value: Any) -> Any:
    if not isinstance(value, Mapping | Sequence) or (len(value) == 3 and not isinstance(value, Mapping)):
        return value
    written = "three components [x, y, z] with z out of the plane, toward the viewer"
    if not isinstance(value, Mapping):
        raise ValueError(f"expected {written}; in the plane give [x, y, 0]")
    raise ValueError(
        f"expected {written}, not a mode. In the plane give [0, -9.81, 0], out of it [0, 0, -9.81], without weight "
        "[0, 0, 0]; tilt: ignore has become upright: true, next to gravity"
    )


GraspGravity = Annotated[
    tuple[Real, Real, Real], Field(strict=False), Unit("m/s2"), ACCELERATION, BeforeValidator(_in_space)
]

Aim = Literal[
    "least_tension", "least_normal_force", "greatest_disturbance", "greatest_friction_margin", "greatest_push"
]


class ObjectiveWeights(Value):
    """A weighted sum; every term is divided by its greatest possible value, so that the weights compare."""

    least_tension: Ratio = 0.0
    """Weight of the sum of all tensions, per sum of the greatest tensions [1]."""
    least_normal_force: Ratio = 0.0
    """Weight of the greatest normal force, per ``contacts.normal_force_max`` [1]."""
    greatest_disturbance: Ratio = 0.0
    """Weight of the resisted disturbance, as a multiple of the wrenches given in ``disturbances`` [1]."""
    greatest_friction_margin: Ratio = 0.0
    """Weight of the least friction margin [1]."""
    greatest_push: Ratio = 0.0
    """Weight of the push that the grasp bears in any direction, per ``contacts.normal_force_max`` [1]."""

    def _check(self) -> None:
        if not self.stated():
            raise ValueError("at least one weight must be positive")


class Disturbances(Value):
    """Wrenches that the grasp should resist, one at a time, on top of the weight."""

    wrenches: Annotated[ListOf[_Wrench], Field(min_length=1, max_length=24)] | None = None
    """World force x, y [N] and moment about the center of mass [N m]; None: forces of 1 N to both sides along both
    axes, and moments of 1 N times ``torque_scale`` both ways."""
    torque_scale: Extent | None = None
    """Length that turns a force into the moment that counts as much [m]; None: the greatest distance of the object's
    boundary from its center of mass."""
    tendons: Literal["retensioned", "locked"] = "retensioned"
    """retensioned: each disturbance has its own tensions within their limits. locked: the drives hold their positions,
    so that a tendon in tension keeps its length and its tension reacts."""


Effort = Literal["quick", "normal", "thorough"]
"""Effort of a search."""


_Share = Annotated[float, Field(ge=0.0, le=0.9, examples=[0.05, "5 %"]), Unit("1")]


class Robust(Value):
    """Errors of the known object that the grasp must tolerate, each up to a bound in both directions."""

    position: Annotated[Distance, Field(examples=[0.002, "2 mm"])] = 0.0
    """Error of the object's position along x and along y [m]; supports that the object touches restrict it."""
    angle: Annotated[float, Field(ge=0.0, le=0.5, examples=[0.05235987755982989, "3 deg"]), Unit("rad")] = 0.0
    """Error of the object's angle [rad], unless a face lies on a support."""
    radius: _Share = 0.0
    """Error of the object's size, all lengths of its shape being too large or too small by the same share [1]."""
    friction: _Share = 0.0
    """Error of all friction coefficients, by the same share [1]."""
    mass: _Share = 0.0
    """Error of the object's mass, as a share [1]."""
    draws: Annotated[int, Field(ge=1, le=100_000)] = 1000
    """Number of random errors, drawn uniformly within the bounds, that test the found grasp."""

    @property
    def bounds(self) -> tuple[float, float, float, float, float, float]:
        """Bounds of the errors of x, y [m], angle [rad], size, friction and mass [1]."""
        return self.position, self.position, self.angle, self.radius, self.friction, self.mass

    def _check(self) -> None:
        if not any(self.bounds):
            raise ValueError("at least one of position, angle, radius, friction and mass must be positive")


class GraspSolver(SolverOptions):
    """Options of the search."""

    effort: Effort = "normal"
    """Effort of the search. quick: the three most promising postures per set of contacts, for sweeps. normal: all that
    may be better than what was found, as long as that takes 600 iterations. thorough: without that limit, and from more
    and rougher starts."""
    random_seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the random errors that test robust grasps; equal seeds give equal results."""
    max_iterations: Annotated[int, Field(ge=1, le=100_000)] = 200
    """Iterations of one solver run."""
    max_total_iterations: Annotated[int, Field(ge=1, le=10_000_000)] = 40_000
    """Iterations of the whole search, diagnosis included, 0.4 to 3 ms each: counted work, so that the verdict does not
    depend on how fast or busy the machine is. Shipped scenes take up to 5,000, random infeasible ones up to 15,000."""
    tolerance: Annotated[float, Field(ge=1e-15, le=1e-4, examples=[1e-9]), Unit("1")] = 1e-9
    """Relative tolerance of the solver, on optimality and constraints [1]."""
    penetration_tolerance: Annotated[float, Field(ge=1e-12, le=1e-4, examples=[1e-6]), Unit("1")] = 1e-6
    """Allowed penetration of the backbone's samples into object and supports, as a part of the finger's length [1].
    Never zero: a finger that wraps the object would then leave the feasible set without an interior."""
