"""Set-points of a controller: constant, sampled in time, or a circle."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from continuum_grasp.scene.value import Positive, Real, Value, Vector2

__all__ = ["CircleReference", "Reference", "RowSamples", "Rows"]

Row = Annotated[tuple[Real, ...], Field(strict=False, min_length=1)]


class RowSamples(Value):
    """Rows of numbers over time."""

    times: Annotated[tuple[Real, ...], Field(strict=False, min_length=2)]
    """Instants, increasing [s]; before the first and after the last the row is held."""
    values: Annotated[tuple[Row, ...], Field(strict=False, min_length=2)]
    """One row per instant."""
    interpolation: Literal["smooth", "linear", "hold"] = "smooth"
    """smooth: monotone piecewise quintic; linear: straight lines; hold: each row until the next instant."""

    @model_validator(mode="after")
    def _consistent(self) -> RowSamples:
        if any(b - a < 1e-9 for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError(f"times must increase by 1e-9 s at least, got {list(self.times)}")
        if len(self.values) != len(self.times):
            raise ValueError(f"values must be as many as times ({len(self.times)}), got {len(self.values)}")
        if len({len(row) for row in self.values}) > 1:
            raise ValueError("all rows of values must have the same number of entries")
        return self

    @property
    def width(self) -> int:
        """Entries of a row."""
        return len(self.values[0])


class CircleReference(Value):
    """A circle that is run through at constant speed."""

    center: Vector2
    """World position of the centre [m]."""
    radius: Positive
    """[m]"""
    frequency: Real
    """Turns per second, counter-clockwise [Hz]."""
    phase: Real = 0.0
    """Angle at time zero, from world +X [rad]."""
    start: Real = 0.0
    """Instant until which the set-point waits at its first position [s]."""


Rows = Row | RowSamples
"""Numbers, constant or over time."""


class Reference(Value):
    """Set-points of what the cost tracks; what is not given is zero, or the initial value where the cost says so."""

    tip: Vector2 | RowSamples | CircleReference | None = None
    """World position of the tip [m]."""
    bending: Rows | None = None
    """Bending angle of each element of the controller's model [rad]."""
    shape: Rows | None = None
    """World positions x, y [m] of the sections of ``cost.shape.at``, one after the other."""
    contact_force: Rows | None = None
    """Normal force at each place where the finger may touch the object, from base to tip [N]."""
    input: Rows | None = None
    """Input that costs no effort: tip moment [N m] or tensions [N]; tensions: least tension where not given."""

    @model_validator(mode="after")
    def _planar(self) -> Reference:
        if isinstance(self.tip, RowSamples) and self.tip.width != 2:
            raise ValueError(f"tip: expected rows of x, y, got {self.tip.width} entries")
        return self
