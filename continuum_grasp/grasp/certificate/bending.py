"""What dry friction in bending exerts along a finger of a grasp, from its stored shape alone.

Each branch of a cell resists the bending by its moment M times a state z from -1 to 1, the same all along the cell: its
virtual work is that of a moment on the turn of the cell. Along a finger that changes along its length k and M are
those at the base, and go with its stiffness. A finger that was bent from its shape at rest on has z = k kappa / M,
kappa being the mean curvature of the cell above rest by this stiffness, as far as that is within the range.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.cells import cell_nodes
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.scene.grasp import FingerSetup

Array = NDArray[Any]

_PARTS = 4
"""Parts of a cell of a finger that changes along its length, in each of which the couples of an exact rod take its
friction as the same: its moment is then off by an eighth of what it changes along the cell."""


class DryBending:
    """The cells of a finger with dry friction in bending, and the moment in each.

    ``states`` (K,) are those of cell after cell, branch by branch; None: of a finger that was bent from rest on.
    """

    def __init__(self, setup: FingerSetup, shape: FingerShape, states: Array | None = None) -> None:
        branches = setup.finger.damping.dry_friction
        self._shape, self._profile = shape, setup.finger.profile
        self._stiffness = np.array([branch.stiffness for branch in branches])
        self._most = np.array([branch.moment for branch in branches])
        parts = [np.linspace(a, b, setup.bending_cells + 1)[:-1] for a, b in pairwise(shape.joints)]
        self.edges = np.append(np.concatenate(parts), shape.joints[-1])
        self.states = self.pulled if states is None else states

    @cached_property
    def _bent(self) -> Array:
        """Mean curvature (C, 1) above rest of each cell [1/m]."""
        s, weights, cell = cell_nodes(self.edges, self._profile.breaks)
        measure = weights * self.per_base(s)
        drawn = np.bincount(cell, measure * self._shape.elastic(s)) / np.bincount(cell, measure)
        return np.asarray(drawn)[:, None]

    def per_base(self, s: Array) -> Array:
        """Bending stiffness (G,) at positions [m] per that at the base [1]."""
        stiffness = self._profile.bending_stiffness
        return np.asarray(stiffness(s) / stiffness(np.zeros(1)))

    @cached_property
    def pulled(self) -> Array:
        """States (K,) of a finger that was bent from its shape at rest on."""
        return np.asarray(np.clip(self._stiffness / self._most * self._bent, -1.0, 1.0).ravel())

    @property
    def moments(self) -> Array:
        """Moment (C,) of each cell against the bending, per that of the stiffness at the base [N m]."""
        return np.asarray(np.reshape(self.states, (-1, self._most.size)) @ self._most)

    def moment(self, s: Array) -> Array:
        """Moment (G,) against the bending at positions [m]."""
        cell = np.clip(np.searchsorted(self.edges, s) - 1, 0, self.edges.size - 2)
        return np.asarray(self.moments[cell] * self.per_base(s))

    @property
    def couples(self) -> list[tuple[float, float]]:
        """Places [m] and couples [N m] that exert on an elastic rod what this friction does."""
        parts = 1 if self._profile.bending_stiffness.constant is not None else _PARTS
        ends = [np.linspace(a, b, parts + 1)[1:] for a, b in pairwise(self.edges)]
        places = np.concatenate([self.edges[:1], *ends])
        against = np.append(self.moment(0.5 * (places[1:] + places[:-1])), 0.0)
        return list(zip(places[1:].tolist(), np.diff(against).tolist(), strict=True))

    @property
    def sticking(self) -> Array:
        """Stiffness (C,) of the branches that stick, of a finger bent from rest on [N m], against the turn of a cell;
        of one that changes along its length against that by ``per_base``.
        """
        sticks = np.abs(self.pulled.reshape(-1, self._most.size)) < 1.0
        s, weights, cell = cell_nodes(self.edges, self._profile.breaks)
        return np.asarray((sticks @ self._stiffness) / np.bincount(cell, weights * self.per_base(s)))
