"""Pressure chambers: each bends the finger by a moment per pressure, beside tendons or in their place."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from continuum_grasp.scene.tendons import LEAST_OFFSET, Offset
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Distance, Length, NonNegative, TimeConstant, Value

if TYPE_CHECKING:
    from continuum_grasp.scene.profile import Channel, Curve


class Chamber(Value):
    """A chamber, or a fluidic muscle, along a part of the finger.

    Its pressure p exerts a bending moment of the magnitude ``p area offset`` from ``start`` to ``to`` and none
    elsewhere: the virtual work of its volume, where bending leaves area and centroid of its cross-section as they are.

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
    """Distance of the centroid of its cross-section from the backbone [m], as of tendons positive on the -X side. A
    pressure bends the finger away from a chamber: one on the +X side towards -X, positively."""
    contracts: bool = False
    """Whether it is a muscle that shortens under pressure, and bends the finger to its own side as a tendon does."""
    start: Distance = 0.0
    """Begin of the chamber [m]."""
    to: Length | None = None
    """End of the chamber [m]; None: at the tip."""
    min_pressure: Annotated[float, Field(ge=-1e6, le=1e9, examples=[-20e3, "-20 kPa"]), Unit("Pa")] = 0.0
    """Least pressure above that of the surroundings [Pa]; negative for suction."""
    max_pressure: Annotated[float, Field(ge=-1e6, le=1e9, examples=[100e3, "100 kPa"]), Unit("Pa")]
    """Greatest pressure above that of the surroundings [Pa]."""
    time_constant: TimeConstant | None = None
    """Time constant with which the pressure follows its command, by a first-order lag [s]. None: at once."""
    stiffness_share: Annotated[NonNegative, Field(le=100.0, examples=[0.1]), Unit("1")] = 0.0
    """Bending stiffness that its wall adds from ``start`` to ``to``, per that of the rod there [1]."""

    def _check(self) -> None:
        if abs(self.offset) < LEAST_OFFSET:
            raise ValueError(f"offset = {self.offset} m: a chamber around the backbone bends nothing")
        self._check_below("min_pressure", "max_pressure")
        self._check_below("start", "to")

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
        """By what its pressure, which is an entry of as many inputs, bends a finger of a length [m]."""
        from continuum_grasp.scene.profile import Channel

        arms = tuple(float(k == entry) for k in range(inputs))
        to = length if self.to is None else self.to
        return Channel(self.shape(length), to, arms, self.time_constant, order=1, gain=self.arm)


ChamberList = Annotated[tuple[Chamber, ...], Field(strict=False, min_length=1, max_length=16)]
