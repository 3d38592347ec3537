"""Winches and motors: states, what they wind up, and how they move.

A winch follows a commanded length by a servo of second order, critically damped, whose speed saturates; a motor turns a
drum against friction and the tensions that its tendons have:

    y' = v,      v' = (2 / t) (v_max tanh((y_cmd - y) / (2 t v_max)) - v)
    phi' = w,    J w' = torque - b w - dry friction - r (T1 - T2)

where T2 is there on a common pulley alone. The wound-up length is ``start`` plus y, or plus the radius times phi; of a
second tendon on a pulley ``start`` less that. Behind a gear with play 2 b the angle d of a drum without inertia takes
the place of phi there, and no state: it is the root of k (phi - d - clip(phi - d, -b, b)) = r (T1(d) - T2(d)).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from continuum_grasp.model.cables import Cables
from continuum_grasp.model.memory import RETURN_SHARE, Memory
from continuum_grasp.model.parameters import Parameters
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import SAME, Finger, LengthDrive, MotorDrive, Tendon

_SLOW = 1.0 / 6000.0
"""Speed of the cable below which dry friction without a memory is rounded off, per the finger's length in its natural
time [1]: 0.4 mm/s of a hand's finger."""

_LOOSE = 1e-6
"""Stiffness that centers the drum within the play while no tendon pulls, per stiffness of the gear [1]."""
_DRUM_STEPS = 3
"""Steps of Newton's method that find the drum behind a play: torques are off by 2e-6 N m in one of a thousand states
that are drawn around the corners of gear and tendons (two steps: 1e-4 N m)."""
_RESTING_STEPS = 1
"""Steps of a motor at rest: torques are off by 7e-5 N m at most, where a tendon begins to pull."""


