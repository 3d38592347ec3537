"""The hand's finger with tendon friction, and models of it that are moved from one shape at rest to the next."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

import continuum_grasp as cg

LENGTH, STIFFNESS, OFFSET = 0.18, 6.11e-3, 0.005
ROD = {"length": LENGTH, "linear_density": 0.034, "bending_stiffness": STIFFNESS}
PASSIVE = {"rod": ROD, "damping": {"material": 3e-5}, "masses": [{"at": LENGTH, "mass": 0.002}]}
CABLE = {"offset": OFFSET, "max_tension": 60.0, "axial_stiffness": 1e4, "series_stiffness": 1 / 3e-5}
"""A tendon that gives."""


def finger(friction, **tendons):
    return cg.Finger(**PASSIVE, tendons={"offset": OFFSET, "max_tension": 60.0, "friction": friction, **tendons})


def model(friction, family="clothoid", elements=2, **tendons):
    return cg.FingerModel(
        finger(friction, **tendons), family=family, elements=elements, gravity=(0, 0), bending_range=2.0
    )


def bend(model, q):
    return float(np.array(model.bending(q, np.zeros(model.nu), [])).sum())


class Loaded:
    """A model that is moved from one shape at rest to the next, each with the friction that the way there leaves.

    Without ``memory`` it is that of tendons that always slide towards their drives.
    """

    def __init__(self, model, *, memory=True):
        self.model, self.q, self._memory = model, np.zeros(model.n), memory
        self.states = np.zeros(len(model.friction_names))
        self._slid = np.zeros_like(self.states)

    def move(self, tensions, force=(0.0, 0.0)):
        model, q = self.model, self.q
        history = (
            np.append(self.states - self._slid, 1.0) if self._memory else np.append(np.ones_like(self.states), 0.0)
        )
        for _ in range(100):
            missing, slope = (np.array(v) for v in model.statics(q, tensions, force, [], history))
            if np.abs(missing).max() < 1e-12:
                break
            step, size = np.linalg.solve(slope, -missing).ravel(), np.abs(missing).max()
            # the stop has kinks: shorter steps where they throw Newton's method
            while np.abs(np.array(model.statics(q + step, tensions, force, [], history)[0])).max() > size > 1e-12:
                step *= 0.5
                if np.abs(step).max() < 1e-12:
                    break
            q = q + step
        self._slid = np.array(model.sliding()(q, tensions, [])).ravel()
        self.q, self.states = q, np.clip(history[:-1] + self._slid, -1.0, 1.0)
        return bend(model, q)


def way(points, step):
    """Values from point to point."""
    found = [points[0]]
    for a, b in pairwise(points):
        found += list(np.linspace(a, b, max(1, math.ceil(abs(b - a) / step)) + 1)[1:])
    return found
