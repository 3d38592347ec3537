"""Tendons of a drive at an instant: tensions with a soft onset, and angles of a drum whose tendons balance a torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from continuum_grasp.model.memory import Memory
from continuum_grasp.model.planar import Scalar


@dataclass(frozen=True)
class Cables:
    """Tendons of a drive at an instant.

    Their tensions have a soft onset. In `towards` and `under`, they pull as soon as they are not slack: the torque is
    then piecewise linear in the angle, with a tendon in tension, both or none.
    """

    start: Scalar  # wound up while the drum is at zero [m], counted from where a straight tendon pulls
    radius: float  # wound up per angle of the drum [m]
    onset: float  # half the change of length from slack to tension [m]
    slack_stiffness: float  # share of the stiffness that they have while they are slack [1]
    compliances: Sequence[Scalar]  # elongation per tension [m/N]
    paths: Sequence[Scalar]  # length that the bend draws in [m]

    def slacks(self, drum: Scalar) -> list[Scalar]:
        """Cable wound up beyond slack [m] where the drum is."""
        wound = [self.start + (side * self.radius) * drum for side in self.sides]
        return [y - path for y, path in zip(wound, self.paths, strict=True)]

    @property
    def sides(self) -> tuple[float, ...]:
        """Whether the drum winds up or pays out each tendon."""
        return (1.0, -1.0)[: len(self.paths)]

    def tensions(self, slacks: Sequence[Scalar]) -> list[Scalar]:
        """Tensions for cable wound up beyond its straight length [N]."""
        pulled, share = [soft(slack, self.onset) for slack in slacks], self.slack_stiffness
        if share:
            pulled = [(1.0 - share) * pull + share * slack for pull, slack in zip(pulled, slacks, strict=True)]
        return [pull / c for pull, c in zip(pulled, self.compliances, strict=True)]

    def slopes(self, slacks: Sequence[Scalar]) -> list[Scalar]:
        """Torque of each tendon per angle of the drum [N m/rad]."""
        return [soft_slope(y, self.onset) * rise for y, rise in zip(slacks, self._rises, strict=True)]

    @cached_property
    def _tight(self) -> list[Scalar]:
        """Least angle with each tendon in tension [rad]."""
        return [side * (path - self.start) / self.radius for side, path in zip(self.sides, self.paths, strict=True)]

    @cached_property
    def _rises(self) -> list[Scalar]:
        """Torque per angle of each tendon in tension [N m/rad]."""
        return [self.radius**2 / c for c in self.compliances]

    def towards(self, gain: float, angle: Scalar) -> Scalar:
        """Return the angle of balance with a torque of a gain [N m/rad] towards an angle."""
        rises = list(zip(self._rises, self._tight, strict=True))
        alone = [angle - slope * (angle - at) / (gain + slope) for slope, at in rises]
        if len(alone) == 1:
            return ca.fmin(angle, alone[0])
        low, high = ca.fmin(*self._tight), ca.fmax(*self._tight)
        pulled = sum(slope * (angle - at) for slope, at in rises)
        both = angle - pulled / (gain + sum(self._rises))
        # None in tension: all of the torque is that towards the angle; without any, the angle as far as no tendon
        # begins to pull.
        edge = ca.fmin(self.onset / self.radius, 0.5 * (high - low))
        none = angle if gain else ca.fmin(ca.fmax(angle, low + edge), high - edge)
        balanced = ca.if_else(ca.SX(self._tight[0]) < self._tight[1], both, none)
        return ca.if_else(balanced < low, alone[1], ca.if_else(balanced > high, alone[0], balanced))

    def under(self, torque: Scalar) -> Scalar:
        """Return the angle of balance with a torque [N m]; if no tendon pulls, an angle between or before their
        onsets.
        """
        rises = list(zip(self._rises, self._tight, strict=True))
        alone = [at + torque / slope for slope, at in rises]
        if len(alone) == 1:
            # About where a soft one begins to: e - u + 2 sqrt(u w) - w of u = min(e, w).
            beyond, edge = torque / self._rises[0], self.onset / self.radius
            within = ca.fmin(beyond, edge)
            # 1e-12: keeps a root differentiable at zero
            begun = 2.0 * ca.sqrt(edge * within + 1e-12 * edge**2)
            return self._tight[0] + (beyond - within) + (begun - edge)
        pulls = ca.SX(torque) > 0.0
        both = (torque + sum(slope * at for slope, at in rises)) / sum(self._rises)
        middle = ca.if_else(ca.SX(self._tight[0]) < self._tight[1], both, 0.5 * (self._tight[0] + self._tight[1]))
        further = ca.if_else(pulls, ca.fmax(middle, alone[0]), ca.fmin(middle, alone[1]))
        return ca.if_else(ca.SX(torque) == 0.0, middle, further)


def soft(length: Scalar, onset: Scalar) -> Scalar:
    """Elongation of a tendon [m] by the length wound up beyond slack [m]: nothing below zero, and smooth."""
    # Half beyond the range of the onset w, and within it w (v + 1)^3 (3 - v) / 16 of v = length / w.
    above = ca.fmax(length + onset, 0.0)
    within = ca.fmin(above, 2.0 * onset)
    unit = 1.0 / (16.0 * onset**3)
    return above - within + (within * within) * (within * (4.0 * onset * unit - unit * within))


def soft_slope(length: Scalar, onset: float) -> Scalar:
    """Derivative of ``soft`` [1]."""
    within = ca.fmin(ca.fmax(length + onset, 0.0), 2.0 * onset)
    return (within * within) * (0.75 / onset**2 - (0.25 / onset**3) * within)


def soft_integral(length: Scalar, onset: float) -> Scalar:
    """Integral of ``soft`` [m2]."""
    v = Memory.clipped((1.0 / onset) * length)
    square = v * v
    inside = (onset**2 / 16.0) * (0.8 + v * (3.0 + v * (4.0 + v * (2.0 - 0.2 * square))))
    beyond = ca.fmax(length - onset, 0.0)
    return inside + beyond * (onset + 0.5 * beyond)