@dataclass(frozen=True)
class Winch(ABC):
    """A drive, and the cables that it winds up."""

    finger: Finger
    drive: LengthDrive | MotorDrive
    tendons: tuple[int, ...]
    start: Scalar
    """Cable wound up of the straight finger while the drive is at zero [m], counted from where a tendon pulls."""
    stiffness: Scalar
    """Tension per length wound up, of a tendon without friction [N/m]."""
    parameters: Parameters | None = None
    """Parameters, possibly with run-time arguments; None: all numbers come from the drive."""
    slack_stiffness: float = 0.0
    """Share of the stiffness that its tendons have while they are slack [1]."""

    @cached_property
    def onset(self) -> float:
        """Half the change of length of its tendons from slack to tension [m]."""
        return self.finger.onset(self.finger.tendon_list[self.tendons[0]])

    @property
    def slow(self) -> float:
        """Rate of its position below which dry friction without a memory is rounded off [rad/s]."""
        return _SLOW * self.finger.rod.length / (self.finger.rod.natural_time * self.radius)

    def _own(self, key: str) -> Scalar:
        """A number of the drive, which may be a run-time argument."""
        return _number(self.drive, key, self.parameters)

    @property
    @abstractmethod
    def radius(self) -> float:
        """Cable per position [m or 1]."""

    @property
    def sides(self) -> tuple[float, ...]:
        """Whether it winds up or pays out each tendon."""
        return (1.0, -1.0)[: len(self.tendons)]

    def of_its(self, values: Sequence[Scalar]) -> list[Scalar]:
        """The entries for the winch's tendons, of values per tendon."""
        return [values[k] for k in self.tendons]

    def cables(self, compliances: Sequence[Scalar], paths: Sequence[Scalar]) -> Cables:
        """The winch's tendons as cables, from compliances [m/N] and paths [m] per tendon."""
        return Cables(
            self.start, self.radius, self.onset, self.slack_stiffness, self.of_its(compliances), self.of_its(paths)
        )

    def wound(self, position: Scalar) -> list[Scalar]:
        """Cable wound up of each tendon [m] at a position of what winds up."""
        return [self.start + (side * self.radius) * position for side in self.sides]

    def position(self, drawn: Sequence[Scalar], tensions: Sequence[Scalar]) -> Scalar:
        """Position of what winds up where cables [m] are drawn in by tensions [N]; between them if both are slack."""
        first = (drawn[0] - self.start) / self.radius
        if len(drawn) == 1:
            return first - ca.if_else(ca.SX(tensions[0]) > 0.0, 0.0, self.onset / self.radius)
        middle, second = (drawn[0] - drawn[1]) / (2.0 * self.radius), (self.start - drawn[1]) / self.radius
        return ca.if_else(ca.SX(tensions[0]) > 0.0, first, ca.if_else(ca.SX(tensions[1]) > 0.0, second, middle))

    # -- what a drive is ----------------------------------------------------------------------------------------------

    @abstractmethod
    def names(self, number: int) -> list[str]:
        """Name and unit of each state; ``number`` counts the drives from one."""

    @property
    def states(self) -> int:
        return len(self.names(1))

    @staticmethod
    def of_finger(
        finger: Finger, parameters: Parameters | None = None, slack_stiffness: float = 0.0
    ) -> tuple[Winch, ...]:
        """The drives of a finger's tendons; none where tensions are commanded."""
        return _winches_of(finger, parameters, slack_stiffness)

    @property
    @abstractmethod
    def time_constant(self) -> float:
        """Time to reach its command while the cables are held [s]."""

    @abstractmethod
    def rates(self, states: Sequence[Scalar], command: Scalar, tensions: Sequence[Scalar]) -> list[Scalar]:
        """Rates of the states under a command and the tensions of its tendons [N]."""

    @abstractmethod
    def drum_at_rest(self, command: Scalar, cables: Cables) -> Scalar:
        """Position of what winds up, of a drive at rest under a command."""

    def given_at_rest(self, command: Scalar) -> list[Scalar]:
        """Return the tensions of its tendons at rest from the command alone [N]; None if they depend on the drum's
        angle.
        """
        return []

    def drum(self, states: Sequence[Scalar], cables: Cables, *, sharp: bool = False) -> Scalar:
        """Return the position of the drum; ``sharp``: tendons pull as soon as they are in tension."""
        return states[0]

    def drum_rate(self, states: Sequence[Scalar], drum: Scalar, cables: Cables, path_rates: Sequence[Scalar]) -> Scalar:
        """Rate of what winds up, where paths change [m/s]."""
        return states[1]

    def at(self, position: Scalar, tensions: Sequence[Scalar], command: Scalar | None) -> list[Scalar]:
        """States at rest where what winds up is, under tensions [N] and a command; None: one that leads there."""
        return [position, *[0.0] * (self.states - 1)]

    def kinetic_energy(self, states: Sequence[Scalar]) -> Scalar:
        """Kinetic energy [J]."""
        return 0.0

    def gear_energy(self, states: Sequence[Scalar], drum: Scalar) -> Scalar:
        """Elastic energy of a gear [J]."""
        return 0.0


@dataclass(frozen=True)
class LengthServo(Winch):
    """A winch that follows a commanded length, whatever the tensions."""

    drive: LengthDrive

    @property
    def radius(self) -> float:
        return 1.0

    def names(self, number: int) -> list[str]:
        return [f"length_{number} [m]", f"length_{number}_rate [m/s]"]

    @property
    def time_constant(self) -> float:
        return self.drive.time_constant

    def rates(self, states: Sequence[Scalar], command: Scalar, tensions: Sequence[Scalar]) -> list[Scalar]:
        pole, (position, speed), greatest_rate = 1.0 / self._own("time_constant"), states, self.drive.rate_max
        wanted = (0.5 * pole) * (command - position)
        if greatest_rate is not None:
            wanted = greatest_rate * tanh((1.0 / greatest_rate) * wanted)
        return [speed, (2.0 * pole) * (wanted - speed)]

    def drum_at_rest(self, command: Scalar, cables: Cables) -> Scalar:
        return command


