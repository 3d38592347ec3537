"""Winches and motors: states, what they wind up, and how they move.

A winch follows a commanded length by a servo of second order, critically damped, whose speed saturates; a motor turns a
drum against friction and the tensions that its tendons have:

    y' = v,      v' = (2 / t) (v_max tanh((y_cmd - y) / (2 t v_max)) - v)
    phi' = w,    J w' = torque - b w - dry friction - r (T1 - T2)

where T2 is there on a common pulley alone. What is wound up is ``start`` plus y, or plus the radius times phi; of a
second tendon on a pulley ``start`` less that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from continuum_grasp.model.parameters import Parameters
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.tendon_friction import RETURN_TIME, clipped, direction, state_rate
from continuum_grasp.scene.drives import LengthDrive, MotorDrive, WinchDrive
from continuum_grasp.scene.tendons import Tendon

SLOW = 0.05
"""Angular velocity below which dry friction without a memory is rounded off [rad/s]: 0.4 mm/s on a drum of 8 mm."""
SOFT = 20e-6
"""Half the length in which a tendon goes from slack to taut [m]: 0.4 N of a cable of 20 N/mm."""

_ROUNDING = 1e-9
"""Relative error of a torque at rest that is none [1]: above that of an equilibrium's residual."""


@dataclass(frozen=True)
class Winch:
    """One drive, and what it winds up."""

    drive: LengthDrive | MotorDrive
    tendons: tuple[int, ...]
    start: Scalar
    """Cable wound up of the straight finger while the drive is at zero [m], counted from where a tendon is taut."""
    stiffness: Scalar
    """Tension per length wound up, of a tendon without friction [N/m]."""
    parameters: Parameters | None = None
    """Of which some may be run-time arguments; None: all numbers are those of the drive."""

    def _own(self, key: str) -> Scalar:
        """A number of the drive, which may be a run-time argument."""
        return _number(self.drive, key, self.parameters)

    @property
    def radius(self) -> float:
        """Cable per position [m or 1]."""
        return self.drive.winch_radius if isinstance(self.drive, MotorDrive) else 1.0

    @property
    def follows(self) -> bool:
        """Whether it goes where it is commanded, whatever the tensions."""
        return isinstance(self.drive, LengthDrive)

    @property
    def sides(self) -> tuple[float, ...]:
        """Whether it winds up or pays out each tendon."""
        return (1.0, -1.0)[: len(self.tendons)]

    def names(self, number: int) -> list[str]:
        """Name and unit of each state; ``number`` counts the drives from one."""
        if isinstance(self.drive, LengthDrive):
            return [f"length_{number} [m]", f"length_{number}_rate [m/s]"]
        own = [f"motor_angle_{number} [rad]", f"motor_angle_{number}_rate [rad/s]"]
        own += [f"motor_friction_{number} [1]"] * (self.drive.presliding_angle is not None)
        return own + [f"drum_angle_{number} [rad]"] * self.has_backlash

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.names(1))

    @property
    def has_backlash(self) -> bool:
        """Whether the drum has an angle of its own, its last state."""
        return isinstance(self.drive, MotorDrive) and self.drive.backlash > 0.0

    def drum(self, states: Sequence[Scalar]) -> Scalar:
        """Position of what winds up."""
        return states[-1] if self.has_backlash else states[0]

    def wound(self, position: Scalar) -> list[Scalar]:
        """Cable wound up of each tendon [m] at a position of what winds up."""
        return [self.start + (side * self.radius) * position for side in self.sides]

    def position(self, drawn: Sequence[Scalar], tensions: Sequence[Scalar]) -> Scalar:
        """Position of what winds up where cables [m] are drawn in by tensions [N]; between them if both are slack."""
        first = (drawn[0] - self.start) / self.radius
        if len(drawn) == 1:
            return first - ca.if_else(ca.SX(tensions[0]) > 0.0, 0.0, SOFT / self.radius)
        middle, second = (drawn[0] - drawn[1]) / (2.0 * self.radius), (self.start - drawn[1]) / self.radius
        return ca.if_else(ca.SX(tensions[0]) > 0.0, first, ca.if_else(ca.SX(tensions[1]) > 0.0, second, middle))

    def position_at_rest(
        self, command: Scalar, drawn: Sequence[Scalar], tensions: Sequence[Scalar], compliances: Sequence[Scalar]
    ) -> Scalar:
        """Position of what winds up under a command, of tendons whose paths and elongation [m] draw cable in."""
        if self.follows:
            return command
        found, drive = self.position(drawn, tensions), self.drive
        if not isinstance(drive, MotorDrive) or drive.position_gain is None:
            return found
        paths = [y - c * tension for y, c, tension in zip(drawn, compliances, tensions, strict=True)]
        angle = self._servo_at_rest(command, compliances, paths)
        return ca.if_else(ca.fabs(self._servo_torque(command, angle)) < drive.torque_max, angle, found)

    def at(self, position: Scalar, tensions: Sequence[Scalar], command: Scalar) -> list[Scalar]:
        """States at rest where what winds up is, under tensions [N] and a command."""
        found: list[Scalar] = [position, *[0.0] * (self.states - 1)]
        if self.has_backlash and isinstance(self.drive, MotorDrive):
            torque, half = self._pull(tensions), 0.5 * self.drive.backlash
            found[-1] = position
            ahead = torque / (self.drive.gear_stiffness or 1.0)
            if self.drive.position_gain is None:
                found[0] += ahead + half * ca.sign(torque)
            else:
                # Between the flanks a servo is where it is commanded; otherwise it is on the flank that bears.
                found[0] += ahead + ca.fmin(ca.fmax(command - position, -half), half)
        return found

    def holding(
        self, states: Sequence[float], tensions: Sequence[float], friction: float | None = None
    ) -> tuple[float, float]:
        """Least and greatest command under which a motor at rest stays where it is by its dry friction [N m].

        ``friction`` is that of the drive where not given.
        """
        drive = self.drive
        if not isinstance(drive, MotorDrive):
            raise TypeError("a winch that follows a length is where it is commanded")
        pull, most = float(self._pull(tensions)), drive.torque_max
        dry = drive.coulomb_friction if friction is None else friction
        least, greatest = pull - dry, pull + dry
        # Without friction a motor that gives all its torque balances all of it: rounding must not be too much.
        if least > most * (1.0 + _ROUNDING) or greatest < -most * (1.0 + _ROUNDING):
            return math.nan, math.nan
        if drive.position_gain is None:
            scale = drive.torque_constant or 1.0
            return max(least, -most) / scale, min(greatest, most) / scale
        angle = float(states[0])
        return (
            angle + least / drive.position_gain if least > -most else -math.inf,
            angle + greatest / drive.position_gain if greatest < most else math.inf,
        )

    def wound_rates(self, speed: Scalar) -> list[Scalar]:
        """Rate of it [m/s]."""
        return [(side * self.radius) * speed for side in self.sides]

    def torque(self, command: Scalar, angle: Scalar = 0.0, rate: Scalar = 0.0) -> Scalar:
        """Torque at the drum [N m] of a motor under a command, where it is and how it turns."""
        drive = self.drive
        if not isinstance(drive, MotorDrive):
            raise TypeError("a winch that follows a length has no torque")
        if drive.position_gain is not None:
            wanted = drive.position_gain * (command - angle) - drive.rate_gain * rate
        else:
            wanted = command if drive.torque_constant is None else drive.torque_constant * command
        return ca.fmin(ca.fmax(wanted, -drive.torque_max), drive.torque_max)

    def _pull(self, tensions: Sequence[Scalar]) -> Scalar:
        """Torque of the tensions on the drum [N m]."""
        return self.radius * sum((side * tension for side, tension in zip(self.sides, tensions, strict=True)), 0.0)

    def _of_gear(self, states: Sequence[Scalar]) -> Scalar:
        """Torque of a gear with play on the drum [N m]."""
        drive, twist = self.drive, states[0] - states[-1]
        if not isinstance(drive, MotorDrive) or drive.gear_stiffness is None:
            raise TypeError("a drive without backlash has no gear")
        half = 0.5 * drive.backlash
        return drive.gear_stiffness * (twist - ca.fmin(ca.fmax(twist, -half), half))

    def drum_rate(self, states: Sequence[Scalar], tensions: Sequence[Scalar]) -> Scalar:
        """Rate of what winds up: a drum without inertia settles between gear and tendons as a friction state does."""
        if not self.has_backlash or not isinstance(self.drive, MotorDrive):
            return states[1]
        stiff = (self.drive.gear_stiffness or 0.0) + 2.0 * self.radius**2 * self.stiffness
        return (1.0 / (RETURN_TIME * stiff)) * (self._of_gear(states) - self._pull(tensions))

    @property
    def inertias(self) -> list[Scalar]:
        """Inertia of a motor, and none of a drum behind the play of its gear [kg m2]; a winch that follows has none."""
        return [self._own("inertia"), *[0.0] * self.has_backlash] if isinstance(self.drive, MotorDrive) else []

    def turning(self, states: Sequence[Scalar]) -> list[Scalar]:
        """Angles that have these inertias."""
        return [states[0], *[states[-1]] * self.has_backlash] if isinstance(self.drive, MotorDrive) else []

    def balance(
        self, states: Sequence[Scalar], command: Scalar, tensions: Sequence[Scalar], slowed: Scalar = 0.0
    ) -> list[Scalar]:
        """Torques that turn them [N m], without dry friction but for what is ``slowed`` by it [N m s]."""
        if not isinstance(self.drive, MotorDrive):
            return []
        position, speed, pull = states[0], states[1], self._pull(tensions)
        driven = self.torque(command, position, speed) - (self._own("viscous_friction") + slowed) * speed
        gear = self._of_gear(states) if self.has_backlash else pull
        return [driven - gear, *[gear - pull] * self.has_backlash]

    def rates(self, states: Sequence[Scalar], command: Scalar, tensions: Sequence[Scalar]) -> list[Scalar]:
        """Rates of the states under a command and the tensions of its tendons [N]."""
        drive, (position, speed, *rest) = self.drive, states
        if isinstance(drive, LengthDrive):
            pole = 1.0 / self._own("time_constant")
            wanted = (0.5 * pole) * (command - position)
            if drive.rate_max is not None:
                wanted = drive.rate_max * tanh((1.0 / drive.rate_max) * wanted)
            return [speed, (2.0 * pole) * (wanted - speed)]
        dry: Scalar = self._own("coulomb_friction")
        slowed: Scalar = 0.0
        if drive.presliding_angle is None and (not isinstance(dry, float) or dry > 0.0):
            slowed = dry / ca.sqrt(speed * speed + SLOW**2)
        torque = self.balance(states, command, tensions, slowed)[0]
        if drive.presliding_angle is not None:
            torque -= dry * direction(rest[0])
        found = [speed, (1.0 / self._own("inertia")) * torque]
        if drive.presliding_angle is not None:
            found.append(state_rate(rest[0], (1.0 / drive.presliding_angle) * speed))
        return found + [self.drum_rate(states, tensions)] * self.has_backlash

    def tensions_at_rest(self, command: Scalar, compliances: Sequence[Scalar], paths: Sequence[Scalar]) -> list[Scalar]:
        """Tensions [N] under a motor that is at rest without dry friction of its own, of tendons drawn in by paths [m].

        On a pulley they are (y_0 + a) / C1 and (y_0 - a) / C2, with a such that their difference balances the torque;
        where that leaves the one slack, the other bears the torque alone.
        """
        pull = self._torque_at_rest(command, compliances, paths) / self.radius
        if len(self.tendons) == 1:
            return [ca.fmax(pull, 0.0)]
        first, second = compliances
        released = ca.fmax(ca.fmax((2.0 * self.start - first * pull) / (first + second), -pull), 0.0)
        return [released + pull, released]

    def _torque_at_rest(self, command: Scalar, compliances: Sequence[Scalar], paths: Sequence[Scalar]) -> Scalar:
        """Torque of a motor at rest [N m]."""
        drive = self.drive
        if not isinstance(drive, MotorDrive) or drive.position_gain is None:
            return self.torque(command)
        wanted = self._servo_torque(command, self._servo_at_rest(command, compliances, paths))
        return ca.fmin(ca.fmax(wanted, -drive.torque_max), drive.torque_max)

    def _servo_torque(self, command: Scalar, angle: Scalar) -> Scalar:
        """Torque of a servo without bounds [N m] at rest where its drum is: servo and gear, one behind the other."""
        gain, half = self._servo
        away = command - angle
        return gain * (away - (ca.fmin(ca.fmax(away, -half), half) if half else 0.0))

    @property
    def _servo(self) -> tuple[float, float]:
        """Torque of a servo at rest per angle of the drum [N m/rad], and half its play [rad]."""
        drive = self.drive
        if not isinstance(drive, MotorDrive) or drive.position_gain is None:
            raise TypeError("a drive without a servo has no gain")
        yields = 1.0 / drive.position_gain + (1.0 / drive.gear_stiffness if drive.gear_stiffness else 0.0)
        return 1.0 / yields, 0.5 * drive.backlash

    def _servo_at_rest(self, command: Scalar, compliances: Sequence[Scalar], paths: Sequence[Scalar]) -> Scalar:
        """Angle of the drum of a motor under a position servo of boundless torque [rad].

        In a play the drum is where the tensions balance, as far as the flanks let it.
        """
        gain, half = self._servo
        if not half:
            return self._balanced(gain, command, compliances, paths)
        low, high = (self._balanced(gain, command + side * half, compliances, paths) for side in (-1.0, 1.0))
        return ca.fmin(ca.fmax(self._balanced(0.0, command, compliances, paths), low), high)

    def _balanced(self, gain: float, command: Scalar, compliances: Sequence[Scalar], paths: Sequence[Scalar]) -> Scalar:
        """Angle [rad] at which the tensions balance a torque of a gain [N m/rad] towards a command.

        Their torque grows with the angle by straight pieces, with one tendon taut, both or none.
        """
        radius, slopes = self.radius, [self.radius**2 / c for c in compliances]
        turns = [(path - self.start) / radius for path in paths]  # at which each is just taut
        first = (gain * command + slopes[0] * turns[0]) / (gain + slopes[0])
        if len(turns) == 1:
            return ca.fmin(command, first)
        low, high = ca.fmin(turns[0], -turns[1]), ca.fmax(turns[0], -turns[1])
        second = (gain * command - slopes[1] * turns[1]) / (gain + slopes[1])
        pulled = gain * command + slopes[0] * turns[0] - slopes[1] * turns[1]
        taut = pulled / (gain + slopes[0] + slopes[1])
        # None taut: all of the torque is that towards the command; without any, the command as far as none is.
        none = command if gain else ca.fmin(ca.fmax(command, low), high)
        between = ca.if_else(ca.SX(turns[0]) < -turns[1], taut, none)
        return ca.if_else(between < low, second, ca.if_else(between > high, first, between))

    def kinetic_energy(self, states: Sequence[Scalar]) -> Scalar:
        """Kinetic energy [J]."""
        return 0.5 * self._own("inertia") * states[1] ** 2 if isinstance(self.drive, MotorDrive) else 0.0


