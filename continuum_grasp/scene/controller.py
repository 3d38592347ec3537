"""A nonlinear model predictive controller and the plant: bounds, horizon, differences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from continuum_grasp.base import InputError
from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.cost import Cost, Reference, RowSamples
from continuum_grasp.scene.drives import TAKES, LengthDrive
from continuum_grasp.scene.estimator import Mounting
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.finger_scene import Fidelity, FingerScene, Initial, begins
from continuum_grasp.scene.loads import Actuation
from continuum_grasp.scene.methods import FAMILIES, INTEGRATORS
from continuum_grasp.scene.reach import Reach, rows_of
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.scene.surroundings import Surroundings
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    Angle,
    Distance,
    Duration,
    Extent,
    Friction,
    Interval,
    ListOf,
    Mass,
    NonNegative,
    Position,
    Positive,
    Ratio,
    TimeConstant,
    Value,
)

if TYPE_CHECKING:
    Method = str
else:
    Method = Literal["auto", *[name for name, each in INTEGRATORS.items() if each.differentiates]]


MOST_SCENARIOS = 8
"""Greatest number of plants [1]: a step takes as many times as long."""


class Penalty(Value):
    """Penalty weights of a soft constraint, per share of its scale.

    With large enough weights, the constraint is satisfied whenever this is possible.
    """

    linear: Ratio = 100.0
    """Weight per share of the violation [1]."""
    quadratic: Ratio = 1000.0
    """Weight per half the squared share of the violation [1]."""


class _Zone(Value):
    of: Literal["tip", "backbone"] = "tip"
    """Part of the finger that must stay outside: the tip, or also four sections of every element."""
    clearance: Distance = 0.0
    """Distance from the edge [m]."""
    penalty: Penalty | Literal["hard"] | None = None
    """Penalty of a violation. hard: a violation means that there is no solution. None: soft, and hard in plans."""


class HalfPlaneZone(_Zone):
    """Half the plane, on one side of a line."""

    type: Literal["half_plane"]
    point: Position
    """A world point of the line [m]."""
    normal_angle: Angle
    """World angle of the normal that points out of the zone [rad]."""

    def distance(self, x: Any, y: Any) -> Any:
        """Distance of points from the edge, positive outside [m], of numbers or expressions."""
        return math.cos(self.normal_angle) * (x - self.point[0]) + math.sin(self.normal_angle) * (y - self.point[1])


class DiscZone(_Zone):
    """A disc."""

    type: Literal["disc"]
    center: Position
    """World position of its center [m]."""
    radius: Annotated[Positive, Unit("m")]
    """Radius [m]."""

    def distance(self, x: Any, y: Any) -> Any:
        """Distance of points from the edge, positive outside [m], of numbers or expressions."""
        dx, dy = x - self.center[0], y - self.center[1]
        # (1 um)^2 keeps the derivative finite at the center.
        return (dx * dx + dy * dy + 1e-12) ** 0.5 - self.radius


Zone = Annotated[HalfPlaneZone | DiscZone, Field(discriminator="type")]


class Bounds(Value):
    """Bounds of the state; limits of the input are in ``controller.input``."""

    curvature: Annotated[Positive, Unit("1/m")] | Literal["finger"] | None = "finger"
    """Greatest curvature [1/m]; finger: as its strain limit and the model's bending range allow; null: none."""
    speed: Annotated[Positive, Field(examples=[25.0, "25 rad/s"]), Unit("rad/s")] | None = None
    """Greatest bending rate of an element [rad/s]."""
    keep_out: dict[str, Zone] = Field(default_factory=dict)
    """Zones by name."""
    penalty: Penalty | Literal["hard"] | None = None
    """Penalty of violations of curvature and speed. hard: a violation means that there is no solution. None: soft, and
    hard in plans."""
    usual_penalty: ClassVar[Penalty | Literal["hard"]] = Penalty()
    """Penalty where a scene states none."""

    def curvature_limit_at(self, finger: Finger, s: float) -> float:
        """Greatest curvature at a position [m], apart from the bending range of a model [1/m]."""
        # Infinite, since a limit of the model's bending range may be less.
        if self.curvature is None:
            return math.inf
        return float(finger.curvature_limit_at(s)) if self.curvature == "finger" else self.curvature