@dataclass(frozen=True)
class _Spring:
    """Torque that turns a drum: a torque towards an angle from beyond a play on, up to a greatest one; or a torque
    alone.
    """

    angle: Scalar
    stiffness: float = 0.0  # [N m/rad]; 0: the torque alone
    half: float = 0.0  # of the play [rad]
    most: float = math.inf  # [N m]
    torque: Scalar = 0.0  # [N m]

    def pull(self, drum: Scalar) -> Scalar:
        """Torque on the drum [N m]."""
        if not self.stiffness:
            return self.torque
        return self._limited(self.stiffness * _beyond(self.angle - drum, self.half))

    def _limited(self, torque: Scalar) -> Scalar:
        return torque if math.isinf(self.most) else ca.fmin(ca.fmax(torque, -self.most), self.most)

    def bearing(self, drum: Scalar) -> Scalar:
        """Return the stiffness of the twisted gear [N m/rad]."""
        twist = ca.fabs(self.angle - drum)
        if math.isinf(self.most):
            return ca.if_else(twist > self.half, self.stiffness, _LOOSE * self.stiffness)
        bears = twist < self.half + self.most / self.stiffness
        if self.half:
            bears = ca.logic_and(bears, twist > self.half)
        return ca.if_else(bears, self.stiffness, _LOOSE * self.stiffness)

    def meets(self, cables: Cables) -> Scalar:
        """Return the drum angle [rad] that balances its tendons if each one pulls without slack."""
        if not self.stiffness:
            return cables.under(self.torque)
        flank = self.angle
        if self.half:
            away = cables.towards(0.0, self.angle) - self.angle
            flank += _within(away, self.half)
        drum = cables.towards(self.stiffness, flank)
        if self.half:  # no torque in the play, nor its rounding
            drum = ca.if_else(ca.fabs(away) < self.half, flank, drum)
        if math.isinf(self.most):
            return drum
        torque = self.stiffness * (flank - drum)
        return ca.if_else(ca.fabs(torque) < self.most, drum, cables.under(self.most * ca.sign(torque)))


