"""Winches and motors: states, what they wind up, and how they move.

A winch follows a commanded length by a servo of second order, critically damped, whose speed saturates; a motor turns a
drum against friction and the tensions that its tendons have:

    y' = v,      v' = (2 / t) (v_max tanh((y_cmd - y) / (2 t v_max)) - v)
    phi' = w,    J w' = torque - b w - dry friction - r (T1 - T2)

where T2 is there on a common pulley alone. What is wound up is ``start`` plus y, or plus the radius times phi; of a
second tendon on a pulley ``start`` less that. Behind a gear with play 2 b the angle d of a drum without inertia takes
the place of phi there, and no state: it is the root of k (phi - d - clip(phi - d, -b, b)) = r (T1(d) - T2(d)).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from continuum_grasp.model.memory import IN_MOTION, clipped, direction
from continuum_grasp.model.parameters import Parameters
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene.drives import LengthDrive, MotorDrive, WinchDrive
from continuum_grasp.scene.tendons import Tendon

SLOW = 0.05
"""Angular velocity below which dry friction without a memory is rounded off [rad/s]: 0.4 mm/s on a drum of 8 mm."""
SOFT = 20e-6
"""Half the length in which a tendon goes from slack to taut [m]: 0.4 N of a cable of 20 N/mm."""

_LOOSE = 1e-6
"""Share of a gear's stiffness by which the drum is where it is within the play while no tendon pulls [1]."""
_DRUM_STEPS = 3
"""Steps of Newton's method that find the drum behind a play: torques are off by 2e-6 N m in one of a thousand states
that are drawn around the corners of gear and tendons (two steps: 1e-4 N m)."""

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

    @property
    def has_play(self) -> bool:
        """Whether a gear leaves it a play."""
        return self._gear is not None

    @property
    def held_stiffness(self) -> float:
        """Torque per angle of a motor whose taut cables are held, in series with its gear [N m/rad]."""
        cables = len(self.tendons) * self.radius**2 * float(self.stiffness)
        return cables if self._gear is None else 1.0 / (1.0 / cables + 1.0 / self._gear[0])

    def of_its(self, values: Sequence[Scalar]) -> list[Scalar]:
        """Those of its tendons, of values per tendon."""
        return [values[k] for k in self.tendons]

    def names(self, number: int) -> list[str]:
        """Name and unit of each state; ``number`` counts the drives from one."""
        if isinstance(self.drive, LengthDrive):
            return [f"length_{number} [m]", f"length_{number}_rate [m/s]"]
        own = [f"motor_angle_{number} [rad]", f"motor_angle_{number}_rate [rad/s]"]
        return own + [f"motor_friction_{number} [1]"] * (self.drive.presliding_angle is not None)

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.names(1))

    @property
    def _gear(self) -> tuple[float, float] | None:
        """Stiffness [N m/rad] and half the play [rad] of a gear; None without a play."""
        drive = self.drive
        if not isinstance(drive, MotorDrive) or drive.gear_stiffness is None:
            return None
        return drive.gear_stiffness, 0.5 * drive.backlash

    def drum(self, states: Sequence[Scalar], compliances: Sequence[Scalar], paths: Sequence[Scalar]) -> Scalar:
        """Position of what winds up tendons of compliances [m/N] that the bend draws in by paths [m].

        A drum behind a play is first where it were if tendons had a sharp onset.
        """
        if self._gear is None:
            return states[0]
        (stiffness, half), drum = self._gear, self.drum_of_sharp_tendons(states, compliances, paths)
        for _ in range(_DRUM_STEPS):
            slacks = self._slacks(drum, paths)
            tensions = [soft(slack) / c for slack, c in zip(slacks, compliances, strict=True)]
            missing = stiffness * _beyond(states[0] - drum, half) - self._pull(tensions)
            drum += missing / (self._bearing(states[0] - drum) + sum(self._slopes(slacks, compliances)))
        return drum

    def drum_of_sharp_tendons(
        self, states: Sequence[Scalar], compliances: Sequence[Scalar], paths: Sequence[Scalar]
    ) -> Scalar:
        """Position of what winds up tendons that pull as soon as they are taut."""
        return states[0] if self._gear is None else self._balanced(self._gear, states[0], compliances, paths)[0]

    def drum_rate(
        self,
        states: Sequence[Scalar],
        drum: Scalar,
        compliances: Sequence[Scalar],
        paths: Sequence[Scalar],
        path_rates: Sequence[Scalar],
    ) -> Scalar:
        """Rate of what winds up, where paths change [m/s]: that of the root, by the implicit function theorem."""
        if self._gear is None:
            return states[1]
        bearing, slopes = self._bearing(states[0] - drum), self._slopes(self._slacks(drum, paths), compliances)
        drawn = zip(self.sides, slopes, path_rates, strict=True)
        turned = (1.0 / self.radius) * sum(side * slope * rate for side, slope, rate in drawn)
        return (bearing * states[1] + turned) / (bearing + sum(slopes))

    def _bearing(self, twist: Scalar) -> Scalar:
        """Stiffness of a gear where it is twisted [N m/rad]."""
        stiffness, half = self._gear or (0.0, 0.0)
        return ca.if_else(ca.fabs(twist) > half, stiffness, _LOOSE * stiffness)

    def _slacks(self, drum: Scalar, paths: Sequence[Scalar]) -> list[Scalar]:
        """Cable wound up beyond taut [m]."""
        return [y - path for y, path in zip(self.wound(drum), paths, strict=True)]

    def _slopes(self, slacks: Sequence[Scalar], compliances: Sequence[Scalar]) -> list[Scalar]:
        """Torque of each tendon per angle of the drum [N m/rad]."""
        return [self.radius**2 * soft_slope(y) / c for y, c in zip(slacks, compliances, strict=True)]

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
        angle, torque = self._balanced(self._servo, command, compliances, paths)
        return ca.if_else(ca.fabs(torque) < drive.torque_max, angle, found)

    def at(self, position: Scalar, tensions: Sequence[Scalar], command: Scalar | None) -> list[Scalar]:
        """States at rest where what winds up is, under tensions [N] and a command; None: one that leads there."""
        angle = position
        if self._gear is not None:
            (stiffness, half), torque = self._gear, self._pull(tensions)
            angle += torque / stiffness
            if command is None or getattr(self.drive, "position_gain", None) is None:
                angle += half * ca.sign(torque)
            else:
                # Between the flanks a servo is where it is commanded; otherwise it is on the flank that bears.
                angle += _within(command - position, half)
        return [angle, *[0.0] * (self.states - 1)]

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

    @property
    def inertia(self) -> Scalar:
        """Moment of inertia of a motor [kg m2]."""
        return self._own("inertia")

    def balance(
        self, states: Sequence[Scalar], command: Scalar, tensions: Sequence[Scalar], slowed: Scalar = 0.0
    ) -> Scalar:
        """Torque that turns a motor [N m], without dry friction but for what is ``slowed`` by it [N m s].

        The drum behind a play has no inertia: what the tensions exert on it the motor feels.
        """
        position, speed = states[0], states[1]
        driven = self.torque(command, position, speed) - (self._own("viscous_friction") + slowed) * speed
        return driven - self._pull(tensions)

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
        torque = self.balance(states, command, tensions, slowed)
        if drive.presliding_angle is not None:
            torque -= dry * direction(rest[0])
        found = [speed, (1.0 / self.inertia) * torque]
        if drive.presliding_angle is not None:
            found.append(IN_MOTION.rate(rest[0], (1.0 / drive.presliding_angle) * speed))
        return found

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
        wanted = self._balanced(self._servo, command, compliances, paths)[1]
        return ca.fmin(ca.fmax(wanted, -drive.torque_max), drive.torque_max)

    @property
    def _servo(self) -> tuple[float, float]:
        """Torque of a servo at rest, gear included, per angle of the drum [N m/rad], and half its play [rad]."""
        drive = self.drive
        if not isinstance(drive, MotorDrive) or drive.position_gain is None:
            raise TypeError("a drive without a servo has no gain")
        yields = 1.0 / drive.position_gain + (1.0 / drive.gear_stiffness if drive.gear_stiffness else 0.0)
        return 1.0 / yields, 0.5 * drive.backlash

    def _balanced(
        self, gear: tuple[float, float], command: Scalar, compliances: Sequence[Scalar], paths: Sequence[Scalar]
    ) -> tuple[Scalar, Scalar]:
        """Angle [rad] at which the tensions balance a torque towards a command, and that torque [N m].

        It has a gain [N m/rad] beyond half a play [rad]; within, the drum is where the tensions balance.
        """
        (gain, half), flank = gear, command
        away = -self._short(0.0, command, compliances, paths) if half else 0.0
        flank += _within(away, half)
        short = self._short(gain, flank, compliances, paths)
        if half:  # no torque in the play, nor its rounding
            short = ca.if_else(ca.fabs(away) < half, 0.0, short)
        return flank - short, gain * short

    def _short(self, gain: float, command: Scalar, compliances: Sequence[Scalar], paths: Sequence[Scalar]) -> Scalar:
        """Angle short of a command [rad] at which the tensions balance a torque of a gain [N m/rad] towards it.

        Their torque grows with the angle by straight pieces, with one tendon taut, both or none.
        """
        radius, slopes = self.radius, [self.radius**2 / c for c in compliances]
        taut_at = [side * (path - self.start) / radius for side, path in zip(self.sides, paths, strict=True)]
        pulled = [slope * (command - angle) for slope, angle in zip(slopes, taut_at, strict=True)]
        alone = [pull / (gain + slope) for pull, slope in zip(pulled, slopes, strict=True)]
        if len(alone) == 1:
            return ca.fmax(alone[0], 0.0)
        low, high = ca.fmin(*taut_at), ca.fmax(*taut_at)
        both = sum(pulled) / (gain + sum(slopes))
        # None taut: all of the torque is that towards the command; without any, the command as far as none is, nor
        # begins to be.
        edge = ca.fmin(SOFT / radius, 0.5 * (high - low))
        none = 0.0 if gain else command - ca.fmin(ca.fmax(command, low + edge), high - edge)
        short = ca.if_else(ca.SX(taut_at[0]) < taut_at[1], both, none)
        angle = command - short
        return ca.if_else(angle < low, alone[1], ca.if_else(angle > high, alone[0], short))

    def kinetic_energy(self, states: Sequence[Scalar]) -> Scalar:
        """Kinetic energy [J]."""
        return 0.5 * self.inertia * states[1] ** 2 if isinstance(self.drive, MotorDrive) else 0.0

    def gear_energy(self, states: Sequence[Scalar], drum: Scalar) -> Scalar:
        """Elastic energy of a gear [J]."""
        stiffness, half = self._gear or (0.0, 0.0)
        return 0.5 * stiffness * _beyond(states[0] - drum, half) ** 2 if stiffness else 0.0


def _within(angle: Scalar, half: float) -> Scalar:
    """An angle as far as it is within half a play to both sides [rad]."""
    return ca.fmin(ca.fmax(angle, -half), half)


def _beyond(angle: Scalar, half: float) -> Scalar:
    """What an angle is beyond it [rad]."""
    return angle - _within(angle, half)


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


def soft_slope(length: Scalar) -> Scalar:
    """Derivative of ``soft`` [1]."""
    v = clipped((1.0 / SOFT) * length)
    return (0.25 * (v + 1.0)) * ((v + 1.0) * (2.0 - v))


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