class InputLimits(Value):
    """Limits of the input; tensions are limited by ``finger.tendons`` alone."""

    moment_max: Annotated[Positive, Field(examples=[0.3, "0.3 N m"]), Unit("N m")] | None = None
    """Greatest magnitude of the tip moment of a finger without tendons [N m]."""
    lengths: Annotated[Interval, Field(examples=[[-0.012, 0.012]]), Unit("m")] | None = None
    """Least and greatest commanded length of every winch [m]; needed for tendons with drive.kind: length."""
    angles: Annotated[Interval, Field(examples=[[-1.5, 1.5], ["-90 deg", "90 deg"]]), Unit("rad")] | None = None
    """Least and greatest commanded angle of every drum [rad]; needed for motors with a position_gain."""
    torques: Annotated[Interval, Field(examples=[[-0.01, 0.2]]), Unit("N m")] | None = None
    """Least and greatest commanded torque of every motor [N m]; None: torque_max of its drive both ways. A motor with
    one tendon needs no more against it than its dry friction."""
    rate_max: Annotated[Positive, Field(examples=[600.0]), Unit("unit of the input per second")] | None = None
    """Greatest change of the input per time [unit of the input per second], such as N/s of tensions."""
    time_constant: TimeConstant | None = None
    """Time constant T of each of two lags in series, 1/(T s + 1)^2, between the command and the tip moment of a finger
    without tendons [s]; for a first-order drive, half its time constant. ``finger.tendons`` has the constant of
    tendons."""


