"""Mounting of a bench: where its camera stands, and the order, signs and zeros of its drives and load cells."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Angle, Position, Positive, Real, Value


class Camera(Value):
    """A camera whose axes are not those of the world."""

    position: Position = (0.0, 0.0)
    """World position of what the camera counts as zero [m]."""
    angle: Angle = 0.0
    """World angle of the camera's x axis [rad]."""
    scale: Annotated[Positive, Unit("1")] = 1.0
    """Camera's reading per true distance [1]."""
    mirrored: bool = False
    """Whether the camera's y axis is to the right of its x axis, as y down in images; where it is stated,
    ``commission`` takes it as known."""


class Connection(Value):
    """A line between computer and bench: the bench's number is sign times the model's, plus zero."""

    of: Annotated[int, Field(ge=1, le=16)]
    """Number of the tendon at its other end, from 1."""
    sign: Literal[-1, 1] = 1
    """Sign of the number of the bench per that of the model."""
    zero: Annotated[Real, Unit("N or N m")] = 0.0
    """Command at which the drive exerts nothing, or reading of a load cell without load [N or N m]."""


Connections = Annotated[tuple[Connection, ...], Field(strict=False, max_length=16)]


class Mounting(Value):
    """Differences between the numbers of a bench and those of the model."""

    camera: Camera = Camera()
    """The camera that sees the tip."""
    drives: Connections = ()
    """Connections of the commands, in the order of the bench; none: those of the model."""
    tensions: Connections = ()
    """Connections of the measured tensions, or tip moment, in the order of the bench; none: those of the model."""

    def _check(self) -> None:
        for name in ("drives", "tensions"):
            ends = [connection.of for connection in getattr(self, name)]
            if sorted(ends) != list(range(1, len(ends) + 1)):
                raise ValueError(f"{name}: expected every number from 1 to {len(ends)} once as `of`, got {ends}")
