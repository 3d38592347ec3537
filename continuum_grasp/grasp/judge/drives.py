"""Cables that winches and motors wind up, by the shape of a finger: what a drive holds, and whether tensions obey it.

A tendon grows longer by C T from where it is just in tension on; the cable wound up is its path along the bent finger
and this elongation. C is the compliance of the cable before the finger and of the cable along it, which counts by the
share of the tension that friction leaves on average.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.judge.check import EXACT, FOLLOWED, Check, Requirement
from continuum_grasp.grasp.judge.space_rod import SpaceRod
from continuum_grasp.scene import DriveLaw, FingerSetup, MotorDrive

_SIGNS = np.array([1.0, -1.0])
"""The bend draws in the left tendon as far as it pays out the right one; a pulley winds them up so."""


LEAST_PULL = 1e-6
"""Tension above which a tendon counts as in tension, per greatest tension."""


@dataclass(frozen=True)
class DriveState:
    """State of a drive.

    Attributes
    ----------
    tendons : tuple of str
        Those that it winds up, ``left`` (the -X side) or ``right``.
    position : float
        Cable wound up since zero [m], or for motors the angle of the motor [rad].
    torque : float
        Holds the tensions without friction of the motor [N m]; NaN for winches that follow a length.
    torque_to_reach : float
        Greatest magnitude while the grasp is reached, the motor's dry friction included [N m].
    command : float
        Input of the drive [m, rad or N m].
    """

    tendons: tuple[str, ...]
    position: float
    torque: float
    torque_to_reach: float
    command: float


def soft(length: Array, onset: float) -> Array:
    """Elongation [m] of tendons with so much cable [m] wound up beyond slack; rounded off within an onset [m]."""
    v = np.clip(length / onset, -1.0, 1.0)
    # The integral of 3 (1 - v^2) / 4 twice: no elongation below -1, the whole length above 1.
    return np.asarray(onset * (3.0 + 8.0 * v + 6.0 * v**2 - v**4) / 16.0 + np.maximum(length - onset, 0.0))


class WoundCables:
    """The two cables of a finger by its shape."""

    def __init__(self, setup: FingerSetup, law: DriveLaw, rod: SpaceRod, tensions: Array) -> None:
        self.law, self._tensions, self._most = law, tensions, setup.tendons.max_tension
        drawn, means = rod.cables()
        self.paths = setup.tendons.offset * drawn * _SIGNS
        self.elongations = (law.series + law.axial * means) * tensions

    @property
    def held(self) -> Array:
        """Quantities that the drives hold: commands [m] of those that lock, else tensions or their difference [N]."""
        law, left_more = self.law, float(self._tensions @ _SIGNS)
        if not law.locks:
            return np.array([left_more]) if law.pulley else self._tensions
        if law.pulley:
            return np.array([self._by_pulley + law.servo * left_more])
        return self._wound + law.servo * self._tensions

    @property
    def _wound(self) -> Array:
        """Cable wound up (2,) of drives of their own [m]: a tendon that does not pull is let out until it is slack."""
        slack = self.law.onset / (1.0 + (self.elongations / self.law.onset) ** 4)
        return np.asarray(self.paths + self.elongations - slack - self.law.start)

    @property
    def _by_pulley(self) -> float:
        """Cable that a pulley winds up of the left tendon [m], by the one that pulls more."""
        k = int(np.argmax(self._tensions))
        return float(_SIGNS[k] * (self._beyond(k) + self.paths[k] - self.law.start))

    def _beyond(self, tendon: int) -> float:
        """Cable that is wound up beyond slack [m]."""
        onset, elongation = self.law.onset, float(self.elongations[tendon])
        return float(brentq(lambda x: float(soft(np.array(x), onset)) - elongation, -onset, elongation + onset))

    @property
    def states(self) -> tuple[DriveState, ...]:
        """States of the drives, one of each tendon or one of both."""
        least = LEAST_PULL * self._most
        pulls = np.where(self._tensions > least, self._tensions, 0.0)
        if self.law.pulley:
            return (self._state(("left", "right"), self._by_pulley, float(pulls @ _SIGNS)),)
        # A slack tendon is wound up as far as would make it just in tension.
        beyond = [self._beyond(k) if pull else 0.0 for k, pull in enumerate(pulls.tolist())]
        wound = (self.paths + beyond - self.law.start).tolist()
        each = zip(("left", "right"), wound, pulls.tolist(), strict=True)
        return tuple(self._state((name,), cable, pull) for name, cable, pull in each)

    def _state(self, tendons: tuple[str, ...], wound: float, pull: float) -> DriveState:
        law, drive = self.law, self.law.drive
        if not isinstance(drive, MotorDrive):
            return DriveState(tendons, wound, np.nan, np.nan, wound)
        position, torque = wound / law.radius, pull * law.radius
        if drive.gear_stiffness is not None:
            # The motor is ahead of the drum by the twist of the gear and its play.
            position += torque / drive.gear_stiffness + 0.5 * drive.backlash * float(np.sign(torque))
        command = torque if drive.position_gain is None else position + torque / drive.position_gain
        return DriveState(tendons, position, torque, abs(torque) + drive.coulomb_friction, command)

    def misfit(self, held: Array) -> Array:
        """Differences of elongations (2,) from the ones of drives that hold ``held``, and of a load on a pulley [m]."""
        law, left_more = self.law, float(self._tensions @ _SIGNS)
        if law.pulley:
            wound = held[0] - law.servo * left_more if law.locks else self._by_pulley
            off = self.elongations - soft(law.start + wound * _SIGNS - self.paths, law.onset)
            return off if law.locks else np.append(off, (left_more - held[0]) * law.series)
        if not law.locks:
            return np.asarray((self._tensions - held) * law.series)
        wound = law.start + held - law.servo * self._tensions
        return np.asarray(self.elongations - soft(wound - self.paths, law.onset))


def drive_checks(setup: FingerSetup, rod: SpaceRod, tensions: Array) -> Iterator[Check]:
    """Checks about the drives of a finger: its tensions go together on a pulley, and motors reach them."""
    law = setup.drive
    if law is None:
        return
    if law.pulley:
        cables = WoundCables(setup, law, rod, tensions)
        off = float(np.abs(cables.misfit(cables.held)).max())
        yield Check(Requirement.DRIVE, setup.name, off, FOLLOWED * rod.length, "m")
    if isinstance(motor := law.drive, MotorDrive):
        load = abs(float(tensions @ _SIGNS)) if law.pulley else float(tensions.max())
        torque = load * motor.winch_radius + motor.coulomb_friction
        yield Check(Requirement.TORQUE, setup.name, torque - motor.torque_max, EXACT * motor.torque_max, "N m")