class CommandedScene(FingerScene, Surroundings):
    """A scene of one finger whose input is chosen, within limits that are at the key ``AT``."""

    AT: ClassVar[str]
    REFUSALS = Consumer.refusals(
        f"""
        {{controller.,}}input.{{lengths,angles,torques}} without finger.input_keys=NAME: {TAKES}
        finger.tendons.time_constant with some_lag: all tendons lag, or none
        {{controller.,}}input.{{moment_max,time_constant}} without finger.input_keys=tip_moment:
            is for a finger without tendons and chambers
        fidelity.family=matched_clothoid without lag:
            needs a continuous tip moment: give input or finger.tendons a time_constant, or use clothoid or arc
        """,
        some_lag=lambda s: len({tendon.time_constant is None for tendon in s.finger.tendon_list}) > 1,
    )

    initial: Annotated[Initial, begins("rest")] = Initial(pose="rest")
    """State at time zero."""
    reference: Reference = Reference()
    """Setpoints of the quantities that the cost tracks."""

    @property
    def limits(self) -> InputLimits:
        """Limits of the input."""
        limits: InputLimits = attrgetter(self.AT)(self)
        return limits

    def _check(self) -> None:
        name, limits = self.finger.input_keys[0], self.limits
        if name == "tip_moment" and limits.moment_max is None:
            raise ValueError(f"{self.AT}.moment_max is needed: the greatest tip moment of a finger without tendons")
        pair = getattr(limits, name, None)
        if pair is None and name in ("lengths", "angles"):
            raise ValueError(f"{self.AT}.{name} is needed: the least and greatest command of the drives")
        greatest = min((drive.limit for drive in self.finger.winches), default=math.inf)
        if pair is not None and max(map(abs, pair)) > greatest:
            raise ValueError(f"{self.AT}.{name}: {list(pair)} is beyond what drive.torque_max allows, {greatest:g}")

    def check_references(self, cost: Cost, *, moves: bool = False) -> None:
        """Refuse setpoints ``reference`` that the finger cannot meet; ``moves``: whether the object does."""
        places = dict(zip(self.contact_names, (*self.contacts, self.finger.rod.length), strict=True))
        gaps = [places[name] for name in cost.tracked_contacts("gap", self.contact_names) if name in places]
        at = () if cost.shape is None else cost.shape.at
        widths = {"shape": (2 * len(at), f"x, y of {len(at)} sections")}
        widths["input"] = len(self.input_limits[0]), self.finger.input_words
        for name, (width, words) in widths.items():
            setpoint = getattr(self.reference, name)
            got = width if setpoint is None else setpoint.width if isinstance(setpoint, RowSamples) else len(setpoint)
            if got != width:
                raise InputError(f"expected {words}, got {got} numbers", key=f"reference.{name}")
        given = dict(self.reference)
        Reach(self.finger, at, self.object, self._bend_limits(), gaps, moves).check("reference", given)

    def check_reach(
        self, key: str, rows: Mapping[str, Any], *, at: Sequence[float] = (), lengths: Sequence[float] | None = None
    ) -> None:
        """Refuse setpoints that the finger cannot meet, with elements of ``lengths`` [m]; None: the stated elements."""
        Reach(self.finger, at, ranges=self._bend_limits(lengths)).check(key, rows)

    @property
    def greatest_moment(self) -> float:
        """Greatest bending moment that inputs, or tensions within their limits, exert at the base [N m]."""
        channels = [channel for channel in self.finger.channels if any(channel.arms)]
        if not channels:
            return self.greatest_sum((1.0,), *self.input_limits)
        limits = [pull.least for pull in self.finger.pulls], [pull.most for pull in self.finger.pulls]
        return sum(abs(channel.gain) * self.greatest_sum(channel.arms, *limits) for channel in channels)

    @staticmethod
    def greatest_sum(arms: Sequence[float], least: Sequence[float], most: Sequence[float]) -> float:
        """Greatest size of the sum of arms times inputs, each between its least and its most."""
        sides = [sorted((arm * low, arm * high)) for arm, low, high in zip(arms, least, most, strict=True)]
        return max(sum(high for _, high in sides), -sum(low for low, _ in sides))

    def _bend_limits(self, lengths: Sequence[float] | None = None) -> list[float]:
        """Return the greatest permitted setpoint of each element's bend [rad]; empty if neither ``lengths`` [m] nor the
        scene give the number of elements.

        It is the stated range, or twice the bend under the greatest moment of the drives, since weight and loads bend
        too.
        """
        elements, stated, length = self.fidelity.elements, self.fidelity.bending_range, self.finger.rod.length
        # Profiles are slow: compute them only to compare angles.
        if not any(value is not None for _, value in self.angles_asked):
            return []
        if lengths is None:
            lengths = [length / elements] * elements if isinstance(elements, int) else elements or ()
        profile = self.finger.profile
        bent = max(map(abs, profile.rest_curvature.extremes))
        if stated is not None:
            return [stated if bent * h < stated else bent * h + 0.5 * stated for h in lengths]
        driven = 2.0 * self.greatest_moment / min(profile.bending_stiffness.extremes)
        return [bent * h + max(self.fidelity.DEFAULT_RANGE, driven * h) for h in lengths]

    @property
    def angles_asked(self) -> list[tuple[str, Any]]:
        """Return the setpoints of ``bending`` and ``tip_angle`` [rad], as rows by name."""
        return [(name, getattr(self.reference, name)) for name in ("bending", "tip_angle")]

    def reached(self, ranges: Sequence[float]) -> list[float] | None:
        """Return the bends (elements,) [rad] that elements must cover for the setpoints; None: ``ranges`` suffice."""
        whole, asked = sum(ranges), list(ranges)
        for name, value in self.angles_asked:
            for _, row in rows_of(name, value):
                turn = abs(row[0] - self.finger.base.angle) / whole
                bends = [turn * reach for reach in ranges] if name == "tip_angle" else map(abs, row)
                asked = [max(pair) for pair in zip(asked, bends, strict=False)]
        # 1.5: range per requested bend: a finger in motion, and its ends, bend more
        return None if asked == list(ranges) else [1.5 * bend for bend in asked]

    @property
    def input_limits(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Least and greatest value of each input, in its unit."""
        finger, limits = self.finger, self.limits
        ranges = [(finger_input.least, finger_input.most) for finger_input in finger.inputs]
        if "tip_moment" in finger.input_keys:
            ranges = [(-(limits.moment_max or 0.0), limits.moment_max or 0.0)]
        pair = getattr(limits, finger.input_keys[0], None)
        if pair is not None:
            ranges[: len(finger.winches)] = [pair] * len(finger.winches)
        return tuple(least for least, _ in ranges), tuple(greatest for _, greatest in ranges)

    @property
    def limit_keys(self) -> str:
        """Keys of the input's limits, for messages."""
        where = {"tensions": "finger.tendons.max_tension", "pressures": "finger.pressure.max_pressure"}
        where |= {"tip_moment": f"{self.AT}.moment_max"}
        return " and ".join(where.get(key, f"{self.AT}.{key}") for key in dict.fromkeys(self.finger.input_keys))

    @property
    def rest_input(self) -> tuple[float, ...]:
        """Input that leaves the finger alone: no tip moment, the least tensions, or the pretension of its drives."""
        least, greatest = self.input_limits
        # On one pulley no torque holds a pretension, and winches that follow a length have it at zero.
        wanted = [
            drive.winch_radius * drive.pretension / (drive.position_gain or 1.0)
            if drive.kind == "motor" and drive.arrangement == "per_tendon"
            else 0.0
            for drive in self.finger.winches
        ]
        wanted += [0.0] * (len(least) - len(wanted))
        return tuple(min(max(at, low), high) for at, low, high in zip(wanted, least, greatest, strict=True))

    @property
    def lag(self) -> float | None:
        """Shortest time constant of the drive [s]; None: an input acts at once, or by motors that turn."""
        drives = [drive.time_constant if isinstance(drive, LengthDrive) else None for drive in self.finger.winches]
        lags = drives or [tendon.time_constant for tendon in self.finger.tendon_list]
        lags = [*lags, *(chamber.time_constant for chamber in self.finger.chambers)] or [self.limits.time_constant]
        known = [lag for lag in lags if lag is not None]
        return min(known) if len(known) == len(lags) else None

    @property
    def initial_input(self) -> tuple[float, ...]:
        """Input before the motion begins."""
        return self.rest_input

    @property
    def model_family(self) -> str:
        """Curvature family of the model."""
        # By friction and stops the tip's bending depends on the shape, and without a lag it jumps: a matched tip has
        # neither.
        free_tip = self.finger.moves_with_free_tip or self.lag is None
        return self.fidelity.family or FAMILIES.default(free_tip=free_tip)

    @property
    def simulated(self) -> Scene:
        """Scene for models and simulations, under the input before the motion.

        A tip moment acts without its lag.
        """
        at_rest = Actuation.of(self.finger.input_keys, self.initial_input)
        fidelity = self.fidelity.replaced(family=self.model_family)
        given = {key: value for key, value in self if key in Scene.model_fields}
        return Scene(**given | {"actuation": at_rest, "fidelity": fidelity})

    @property
    def model_parameters(self) -> tuple[str, ...]:
        """Parameters of the model."""
        return self.parameters

    @property
    def predicted_finger(self) -> Finger:
        """Finger of the model."""
        return self.finger

    @property
    def disturbances(self) -> frozenset[str]:
        """Disturbances that are parameters of the model: tip_force, tip_moment, tip_offset, object_position, ..."""
        return frozenset()


class Horizon(Value):
    """Time grid of the prediction."""

    stages: Annotated[int, Field(ge=2, le=500)] = 30
    """Number of stages."""
    stage: Annotated[float, Field(ge=1e-5, le=10.0), Unit("s")] = 0.01
    """Length of one stage, over which the input is constant [s]."""
    method: Method = "auto"
    """rk4: explicit steps of order 4; sdirk2: L-stable steps of order 2, for stiff models such as those in contact;
    sdirk2_contact: the same with a third Newton iteration; auto: rk4 unless the stiffness requires more than four
    steps per stage, or more than ``substeps``, then sdirk2, or sdirk2_contact for contacts that close within a
    control period (of a hand from about 14 kN/m). A step of either takes the same time; the modes that one of sdirk2
    does not resolve can make a loop swing whose ``cost.input_rate`` is small."""
    substeps: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Steps per stage; None: as many as the stiffness requires (implicit methods: one per control period, more with
    contacts that close within one)."""


class _Differs(Value):
    """Differences of a finger from the controller's finger."""

    stiffness: Annotated[Positive, Unit("1")] = 1.0
    """Bending stiffness relative to the controller's finger [1]."""
    damping: Annotated[Positive, Unit("1")] = 1.0
    """Damping of the material and per element, relative to the controller's finger [1]."""
    tip_mass: Mass = 0.0
    """Mass at the tip that the controller's finger does not have [kg]."""
    tendon_friction: Friction | None = None
    """Capstan friction coefficient of the tendons [1]; None: as the controller knows it."""
    presliding: Annotated[Extent, Field(examples=[20e-6, "20 um"])] | None = None
    """Sliding of the tendons within which friction turns from one direction to the other, halved [m]; None: as the
    controller knows it."""
    axial_stiffness: Annotated[Positive, Unit("N")] | None = None
    """Stiffness EA of the tendons [N]; None: as the controller knows it. Needed for ``guides`` where the tension is
    commanded."""
    series_stiffness: Annotated[Positive, Unit("N/m")] | None = None
    """Stiffness between drive and finger [N/m]; None: as the controller knows it."""
    time_constant: TimeConstant | None = None
    """Time constant of each lag of the drive [s]; None: as the controller knows it."""


class Scenario(_Differs):
    """A plant that a robust controller plans for, by how it differs from the controller's finger."""

    weight: Annotated[Positive, Unit("1")] = 1.0
    """Weight of this plant's cost relative to the other plants: its probability, up to a factor [1]. Constraints count
    in full."""

    @property
    def changes(self) -> dict[str, float]:
        """The differences, by key."""
        return self.stated("weight")


class Limited(Value):
    """Limits that all controllers keep to."""

    input: InputLimits = InputLimits()
    """Limits of the input."""
    bounds: Bounds = Bounds()
    """Bounds of the state."""
    deadline: Duration | None = None
    """Time after which a command counts as late [s]; None: the period."""


class ControllerSettings(Limited):
    """Nonlinear model predictive control by real-time iterations."""

    period: Annotated[float, Field(ge=1e-6, le=10.0), Unit("s")] | None = None
    """Time from one command to the next [s]; None: a stage."""
    horizon: Horizon = Horizon()
    """Time grid of the prediction."""
    cost: Cost
    """Tracked quantities, and the weight of each error."""
    sqp_iterations: Annotated[int, Field(ge=1, le=20)] = 1
    """Linearizations of the problem per command. One is the real-time iteration; more approach the optimum of a
    strongly nonlinear problem, in as many times the time."""
    start_iterations: Annotated[int, Field(ge=1, le=100)] = 5
    """Linearizations for a command without a previous plan, such as the first one."""
    start_calls: Annotated[int, Field(ge=1, le=100)] = 1
    """Number of commands over which the start iterations are spread, to shorten the longest call. The first command
    integrates the motion from which it starts, and then makes its share of the iterations, rounded down. No more than
    ``start_iterations``."""
    iterations: Annotated[int, Field(ge=1, le=100)] = 40
    """Greatest number of factorizations per QP, in addition to the one of its preparation. If they do not solve the QP,
    it ends with an input within its limits and the status ITERATION_LIMIT."""
    scenarios: ListOf[Scenario] = ()
    """Plants for which the controller plans at once, 2 to 8: each has its own plan, all plans share the first command,
    and the cost is the weighted mean. {} is the unchanged finger. Empty: only the unchanged finger."""
    supervisor: bool = True
    """Whether a supervisor watches the loop. If sensors contradict the model, it raises ``input_rate`` up to 64-fold.
    If this does not help, or readings freeze, it ramps the command to the input at rest (no moment, the least tensions,
    the pretension of drives) until it is re-armed."""

    def _check(self) -> None:
        if self.period is not None and self.period > self.horizon.stage * self.horizon.stages:
            raise ValueError(f"period = {self.period} s is longer than the whole horizon")
        count = len(self.scenarios)
        if count == 1 or count > MOST_SCENARIOS:
            raise ValueError(f"scenarios: expected 2 to {MOST_SCENARIOS} plants, or none, got {count}")
        if self.start_calls > self.start_iterations:
            raise ValueError(
                f"start_calls = {self.start_calls}: expected start_iterations = {self.start_iterations} or less"
            )

    @property
    def step(self) -> float:
        """Time from one command to the next [s]."""
        return self.horizon.stage if self.period is None else self.period


class PlantDifferences(_Differs):
    """Differences of the plant from the controller's model."""

    fidelity: Fidelity = Fidelity(family=FAMILIES.default(free_tip=True), elements=8)
    """Resolution of the plant's model."""
    guides: Annotated[int, Field(ge=8, le=200)] | None = None
    """Alternative to ``fidelity``: a chain with this number of hinges and a guide of the tendons at each. At the
    guides, the tendons stick or slide by the capstan law alone; between guides they are elastic, and slack instead of
    pushing. None: elements and cells."""
    drive_order: Literal[1, 2] | None = None
    """Order of the drive's lag; None: as the controller knows it. A ramp is followed as many times the time constant
    late."""
    object_mass: Annotated[Positive, Unit("1")] = 1.0
    """Mass of a moving object, per mass that the controller knows [1]."""
    object_friction: Annotated[Positive, Unit("1")] = 1.0
    """Friction coefficients of a moving object, per coefficients that the controller knows [1]."""
    noise: Ratio = 1.0
    """Measurement noise relative to ``estimator.measured`` [1]. Without any, no reading at rest counts as frozen."""
    delay: Annotated[NonNegative, Unit("s")] | None = None
    """Age of measurements when they arrive [s]; None: ``estimator.delay``."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the noise."""
    mounting: Mounting | None = None
    """True mounting of the plant's bench; None: the controller's mounting, ``{}``: as the model counts."""

    def tendon_changes(self, finger: Finger) -> dict[str, float]:
        """Changes of a finger's tendons, as ``Finger.with_tendons`` takes it."""
        changes = {"friction": self.tendon_friction, "presliding": self.presliding}
        if finger.winches:
            changes |= {"axial_stiffness": self.axial_stiffness, "series_stiffness": self.series_stiffness}
        return {key: value for key, value in changes.items() if value is not None}
