"""Data that describe a graded rod: sections, samples, or a straightened spiral."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, TypeAlias, TypeVar

from pydantic import Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.magnitudes import DENSITY, MODULUS, THICKNESS
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Distance, Extent, Increasing, Length, ListOf, NonNegative, Positive, Real, Value

_Number = TypeVar("_Number")
Varying: TypeAlias = _Number | Annotated[tuple[_Number, _Number], Field(strict=False)]
"""A number, or its values at the base end and at the tip end, linear between."""
Along: TypeAlias = "float | tuple[float, float] | PiecewiseCurvature"
"""Values along a finger, as `scene.profile.Curve` reads it."""
Modulus = Annotated[float, Field(ge=1e-3, le=1e15), Unit("Pa"), MODULUS]
Density = Annotated[float, Field(ge=1e-3, le=1e6), Unit("kg/m3"), DENSITY]
Stiffness = Annotated[float, Field(ge=1e-24, le=1e15), Unit("N m2")]
LinearDensity = Annotated[float, Field(ge=1e-15, le=1e9), Unit("kg/m")]
RotaryInertia = Annotated[NonNegative, Unit("kg m")]
Curvature = Annotated[Real, Unit("1/m")]


def ends(value: float | tuple[float, float]) -> tuple[float, float]:
    """Values at the base end and at the tip end."""
    return value if isinstance(value, tuple) else (value, value)


class PiecewiseCurvature(Value):
    """A rest curvature that is constant between ``breaks``."""

    breaks: Annotated[ListOf[Length], Increasing]
    """Positions along the finger where the curvature jumps, increasing [m]."""
    values: Annotated[ListOf[Real], Unit("1/m")]
    """Curvatures between them, one more than ``breaks`` [1/m]."""

    def _check(self) -> None:
        self._check_count("values", self.values, len(self.breaks) + 1, "part between breaks and ends")


class RodFactors(Value):
    """Factors on the numbers of a graded rod: identified ones, or the differences of another rod."""

    bending_stiffness: Annotated[Positive, Unit("1")] = 1.0
    """On the bending stiffness [1]."""
    linear_density: Annotated[Positive, Unit("1")] = 1.0
    """Factor on the mass per length [1]."""
    rotary_inertia: Annotated[NonNegative, Unit("1")] = 1.0
    """On the rotary inertia per length [1]."""


class CrossSection(Value):
    """Cross section of a rod, or of a part of a rod; each value is a number, or ``[from, to]`` for one that changes
    linearly from base to tip side.

    Give ``thickness`` and ``width`` (a rectangle), or ``diameter`` (round), with the modulus and density of the
    material; or ``bending_stiffness`` and ``linear_density``. A ``thickness`` or ``diameter`` beside these sets only
    how thick the finger is and where the strain limit is reached.
    """

    REFUSALS: ClassVar[tuple[Consumer, ...]] = Consumer.refusals(
        """
        {thickness,width} with diameter: is not allowed in a round section
        {width,youngs_modulus,density} with bending_stiffness:
            has no effect beside bending_stiffness and linear_density
        """
    )

    thickness: Annotated[Varying[Extent], THICKNESS, Field(examples=[0.02, "20 mm"])] | None = None
    """Thickness in the plane of bending [m]."""
    width: Varying[Extent] | None = None
    """Width across the plane of bending [m]."""
    diameter: Annotated[Varying[Extent], THICKNESS, Field(examples=[0.0012, "1.2 mm"])] | None = None
    """Diameter of a solid round section [m]."""
    youngs_modulus: Varying[Modulus] | None = None
    """Young's modulus E [Pa]; of a part by default the rod's."""
    density: Varying[Density] | None = None
    """Density [kg/m3]; of a part by default the rod's."""
    bending_stiffness: Varying[Stiffness] | None = None
    """Bending stiffness E I [N m2]."""
    linear_density: Varying[LinearDensity] | None = None
    """Mass per length, rho A [kg/m]."""
    rotary_inertia: Varying[RotaryInertia] | None = None
    """Rotary inertia per length, rho I [kg m]; 0 leaves it out of the model. Where not given, of a part the
    rod's, or the shape's, or none beside ``linear_density``."""

    @property
    def thick(self) -> float | tuple[float, float] | None:
        """Thickness or diameter [m], where known."""
        return self.thickness if self.diameter is None else self.diameter

    def check_shape(self) -> None:
        """Refuse shapes with missing dimensions, by `ValueError`."""
        linear = [key for key in ("bending_stiffness", "linear_density") if getattr(self, key) is not None]
        if len(linear) == 1:
            missing = "linear_density" if linear[0] == "bending_stiffness" else "bending_stiffness"
            raise ValueError(f"{linear[0]} needs {missing} beside it")
        if not linear and self.diameter is None and (self.thickness is None or self.width is None):
            raise ValueError(
                "a section needs thickness and width, or diameter, or bending_stiffness and linear_density"
            )

    @property
    def left_open(self) -> tuple[str, ...]:
        """Keys that concern it, and that it does not state."""
        shaped = self.bending_stiffness is None
        keys = ("youngs_modulus", "density", "rotary_inertia") if shaped else ("rotary_inertia",)
        return tuple(key for key in keys if getattr(self, key) is None)


