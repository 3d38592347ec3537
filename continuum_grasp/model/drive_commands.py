"""Commands of drives for tensions, in a finger whose tendons were only pulled."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array
from continuum_grasp.model.winches import Winch
from continuum_grasp.scene import Finger, MotorDrive


class DriveCommands:
    """Commands from tensions, in a finger whose tendons were only pulled; ``s`` are places along it [m]."""

    def __init__(self, finger: Finger, s: ArrayLike) -> None:
        self._finger = finger
        self._s = np.asarray(s, dtype=float)
        self._winches = Winch.of_finger(finger)

    def of(self, tensions: ArrayLike, angles: ArrayLike) -> Array:
        """Commands (nu) under tensions (T) [N] at the drives, with angles of the backbone at ``s`` [rad]."""
        pulled = np.asarray(tensions, dtype=float)
        if not self._winches:
            return pulled.copy()
        drawn = [self._drawn(k, np.asarray(angles, dtype=float)) for k in range(len(pulled))]
        return np.array([self._command(winch, pulled, drawn) for winch in self._winches])

    def closing(self, pulls: ArrayLike) -> Array:
        """Return the direction in which each command (nu) pulls harder with the tendons that close the finger.

        1 is up; -1 is down, for example for a pulley that winds up its second tendon; 0 means that the command moves
        none of them. ``pulls`` (T) marks the closing tendons.
        """
        closes = np.asarray(pulls, dtype=bool)
        directions = []
        for winch in self._winches:
            sides = [side for side, k in zip(winch.sides, winch.tendons, strict=True) if closes[k]]
            directions.append(sides[0] if sides else 0.0)
        return np.array(directions) if self._winches else closes.astype(float)

    def _drawn(self, tendon: int, angles: Array) -> tuple[float, float]:
        """Length of a tendon drawn in by the bend [m], and by tension [m/N]."""
        cable = self._finger.tendon_list[tendon]
        _, _, channel, arm = self._finger.pulls[tendon]
        middle = 0.5 * (self._s[1:] + self._s[:-1])
        inside = np.clip(np.diff(np.minimum(self._s, channel.to)), 0.0, None)
        bends = np.diff(angles)
        path = arm * float(channel.shape(middle) @ bends)
        # A tendon that was drawn in loses tension towards its end, one that was let out gains it.
        passed = cable.conduit_bend + np.cumsum(np.abs(bends)) - 0.5 * np.abs(bends)
        share = np.exp(-math.copysign(cable.friction, path) * passed)
        if cable.axial_stiffness is None or cable.series_stiffness is None:
            raise TypeError("a tendon whose tension is commanded has no compliance")
        return path, float(inside @ share) / cable.axial_stiffness + 1.0 / cable.series_stiffness

    def _command(self, winch: Winch, pulled: Array, drawn: list[tuple[float, float]]) -> float:
        routes = [drawn[k] for k in winch.tendons]
        lengths = [path + give * pulled[k] for (path, give), k in zip(routes, winch.tendons, strict=True)]
        # On one pulley, the stronger tendon determines the angle; the tension of the other one follows.
        tightest = max(winch.tendons, key=lambda k: pulled[k])
        position = float(ca.DM(winch.position(lengths, [float(pulled[k]) * (k == tightest) for k in winch.tendons])))
        drive = winch.drive
        if not isinstance(drive, MotorDrive):
            return position
        held = [
            max(wound - path, 0.0) / give
            for wound, (path, give) in zip(map(float, winch.wound(position)), routes, strict=True)
        ]
        torque = winch.radius * sum(side * tension for side, tension in zip(winch.sides, held, strict=True))
        angle = float(ca.DM(winch.at(position, held, None)[0]))
        return angle + torque / (drive.position_gain or math.inf)
