"""Tendons, a pair at equal distances or a list of single ones that end anywhere; and chambers under pressure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, field_validator

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.drives import WinchDrive
from continuum_grasp.scene.graded import Varying, ends
from continuum_grasp.scene.magnitudes import FORCE
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    SAME,
    Distance,
    Extent,
    Friction,
    Length,
    ListOf,
    NonNegative,
    Positive,
    TimeConstant,
    Value,
)

if TYPE_CHECKING:
    from continuum_grasp.scene.profile import Channel, Curve


MOST_SLOPE = 0.3
"""Greatest change of a tendon's offset per length [1]: up to there the constant cosine of its law leaves errors of the
tip below 5e-4 of the length."""
_PER_OFFSET = 250.0
"""Offset of a tendon per presliding by default [1]: 20 um of 5 mm, for strands in guides."""
LEAST_OFFSET = 1e-6
"""Least offset at the base [m], the scale of the shape of the moment; the same as for a length."""

Offset = Annotated[float, Field(ge=-1e4, le=1e4), Unit("m")]


class _Tensions(Value):
    """Drive and guides of one tendon."""

    REFUSALS = Consumer.refusals(
        """
        {axial_stiffness,series_stiffness} without drive:
            has no effect where the tension is commanded: give a drive
        conduit_bend without friction
        drive without axial_stiffness: needs axial_stiffness: the tension follows from it
        drive without series_stiffness: needs series_stiffness: the tension follows from it
        min_tension with drive: must be zero: drives cannot maintain it; see drive.pretension
        time_constant with drive: works only for commanded tensions: leave it out
        drive_order without time_constant: has no effect without a lag
        """
    )

    min_tension: Annotated[NonNegative, Unit("N"), FORCE] = 0.0
    """Least tension [N]."""
    max_tension: Annotated[Positive, Unit("N"), FORCE]
    """Greatest tension [N]."""
    friction: Friction = 0.0
    """Capstan friction coefficient between tendon and guides [1]: the tension of a sliding tendon changes by the factor
    exp(friction * bend) against the sliding, the tension of a sticking tendon by less."""
    friction_cells: Annotated[int, Field(ge=1, le=16)] = 2
    """Cells per element with a friction state each: one costs least, two follow loops within 1 %."""
    presliding: Annotated[Extent | None, Field(examples=[20e-6, "20 um"])] = None
    """Sliding within which friction turns from one direction to the other, halved [m]; None: the tendon's greatest
    offset / 250."""
    conduit_bend: Annotated[NonNegative, Field(le=100.0), Unit("rad")] = 0.0
    """Bend of a sheath between drive and finger, whose friction the tendon passes first [rad]."""
    time_constant: TimeConstant | None = None
    """Time constant T of each lag in series between a command and its tension [s]: two lags, 1/(T s + 1)^2, unless
    ``drive_order`` is 1. After T, a first-order drive has made 63 % of a step, a second-order drive 26 %. None: the
    tension is commanded directly."""
    drive_order: Literal[1, 2] = 2
    """Order of that lag: 2: critically damped, two lags in series; 1: T dF/dt = F_command - F. The mean delay is as
    many times T."""
    axial_stiffness: Annotated[Positive, Field(examples=[10e3]), Unit("N")] | None = None
    """Stiffness EA of the tendon along the finger [N]; needed by drives."""
    series_stiffness: Annotated[Positive, Field(examples=[3e4]), Unit("N/m")] | None = None
    """Stiffness of the parts between the drive and the finger, free cable, springs, gear, in series [N/m]."""
    drive: WinchDrive | None = None
    """A winch or a motor, which need both stiffnesses; None: the tension is commanded."""

    @field_validator("drive", mode="before")
    @classmethod
    def _no_tension_drive(cls, given: object) -> object:
        if isinstance(given, Mapping) and given.get("kind") == "tension":
            raise ValueError(
                "omit drive where tensions are commanded; their lag is time_constant of the tendons, next to "
                "max_tension"
            )
        return given

    def _check(self) -> None:
        self._check_below("min_tension", "max_tension")


class Tendons(_Tensions):
    """Two tendons at equal distances from the backbone; tendon 1 is on the -X side and bends the finger positively."""

    offset: Annotated[Length, Field(examples=[0.005, "5 mm"])]
    """Distance e of each tendon from the backbone [m]; tip moment = (F1 - F2) e, equation (42)."""


class Tendon(_Tensions):
    """One tendon, at a distance from the backbone that is constant or changes linearly from base to its end.

    Its bending moment is ``T e(s)`` up to its end, and zero beyond. A tendon that is inclined to the backbone by the
    slope e' has this moment times ``cos = 1 / sqrt(1 + e'^2)``, by the virtual work of its length ``int sqrt((1 - e
    k)^2 + e'^2) ds`` with small e k in the square root.
    """

    offset: Annotated[Varying[Offset], Field(examples=[0.008, "8 mm"])]
    """Distance e from the backbone [m], or its values at the base and at the tendon's end; positive on the -X side,
    where its tension bends the finger positively."""
    to: Length | None = None
    """Place where the tendon is fastened to the finger [m]; None: at the tip."""

    def _check(self) -> None:
        if abs(ends(self.offset)[0]) < LEAST_OFFSET:
            raise ValueError(f"offset = {ends(self.offset)[0]} m at the base: a tendon on the backbone cannot bend it")

    @property
    def offsets(self) -> tuple[float, float]:
        """Distance from the backbone at the base and at the tendon's end [m]."""
        return ends(self.offset)

    @property
    def greatest_offset(self) -> float:
        """Greatest distance from the backbone [m]."""
        return max(map(abs, ends(self.offset)))

    @property
    def presliding_length(self) -> float:
        """Sliding within which friction turns, halved [m]: ``presliding``, or what stands for it."""
        return self.greatest_offset / _PER_OFFSET if self.presliding is None else self.presliding

    def end(self, length: float) -> float:
        """End of the tendon along a finger of a length [m]."""
        return length if self.to is None else self.to

    def slope(self, length: float) -> float:
        """Change of its offset per length along a finger [1]."""
        first, last = ends(self.offset)
        return (last - first) / self.end(length)

    def shape(self, length: float) -> Curve:
        """Offset along a finger of a length [m], per offset at the base; zero beyond the tendon's end."""
        from continuum_grasp.scene.profile import Curve

        (first, last), to = ends(self.offset), self.end(length)
        piece = (1.0,) if first == last else (1.0, (last / first - 1.0) / to)
        return Curve.of_pieces(length, (0.0, to), (piece, (0.0,)))

    def compliance(self, length: float) -> float:
        """Elongation per tension of a tendon on a winch, without friction [m/N]; infinite where no winch pulls it."""
        if self.axial_stiffness is None or self.series_stiffness is None:
            return math.inf
        return 1.0 / self.series_stiffness + self.end(length) / self.axial_stiffness

    def arm(self, length: float) -> float:
        """Bending moment at the base per tension [m]: the offset there times the cosine."""
        return ends(self.offset)[0] / math.sqrt(1.0 + self.slope(length) ** 2)


AnyTendons = Tendons | Annotated[ListOf[Tendon], Field(min_length=1, max_length=16)]
"""A pair of tendons, or a list of single ones."""


def two_lags(tendons: tuple[Tendon, ...], length: float) -> bool:
    """Whether tendons whose moments add up lag by different times."""
    groups = alike(tendons, length)
    return any(len({(tendons[k].time_constant, tendons[k].drive_order) for k in group}) > 1 for group in groups)


def one_sided(tendons: tuple[Tendon, ...]) -> bool:
    """Whether two tendons are not at equal distances on both sides."""
    pairs = zip(*(ends(tendon.offset) for tendon in tendons), strict=True)
    return len(tendons) == 2 and any(abs(a + b) > SAME * abs(a) for a, b in pairs)


def alike(tendons: tuple[Tendon, ...], length: float) -> list[list[int]]:
    """Numbers of the tendons whose moments have the same shape up to a factor, in groups."""
    shapes: list[tuple[float, float]] = []
    groups: list[list[int]] = []
    for k, tendon in enumerate(tendons):
        first, last = ends(tendon.offset)
        shape = (last / first, tendon.end(length))
        for group, known in zip(groups, shapes, strict=True):
            if abs(shape[0] - known[0]) <= SAME and abs(shape[1] - known[1]) <= SAME * length:
                group.append(k)
                break
        else:
            shapes.append(shape)
            groups.append([k])
    return groups


def channels(length: float, tendons: tuple[Tendon, ...], *, apart: bool = False) -> tuple[Channel, ...]:
    """One channel per shape of moment along a finger of a length [m], or ``apart`` one per tendon."""
    from continuum_grasp.scene.profile import Channel

    per_shape = []
    for group in [[k] for k in range(len(tendons))] if apart else alike(tendons, length):
        like, shape = tendons[group[0]], tendons[group[0]].shape(length)
        arms = tuple(tendon.arm(length) if k in group else 0.0 for k, tendon in enumerate(tendons))
        to = like.end(length) if shape.breaks else length
        per_shape.append(Channel(shape, to, arms, like.time_constant, like.drive_order))
    return tuple(per_shape)


class Chamber(Value):
    """A chamber, or a fluidic muscle, along a part of the finger.

    Its pressure p exerts a bending moment of the magnitude ``p area offset`` from ``start`` to ``to`` and none
    elsewhere, by the virtual work of its volume; bending does not change area and centroid of its cross-section.

    Examples
    --------
    >>> from continuum_grasp.scene import Chamber
    >>> chamber = Chamber.model_validate({"area": "80 mm2", "offset": "-6 mm", "max_pressure": "100 kPa"})
    >>> round(chamber.arm, 12)  # m3, moment per pressure
    4.8e-07
    """

    area: Annotated[float, Field(ge=1e-12, le=1.0, examples=[80e-6, "80 mm2"]), Unit("m2")]
    """Area of its cross-section [m2]."""
    offset: Annotated[Offset, Field(examples=[0.006, "6 mm"])]
    """Distance of the centroid of its cross-section from the backbone [m]; like that of tendons, positive on the -X
    side. A pressure bends the finger away from the chamber: a chamber on the +X side bends it towards -X,
    positively."""
    contracts: bool = False
    """Whether it is a muscle that shortens under pressure, and bends the finger to its own side as a tendon does."""
    start: Distance = 0.0
    """Begin of the chamber [m]."""
    to: Length | None = None
    """End of the chamber [m]; None: at the tip."""
    min_pressure: Annotated[float, Field(ge=-1e6, le=1e9, examples=[-20e3, "-20 kPa"]), Unit("Pa")] = 0.0
    """Least pressure above the surroundings' [Pa]; negative for suction."""
    max_pressure: Annotated[float, Field(ge=-1e6, le=1e9, examples=[100e3, "100 kPa"]), Unit("Pa")]
    """Greatest pressure above the surroundings' [Pa]."""
    time_constant: TimeConstant | None = None
    """Time constant of the first-order lag between the command and the pressure [s]. None: no lag."""
    stiffness_share: Annotated[NonNegative, Field(le=100.0, examples=[0.1]), Unit("1")] = 0.0
    """Bending stiffness that its wall adds from ``start`` to ``to``, relative to the rod there [1]."""

    def _check(self) -> None:
        if abs(self.offset) < LEAST_OFFSET:
            raise ValueError(f"offset = {self.offset} m: a chamber around the backbone cannot bend the finger")
        self._check_below("min_pressure", "max_pressure")
        self._check_below("start", "to")

    @property
    def offsets(self) -> tuple[float, float]:
        """Distance from the backbone at both ends [m]."""
        return self.offset, self.offset

    @property
    def arm(self) -> float:
        """Bending moment per pressure [m3]."""
        return (1.0 if self.contracts else -1.0) * self.area * self.offset

    def along(self, length: float, inside: float, outside: float) -> Curve:
        """One value along the chamber and another elsewhere, along a finger of a length [m]."""
        from continuum_grasp.scene.profile import Curve

        starts = (0.0, self.start, length if self.to is None else self.to)
        return Curve.of_pieces(length, starts, ((outside,), (inside,), (outside,)))

    def shape(self, length: float) -> Curve:
        """Shape of the moment along a finger of a length [m]: one along the chamber and zero elsewhere."""
        return self.along(length, 1.0, 0.0)

    def channel(self, length: float, entry: int, inputs: int) -> Channel:
        """Return the bending channel of its pressure, one of several inputs, in a finger of a length [m]."""
        from continuum_grasp.scene.profile import Channel

        arms = tuple(float(k == entry) for k in range(inputs))
        to = length if self.to is None else self.to
        return Channel(self.shape(length), to, arms, self.time_constant, order=1, gain=self.arm)


ChamberList = Annotated[ListOf[Chamber], Field(min_length=1, max_length=16)]
