"""Loads and inputs, constant or given by samples in time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import Field

from continuum_grasp.scene.drives import COMMANDS
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Distance, Increasing, ListOf, Real, Value, Vector2


class Sampled(Value):
    """Values at instants."""

    times: Annotated[ListOf[Real], Field(min_length=2), Increasing, Unit("s")]
    """Instants, increasing [s]; before the first and after the last the value is held."""
    interpolation: Literal["smooth", "linear", "hold"] = "smooth"
    """smooth: monotone piecewise quintic with continuous rate and acceleration; linear: straight lines; hold: each
    value until the next instant."""

    def _check(self) -> None:
        # Closer instants give slopes that swamp the splines in rounding.
        if any(b - a < 1e-9 for a, b in pairwise(self.times)):
            raise ValueError("times must be 1e-9 s apart at least")
        self._check_count("values", getattr(self, "values", ()), len(self.times), "instant of times")


class Samples(Sampled):
    """A scalar function of time."""

    values: Annotated[ListOf[Real], Unit(None)]
    """Value at each instant, in the unit of the quantity."""


class VectorSamples(Sampled):
    """A planar vector function of time."""

    values: Annotated[ListOf[Vector2], Unit(None)]
    """Components x, y at each instant, in the unit of the quantity."""


class ForceLoad(Value):
    """A point force on the backbone."""

    kind: Literal["force"] = "force"
    at: Distance
    """Position along the finger [m]."""
    force: Annotated[Vector2 | VectorSamples, Unit("N")]
    """Force [N]: in the world, or, for a following force, in the section's axes (X across, Y along)."""
    follows: bool = False
    """True: the force turns with the section it acts on."""

    @property
    def value(self) -> tuple[float, float] | VectorSamples:
        """Force, as `MomentLoad.value` is the moment."""
        return self.force


class MomentLoad(Value):
    """A point moment on the backbone, positive counter-clockwise."""

    kind: Literal["moment"] = "moment"
    at: Distance
    """Position along the finger [m]."""
    moment: Annotated[Real | Samples, Unit("N m")]
    """Moment [N m]."""
    input: bool = False
    """True: the moment is an input of the model, as tensions are, and bends the finger by a known shape; false: it is
    a load like others."""

    @property
    def value(self) -> float | Samples:
        """Moment, as `ForceLoad.value` is the force."""
        return self.moment


Load = Annotated[ForceLoad | MomentLoad, Field(discriminator="kind")]


class ObjectLoad(Value):
    """Force and moment that pull at an object that moves."""

    force: Annotated[Vector2 | VectorSamples, Unit("N")] = (0.0, 0.0)
    """World force at the center of mass [N]."""
    moment: Annotated[Real | Samples, Unit("N m")] = 0.0
    """Moment, positive counter-clockwise [N m]."""


class SupportMotion(Value):
    """Motion of a round support over time."""

    shift: Annotated[Vector2 | VectorSamples, Unit("m")] = (0.0, 0.0)
    """World distance x, y of its center from its ``position`` [m]."""
    turn: Annotated[Real | Samples, Unit("rad")] = 0.0
    """Angle about its center, positive counter-clockwise [rad]: its surface drags the object by friction."""

    def _check(self) -> None:
        for value in (self.shift, self.turn):
            if isinstance(value, Sampled) and value.interpolation == "hold":
                raise ValueError("a support that jumps has no velocity: expected interpolation smooth or linear")


class Actuation(Value):
    """The input of the finger: the tip moment, or the inputs of its tendons' drives and its chambers."""

    tip_moment: Annotated[Real | Samples, Unit("N m")] | None = None
    """Tip moment [N m], for a finger without tendons and chambers."""
    tensions: Annotated[ListOf[Real | Samples], Field(min_length=1), Unit("N")] | None = None
    """Tension of each tendon [N], for a finger with tendons: F1, F2 of a pair."""
    lengths: Annotated[ListOf[Real | Samples], Field(min_length=1), Unit("m")] | None = None
    """Cable that each winch winds up [m], for tendons with ``drive.kind: length``."""
    torques: Annotated[ListOf[Real | Samples], Field(min_length=1), Unit("N m")] | None = None
    """Torque of each motor at the drum [N m], for tendons with ``drive.kind: motor``."""
    angles: Annotated[ListOf[Real | Samples], Field(min_length=1), Unit("rad")] | None = None
    """Angle of each drum [rad], where its drive has a ``position_gain``."""
    pressures: Annotated[ListOf[Real | Samples], Field(min_length=1), Unit("Pa")] | None = None
    """Pressure of each chamber above the surroundings' [Pa], for a finger with ``pressure``."""

    def _check(self) -> None:
        # Chambers may act together with tendons of one kind.
        if self.pressures is None or self.tip_moment is not None or len(self.given) > 2:
            self._check_one_given(*COMMANDS)

    @staticmethod
    def by_key(keys: Sequence[str], values: Sequence[Any]) -> dict[str, Any]:
        """Keys and values of an actuation, of one command per key given: commands of one key together, in order."""
        commands: dict[str, Any] = {}
        for key, value in zip(keys, values, strict=True):
            commands[key] = value if key == "tip_moment" else (*commands.get(key, ()), value)
        return commands

    @classmethod
    def of(cls, keys: Sequence[str], values: Sequence[float | Samples]) -> Self:
        """Commands by the key of each."""
        return cls(**cls.by_key(keys, values))

    @property
    def given(self) -> dict[str, tuple[float | Samples, ...]]:
        """Commands by their key: one per drive and chamber, or the tip moment alone."""
        named = ((key, getattr(self, key)) for key in COMMANDS)
        return {
            key: command if isinstance(command, tuple) else (command,) for key, command in named if command is not None
        }

    @property
    def values(self) -> tuple[float | Samples, ...]:
        """All commands, in the order of the inputs."""
        return tuple(value for values in self.given.values() for value in values)

    @property
    def constants(self) -> tuple[float, ...]:
        """Return all commands of a constant actuation, in the order of the inputs."""
        return tuple(value for value in self.values if not isinstance(value, Samples))
