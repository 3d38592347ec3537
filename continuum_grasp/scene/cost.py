"""Targets of a controller: weights of its cost, and setpoints that are constant, sampled in time, or a circle.

A new cost term has its weight in ``Cost`` and its setpoint in ``Reference``, under the same name; see
``control/ocp/cost_terms.py``.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.loads import Sampled
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Angle, Length, ListOf, NonNegative, Position, Positive, Real, Value, Vector2


def _running(value: Any) -> Any:
    """Take a bare number as the running weight."""
    return {"running": value} if isinstance(value, int | float) and not isinstance(value, bool) else value


class Weight(Value):
    """Weight of an error: the cost is half the squared error times this."""

    running: Annotated[NonNegative, Field(examples=[2e4]), Unit("per second and square of the error's unit")] = 0.0
    """Weight all along the horizon [per second and square of the error's unit]."""
    terminal: Annotated[NonNegative, Field(examples=[2e3]), Unit("per square of the error's unit")] = 0.0
    """Weight once, at the end of the horizon [per square of the error's unit]."""


Weighted = Annotated[Weight, BeforeValidator(_running, json_schema_input_type=float | Weight)]


class ShapeWeight(Weight):
    """Positions along the finger that track setpoints."""

    at: Annotated[ListOf[Length], Field(min_length=1)]
    """Positions along the finger [m]."""


class ForceWeight(Weight):
    """Contacts whose normal forces, or distances from the object, track setpoints."""

    of: Annotated[ListOf[str], Field(min_length=1)] | None = None
    """Names of the contacts: finger.1 and so on at ``contacts``, finger.tip; None: all of these."""


ForcesWeighted = Annotated[ForceWeight, BeforeValidator(_running, json_schema_input_type=float | ForceWeight)]


class Cost(Value):
    """Weights of half the squared errors; a term without a weight takes no computing time."""

    tip: Annotated[Weighted, Field(examples=[2e4]), Unit("1/m2")] | None = None
    """World position of the tip [1/m2]."""
    bending: Annotated[Weighted, Field(examples=[100.0]), Unit("1/rad2")] | None = None
    """Bending angle of each element [1/rad2]."""
    shape: Annotated[ShapeWeight, Unit("1/m2")] | None = None
    """World positions along the finger [1/m2]."""
    tip_angle: Annotated[Weighted, Field(examples=[100.0]), Unit("1/rad2")] | None = None
    """Orientation of the tip [1/rad2]."""
    speed: Annotated[Weighted, Field(examples=[0.02]), Unit("s2/rad2")] | None = None
    """Bending rate of each element, towards zero [s2/rad2]."""
    contact_force: Annotated[ForcesWeighted, Field(examples=[1.0]), Unit("1/N2")] | None = None
    """Normal force at each place where the finger may touch the object [1/N2]."""
    gap: Annotated[ForcesWeighted, Field(examples=[1e4]), Unit("1/m2")] | None = None
    """Distance of each place where the finger may touch the object from its surface, negative where pressed in
    [1/m2]: what leads the finger to an object and away from it."""
    object_position: Annotated[Weighted, Field(examples=[1e4]), Unit("1/m2")] | None = None
    """World position of an object that moves [1/m2]."""
    object_angle: Annotated[Weighted, Field(examples=[100.0]), Unit("1/rad2")] | None = None
    """World angle of an object that moves [1/rad2]."""
    effort: Annotated[NonNegative, Field(examples=[1e-3]), Unit("per second and square of the input's unit")] | None = (
        None
    )
    """Input away from ``reference.input`` [per second and square of the input's unit], such as 1/(s N2) of tensions."""
    input_rate: Annotated[NonNegative, Field(examples=[5e-4]), Unit("s per square of the input's unit")] | None = None
    """Change of the input per time, towards zero [s per square of the input's unit]."""

    def _check(self) -> None:
        *others, last = [name for name in Cost.model_fields if name in Reference.model_fields]
        names = f"{', '.join(others)} or {last}"
        tracked = [weight for name in (*others, last) if (weight := getattr(self, name)) is not None]
        if not tracked:
            raise ValueError(f"a controller needs something to track: {names}")
        if not any(w.running or w.terminal for w in tracked):
            raise ValueError(f"give {names} a weight greater than 0: nothing is tracked")
        if not self.effort and not self.input_rate:
            raise ValueError("give effort or input_rate a weight greater than 0: without either inputs are not unique")

    def weights(self, term: str) -> tuple[float, float | None]:
        """Running and terminal weight of a term; None: the end of the horizon lacks the term."""
        weight: Weight | float = getattr(self, term)
        return (weight.running, weight.terminal) if isinstance(weight, Weight) else (weight, None)

    def tracked_contacts(self, term: str, names: tuple[str, ...]) -> tuple[str, ...]:
        """Names of the contacts that ``contact_force`` or ``gap`` tracks, among the existing ones."""
        weight: ForceWeight | None = getattr(self, term)
        return () if weight is None else weight.of or names

    @staticmethod
    def reference_refusals(key: str) -> tuple[Consumer, ...]:
        """Refuse setpoints that nothing tracks, and weights without a setpoint, at the key of a scene's cost."""
        names = [name for name in Reference.model_fields if name != "input"]
        asked = [name for name in names if name not in _WITH_DEFAULT]
        return Consumer.refusals(
            f"""
            reference.{{{",".join(names)}}} without {key}.NAME: nothing tracks it: give {key}.NAME a weight
            reference.input without {key}.effort: nothing tracks it: give {key}.effort a weight
            {key}.{{{",".join(asked)}}} without reference.NAME
            """
        )


Row = Annotated[ListOf[Real], Field(min_length=1)]


class RowSamples(Sampled):
    """Rows of numbers over time."""

    values: Annotated[ListOf[Row], Field(min_length=2), Unit(None)]
    """One row per instant, in the unit of the referenced quantity."""

    def _check(self) -> None:
        if len({len(row) for row in self.values}) > 1:
            raise ValueError("all rows of values must have the same number of entries")

    @property
    def width(self) -> int:
        """Entries of a row."""
        return len(self.values[0])


class CircleReference(Value):
    """A circle traversed at constant speed."""

    center: Position
    """World position of the center [m]."""
    radius: Annotated[Positive, Unit("m")]
    """Radius [m]."""
    frequency: Annotated[Real, Unit("Hz")]
    """Turns per second, counter-clockwise [Hz]."""
    phase: Angle = 0.0
    """Angle at time zero, from world +X [rad]."""
    start: Annotated[Real, Unit("s")] = 0.0
    """Instant until which the setpoint waits at its first position [s]."""


Rows = Row | RowSamples
"""Numbers, constant or over time."""


def _row(value: Any) -> Any:
    """Take a bare number as a row of one entry."""
    return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value


AngleRow = Annotated[Row, BeforeValidator(_row, json_schema_input_type=float | Row)]


class Reference(Value):
    """Setpoints of the quantities that the cost tracks."""

    tip: Annotated[Vector2 | RowSamples | CircleReference, Unit("m")] | None = None
    """World position of the tip [m]."""
    bending: Annotated[Rows, Unit("rad")] | None = None
    """Bending angle of each element of the controller's model [rad]; by default zero."""
    shape: Annotated[Rows, Unit("m")] | None = None
    """World positions x, y [m] of the sections of ``cost.shape.at``, one after the other."""
    tip_angle: Annotated[AngleRow | RowSamples, Unit("rad")] | None = None
    """World angle of the tip's section, whose tangent is (-sin, cos) of it [rad]; samples have rows of one entry."""
    contact_force: Annotated[Rows, Unit("N")] | None = None
    """Normal force at each place where the finger may touch the object, from base to tip [N]."""
    gap: Annotated[Rows, Unit("m")] | None = None
    """Distance of each place where the finger may touch the object from its surface, from base to tip [m]."""
    object_position: Annotated[Vector2 | RowSamples, Unit("m")] | None = None
    """World position of an object that moves [m]."""
    object_angle: Annotated[AngleRow | RowSamples, Unit("rad")] | None = None
    """World angle of an object that moves [rad]; samples have rows of one entry."""
    input: Annotated[Rows, Unit("unit of the input")] | None = None
    """Input that costs no effort: tip moment, tensions, or commands of drives [unit of the input]. None: zero moment,
    the least tensions, or the pretension of drives."""

    def _check(self) -> None:
        for name in ("tip", "object_position"):
            rows = getattr(self, name)
            if isinstance(rows, RowSamples) and rows.width != 2:
                raise ValueError(f"{name}: expected rows of x, y, got {rows.width} entries")


_WITH_DEFAULT = frozenset({"bending", "input"})
"""Quantities with a default setpoint: straight, least tension. The world's origin is no setpoint."""
