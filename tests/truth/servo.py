"""A motor with dry friction that winds up the tendon of a chain of guides, under a position servo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.truth.tendon_motion import MovingFinger


@dataclass
class ServoedChain:
    """One tendon on a drum; the motor sticks exactly until its dry friction is overcome.

    ``wound`` is what the drum has wound up at angle zero [m], ``applied`` the torque of the last step. Numbers of the
    motor are at the drum.
    """

    chain: MovingFinger
    wound: float
    radius: float = 0.008
    inertia: float = 2e-6
    viscous: float = 1e-5
    dry: float = 2e-3
    position_gain: float = 0.8
    rate_gain: float = 2.5e-3
    torque_max: float = 0.4
    angle: float = 0.0
    rate: float = 0.0
    applied: float = 0.0

    def __post_init__(self) -> None:
        self.chain.start([("length", self.wound)])

    def torque(self, command: float) -> float:
        """Of the servo [N m]."""
        wanted = self.position_gain * (command - self.angle) - self.rate_gain * self.rate
        return float(np.clip(wanted, -self.torque_max, self.torque_max))

    def advance(self, command: float, across: float = 0.0) -> None:
        """One step of the chain; ``across`` is a force where it is pushed, to the left, seen from base to tip [N]."""
        h, pulled = self.chain.time_step, self.radius * float(self.chain.tensions[0])
        self.applied = self.torque(command)
        free = self.rate + h / self.inertia * (self.applied - self.viscous * self.rate - pulled)
        self.rate = float(np.sign(free) * max(abs(free) - h * self.dry / self.inertia, 0.0))
        self.angle += h * self.rate
        leaning = float(self.chain.bends[: self.chain.pushed].sum())
        force = (-across * np.cos(leaning), -across * np.sin(leaning))
        self.chain.advance([("length", self.wound + self.radius * self.angle)], force)

    def readings(self, step: float, noise: float, rng: np.random.Generator) -> list[float]:
        """Angle by an encoder with a step [rad], and the torque that acted last, with noise [N m]."""
        return [step * round(self.angle / step), self.applied + noise * rng.standard_normal()]