@dataclass(frozen=True)
class Motor(Winch):
    """A motor that turns a drum, with or without a gear that has a play."""

    drive: MotorDrive

    @property
    def radius(self) -> float:
        return self.drive.winch_radius

    def names(self, number: int) -> list[str]:
        names = [f"motor_angle_{number} [rad]", f"motor_angle_{number}_rate [rad/s]"]
        return names + [f"motor_friction_{number} [1]"] * (self.drive.presliding_angle is not None)

    @property
    def gear(self) -> tuple[float, float] | None:
        """Stiffness [N m/rad] and half the play [rad] of a gear; None without a play."""
        stiffness = self.drive.gear_stiffness
        return None if stiffness is None else (stiffness, 0.5 * self.drive.backlash)

    @property
    def held_stiffness(self) -> float:
        """Torque per angle of a motor whose cables in tension are held, in series with its gear [N m/rad]."""
        cables = len(self.tendons) * self.radius**2 * float(self.stiffness)
        return cables if self.gear is None else 1.0 / (1.0 / cables + 1.0 / self.gear[0])

    @property
    def time_constant(self) -> float:
        return math.sqrt(self.drive.inertia / ((self.drive.position_gain or 0.0) + self.held_stiffness))

    @property
    def inertia(self) -> Scalar:
        """Moment of inertia [kg m2]."""
        return self._own("inertia")

    # -- torques ------------------------------------------------------------------------------------------------------

    def torque(self, command: Scalar, angle: Scalar = 0.0, rate: Scalar = 0.0) -> Scalar:
        """Return the torque at the drum under a command, from its angle and its rate [N m]."""
        drive = self.drive
        if drive.position_gain is not None:
            wanted = drive.position_gain * (command - angle) - drive.rate_gain * rate
        else:
            wanted = command
        return ca.fmin(ca.fmax(wanted, -drive.torque_max), drive.torque_max)

    def balance(
        self, states: Sequence[Scalar], command: Scalar, tensions: Sequence[Scalar], slowed: Scalar = 0.0
    ) -> Scalar:
        """Return the driving torque [N m], without dry friction except for the part ``slowed`` by it [N m s].

        The drum behind a play has no inertia, so the torque of the tensions acts on the motor.
        """
        position, speed = states[0], states[1]
        driven = self.torque(command, position, speed) - (self._own("viscous_friction") + slowed) * speed
        return driven - self._pull(tensions)

    def rates(self, states: Sequence[Scalar], command: Scalar, tensions: Sequence[Scalar]) -> list[Scalar]:
        drive, (_, speed, *rest) = self.drive, states
        dry: Scalar = self._own("coulomb_friction")
        slowed: Scalar = 0.0
        if drive.presliding_angle is None and (not isinstance(dry, float) or dry > 0.0):
            slowed = dry / ca.sqrt(speed * speed + self.slow**2)
        torque = self.balance(states, command, tensions, slowed)
        if drive.presliding_angle is not None:
            torque -= dry * Memory.direction(rest[0])
        rates = [speed, (1.0 / self.inertia) * torque]
        if drive.presliding_angle is not None:
            memory = Memory(RETURN_SHARE * self.finger.rod.natural_time)
            rates.append(memory.rate(rest[0], (1.0 / drive.presliding_angle) * speed))
        return rates

    def holding(
        self, states: Sequence[float], tensions: Sequence[float], friction: float | None = None
    ) -> tuple[float, float]:
        """Return the least and greatest command at which dry friction holds a motor at rest [N m].

        ``friction`` is by default the drive's.
        """
        drive = self.drive
        pull, limit = float(self._pull(tensions)), drive.torque_max
        dry = drive.coulomb_friction if friction is None else friction
        least, greatest = pull - dry, pull + dry
        # Without friction a motor that gives all its torque balances all of it: rounding must not be too much.
        if least > limit * (1.0 + SAME) or greatest < -limit * (1.0 + SAME):
            return math.nan, math.nan
        if drive.position_gain is None:
            return max(least, -limit), min(greatest, limit)
        angle = float(states[0])
        return (
            angle + least / drive.position_gain if least > -limit else -math.inf,
            angle + greatest / drive.position_gain if greatest < limit else math.inf,
        )

    def _pull(self, tensions: Sequence[Scalar]) -> Scalar:
        """Torque of the tensions on the drum [N m]."""
        return self.radius * sum((side * tension for side, tension in zip(self.sides, tensions, strict=True)), 0.0)

    # -- the drum, which has no inertia of its own --------------------------------------------------------------------

    def drum(self, states: Sequence[Scalar], cables: Cables, *, sharp: bool = False) -> Scalar:
        if self.gear is None:
            return states[0]
        return self._balanced(_Spring(states[0], *self.gear), cables, 0 if sharp else _DRUM_STEPS)

    def drum_at_rest(self, command: Scalar, cables: Cables) -> Scalar:
        drive = self.drive
        if drive.position_gain is None:
            for pull in self.given_at_rest(command):
                return self._balanced(_Spring(0.0, torque=self.radius * pull), cables, _DRUM_STEPS)
            return self._balanced(_Spring(0.0, torque=self.torque(command)), cables, _RESTING_STEPS)
        # A servo is a spring, and a gear one in series with it.
        stiffness, half = self.gear or (math.inf, 0.0)
        servo = 1.0 / (1.0 / drive.position_gain + 1.0 / stiffness)
        return self._balanced(_Spring(command, servo, half, drive.torque_max), cables, _RESTING_STEPS)

    def given_at_rest(self, command: Scalar) -> list[Scalar]:
        if self.drive.position_gain is not None or len(self.tendons) > 1:
            return []
        # A cable pulls: a torque the other way has nothing to balance it.
        return [ca.fmax(self.torque(command), 0.0) / self.radius]

    def _balanced(self, spring: _Spring, cables: Cables, steps: int) -> Scalar:
        """Return the angle of the drum at which the tensions balance its torque [rad].

        The first guess assumes a sharp onset of the tensions.
        """
        drum = spring.meets(cables)
        loose = 0.0 if spring.stiffness else _LOOSE * self.radius**2 * self.stiffness
        for _ in range(steps):
            slacks = cables.slacks(drum)
            missing = spring.pull(drum) - self._pull(cables.tensions(slacks))
            drum += missing / (spring.bearing(drum) + loose + sum(cables.slopes(slacks)))
        return drum

    def drum_rate(self, states: Sequence[Scalar], drum: Scalar, cables: Cables, path_rates: Sequence[Scalar]) -> Scalar:
        if self.gear is None:
            return states[1]
        # That of the root, by the implicit function theorem.
        bearing = _Spring(states[0], *self.gear).bearing(drum)
        slopes = cables.slopes(cables.slacks(drum))
        drawn = zip(self.sides, slopes, path_rates, strict=True)
        turned = (1.0 / self.radius) * sum(side * slope * rate for side, slope, rate in drawn)
        return (bearing * states[1] + turned) / (bearing + sum(slopes))

    # -- at rest, and energies ----------------------------------------------------------------------------------------

    def at(self, position: Scalar, tensions: Sequence[Scalar], command: Scalar | None) -> list[Scalar]:
        angle = position
        if self.gear is not None:
            (stiffness, half), torque = self.gear, self._pull(tensions)
            angle += torque / stiffness
            if command is None or self.drive.position_gain is None:
                angle += half * ca.sign(torque)
            else:
                # Between the flanks, a servo is at its command; otherwise it is on the loaded flank.
                angle += _within(command - position, half)
        return super().at(angle, tensions, command)

    def kinetic_energy(self, states: Sequence[Scalar]) -> Scalar:
        return 0.5 * self.inertia * states[1] ** 2

    def gear_energy(self, states: Sequence[Scalar], drum: Scalar) -> Scalar:
        if self.gear is None:
            return 0.0
        stiffness, half = self.gear
        return 0.5 * stiffness * _beyond(states[0] - drum, half) ** 2


