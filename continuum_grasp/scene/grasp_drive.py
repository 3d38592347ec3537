"""Drives of a finger that grasps, as plain numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from continuum_grasp.scene.drives import LengthDrive, MotorDrive
from continuum_grasp.scene.finger import Finger


@dataclass(frozen=True)
class DriveLaw:
    """The winches or motors of a pair of tendons, at rest."""

    drive: LengthDrive | MotorDrive
    series: float
    """Elongation of what is between drive and finger per tension [m/N]."""
    axial: float
    """Elongation along the finger per tension that is the same all along [m/N]."""

    @staticmethod
    def of(finger: Finger) -> DriveLaw | None:
        """Drive of a finger; None where tensions are commanded."""
        tendon = finger.tendon_list[0]
        if tendon.drive is None or tendon.axial_stiffness is None or tendon.series_stiffness is None:
            return None
        axial = tendon.end(finger.rod.length) / tendon.axial_stiffness
        return DriveLaw(tendon.drive, 1.0 / tendon.series_stiffness, axial)

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
        """Cable wound up of the straight finger while the drive is at zero [m], counted from where it is in tension."""
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
    def friction(self) -> float:
        """Dry friction of the motor, as a tension [N]."""
        return self.drive.coulomb_friction / self.radius if isinstance(self.drive, MotorDrive) else 0.0

    @property
    def greatest(self) -> float:
        """Greatest tension, or difference of the two on a pulley, that the motor pulls up against its friction [N]."""
        if not isinstance(self.drive, MotorDrive):
            return math.inf
        return self.drive.torque_max / self.radius - self.friction