def tanh(x: Scalar) -> Scalar:
    """Hyperbolic tangent, of functions that strict C has; beyond 20 it is one to the last bit."""
    return 1.0 - 2.0 / (1.0 + ca.exp(2.0 * ca.fmin(ca.fmax(x, -20.0), 20.0)))


def soft(length: Scalar) -> Scalar:
    """Elongation of a tendon [m] of what is wound up beyond taut [m]: nothing below zero, and smooth."""
    # Half beyond the range of the softness, and within it w (v + 1)^3 (3 - v) / 16 of v = length / w.
    above = ca.fmax(length + SOFT, 0.0)
    within = ca.fmin(above, 2.0 * SOFT)
    unit = 1.0 / (16.0 * SOFT**3)
    return above - within + (within * within) * (within * (4.0 * SOFT * unit - unit * within))


def soft_integral(length: Scalar) -> Scalar:
    """Integral of ``soft`` [m2]."""
    v = clipped((1.0 / SOFT) * length)
    square = v * v
    inside = (SOFT**2 / 16.0) * (0.8 + v * (3.0 + v * (4.0 + v * (2.0 - 0.2 * square))))
    beyond = ca.fmax(length - SOFT, 0.0)
    return inside + beyond * (SOFT + 0.5 * beyond)


def winches_of(tendons: Sequence[Tendon], length: float, parameters: Parameters | None = None) -> tuple[Winch, ...]:
    """The drives of tendons on a finger of a length [m]; none where tensions are commanded."""
    found: list[Winch] = []
    for k, tendon in enumerate(tendons):
        drive = tendon.drive
        if drive is None or (found and drive.arrangement == "one_pulley"):
            continue
        own = (0, 1) if drive.arrangement == "one_pulley" else (k,)
        given = compliance(tendon, length, parameters)
        start = _number(drive, "pretension", parameters) * given - _number(drive, "slack", parameters)
        found.append(Winch(drive, own, start, 1.0 / given, parameters))
    return tuple(found)


def _number(drive: WinchDrive, key: str, parameters: Parameters | None) -> Scalar:
    name = f"drive_{key}"
    return parameters[name] if parameters and parameters.is_runtime(name) else float(getattr(drive, key))


def stiffnesses(tendon: Tendon, parameters: Parameters | None = None) -> tuple[Scalar, Scalar]:
    """Those of a tendon whose tension is not commanded: along the finger [N], and in series [N/m]."""
    found: list[Scalar] = []
    for key, stated in (("axial", tendon.axial_stiffness), ("series", tendon.series_stiffness)):
        if stated is None:
            raise TypeError("a tendon whose tension is commanded has no stiffness")
        name = f"tendon_{key}_stiffness"
        found.append(parameters[name] if parameters and parameters.is_runtime(name) else stated)
    return found[0], found[1]


def compliance(tendon: Tendon, length: float, parameters: Parameters | None = None) -> Scalar:
    """Elongation per tension of a tendon without friction [m/N]."""
    axial, series = stiffnesses(tendon, parameters)
    return 1.0 / series + (length if tendon.to is None else tendon.to) / axial
