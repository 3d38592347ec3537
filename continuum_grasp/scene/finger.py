"""The finger: rod, damping, masses, tendons, base pose."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property
from typing import Annotated, NamedTuple, Protocol

from pydantic import Field

from continuum_grasp.scene.profile import Channel, Curve, Profile
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    Angle,
    Distance,
    Extent,
    Friction,
    Increasing,
    Length,
    Mass,
    NonNegative,
    Position,
    Positive,
    Real,
    TimeConstant,
    Value,
    doubt,
    doubt_outside,
)

_SECTION_KEYS = ("diameter", "density", "youngs_modulus")
_LINEAR_KEYS = ("linear_density", "bending_stiffness")


class _Placed(Protocol):
    """Something at a position along the finger."""

    @property
    def at(self) -> float: ...


class Rod(Value):
    """A uniform, inextensible, unshearable elastic rod.

    Give either ``diameter``, ``density`` and ``youngs_modulus`` (a solid round section), or
    ``linear_density``, ``bending_stiffness`` and, where it matters, ``rotary_inertia``; a ``diameter`` beside these
    sets nothing but where the strain limit is reached and, without ``half_thickness``, how thick the finger is.
    """

    length: Annotated[Length, Field(examples=[0.18, "180 mm"])]
    """Length L [m]."""
    diameter: Annotated[Extent | None, Field(examples=[0.0012, "1.2 mm"])] = None
    """Diameter of a solid round section [m]; smaller than the length."""
    density: Annotated[float, Field(ge=1e-3, le=1e6), Unit("kg/m3")] | None = None
    """Density [kg/m3]."""
    youngs_modulus: Annotated[float, Field(ge=1e-3, le=1e15), Unit("Pa")] | None = None
    """Young's modulus E [Pa]."""
    linear_density: Annotated[float, Field(ge=1e-15, le=1e9), Unit("kg/m")] | None = None
    """Mass per length, rho A [kg/m]."""
    bending_stiffness: Annotated[float, Field(ge=1e-24, le=1e15), Unit("N m2")] | None = None
    """Bending stiffness E I [N m2]."""
    rotary_inertia: Annotated[NonNegative, Unit("kg m")] | None = None
    """Rotary inertia per length, rho I [kg m]; 0 leaves it out of the model. Not given: that of the round section, or
    none beside ``linear_density``."""

    def _check(self) -> None:
        # The diameter may stand beside both: it says where the strain limit is reached.
        section = [k for k in _SECTION_KEYS[1:] if getattr(self, k) is not None]
        linear = [k for k in _LINEAR_KEYS if getattr(self, k) is not None]
        if section and linear:
            raise ValueError(
                f"give either {', '.join(_SECTION_KEYS)} or {', '.join(_LINEAR_KEYS)}, "
                f"not both; got {', '.join(section + linear)}"
            )
        wanted = _LINEAR_KEYS if linear else _SECTION_KEYS
        missing = [k for k in wanted if getattr(self, k) is None]
        if missing:
            raise ValueError(f"a rod needs {', '.join(wanted)}; missing {', '.join(missing)}")
        if self.diameter is not None and self.diameter >= self.length:
            raise ValueError(
                f"diameter = {self.diameter} m is not smaller than the length of {self.length} m (both are in meters)"
            )
        too_large = "m is large for a finger; is it in millimeters? (expected: m)"
        doubt_outside("rod.length", self.length, 0.0, 10.0, too_large)
        doubt_outside("rod.diameter", self.diameter, 0.0, 0.3, too_large)
        # From soft gels to graphene, and from foams to osmium.
        no_material = "Pa is that of no material; 60 GPa is 60e9 (expected: Pa)"
        doubt_outside("rod.youngs_modulus", self.youngs_modulus, 1e3, 2e12, no_material)
        no_solid = "kg/m3 is that of no solid; 6.45 g/cm3 is 6450 (expected: kg/m3)"
        doubt_outside("rod.density", self.density, 10.0, 23e3, no_solid)

    def check_inside(self, key: str, placed: Iterable[_Placed]) -> None:
        """Refuse entries of ``key`` that lie beyond the tip, but for rounding."""
        for k, one in enumerate(placed):
            if one.at > self.length * (1 + 1e-12):
                raise ValueError(f"{key}[{k}].at = {one.at} m is beyond the finger's length of {self.length} m")

    def check_sections(self, key: str, positions: Iterable[float]) -> None:
        """Refuse sections that lie beyond the tip; positions are often sums of lengths, with their rounding."""
        for k, at in enumerate(positions):
            if at > self.length * (1 + 1e-9):
                raise ValueError(f"{key}.at[{k}] = {at} m is beyond the finger")

    @property
    def mass_per_length(self) -> float:
        """Mass per length rho A [kg/m]."""
        if self.linear_density is not None:
            return self.linear_density
        # A rod without linear_density has both of these, as _check sees to.
        return (self.density or 0.0) * math.pi * (self.diameter or 0.0) ** 2 / 4

    @property
    def stiffness(self) -> float:
        """Bending stiffness E I [N m2]."""
        if self.bending_stiffness is not None:
            return self.bending_stiffness
        return (self.youngs_modulus or 0.0) * self._second_moment

    @property
    def inertia_per_length(self) -> float:
        """Rotary inertia per length rho I [kg m]."""
        if self.rotary_inertia is not None:
            return self.rotary_inertia
        return 0.0 if self.density is None else self.density * self._second_moment

    @property
    def _second_moment(self) -> float:
        # Of a solid round section about a diameter [m4].
        return math.pi * (self.diameter or 0.0) ** 4 / 64


