"""Quantities of a finger that cost terms and sensors are computed from, and what sensors read of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from continuum_grasp.model import Motor
from continuum_grasp.scene import Measured

OBJECT_POSE = ("object_x [m]", "object_y [m]", "object_angle [rad]")
"""Names and units of the measured pose of an object."""


@dataclass(frozen=True)
class Quantities:
    """Quantities that terms and sensors are computed from: expressions of a controller's model or of a plant, made when
    asked for.
    """

    length: float  # of the finger [m]
    tip: Callable[[], Any]  # world position (2) [m]
    sections: Callable[[Sequence[float]], Sequence[Any]]  # world positions (2, K) [m], angles (K) [rad], of places [m]
    object_pose: Callable[[], Any]  # of one that moves: x, y [m] and angle [rad]
    bending: Callable[[], Any]  # of each element of the controller's model [rad]
    bending_rate: Callable[[], Any]  # [rad/s]
    contact_force: Callable[[], Any]  # normal force at each tracked contact [N]
    gap: Callable[[], Any]  # distance from the object if it is tracked [m]
    input: Any  # tip moment [N m], tensions [N] or commands of drives (nu)
    input_rate: Any  # its change per time

    def sensed(
        self,
        asked: Measured,
        motors: Sequence[Motor],
        states: Mapping[str, ca.SX],
        u: ca.SX,
        tensions: Mapping[str, ca.SX],
    ) -> dict[str, dict[str, ca.SX]]:
        """Express what sensors read, by sensor: each number by its name and unit, in the order of a measurement.

        The finger belongs to a controller or a plant: states by name, commands u (nu), and the tensions
        [N] that are read.
        """
        readings = dict[str, dict[str, ca.SX]]()
        if asked.tip is not None:
            readings["tip"] = dict(zip(("tip_x [m]", "tip_y [m]"), ca.vertsplit(self.tip()), strict=True))
        if asked.tension is not None:
            readings["tension"] = dict(tensions)

        def read_states(sensor: str, word: str) -> None:
            if getattr(asked, sensor) is not None:
                selected = {name: x for name, x in states.items() if name.startswith(word) and "_rate" not in name}
                readings[sensor] = selected

        read_states("length", "length_")
        read_states("angle", "motor_angle_")
        if asked.torque is not None:
            for k, motor in enumerate(motors):
                position, rate = (states[name] for name in motor.names(k + 1)[:2])
                readings.setdefault("torque", {})[_torque_name(k + 1)] = ca.SX(motor.torque(u[k], position, rate))
        read_states("pressure", "pressure_")
        if asked.bending is not None:
            angles = ca.vertsplit(ca.vec(self.sections(asked.bending.at)[1]))
            readings["bending"] = {f"angle_{k + 1} [rad]": angle for k, angle in enumerate(angles)}
        if asked.object is not None:
            readings["object"] = dict(zip(OBJECT_POSE, ca.vertsplit(self.object_pose()[:3]), strict=True))
        return readings


def _torque_name(number: int) -> str:
    """Name and unit of the measured torque of a motor."""
    return f"motor_torque_{number} [N m]"