def _within(angle: Scalar, half: float) -> Scalar:
    """Limit an angle to half the play on both sides [rad]."""
    return ca.fmin(ca.fmax(angle, -half), half)


def _beyond(angle: Scalar, half: float) -> Scalar:
    """Part of an angle that is beyond the play [rad]."""
    return angle - _within(angle, half)


def tanh(x: Scalar) -> Scalar:
    """Hyperbolic tangent, of functions that strict C has; beyond 20 it is one to the last bit."""
    return 1.0 - 2.0 / (1.0 + ca.exp(2.0 * ca.fmin(ca.fmax(x, -20.0), 20.0)))


def _winches_of(finger: Finger, parameters: Parameters | None, slack_stiffness: float) -> tuple[Winch, ...]:
    winches: list[Winch] = []
    for k, tendon in enumerate(finger.tendon_list):
        drive = tendon.drive
        if drive is None or (winches and drive.arrangement == "one_pulley"):
            continue
        indices = (0, 1) if drive.arrangement == "one_pulley" else (k,)
        tendon_compliance = compliance(tendon, finger.rod.length, parameters)
        start = _number(drive, "pretension", parameters) * tendon_compliance - _number(drive, "slack", parameters)
        numbers = indices, start, 1.0 / tendon_compliance, parameters, slack_stiffness
        if isinstance(drive, MotorDrive):
            winches.append(Motor(finger, drive, *numbers))
        else:
            winches.append(LengthServo(finger, drive, *numbers))
    return tuple(winches)


def _number(drive: LengthDrive | MotorDrive, key: str, parameters: Parameters | None) -> Scalar:
    name = f"drive_{key}"
    return parameters[name] if parameters and parameters.is_runtime(name) else float(getattr(drive, key))


def stiffnesses(tendon: Tendon, parameters: Parameters | None = None) -> tuple[Scalar, Scalar]:
    """Stiffnesses of a tendon whose tension is not commanded: along the finger [N], and in series [N/m]."""
    stiffness_pair: list[Scalar] = []
    for key, stated in (("axial", tendon.axial_stiffness), ("series", tendon.series_stiffness)):
        if stated is None:
            raise TypeError("a tendon whose tension is commanded has no stiffness")
        name = f"tendon_{key}_stiffness"
        stiffness_pair.append(parameters[name] if parameters and parameters.is_runtime(name) else stated)
    return stiffness_pair[0], stiffness_pair[1]


def compliance(tendon: Tendon, length: float, parameters: Parameters | None = None) -> Scalar:
    """Elongation per tension of a tendon without friction [m/N]."""
    axial, series = stiffnesses(tendon, parameters)
    return 1.0 / series + (length if tendon.to is None else tendon.to) / axial
