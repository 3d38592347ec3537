"""Drives that wind up the tendons: winches that follow a commanded length, and motors; at rest, as plain numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.magnitudes import FORCE
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import GREATEST, Distance, Extent, NonNegative, Positive, TimeConstant, Value

if TYPE_CHECKING:
    from continuum_grasp.scene.profile import Channel

ONSET = 1.0 / 16.0
"""Tension within which a tendon on a winch goes from slack to tension, per its natural tension [1]: 0.4 N of a hand's
finger."""
COMMANDS = {
    "tip_moment": ("tip_moment", "N m"),
    "tensions": ("tension", "N"),
    "lengths": ("length", "m"),
    "torques": ("torque", "N m"),
    "angles": ("angle", "rad"),
    "pressures": ("pressure", "Pa"),
}
"""Name and unit of what a finger takes, by its key in ``actuation``."""
TAKES = (
    "is not what this finger takes: tip_moment without tendons and chambers, pressures of chambers, tensions of "
    "tendons without drive, lengths with drive.kind: length; of motors angles with a position_gain, else torques"
)
"""Why a command, or a limit of one, has no place at a finger with other drives."""


class Input(NamedTuple):
    """One input of a finger."""

    key: str  # in ``actuation``
    name: str
    unit: str
    least: float  # infinite unless drives, tendons or chambers state it
    most: float

    @property
    def word(self) -> str:
        """Name without a number."""
        return COMMANDS[self.key][0]

    @property
    def label(self) -> str:
        """Name and unit in one word, as in ``u_names`` of the model."""
        return f"{self.name} [{self.unit}]"


def numbered(given: Iterable[tuple[str, float, float]]) -> tuple[Input, ...]:
    """Inputs by their keys and limits, inputs of one key with numbers from 1 on."""
    inputs: list[Input] = []
    for key, least, greatest in given:
        word, unit = COMMANDS[key]
        number = 1 + sum(earlier.key == key for earlier in inputs)
        inputs.append(Input(key, word if key == "tip_moment" else f"{word}_{number}", unit, least, greatest))
    return tuple(inputs)


class Pull(NamedTuple):
    """Effect by which the tension of a tendon [N], or the pressure of a chamber [Pa], bends the finger."""

    least: float
    most: float
    channel: Channel
    arm: float  # amplitude of the channel per tension [m], or per pressure


class _Winch(Value):
    """Keys that winches have in common."""

    REFUSALS: ClassVar[tuple[Consumer, ...]] = Consumer.refusals(
        "slack with pretension: and pretension exclude each other"
    )

    arrangement: Literal["one_pulley", "per_tendon"] = "per_tendon"
    """one_pulley: one drive winds up the first of two tendons by as much as it pays out the second; per_tendon: each
    tendon has a drive of its own."""
    pretension: Annotated[NonNegative, Unit("N"), FORCE] = 0.0
    """Tension of the straight finger while the drives are at zero [N]."""
    slack: Distance = 0.0
    """Length that a drive must wind up until its tendon is in tension on the straight finger [m]."""


class LengthDrive(_Winch):
    """A winch whose servo follows a commanded length."""

    kind: Literal["length"]
    time_constant: TimeConstant
    """Time constant T of each of two lags in series, 1/(T s + 1)^2, between the command and the servo [s]; for a
    first-order servo, half its time constant."""
    rate_max: Annotated[Positive, Field(examples=[0.1]), Unit("m/s")] | None = None
    """Greatest speed [m/s]; None: not limited."""

    @property
    def key(self) -> str:
        """Key of its commands in ``actuation``."""
        return "lengths"

    @property
    def limit(self) -> float:
        """Greatest magnitude of a command; infinite without a limit."""
        return math.inf


class MotorDrive(_Winch):
    """A motor that turns a winch."""

    REFUSALS = Consumer.refusals(
        """
        presliding_angle without coulomb_friction
        rate_gain without position_gain
        backlash without gear_stiffness
        gear_stiffness without backlash
        backlash with arrangement=per_tendon: has no effect per_tendon: a tendon loads one flank alone; see slack
        """
    )

    kind: Literal["motor"]
    winch_radius: Annotated[Extent, Field(examples=[0.008, "8 mm"])]
    """Cable wound up per angle [m]."""
    inertia: Annotated[float, Field(ge=1e-20, le=1e12, examples=[2e-6]), Unit("kg m2")]
    """Moment of inertia at the drum, with motor and gear [kg m2]: a gear ratio N multiplies the motor's N^2
    times."""
    viscous_friction: Annotated[NonNegative, Unit("N m s")] = 0.0
    """Torque at the drum per angular velocity [N m s]; a gear ratio N multiplies the motor's N^2 times."""
    coulomb_friction: Annotated[NonNegative, Unit("N m")] = 0.0
    """Dry friction at the drum [N m]; a gear ratio N multiplies the motor's N times."""
    presliding_angle: Annotated[float, Field(ge=1e-6, le=1.0, examples=[0.005]), Unit("rad")] | None = None
    """Half the angle within which dry friction changes its direction [rad]; such a drive holds a load without current,
    like a worm gear. None: friction depends on the velocity alone, and a load creeps."""
    torque_max: Annotated[Positive, Field(examples=[0.2]), Unit("N m")]
    """Greatest magnitude of the torque at the drum [N m]."""
    position_gain: Annotated[Positive, Field(examples=[2.0]), Unit("N m/rad")] | None = None
    """Torque per angle short of the commanded one [N m/rad], of a position servo: the input is then an angle. None: no
    servo."""
    rate_gain: Annotated[NonNegative, Unit("N m s/rad")] = 0.0
    """Torque of the servo against the angular velocity [N m s/rad]."""
    backlash: Annotated[NonNegative, Unit("rad")] = 0.0
    """Play of the gear, as an angle of the drum from flank to flank [rad]; of one_pulley."""
    gear_stiffness: Annotated[Positive, Field(examples=[20.0]), Unit("N m/rad")] | None = None
    """Stiffness of the gear at the drum [N m/rad]; needed for backlash, without it a part of ``series_stiffness``."""

    def unlimited(self) -> MotorDrive:
        """Return the motor with unlimited torque, so that it never saturates and holds any position."""
        return self.replaced(torque_max=GREATEST)

    @property
    def key(self) -> str:
        """Key of its commands in ``actuation``."""
        return "torques" if self.position_gain is None else "angles"

    @property
    def limit(self) -> float:
        """Greatest magnitude of a command; infinite without a limit."""
        return self.torque_max if self.position_gain is None else math.inf


