"""A motor that turns a drum through a gear with play, and the chain of hinges whose two tendons are on that drum.

It shares nothing with the package. The drum has no inertia and no state: it is the root that a bracketing search finds
of gear torque and tensions, which begin as soon as a tendon is in tension. Tendons have no friction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy import integrate, optimize

from tests.truth.tendon_motion import MovingFinger


def drum_angle(angle: float, play: float, stiffness: float, pull: Callable[[float], float]) -> float:
    """Angle of a drum behind a motor at an angle; ``pull`` is the torque of the tensions, and grows with the drum's."""

    def missing(drum: float) -> float:
        twist = angle - drum
        return stiffness * (twist - np.clip(twist, -0.5 * play, 0.5 * play)) - pull(drum)

    reach = 0.5 * play
    while missing(angle - reach) < 0.0 or missing(angle + reach) > 0.0:
        reach = 2.0 * reach + 1e-3
    return float(optimize.brentq(missing, angle - reach, angle + reach, xtol=1e-15, rtol=1e-14))


@dataclass
class GearedChain:
    """State [bends, rates, angle of the motor, its rate]; ``wound`` is what is wound up of each tendon at zero [m]."""

    chain: MovingFinger
    wound: float
    play: float
    stiffness: float
    radius: float = 0.008
    inertia: float = 2e-6
    viscous: float = 2e-4
    x: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.x = np.zeros(2 * self.chain.hinges + 2)
        self._give = self.chain.series_compliance + self.chain.length / self.chain.axial_stiffness

    def tensions(self, path: float, drum: float) -> np.ndarray:
        """Of both tendons [N], drawn in and let out by a path [m]."""
        turned = np.array([1.0, -1.0]) * (self.radius * drum - path)
        return np.maximum(self.wound + turned, 0.0) / self._give

    def rate(self, x: np.ndarray, torque: float) -> np.ndarray:
        """Of the state."""
        own, n = self.chain, self.chain.hinges
        bends, rates, angle, speed = x[:n], x[n : 2 * n], x[-2], x[-1]
        path = own.offset * bends.sum()

        def pull(drum: float) -> float:
            first, second = self.tensions(path, drum)
            return self.radius * (first - second)

        pulled = pull(drum_angle(angle, self.play, self.stiffness, pull))
        below = np.tril(np.ones((n, n)))
        mass, swing = own._inertia(bends)
        force = own.offset * pulled / self.radius - (own.stiffness * bends + own.damping * rates) * n / own.length
        force -= below.T @ (swing @ np.cumsum(rates) ** 2)
        gained = np.linalg.solve(below.T @ mass @ below, force)
        return np.array([*rates, *gained, speed, (torque - self.viscous * speed - pulled) / self.inertia])

    def go(self, torque: float, duration: float) -> np.ndarray:
        """The state [s] later under a constant torque [N m]."""
        found = integrate.solve_ivp(
            lambda _, x: self.rate(x, torque), (0.0, duration), self.x, "LSODA", rtol=1e-7, atol=1e-9, max_step=1e-3
        )
        self.x = found.y[:, -1]
        return self.x
