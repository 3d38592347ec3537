"""Dry friction in bending on a chain of hinges: each branch is a spring between its hinge and a slider of its own.

A branch of stiffness k that slides at the moment M is, at a hinge whose compliance is that of the rod times a length h,
a spring k/h from the hinge's bend to the angle of a body beside it, a joint with the friction M: moments along an
element are in series. The body weighs nothing; what it needs for MuJoCo is an inertia on its joint, by which it swings
on its spring far above the finger. MuJoCo's friction is no stop but a steep damper, so that a slider creeps where it
should stick: by a rate of (1 - d) / d per step, d being the impedance, times the square of its pulsation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.closed_loop.links import Links
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.finger import Finger

_FASTER = 30.0
"""Pulsation of a slider on its spring per first pulsation of the straight chain [1]: moments to and fro of a rod with a
load give bends within 0.8 % of their range at 20, 0.3 % at 40; the rate of creep grows with the square."""
_DAMPING = 0.05
"""Damping ratio of a slider on its spring: 0.2 adds 0.4 % to these errors, since it damps branches that stick."""
IMPEDANCE = 0.9999
"""Impedance of the friction, the greatest that MuJoCo takes (mjMAXIMP of its sources)."""


@dataclass(frozen=True)
class Sliders:
    """Branches of N hinges.

    Attributes
    ----------
    stiffness, moment : ndarray, shape (B, N)
        Of the springs [N m/rad], and at which they slide [N m].
    pulsation : float
        Of a slider on its spring [rad/s].
    start : ndarray, shape (B, N)
        Angles of the sliders at time zero [rad].
    """

    stiffness: Array
    moment: Array
    pulsation: float
    start: Array

    @staticmethod
    def of(finger: Finger, links: Links, bends: Array, states: Array) -> Sliders | None:
        """The branches of a finger that is bent at its hinges by ``bends`` (N,), with friction states (B, N)."""
        branches = finger.damping.dry_friction
        if not branches:
            return None
        # Along a graded rod branches go with the bending stiffness, and slide at the same curvature everywhere.
        local = links.stiffness / float(finger.profile.bending_stiffness(0.0))
        stiffness = np.outer([branch.stiffness for branch in branches], local)
        moment = np.outer([branch.moment for branch in branches], local * np.diff(links.edges))
        pulsations, _ = links.pulsations()
        start = (bends - links.rest) - states * moment / stiffness
        return Sliders(stiffness, moment, _FASTER * float(pulsations[0]), start)

    @property
    def stuck(self) -> Array:
        """Stiffness (N,) that branches add to the hinges while they stick [N m/rad]."""
        return np.asarray(self.stiffness.sum(axis=0))

    @property
    def longest_step(self) -> float:
        """Longest stable step of a slider on its spring [s]."""
        return 2.0 / self.pulsation

    def creep_time(self, step: float) -> float:
        """Time [s] in which a branch that should stick loses its moment."""
        return IMPEDANCE / (1.0 - IMPEDANCE) / (step * self.pulsation**2)

    def bodies(self, k: int) -> list[tuple[int, float, float]]:
        """Number, inertia [kg m2] and friction [N m] of the sliders of a hinge."""
        columns = self.stiffness[:, k] / self.pulsation**2, self.moment[:, k]
        return [(j, *row) for j, row in enumerate(zip(*columns, strict=True), 1)]

    def springs(self, rest: Array) -> list[tuple[int, int, float, float, float]]:
        """Hinge, number, stiffness and damping of springs of the hinges' bends, and the bends at rest (N,) beyond which
        they pull, less the angles of the sliders.
        """
        damping = 2.0 * _DAMPING * self.stiffness / self.pulsation
        places = [(k, j) for k in range(len(rest)) for j in range(len(self.stiffness))]
        return [(k + 1, j + 1, self.stiffness[j, k], damping[j, k], rest[k]) for k, j in places]


def states_at(model: FingerModel, x: Array, places: Array) -> Array:
    """Friction states (B, N) of dry friction in bending of a state at places along the finger [m]."""
    made, branches = model.structure, len(model.finger.damping.dry_friction)
    cells = [port.element for law in made.laws if law.kind == "friction" for port in law.ports]
    counts = np.bincount(cells)
    ends = [np.linspace(a, b, n + 1)[1:] for a, b, n in zip(made.mesh.ends, made.mesh.ends[1:], counts, strict=False)]
    cell = np.clip(np.searchsorted(np.concatenate(ends), places), 0, len(cells) - 1)
    states = x[model.nx - branches * len(cells) :].reshape(-1, branches)
    return np.asarray(np.clip(states[cell].T, -1.0, 1.0))