WinchDrive = Annotated[LengthDrive | MotorDrive, Field(discriminator="kind")]


@dataclass(frozen=True)
class DriveLaw:
    """The winches or motors of a pair of tendons, at rest."""

    drive: LengthDrive | MotorDrive
    series: float
    """Elongation of the parts between drive and finger per tension [m/N]."""
    axial: float
    """Elongation along the finger per tension that is the same all along [m/N]."""
    onset: float
    """Half the change of length between a slack tendon and a tendon in tension [m]."""

    @property
    def pulley(self) -> bool:
        """Whether one drive winds up the one tendon by as much as it pays out the other."""
        return self.drive.arrangement == "one_pulley"

    @property
    def locks(self) -> bool:
        """Whether it holds its position by itself: a winch that follows a length, or a motor under a servo."""
        return isinstance(self.drive, LengthDrive) or self.drive.position_gain is not None

    @property
    def start(self) -> float:
        """Length of cable wound up by the drive at zero while the finger is straight [m]; zero is the start of
        tension.
        """
        return self.drive.pretension * (self.series + self.axial) - self.drive.slack

    @property
    def radius(self) -> float:
        """Cable per position [m per rad, or 1]."""
        return self.drive.winch_radius if isinstance(self.drive, MotorDrive) else 1.0

    @property
    def servo(self) -> float:
        """Cable that a position servo yields per tension [m/N], with the twist of a gear whose flank bears."""
        if not isinstance(self.drive, MotorDrive) or self.drive.position_gain is None:
            return 0.0
        gear = 0.0 if self.drive.gear_stiffness is None else 1.0 / self.drive.gear_stiffness
        return self.radius**2 * (1.0 / self.drive.position_gain + gear)

    def springs(self, pulls: Sequence[float]) -> list[float]:
        """Tension of each tendon per path drawn in while the drives hold [N/m]: ``own`` if nothing but these yields."""
        servo = self.servo if self.locks else 0.0
        return [each / (1.0 + servo * (sum(pulls) if self.pulley else each)) for each in pulls]

    @property
    def greatest(self) -> float:
        """Greatest tension, or difference of the two on a pulley, that the motor pulls up against its friction [N]."""
        if not isinstance(self.drive, MotorDrive):
            return math.inf
        return self.drive.torque_max / self.radius - self.drive.coulomb_friction / self.radius
