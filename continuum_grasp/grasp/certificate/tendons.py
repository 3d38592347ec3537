"""What tendons with friction exert along a finger of a grasp, by the capstan equation, from its stored shape alone.

The friction of a cell acts by its state z from -1 to 1: the tension of a tendon on the -X side falls across it by the
factor exp(-friction turn z), that of one on the other side, which slides the other way, rises by as much.
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.cells import cell_nodes
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.scene.grasp import FingerSetup

Array = NDArray[Any]

_PRESLIDING = 1e-3
"""Bend beyond a friction cell from which on it slides [rad]: that of the law that is verified."""


class TendonFriction:
    """The friction cells of a finger's tendons, between the ends of its elements.

    ``states`` (K,) are those of the cells; None: of tendons that slid from the straight finger on.
    """

    def __init__(self, setup: FingerSetup, shape: FingerShape, states: Array | None = None) -> None:
        self._setup, self._shape = setup, shape
        cells = setup.tendons.friction_cells
        parts = [np.linspace(a, b, cells + 1)[:-1] for a, b in pairwise(shape.joints)]
        self.edges = np.append(np.concatenate(parts), shape.joints[-1])
        self.states = self.pulled if states is None else states

    @cached_property
    def _widths(self) -> Array:
        return np.diff(self.edges)

    @cached_property
    def _halves(self) -> tuple[Array, Array]:
        """Along the halves of each cell (K, 2) the turn of the finger where the tendons run, and what it draws in of
        them per offset at the base.
        """
        channel, profile = self._shape.channels[0], self._shape.profile
        ends = np.append(np.stack([self.edges[:-1], self.edges[:-1] + 0.5 * self._widths], axis=1), self.edges[-1])
        s, weights, half = cell_nodes(ends, profile.breaks, channel.shape.breaks)
        bent, drawn = weights * self._shape.curvature(s), channel.shape(s)
        turned, path = (np.bincount(half, each, ends.size - 1) for each in (bent * (drawn != 0.0), bent * drawn))
        return turned.reshape(-1, 2), path.reshape(-1, 2)

    @cached_property
    def pulled(self) -> Array:
        """States (K,) of tendons that slid from the straight finger on: by what is drawn in beyond the middle of each
        cell.
        """
        early, late = self._halves[1].T
        beyond = np.append(np.cumsum((early + late)[::-1])[::-1][1:], 0.0) + late
        return np.asarray(np.clip(beyond / _PRESLIDING, -1.0, 1.0))

    @cached_property
    def losses(self) -> Array:
        """Change (K,) of the logarithm of the tension across each cell, of a tendon on the -X side."""
        turned = self._halves[0].sum(axis=1)
        # The law of the model that is verified: of a constant curvature in a cell, without sign, and rounded off.
        rounding = 1e-3 * self._widths / self.edges[-1]
        return np.asarray(self._setup.tendons.friction * turned**2 / np.sqrt(turned**2 + rounding**2) * self.states)

    def _shares(self, arm: float) -> tuple[Array, Array]:
        """Of a tendon: its change across each cell, and its mean tension there per that at the base."""
        own = math.copysign(1.0, arm) * self.losses
        return own, np.exp(-(np.cumsum(own) - 0.5 * own)) * (1.0 + own**2 / 24.0)

    def shares(self, arm: float, s: Array) -> Array:
        """Tension (G,) at positions [m] of the tendon with this arm, per that at the base."""
        passed = np.append(0.0, np.cumsum(math.copysign(1.0, arm) * self.losses))
        return np.asarray(np.exp(-np.interp(s, self.edges, passed)))

    def mean(self, arm: float) -> float:
        """Mean along the finger of the tension of the tendon with this arm, per that at the base."""
        return float(self._shares(arm)[1] @ self._widths / self.edges[-1])

    def moment(self, s: Array, tensions: Array) -> Array:
        """Bending moment (G,) of the tendons at positions [m], with tensions (2,) at the base [N]."""
        channel = self._shape.channels[0]
        cell = np.clip(np.searchsorted(self.edges, s) - 1, 0, self._widths.size - 1)
        across = (s - self.edges[cell]) / self._widths[cell] - 0.5
        moment = np.zeros(s.shape)
        for arm, tension in zip(channel.arms, tensions, strict=True):
            own, mean = self._shares(arm)
            moment += arm * tension * mean[cell] * (1.0 - own[cell] * across)
        return np.asarray(moment * channel.shape(s))
