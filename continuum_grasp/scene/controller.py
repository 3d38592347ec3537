"""Cost, bounds and horizon of a nonlinear model predictive controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from continuum_grasp.scene.integrators import CONTROL_METHODS
from continuum_grasp.scene.value import Length, NonNegative, Positive, Real, Value, Vector2

__all__ = [
    "Bounds",
    "Controller",
    "Cost",
    "DiscZone",
    "ForceWeight",
    "HalfPlaneZone",
    "Horizon",
    "InputLimits",
    "Penalty",
    "ShapeWeight",
    "Weight",
    "Zone",
]

if TYPE_CHECKING:
    Method = str
else:
    Method = Literal["auto", *CONTROL_METHODS]


def _running(value: Any) -> Any:
    """A bare number is the running weight."""
    return {"running": value} if isinstance(value, int | float) and not isinstance(value, bool) else value


class Weight(Value):
    """What an error costs."""

    running: NonNegative = 0.0
    """Cost per second of half the squared error, per unit squared."""
    terminal: NonNegative = 0.0
    """The same at the end of the horizon, once."""


Weighted = Annotated[Weight, BeforeValidator(_running, json_schema_input_type=float | Weight)]


class ShapeWeight(Weight):
    """Positions along the finger that are to follow set-points."""

    at: Annotated[tuple[Length, ...], Field(strict=False, min_length=1)]
    """Positions along the finger [m]."""


class ForceWeight(Weight):
    """Contacts whose normal forces are to follow set-points."""

    of: Annotated[tuple[str, ...], Field(strict=False, min_length=1)] | None = None
    """Names of the contacts: finger.1 and so on at ``contacts``, finger.tip; None: all of these."""


ForcesWeighted = Annotated[ForceWeight, BeforeValidator(_running, json_schema_input_type=float | ForceWeight)]


class Cost(Value):
    """Weights of half the squared errors; what has no weight costs no instruction."""

    tip: Weighted | None = None
    """World position of the tip [1/m2]."""
    bending: Weighted | None = None
    """Bending angle of each element [1/rad2]."""
    shape: ShapeWeight | None = None
    """World positions along the finger [1/m2]."""
    speed: Weighted | None = None
    """Bending rate of each element, towards zero [s2/rad2]."""
    contact_force: ForcesWeighted | None = None
    """Normal force at each place where the finger may touch the object [1/N2]."""
    effort: NonNegative | None = None
    """Input away from ``reference.input`` [1/N2, or 1/(N m)2 of the tip moment]."""
    input_rate: NonNegative | None = None
    """Change of the input per time, towards zero [s2/N2, or s2/(N m)2]."""

    @model_validator(mode="after")
    def _something(self) -> Cost:
        followed = [w for w in (self.tip, self.bending, self.shape, self.contact_force) if w is not None]
        if not followed:
            raise ValueError("a controller needs something to follow: tip, bending, shape or contact_force")
        if not any(w.running or w.terminal for w in followed):
            raise ValueError("give tip, bending, shape or contact_force a weight greater than 0: nothing is followed")
        if not self.effort and not self.input_rate:
            raise ValueError("give effort or input_rate a weight greater than 0: without either inputs are not unique")
        return self


class Penalty(Value):
    """Price of leaving a bound, per share of its scale; large enough, the bound is kept wherever that is possible."""

    linear: NonNegative = 100.0
    """Per share."""
    quadratic: NonNegative = 1000.0
    """Of half the squared share."""


class _Zone(Value):
    of: Literal["tip", "backbone"] = "tip"
    """What must stay out: the tip, or also four sections of every element."""
    clearance: NonNegative = 0.0
    """Distance that is kept from the edge [m]."""
    penalty: Penalty | Literal["hard"] = Penalty()


class HalfPlaneZone(_Zone):
    """All behind a line."""

    type: Literal["half_plane"]
    point: Vector2
    """A world point of the line [m]."""
    normal_angle: Real
    """World angle of the normal that points out of the zone [rad]."""


class DiscZone(_Zone):
    """A disc."""

    type: Literal["disc"]
    center: Vector2
    """World position of its centre [m]."""
    radius: Positive
    """[m]"""


Zone = Annotated[HalfPlaneZone | DiscZone, Field(discriminator="type")]


class Bounds(Value):
    """What must not be left; the input's own limits are those of ``controller.input``."""

    curvature: Positive | Literal["finger"] | None = "finger"
    """Greatest curvature [1/m]; finger: that of its strain limit and of the model's bending range; null: none."""
    speed: Positive | None = None
    """Greatest bending rate of an element [rad/s]."""
    keep_out: dict[str, Zone] = Field(default_factory=dict)
    """Zones by name."""
    penalty: Penalty | Literal["hard"] = Penalty()
    """Of curvature and speed."""


class InputLimits(Value):
    """Limits of the input; tensions are limited by ``finger.tendons`` alone."""

    moment_max: Positive | None = None
    """Greatest tip moment, either way, of a finger without tendons [N m]."""
    rate_max: Positive | None = None
    """Greatest change of the input per time [N/s or N m/s]."""
    time_constant: Annotated[float, Field(ge=1e-6, le=1e6)] | None = None
    """Lag with which the tip moment of a finger without tendons follows [s]; that of tendons is their own."""


class Horizon(Value):
    """Time grid of the prediction."""

    stages: Annotated[int, Field(ge=2, le=500)] = 30
    stage: Annotated[float, Field(ge=1e-5, le=10.0)] = 0.01
    """Length of one stage, over which the input is constant [s]."""
    method: Method = "auto"
    """rk4: explicit steps of order 4; sdirk2: L-stable steps of order 2, for stiff models such as those in contact;
    auto: rk4 unless the stiffness asks for more than four steps per stage."""
    substeps: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Steps per stage; None: as many as the stiffness asks for (sdirk2: one per 10 ms)."""


class Controller(Value):
    """Nonlinear model predictive control by real-time iterations."""

    period: Annotated[float, Field(ge=1e-6, le=10.0)] | None = None
    """Time from one command to the next [s]; None: a stage."""
    horizon: Horizon = Horizon()
    cost: Cost
    input: InputLimits = InputLimits()
    bounds: Bounds = Bounds()
    sqp_iterations: Annotated[int, Field(ge=1, le=20)] = 1
    """Linearisations of the problem per command. One is the real-time iteration; more come nearer to the optimum of a
    strongly nonlinear problem, at so many times the price."""
    start_iterations: Annotated[int, Field(ge=1, le=100)] = 5
    """The same for a command that has no plan to go on from, such as the first one."""
    iterations: Annotated[int, Field(ge=1, le=100)] = 20
    """Greatest number of interior-point iterations per quadratic programme."""
    supervisor: bool = True
    """Whether the loop is supervised: where sensors contradict the model, ``input_rate`` is raised up to 16-fold; where
    that does not help, or readings freeze, the command goes to the least tensions (no moment) until it is re-armed."""
    deadline: Positive | None = None
    """Time after which a command counts as late [s]; None: the period."""

    @model_validator(mode="after")
    def _commensurate(self) -> Controller:
        if self.period is not None and self.period > self.horizon.stage * self.horizon.stages:
            raise ValueError(f"period = {self.period} s is longer than the whole horizon")
        return self

    @property
    def step(self) -> float:
        """Time from one command to the next [s]."""
        return self.horizon.stage if self.period is None else self.period