class Damping(Value):
    """Internal damping; both kinds may be given and add up."""

    material: Annotated[NonNegative, Unit("N m2 s")] = 0.0
    """Material (Kelvin-Voigt) damping eta [N m2 s]: bending moment per curvature rate. Does not depend on the mesh."""
    per_arc: Annotated[NonNegative, Unit("N m s")] = 0.0
    """The paper's c_frc [N m s] of equation (39): moment per rate of each element's bending angle."""


class PointMass(Value):
    """A point mass on the backbone."""

    at: Distance
    """Position along the finger [m]."""
    mass: Mass
    """Mass [kg]."""


class PiecewiseCurvature(Value):
    """A rest curvature that is constant between ``breaks``."""

    breaks: Annotated[tuple[Length, ...], Field(strict=False), Increasing]
    """Positions along the finger where the curvature jumps, increasing [m]."""
    values: Annotated[tuple[Real, ...], Field(strict=False), Unit("1/m")]
    """Curvatures between them, one more than ``breaks`` [1/m]."""

    def _check(self) -> None:
        if len(self.values) != len(self.breaks) + 1:
            raise ValueError(
                f"values must have one entry more than breaks ({len(self.breaks) + 1}), got {len(self.values)}"
            )


class Tendons(Value):
    """Two tendons at equal distances from the backbone; tendon 1 is on the -X side and bends the finger positively."""

    offset: Annotated[Length, Field(examples=[0.005, "5 mm"])]
    """Distance e of each tendon from the backbone [m]; tip moment = (F1 - F2) e, equation (42)."""
    min_tension: Annotated[NonNegative, Unit("N")] = 0.0
    """Least tension [N]."""
    max_tension: Annotated[Positive, Unit("N")]
    """Greatest tension [N]."""
    friction: Friction = 0.0
    """Capstan friction coefficient between tendon and guides [1]: tension falls as exp(-friction * bent angle)."""
    time_constant: TimeConstant | None = None
    """Time constant of the tension drive [s]: the commanded tension is followed through a critically damped
    second-order lag. None: the tension is what is commanded."""

    def _check(self) -> None:
        if self.min_tension >= self.max_tension:
            raise ValueError(f"min_tension ({self.min_tension}) must be below max_tension ({self.max_tension})")


class BasePose(Value):
    """Pose of the clamped base in the world; the undeformed finger points along the base's Y axis."""

    position: Position = (0.0, 0.0)
    """World position of the base [m]."""
    angle: Annotated[Angle, Field(examples=[-1.5707963267948966, "-90 deg"])] = 0.0
    """Angle from world axes to base axes, counter-clockwise [rad]."""

    def _check(self) -> None:
        turn = 2 * math.pi * (1 + 1e-9)
        why = f"rad is beyond a full turn; is it in degrees? (expected: rad, or {self.angle:g} deg)"
        doubt_outside("base.angle", self.angle, -turn, turn, why)