class RodSection(CrossSection):
    """A part of a rod."""

    to: Length
    """End of the section [m]; the last section ends at the rod's length."""
    rest_curvature: Varying[Curvature] | None = None
    """Curvature of the unloaded section [1/m], positive towards -X; by default none."""

    def _check(self) -> None:
        self.check_shape()


class RodSamples(Value):
    """A rod by samples at positions along it, between which the values are smooth and monotone.

    Interpolated by monotone cubics (PCHIP: Fritsch and Butland, doi:10.1137/0905021), stiffness and mass
    through the logarithm, so that neither overshoots nor is negative anywhere.
    """

    at: Annotated[ListOf[Distance], Field(min_length=2, max_length=1000), Increasing]
    """Positions along the rod, increasing from 0 to the length [m]."""
    bending_stiffness: ListOf[Stiffness]
    """Bending stiffness E I at each [N m2]."""
    linear_density: ListOf[LinearDensity]
    """Mass per length rho A at each [kg/m]."""
    rotary_inertia: ListOf[RotaryInertia] | None = None
    """Rotary inertia per length rho I at each [kg m]; by default none."""
    rest_curvature: ListOf[Curvature] | None = None
    """Curvature of the unloaded rod at each [1/m], positive towards -X."""
    thickness: ListOf[Extent] | None = None
    """Thickness at each [m]: how thick the finger is, and where the strain limit is reached."""

    def _check(self) -> None:
        if self.at[0] != 0.0:
            raise ValueError(f"at[0] = {self.at[0]} m: the first sample must be at 0")
        for key in ("bending_stiffness", "linear_density", "rotary_inertia", "rest_curvature", "thickness"):
            self._check_count(key, getattr(self, key), len(self.at), "position")


class SpiRob(Value):
    """A logarithmic spiral, cut into units along its central line and straightened.

    Two boundaries ``r = a exp(b angle)``, one turn apart, have the central line ``r = a (exp(2 pi b) + 1) / 2 exp(b
    angle)`` and the thickness ``h = a (exp(2 pi b) - 1) exp(b angle)`` between them (Wang, Freris and Wei, SpiRobs,
    doi:10.1016/j.device.2024.100646). Distance from the apex along the central line and thickness both grow as
    ``exp(b angle)``: straightened, the spiral is a linear taper with ``dh/ds = -2 b tanh(pi b) / sqrt(1 + b^2)``, from
    which b follows. A curvature of ``2 tanh(pi b) / (sqrt(1 + b^2) h)`` closes its gaps and restores the spiral.

    An elastic layer in the middle bends; the units beside it are rigid but not bonded to each other, so that the
    stiffness comes from the layer and mass and rotary inertia from the full thickness, gaps included. The
    model has many units.
    """

    base_thickness: Extent
    """Thickness at the base [m]."""
    tip_thickness: Extent
    """Thickness at the tip [m]."""
    units: Annotated[int, Field(ge=2, le=1000)]
    """Number of units; each turns by the same angle where its gap is closed."""
    core: Annotated[float, Field(ge=1e-3, le=1.0, examples=[0.12, "12 %"]), Unit("1")]
    """Thickness of the elastic layer per thickness [1]."""
    width: Varying[Extent] | None = None
    """Width across the plane of bending [m]; by default as the thickness."""

    def _check(self) -> None:
        self._check_below("tip_thickness", "base_thickness")

    def growth(self, length: float) -> float:
        """The exponent b of the spiral ``r = a exp(b angle)`` [1] that a straightened length [m] has."""
        taper = (self.base_thickness - self.tip_thickness) / length
        low, high = 0.0, 1.0
        # The taper grows with b; thickness above a third of the length, which is refused, begins below b = 0.3.
        for _ in range(60):
            b = 0.5 * (low + high)
            low, high = (b, high) if 2 * b * math.tanh(math.pi * b) < taper * math.sqrt(1 + b * b) else (low, b)
        return 0.5 * (low + high)

    def unit_angle(self, length: float) -> float:
        """Angle by which each unit turns where its gap is closed [rad], for a straightened length [m]."""
        return math.log(self.base_thickness / self.tip_thickness) / (self.growth(length) * self.units)

    def edges(self, length: float) -> tuple[float, ...]:
        """Ends of the units [m], from 0 to the length."""
        base, tip, n = self.base_thickness, self.tip_thickness, self.units
        inside = (length * (base - base * (tip / base) ** (k / n)) / (base - tip) for k in range(1, n))
        return (0.0, *inside, length)
