"""Winches and motors: states, what they wind up, and how they move.

A winch follows a commanded length by a servo of second order, critically damped, whose speed saturates; a motor turns a
drum against friction and the tensions that its tendons have:

    y' = v,      v' = (2 / t) (v_max tanh((y_cmd - y) / (2 t v_max)) - v)
    phi' = w,    J w' = torque - b w - dry friction - r (T1 - T2)

where T2 is there on a common pulley alone. What is wound up is ``start`` plus y, or plus the radius times phi; of a
second tendon on a pulley ``start`` less that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.tendon_friction import clipped, direction, state_rate
from continuum_grasp.scene.drives import LengthDrive, MotorDrive
from continuum_grasp.scene.tendons import Tendon

SLOW = 0.05
"""Angular velocity below which dry friction without a memory is rounded off [rad/s]: 0.4 mm/s on a drum of 8 mm."""
SOFT = 20e-6
"""Half the length in which a tendon goes from slack to taut [m]: 0.4 N of a cable of 20 N/mm."""


@dataclass(frozen=True)
class Winch:
    """One drive, and what it winds up."""

    drive: LengthDrive | MotorDrive
    tendons: tuple[int, ...]
    start: float
    """Cable wound up of the straight finger while the drive is at zero [m], counted from where a tendon is taut."""

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
        return own + [f"motor_friction_{number} [1]"] * (self.drive.presliding_angle is not None)

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.names(1))

    def wound(self, position: Scalar) -> list[Scalar]:
        """Cable wound up of each tendon [m] at a position."""
        return [self.start + (side * self.radius) * position for side in self.sides]

    def position(self, drawn: Sequence[Scalar], tensions: Sequence[Scalar]) -> Scalar:
        """Position where cables [m] are drawn in by tensions [N]: that of the first tendon that is taut."""
        found = (drawn[0] - self.start) / self.radius
        if len(drawn) > 1:
            found = ca.if_else(ca.SX(tensions[0]) > 0.0, found, (self.start - drawn[1]) / self.radius)
        return found

    def wound_rates(self, speed: Scalar) -> list[Scalar]:
        """Rate of it [m/s]."""
        return [(side * self.radius) * speed for side in self.sides]

    def torque(self, command: Scalar) -> Scalar:
        """Torque at the drum [N m] of a motor under a command."""
        drive = self.drive
        if not isinstance(drive, MotorDrive):
            raise TypeError("a winch that follows a length has no torque")
        per_command = drive.torque_constant or 1.0
        limit = drive.torque_max / per_command
        return per_command * ca.fmin(ca.fmax(command, -limit), limit)

    def rates(self, states: Sequence[Scalar], command: Scalar, tensions: Sequence[Scalar]) -> list[Scalar]:
        """Rates of the states under a command and the tensions of its tendons [N]."""
        position, speed, *rest = states
        drive = self.drive
        if isinstance(drive, LengthDrive):
            pole = 1.0 / drive.time_constant
            wanted = (0.5 * pole) * (command - position)
            if drive.rate_max is not None:
                wanted = drive.rate_max * ca.tanh((1.0 / drive.rate_max) * wanted)
            return [speed, (2.0 * pole) * (wanted - speed)]
        torque = self.torque(command) - drive.viscous_friction * speed
        if rest:
            torque -= drive.coulomb_friction * direction(rest[0])
        elif drive.coulomb_friction > 0.0:
            torque -= drive.coulomb_friction * speed / ca.sqrt(speed * speed + SLOW**2)
        pull = sum((side * tension for side, tension in zip(self.sides, tensions, strict=True)), 0.0)
        found = [speed, (1.0 / drive.inertia) * (torque - drive.winch_radius * pull)]
        return found + [state_rate(z, (1.0 / (drive.presliding_angle or 1.0)) * speed) for z in rest]

    def tensions_at_rest(self, command: Scalar, compliances: Sequence[Scalar]) -> list[Scalar]:
        """Tensions [N] under the torque of a motor that is at rest without dry friction of its own.

        On a pulley they are (y_0 + a) / C1 and (y_0 - a) / C2, with a such that their difference balances the torque;
        where that leaves the one slack, the other bears the torque alone.
        """
        pull = self.torque(command) / self.radius
        if len(self.tendons) == 1:
            return [ca.fmax(pull, 0.0)]
        first, second = compliances
        released = ca.fmax(ca.fmax((2.0 * self.start - first * pull) / (first + second), -pull), 0.0)
        return [released + pull, released]

    def kinetic_energy(self, states: Sequence[Scalar]) -> Scalar:
        """Kinetic energy [J]."""
        return 0.5 * self.drive.inertia * states[1] ** 2 if isinstance(self.drive, MotorDrive) else 0.0


def soft(length: Scalar) -> Scalar:
    """Elongation of a tendon [m] of what is wound up beyond taut [m]: nothing below zero, and smooth."""
    v = clipped((1.0 / SOFT) * length)
    square = v * v
    unit = SOFT / 16.0
    inside = 3.0 * unit + (8.0 * unit) * v + square * (6.0 * unit - unit * square)
    return inside + ca.fmax(length - SOFT, 0.0)


def soft_integral(length: Scalar) -> Scalar:
    """Integral of ``soft`` [m2]."""
    v = clipped((1.0 / SOFT) * length)
    square = v * v
    inside = (SOFT**2 / 16.0) * (0.8 + v * (3.0 + v * (4.0 + v * (2.0 - 0.2 * square))))
    beyond = ca.fmax(length - SOFT, 0.0)
    return inside + beyond * (SOFT + 0.5 * beyond)


def winches_of(tendons: Sequence[Tendon], length: float) -> tuple[Winch, ...]:
    """The drives of tendons on a finger of a length [m]; none where tensions are commanded."""
    found: list[Winch] = []
    for k, tendon in enumerate(tendons):
        drive = tendon.drive
        if drive is None or (found and drive.arrangement == "one_pulley"):
            continue
        own = (0, 1) if drive.arrangement == "one_pulley" else (k,)
        found.append(Winch(drive, own, drive.pretension * compliance(tendon, length) - drive.slack))
    return tuple(found)


def compliance(tendon: Tendon, length: float) -> float:
    """Elongation per tension of a tendon without friction [m/N]."""
    if tendon.axial_stiffness is None or tendon.series_stiffness is None:
        raise TypeError("a tendon whose tension is commanded has no compliance")
    return 1.0 / tendon.series_stiffness + (length if tendon.to is None else tendon.to) / tendon.axial_stiffness
