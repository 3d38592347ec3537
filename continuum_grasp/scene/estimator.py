"""An estimator: its sensors and the unknowns that it estimates; and how a bench is mounted, whose camera, load
cells and drives count otherwise than the model.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    Angle,
    Duration,
    Length,
    ListOf,
    Position,
    Positive,
    Real,
    Value,
)


class Camera(Value):
    """A camera whose axes differ from the world's."""

    position: Position = (0.0, 0.0)
    """World position of the camera's origin [m]."""
    angle: Angle = 0.0
    """World angle of the camera's x axis [rad]."""
    scale: Annotated[Positive, Unit("1")] = 1.0
    """Camera's reading per true distance [1]."""
    mirrored: bool = False
    """Whether the camera's y axis is to the right of its x axis, as in images with y down. If stated, ``commission``
    takes it as known."""


class Connection(Value):
    """A line between computer and bench: the bench's number is sign times the model's, plus zero."""

    of: Annotated[int, Field(ge=1, le=16)]
    """Number of the tendon at its other end, from 1."""
    sign: Literal[-1, 1] = 1
    """Sign of the number of the bench per number of the model."""
    zero: Annotated[Real, Unit("N or N m")] = 0.0
    """Command of a drive that exerts nothing, or reading of a load cell without load [N or N m]."""


Connections = Annotated[ListOf[Connection], Field(max_length=16)]


class Mounting(Value):
    """Differences between the numbers of a bench and the model's."""

    camera: Camera = Camera()
    """The camera that sees the tip."""
    drives: Connections = ()
    """Connections of the commands, in the order of the bench; none: as in the model."""
    tensions: Connections = ()
    """Connections of the measured tensions, or tip moment, in the order of the bench; none: as in the model."""

    @staticmethod
    def lines(ends: Iterable[int], signs: Iterable[int]) -> tuple[Connection, ...]:
        """Lines to tendons by number, from 1, with their signs."""
        return tuple(Connection(of=end, sign=1 if sign > 0 else -1) for end, sign in zip(ends, signs, strict=True))

    def _check(self) -> None:
        for name in ("drives", "tensions"):
            ends = [connection.of for connection in getattr(self, name)]
            if sorted(ends) != list(range(1, len(ends) + 1)):
                raise ValueError(f"{name}: expected every number from 1 to {len(ends)} once as `of`, got {ends}")


class BendingSensors(Value):
    """Angles of sections."""

    at: Annotated[ListOf[Length], Field(min_length=1)]
    """Positions along the finger [m]."""
    std: Annotated[Positive, Field(examples=[0.003, "3 mrad"]), Unit("rad")]
    """Standard deviation of a measured angle [rad]."""


class ObjectSensor(Value):
    """A camera that sees the pose of an object that moves."""

    position: Annotated[Positive, Field(examples=[5e-4, "0.5 mm"]), Unit("m")]
    """Standard deviation of each measured coordinate [m]."""
    angle: Annotated[Positive, Field(examples=[0.005, "5 mrad"]), Unit("rad")]
    """Standard deviation of the measured angle [rad]."""


_SENSOR_KEYS = {
    "tip_x": "tip",
    "tip_y": "tip",
    "length_": "length",
    "motor_angle_": "angle",
    "motor_torque_": "torque",
} | {
    "pressure_": "pressure",
    "angle_": "bending.std",
    "object_angle": "object.angle",
    "object_": "object.position",
}
"""Key in ``estimator.measured`` by how a name of a measurement begins; others are tensions and moments."""


