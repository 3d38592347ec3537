"""A rod as a chain of rigid links on hinges with stops, written apart from the package.

Hinge i has the moment EI b/h + eta b'/h + sum of stops, each a spring k/h that slides at its moment, in steps of the
implicit Euler kind: velocities from forces at the end of the step, with the stops that will stick taken as springs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def stop(path: Sequence[float], stiffness: float, moment: float, start: float = 0.0) -> Array:
    """Moment of one stop along a path of curvatures, which begins at ``start`` without moment."""
    found, last, z = [], start, 0.0
    for kappa in path:
        z = min(max(z + stiffness * (kappa - last), -moment), moment)
        last = kappa
        found.append(z)
    return np.array(found)


class Chain:
    """Links hang from a clamp; angles (hinges + 1,) from the clamp's direction, the first zero.

    Lengths of the links [m] are h/2, h, ..., h, h/2; ``mass`` [kg] and ``inertia`` [kg m2] are of a body at the tip.
    """

    def __init__(
        self,
        length: float,
        density: float,
        stiffness: float,
        viscosity: float,
        branches: Sequence[tuple[float, float]],
        mass: float,
        hinges: int,
        inertia: float = 0.0,
        gravity: float = 9.81,
    ) -> None:
        self.h = length / hinges
        self.links = np.array([self.h / 2, *[self.h] * (hinges - 1), self.h / 2])
        self.stiffness, self.viscosity, self.branches, self.gravity = stiffness, viscosity, branches, gravity
        count = hinges + 1
        # Lever of every mass point: its position is the sum of lever times direction of the links.
        levers = [np.append(self.links[:i], [0.5 * self.links[i], *[0.0] * (count - i - 1)]) for i in range(count)]
        levers.append(self.links.copy())
        masses = np.append(density * self.links, mass)
        self._coupling = sum(m * np.outer(a, a) for m, a in zip(masses, levers, strict=True))
        self._first = sum(m * a for m, a in zip(masses, levers, strict=True))
        self._own = density * self.links**3 / 12.0
        self._own[-1] += inertia
        self.angles, self.rates = np.zeros(count), np.zeros(count)
        self.z = np.zeros((hinges, len(branches)))

    def bend(self, curvature: float) -> None:
        """Bend evenly from straight."""
        bends = np.full(len(self.z), curvature * self.h)
        self.angles[1:] = np.cumsum(bends)
        for j, (stiffness, moment) in enumerate(self.branches):
            self.z[:, j] = np.clip(self.z[:, j] + stiffness / self.h * bends, -moment, moment)

    def step(self, dt: float) -> None:
        """Go on by ``dt`` [s]."""
        angles, rates, h = self.angles, self.rates, self.h
        apart = angles[:, None] - angles[None, :]
        mass = self._coupling * np.cos(apart) + np.diag(self._own)
        force = -(self._coupling * np.sin(apart)) @ rates**2 - self.gravity * self._first * np.sin(angles)
        bends, bending = np.diff(angles), np.diff(rates)
        moment = self.stiffness / h * (bends + dt * bending) + self.viscosity / h * bending
        slope = np.full(len(bends), (dt * self.viscosity + dt**2 * self.stiffness) / h)
        for j, (stiffness, most) in enumerate(self.branches):
            tried = self.z[:, j] + dt * stiffness / h * bending
            moment += np.clip(tried, -most, most)
            slope += np.where(np.abs(tried) < most, dt**2 * stiffness / h, 0.0)
        differences = np.diff(np.eye(len(angles)), axis=0)
        force = force - differences.T @ moment
        mass = mass + differences.T @ (slope[:, None] * differences)
        rates[1:] += dt * np.linalg.solve(mass[1:, 1:], force[1:])
        bending = np.diff(rates)
        for j, (stiffness, most) in enumerate(self.branches):
            self.z[:, j] = np.clip(self.z[:, j] + dt * stiffness / h * bending, -most, most)
        angles[1:] += dt * rates[1:]

    @property
    def tip(self) -> Array:
        """Position of the tip [m], hanging along -y."""
        return np.array([self.links @ np.sin(self.angles), -self.links @ np.cos(self.angles)])
