"""The finger: rod, damping, masses, tendons, base pose."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from continuum_grasp.errors import InputError
from continuum_grasp.scene.rod import Rod
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    Angle,
    Distance,
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

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from continuum_grasp.scene.profile import Array, Channel, Profile


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
    """Half the outer thickness [m], where contacts touch; half that of the rod's section where not given."""
    strain_limit: Annotated[float, Field(ge=1e-9, lt=1.0, examples=[0.06, "6 %"]), Unit("1")] | None = None
    """Greatest bending strain of the rod [1], 0.06 for 6 %; needs the thickness of the rod's section."""
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
        if self.strain_limit is not None and not self.rod.own_thickness:
            raise ValueError("strain_limit needs rod.diameter, or a thickness of a graded rod")
        if offset is not None and half is not None and 0.0 < half < offset:
            doubt(
                f"tendons.offset = {offset:g} m is more than half_thickness = {half:g} m: "
                "the tendons run outside the finger"
            )
        if self.rest_curvature != 0.0 and self.rod.own_rest_curvature:
            raise ValueError("rest_curvature is given by the rod already")
        breaks = self.rest_curvature.breaks if isinstance(self.rest_curvature, PiecewiseCurvature) else ()
        if breaks and breaks[-1] >= length:
            raise ValueError(
                f"rest_curvature.breaks end at {breaks[-1]} m, not before the finger's length of {length} m"
            )
        # Only a rod given by its density shows by its mass in which unit its user thinks.
        for k, m in enumerate(self.masses if self.rod.density is not None else ()):
            if m.mass > 1e3 * self.rod.mass:
                own = f"{self.rod.mass:.2g} kg"
                doubt(f"masses[{k}].mass = {m.mass:g} kg on a rod of {own}; is it in grams? (expected: kg)")

    @property
    def thickness_radius(self) -> float:
        """Half the outer thickness [m], where it is greatest."""
        return self.profile.half_thickness.most()

    @property
    def curvature_limit(self) -> float:
        """Greatest curvature that the strain limit allows everywhere [1/m]; infinite without a limit."""
        depth = self.profile.half_depth
        # Euler-Bernoulli: the strain of the outermost fiber is curvature times radius.
        return math.inf if self.strain_limit is None or depth is None else self.strain_limit / depth.most()

    def curvature_limit_at(self, s: ArrayLike) -> Array:
        """Greatest curvature that the strain limit allows at positions [m], of their shape [1/m]; infinite without."""
        import numpy as np

        depth, at = self.profile.half_depth, np.asarray(s, dtype=float)
        if self.strain_limit is None or depth is None:
            return np.full(at.shape, np.inf)
        return np.asarray(self.strain_limit / np.maximum(depth(at), depth(at, tip_side=True)))

    @property
    def curvature_pieces(self) -> tuple[tuple[float, float, float], ...]:
        """Rest curvature as (start [m], end [m], curvature [1/m])."""
        curve = self.profile.rest_curvature
        if any(any(c[1:]) for c in curve.coefficients):
            raise InputError("rest_curvature that changes inside a section is not supported here", key="finger.rod")
        return tuple((a, b, c[0]) for (a, b), c in zip(pairwise(curve.edges), curve.coefficients, strict=True))

    @cached_property
    def profile(self) -> Profile:
        """The rod along its length, with the finger's rest curvature and thickness."""
        from continuum_grasp.scene.profile import Curve

        own = self.rod.profile
        rest, half = own.rest_curvature, own.half_thickness
        if isinstance(self.rest_curvature, PiecewiseCurvature):
            edges = (0.0, *self.rest_curvature.breaks, own.length)
            rest = Curve(edges, tuple((value,) for value in self.rest_curvature.values))
        elif self.rest_curvature != 0.0:
            rest = Curve.uniform(own.length, self.rest_curvature)
        if self.half_thickness is not None:
            half = Curve.uniform(own.length, self.half_thickness)
        return replace(own, rest_curvature=rest, half_thickness=half)

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """The shapes of the moments by which tendons bend the finger; none without tendons."""
        from continuum_grasp.scene.profile import Channel, Curve

        if self.tendons is None:
            return ()
        whole, offset = Curve.uniform(self.rod.length, 1.0), self.tendons.offset
        return (Channel(whole, self.rod.length, (offset, -offset), self.tendons.time_constant),)

    @property
    def tendon_friction(self) -> float:
        """Capstan friction coefficient of the tendons [1]."""
        return 0.0 if self.tendons is None else self.tendons.friction

    @property
    def tendon_list(self) -> tuple[float, ...]:
        """To be replaced by that of the scene."""
        return () if self.tendons is None else (self.tendons.offset, -self.tendons.offset)