class Measured(Value):
    """Measured quantities, each with the standard deviation of its noise."""

    tip: Annotated[Positive, Field(examples=[3e-4, "0.3 mm"]), Unit("m")] | None = None
    """Noise of each coordinate of the tip's world position, by a camera [m]."""
    tension: Annotated[Positive, Field(examples=[0.1]), Unit("N or N m")] | None = None
    """Noise of each tendon's tension, or of the tip moment of a finger without tendons [N or N m]; needs a lag, since
    without one it is the input itself."""
    pressure: Annotated[Positive, Field(examples=[200.0, "0.2 kPa"]), Unit("Pa")] | None = None
    """Noise of each chamber's pressure [Pa], which needs a lag as a tension does."""
    bending: BendingSensors | None = None
    """Angles of sections; None: not measured."""
    object: ObjectSensor | None = None
    """Pose of an object that moves; None: not measured."""
    length: Annotated[Positive, Field(examples=[2e-5, "20 um"]), Unit("m")] | None = None
    """Noise of the length of cable that each winch has wound up, with ``drive.kind: length`` [m]; of an encoder, a step
    over the root of 12."""
    angle: Annotated[Positive, Field(examples=[4e-4, "0.4 mrad"]), Unit("rad")] | None = None
    """Noise of the angle of each drum, with ``drive.kind: motor`` [rad]; of an encoder, a step over the root of 12."""
    torque: Annotated[Positive, Field(examples=[1e-4]), Unit("N m")] | None = None
    """Noise of the torque of each motor at its drum [N m]."""

    def std_of(self, name: str) -> float | None:
        """Return the standard deviation of a measured number, by its name; None if it is not measured."""
        key = next((key for start, key in _SENSOR_KEYS.items() if name.startswith(start)), "tension")
        std: Any = self
        for part in key.split("."):
            std = std and getattr(std, part)
        return std or None

    def _check(self) -> None:
        shows = ("tip", "bending", "length", "angle")
        if all(getattr(self, name) is None for name in shows):
            raise ValueError(
                "measure the tip, the bending, or a winch (its length or angle): the shape cannot be "
                "estimated from a tension alone"
            )


class Disturbed(Value):
    """Slowly varying unknowns estimated with the state, each with its drift per square root of a second."""

    tip_moment: Annotated[Positive, Field(examples=[0.01]), Unit("N m / s^0.5")] | None = None
    """Tip moment missing in the model, from wrong stiffness or friction [N m / s^0.5]."""
    tip_offset: Annotated[Positive, Field(examples=[0.001]), Unit("m / s^0.5")] | None = None
    """Error of the measured tip across the path of the tip under an even bend, such as that of a scaled, shifted or
    turned camera [m / s^0.5]. Without this unknown, the estimated finger bends to an error that no bend explains, and
    the tip misses its setpoint by several times this error. With it, the measured tip meets its setpoint. Use it
    together with one disturbance that moves the tip along the path."""
    tip_force: Annotated[Positive, Field(examples=[0.1]), Unit("N / s^0.5")] | None = None
    """Unknown world force at the tip, each component [N / s^0.5]."""
    contact_force: Annotated[Positive, Field(examples=[0.2]), Unit("N / s^0.5")] | None = None
    """Unknown world force at each place of ``contacts``, each component [N / s^0.5]."""
    contact_friction: Annotated[Positive, Field(examples=[0.5]), Unit("1 / s^0.5")] | None = None
    """Friction in the plane at each contact with the object, per ``contact_law.friction`` times the normal force: a
    share between -1 and 1 [1 / s^0.5]; it replaces the friction of the contact law."""
    object_position: Annotated[Positive, Field(examples=[0.004]), Unit("m / s^0.5")] | None = None
    """Position of a fixed object, each coordinate [m / s^0.5]; observable only in contact."""
    bending_stiffness: Annotated[Positive, Field(examples=[0.1]), Unit("1 / s^0.5")] | None = None
    """Bending stiffness, relative [1 / s^0.5]; must be one of the scene's ``parameters``."""
    tendon_friction: Annotated[Positive, Field(examples=[0.1]), Unit("1 / s^0.5")] | None = None
    """Friction coefficient of the tendons, relative [1 / s^0.5]; must be one of the scene's ``parameters``."""


class Spread(Value):
    """Standard deviations at the start for unknowns that stay constant for a plant."""

    object_position: Annotated[Positive, Field(examples=["3 mm"]), Unit("m")] | None = None
    """Spread of each coordinate of a fixed object [m]."""
    bending_stiffness: Annotated[Positive, Field(examples=["10 %"]), Unit("1")] | None = None
    """Spread of the bending stiffness, relative [1]."""
    tendon_friction: Annotated[Positive, Field(examples=["40 %"]), Unit("1")] | None = None
    """Spread of the friction coefficient of the tendons, relative [1]."""