class Finger(Value):
    """A tendon-driven continuum finger."""

    rod: Rod
    """The elastic rod that the finger is."""
    damping: Damping = Damping()
    """What damps its bending."""
    rest_curvature: Annotated[Real, Unit("1/m")] | PiecewiseCurvature = 0.0
    """Curvature of the unloaded finger [1/m], positive towards -X."""
    half_thickness: Annotated[Distance | None, Field(examples=[0.006, "6 mm"])] = None
    """Half the outer thickness [m], where contacts touch; half the rod's diameter where not given."""
    strain_limit: Annotated[float, Field(ge=1e-9, lt=1.0, examples=[0.06, "6 %"]), Unit("1")] | None = None
    """Greatest bending strain of the rod [1], 0.06 for 6 %; needs the rod's diameter."""
    masses: Annotated[tuple[PointMass, ...], Field(strict=False)] = ()
    """Point masses beside the rod's own mass."""
    tendons: Tendons | None = None
    """None: the input is the tip moment itself."""
    base: BasePose = BasePose()
    """Where the base is clamped, and in which direction."""

    def _check(self) -> None:
        length, half = self.rod.length, self.half_thickness
        self.rod.check_inside("masses", self.masses)
        offset = None if self.tendons is None else self.tendons.offset
        for key, value in (("tendons.offset", offset), ("half_thickness", half)):
            if value is not None and value >= length:
                raise ValueError(f"{key} = {value} m is not smaller than the finger's length of {length} m")
        if self.strain_limit is not None and self.rod.diameter is None:
            raise ValueError("strain_limit needs rod.diameter")
        if offset is not None and half is not None and 0.0 < half < offset:
            doubt(
                f"tendons.offset = {offset:g} m is more than half_thickness = {half:g} m: "
                "the tendons run outside the finger"
            )
        breaks = self.rest_curvature.breaks if isinstance(self.rest_curvature, PiecewiseCurvature) else ()
        if breaks and breaks[-1] >= length:
            raise ValueError(
                f"rest_curvature.breaks end at {breaks[-1]} m, not before the finger's length of {length} m"
            )
        # Only a rod given by its density shows by its mass in which unit its user thinks.
        own = self.rod.mass_per_length * length
        for k, m in enumerate(self.masses):
            if self.rod.density is not None and m.mass > 1e3 * own:
                doubt(f"masses[{k}].mass = {m.mass:g} kg on a rod of {own:.2g} kg; is it in grams? (expected: kg)")

    @property
    def thickness_radius(self) -> float:
        """Half the outer thickness [m]."""
        return 0.5 * (self.rod.diameter or 0.0) if self.half_thickness is None else self.half_thickness

    @property
    def curvature_limit(self) -> float:
        """Greatest curvature that the strain limit allows [1/m]; infinite without a limit."""
        if self.strain_limit is None or self.rod.diameter is None:
            return math.inf
        # Euler-Bernoulli: the strain of the outermost fiber is curvature times radius.
        return self.strain_limit / (0.5 * self.rod.diameter)

    @property
    def curvature_pieces(self) -> tuple[tuple[float, float, float], ...]:
        """Rest curvature as (start [m], end [m], curvature [1/m])."""
        if isinstance(self.rest_curvature, PiecewiseCurvature):
            edges = (0.0, *self.rest_curvature.breaks, self.rod.length)
            return tuple(zip(edges, edges[1:], self.rest_curvature.values, strict=False))
        return ((0.0, self.rod.length, self.rest_curvature),)

    @cached_property
    def profile(self) -> Profile:
        """The rod along its length."""
        rod, pieces = self.rod, self.curvature_pieces

        def uniform(value: float) -> Curve:
            return Curve.uniform(rod.length, value)

        return Profile(
            rod.length,
            uniform(rod.stiffness),
            uniform(rod.mass_per_length),
            uniform(rod.inertia_per_length),
            Curve((0.0, *(end for _, end, _ in pieces)), tuple((value,) for _, _, value in pieces)),
            uniform(self.thickness_radius),
            None if rod.diameter is None else uniform(0.5 * rod.diameter),
        )

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """The shapes of the moments by which tendons bend the finger; none without tendons."""
        if self.tendons is None:
            return ()
        whole, offset = Curve.uniform(self.rod.length, 1.0), self.tendons.offset
        return (Channel(whole, self.rod.length, (offset, -offset), self.tendons.time_constant),)


class _Tendon(NamedTuple):
    min_tension: float
    max_tension: float
    friction: float
    time_constant: float | None


def tendon_list(finger: Finger) -> tuple[_Tendon, ...]:
    """Each tendon of a finger; until ``Finger.tendon_list`` is there."""
    t = finger.tendons
    return () if t is None else (_Tendon(t.min_tension, t.max_tension, t.friction, t.time_constant),) * 2


def with_tendons(finger: Finger, **changes: float | None) -> Finger:
    """The same with changes of every tendon; until ``Finger.tendon_list`` is there."""
    return finger if finger.tendons is None else finger.replaced(tendons=finger.tendons.replaced(**changes))
