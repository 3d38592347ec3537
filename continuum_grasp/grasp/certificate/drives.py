"""States of the drives of a finger in a grasp, and whether they can be, from its stored shape and tensions alone.

A tendon in tension T at its drive is wound up by y = (its path along the bent finger) + C T; C is the elongation
of cable and tendon per tension at the drive, the latter by the share of the tension that friction leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.friction import TendonFriction, cell_nodes, friction_of
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.scene import FingerSetup, MotorDrive

LEAST_PULL = 1e-6
"""Tension above which a tendon counts as in tension, per greatest tension."""


@dataclass(frozen=True)
class RecomputedDrive:
    """State of one drive."""

    tendons: tuple[str, ...]  # those that it winds up, ``left`` (the -X side) or ``right``
    position: float  # cable wound up since zero [m], or for motors the angle of the motor [rad]
    torque: float  # holds the tensions without friction of the motor [N m]; NaN for winches that follow a length
    torque_to_reach: float  # greatest magnitude while the grasp is reached, the motor's dry friction included [N m]
    command: float  # what the drive takes [m, rad or N m]


class WoundTendons:
    """The two tendons of a finger and the drives that wind them up; tensions (2,) are at the drives [N]."""

    def __init__(
        self, setup: FingerSetup, shape: FingerShape, tensions: Array, friction: TendonFriction | None
    ) -> None:
        if setup.drive is None:
            raise ValueError(f"{setup.name} has no drives that wind up its tendons")
        self.law = setup.drive
        self.tensions = tensions
        self._most = setup.tendons.max_tension
        self._shape, self._friction = shape, friction

    @cached_property
    def path(self) -> float:
        """Length by which the bend draws in the tendon on the -X side, and pays out the other [m]."""
        (channel,), profile = self._shape.channels, self._shape.profile
        s, w, _ = cell_nodes(self._shape.joints, profile.breaks, channel.shape.breaks)
        return float(abs(channel.arms[0]) * (self._shape.curvature(s) * channel.shape(s)) @ w)

    @property
    def paths(self) -> Array:
        """Paths of both tendons (2,) [m]."""
        return self.path * np.array([1.0, -1.0])

    @cached_property
    def compliances(self) -> Array:
        """Elongation per tension at the drive (2,) [m/N]."""
        means = np.ones(2)
        if self._friction is not None:
            means = np.array([self._friction.mean(arm) for arm in self._shape.channels[0].arms])
        return self.law.series + self.law.axial * means

    @property
    def in_tension(self) -> NDArray[np.bool_]:
        """Whether each pulls (2,)."""
        return np.asarray(self.tensions > LEAST_PULL * self._most)

    @cached_property
    def wound(self) -> Array:
        """Cable wound up (2,) [m]; of a slack tendon, as much as would make it just in tension."""
        return np.asarray(self.paths + _unsoftened(self.compliances * self.tensions, self.law.onset, self.in_tension))

    @property
    def _wound_by_pulley(self) -> float:
        """Length that the pulley winds up of the one and pays out of the other, counted from zero [m]."""
        if self.tensions[0] >= self.tensions[1]:
            return float(self.wound[0] - self.law.start)
        return float(self.law.start - self.wound[1])

    @property
    def held(self) -> Array:
        """Quantities that the drives hold while friction or object change: cable [m] of drives that lock, one for each;
        of a motor on a pulley under a torque the difference of the tensions [N]; of others the tensions (2,) [N].
        """
        law, (left, right) = self.law, self.tensions
        if law.pulley:
            return np.array([self._wound_by_pulley + law.servo * (left - right) if law.locks else left - right])
        if not law.locks:
            return self.tensions
        # A tendon that does not pull is let out until it is slack.
        elongation = self.compliances * self.tensions
        let_out = law.onset / (1.0 + (elongation / law.onset) ** 4)
        return np.asarray(self.paths + elongation - let_out + law.servo * self.tensions)

    def misfit(self, held: Array | None = None) -> float:
        """By how much the tensions differ from the drives' where they hold, greatest of the tendons [N]; None: only
        whether the two tendons of a pulley go together.
        """
        law, (left, right) = self.law, self.tensions
        held = self.held if held is None else held
        if law.pulley:
            wound = held[0] - law.servo * (left - right) if law.locks else self._wound_by_pulley
            commanded = law.start + wound * np.array([1.0, -1.0])
        elif not law.locks:
            return float(np.abs(self.tensions - held).max())
        else:
            commanded = held - law.servo * self.tensions
        off = np.abs(_softened(commanded - self.paths, law.onset) / self.compliances - self.tensions).max()
        # Of a motor on a pulley under a torque also the difference of the tensions.
        if law.pulley and not law.locks:
            off = max(off, abs(left - right - held[0]))
        return float(off)

    @property
    def over_torque(self) -> tuple[float, float] | None:
        """By how much the torque that reaches the tensions is above the greatest, negative within, and that greatest
        torque [N m]; None of winches that follow a length, which have no torque.
        """
        drive = self.law.drive
        if not isinstance(drive, MotorDrive):
            return None
        pulls = [abs(self.tensions[0] - self.tensions[1])] if self.law.pulley else self.tensions
        reached = float(np.max(pulls)) * self.law.radius + drive.coulomb_friction
        return reached - drive.torque_max, drive.torque_max

    @property
    def springs(self) -> Array:
        """Tension at the drive per path drawn in while the drives hold (2,) [N/m]; none of a slack tendon."""
        stiffness = (
            np.where(self.in_tension, _softness(self.wound - self.paths, self.law.onset), 0.0) / self.compliances
        )
        return np.array(self.law.springs(stiffness.tolist()))

    @property
    def drives(self) -> tuple[RecomputedDrive, ...]:
        pulls = np.where(self.in_tension, self.tensions, 0.0)
        if self.law.pulley:
            return (self._state(("left", "right"), self._wound_by_pulley, float(pulls[0] - pulls[1])),)
        each = zip(("left", "right"), self.wound - self.law.start, pulls, strict=True)
        return tuple(self._state((name,), float(wound), float(pull)) for name, wound, pull in each)

    def _state(self, tendons: tuple[str, ...], wound: float, pull: float) -> RecomputedDrive:
        law = self.law
        drive = self.law.drive
        if not isinstance(drive, MotorDrive):
            return RecomputedDrive(tendons, wound, np.nan, np.nan, wound)
        position = wound / law.radius
        torque = pull * law.radius
        if drive.gear_stiffness is not None:  # the motor is ahead of the drum by the twist of the gear and its play
            position += torque / drive.gear_stiffness + 0.5 * drive.backlash * float(np.sign(torque))
        command = torque if drive.position_gain is None else position + torque / drive.position_gain
        return RecomputedDrive(tendons, position, torque, abs(torque) + drive.coulomb_friction, command)


class StoredFinger:
    """A finger of a grasp by its stored numbers alone: its shape, tensions (2,) [N], base (3,), friction and drives;
    ``arrays`` as `continuum_grasp.grasp.certify` takes them.
    """

    def __init__(self, setup: FingerSetup, arrays: Mapping[str, Any]) -> None:
        self.setup = setup
        self.name = setup.name
        self.finger = setup.finger
        self.profile = setup.finger.profile
        self.shape = FingerShape(setup, arrays)
        self.tensions, self.base = (np.asarray(arrays[f"{self.name}.{k}"], dtype=float) for k in ("tensions", "base"))
        # From stored states, or from pulling the unloaded finger; None without friction.
        self.friction, self.dry = friction_of(setup, self.shape, arrays.get(f"{self.name}.friction_states"))
        winds = setup.drive is not None
        self.wound = WoundTendons(setup, self.shape, self.tensions, self.friction) if winds else None


def _softened(length: Array, onset: float) -> Array:
    """Elongation [m] by the length wound up beyond slack [m]; rounded off within an onset [m] to either side."""
    v = np.clip(length / onset, -1.0, 1.0)
    return np.asarray(onset / 16.0 * (3.0 + v * (8.0 + v * (6.0 - v * v))) + np.maximum(length - onset, 0.0))


def _softness(length: Array, onset: float) -> Array:
    """Derivative of `_softened`."""
    v = np.clip(length / onset, -1.0, 1.0)
    return np.asarray((8.0 + 12.0 * v - 4.0 * v**3) / 16.0)


def _unsoftened(elongation: Array, onset: float, pulling: NDArray[np.bool_]) -> Array:
    """Length wound up beyond straight for an elongation [m]; none for a slack tendon. By Newton's method."""
    x = np.asarray(elongation, dtype=float).copy()
    for _ in range(50):
        # Not at the end of the slack range, where the law is flat.
        slope = _softness(np.maximum(x, onset * (1e-9 - 1.0)), onset)
        x -= np.clip((_softened(x, onset) - elongation) / slope, -onset, onset)
    return np.asarray(np.where(pulling, x, 0.0))