class Adapt(Value):
    """Model parameters estimated while the controller runs, each with the standard deviation of plants about nominal.

    Each must be one of the scene's ``parameters``. Estimates start at the nominal values; the controller plans with
    them until measurements tell more.
    """

    bending_stiffness: Annotated[Positive, Field(le=1.0, examples=["30 %"]), Unit("1")] | None = None
    """Drift of the bending stiffness, relative [1]."""
    tip_mass: Annotated[Positive, Field(examples=["5 g"]), Unit("kg")] | None = None
    """Drift of the mass at the tip, a payload [kg]; it is never below zero."""
    drive_time_constant: Annotated[Positive, Field(le=1.0, examples=["40 %"]), Unit("1")] | None = None
    """Drift of the time constant T of the drive, relative [1]. Only the dead time, 2 T and the delay of measurements,
    shows: a delay other than ``delay`` is found as half of it in T."""
    forgetting_time: Annotated[Duration, Field(examples=["60 s"])] | None = None
    """Time within which variances return to their start without informative measurements [s]: a shorter time follows
    changing parameters, a longer one averages over more noise. None: 785 natural times of the finger, sqrt(m L^3 / E
    I); for example, 60 s at 76 ms."""

    @property
    def spreads(self) -> dict[str, float]:
        """Standard deviations of the estimated parameters at the start, by name."""
        return self.stated("forgetting_time")

    def _check(self) -> None:
        if not self.spreads:
            raise ValueError("name a parameter: bending_stiffness, tip_mass or drive_time_constant")


class EstimatorSettings(Value):
    """An extended Kalman filter with disturbance states.

    Measurements meet the setpoints where the filter estimates as many disturbances as measured coordinates of the tip,
    and a finger at rest shows all of them (Pannocchia and Rawlings, doi:10.1002/aic.690490213; Maeder, Borrelli and
    Morari, doi:10.1016/j.automatica.2009.05.007): of a tip on one curve one that moves it along the curve, and
    `tip_offset`.
    """

    REFUSALS = Consumer.refusals(
        """
        spread.{object_position,bending_stiffness,tendon_friction} without disturbances.NAME: needs its drift among
            disturbances: what does not drift is not estimated
        disturbances.tip_offset without measured.tip: needs a camera that sees the tip
        """
    )

    measured: Measured
    """Measured quantities, and the noise of each."""
    disturbances: Disturbed = Disturbed()
    """Unknowns that are estimated with the state."""
    spread: Spread = Spread()
    """Standard deviations of unknowns from their nominal values at the start; by default, their drift in 100 control
    periods. A stiffness that differs between plants has a wide spread and a slow drift."""
    adapt: Adapt | None = None
    """Model parameters that are estimated while it runs; None: none."""
    acceleration_std: Annotated[Positive, Field(examples=[1.0]), Unit("rad/s2 s^0.5")] | None = None
    """Unmodeled acceleration of each bending angle [rad/s2 s^0.5]. None: 0.2113 T^-1.5, with the natural time of the
    finger T = sqrt(m L^3 / E I); 10 of one with 76 ms."""
    object_acceleration_std: Annotated[Positive, Field(examples=[0.1]), Unit("m/s2 s^0.5")] | None = None
    """Unmodeled acceleration of an object that moves, each coordinate [m/s2 s^0.5]; of its turning, as much at its
    radius of gyration. None: 0.01174 L T^-1.5, with length and natural time of the finger; 0.1 of 180 mm and 76 ms."""
    initial_std: Annotated[Positive, Unit("rad")] = 0.05
    """Standard deviation of each bending angle at the start [rad]; of their rates 0.76 times that per natural
    time of the finger, sqrt(m L^3 / E I)."""
    delay: Annotated[float, Field(ge=0.0, le=1.0), Unit("s")] = 0.0
    """Known age of a measurement when it arrives, a whole number of control periods [s]."""
    outlier: Annotated[float, Field(ge=2.0, le=100.0, examples=[8.0]), Unit("1")] = 8.0
    """A sensor further than this many standard deviations from its expected value [1] is rejected, unless that happens
    too often: then the model is wrong, and the sensor is used with bounded influence."""
    frozen: bool = True
    """Whether a reading at rest for 2.6 natural times of the finger (20 samples at least) and its delay is missing
    while the command moves. False: for sensors whose resolution is coarser than their noise, which repeat a number
    while the finger rests."""

    def _check(self) -> None:
        if self.adapt and self.adapt.bending_stiffness is not None and self.disturbances.tip_moment is not None:
            self._doubt(
                "adapt.bending_stiffness",
                "beside disturbances.tip_moment: at rest nothing tells them apart; leave the "
                "moment out, or let it drift slowly",
            )
