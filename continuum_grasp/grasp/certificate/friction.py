"""Friction of a finger of a grasp, from its stored shape alone: of its tendons, and dry friction in bending.

By the capstan equation the tension of a tendon on the -X side falls across a cell with state z, from -1 to 1, by the
factor exp(-friction turn z); a tendon on the other side, which slides the other way, rises by as much.

Each branch of a cell resists the bending by its moment M times a state z from -1 to 1, the same all along the cell: its
virtual work is the work of a moment on the turn of the cell. Along a finger that changes along its length k and M are
taken at the base, and go with the harmonic mean stiffness of the cell, by which an even moment bends it. A finger that
was bent from its shape at rest on has z = k kappa / M, kappa being the mean curvature of the cell above rest, as far as
that is within the range.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.scene import FingerSetup, GraspScene

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


def cell_nodes(edges: Array, *breaks: Sequence[float]) -> tuple[Array, Array, NDArray[np.int64]]:
    """Nodes (G,) [m] and weights [m] between places where something may have a kink, and the cell that each is in.

    ``edges`` (K + 1,) bound the cells, ``breaks`` are other such places [m]. Sixteen nodes between two places: to
    rounding for tapers to a tenth.
    """
    inside = [at for at in np.concatenate(breaks) if edges[0] < at < edges[-1]] if breaks else []
    places = np.unique(np.concatenate([edges, inside]))
    middle = 0.5 * (places[1:] + places[:-1])[:, None]
    half = 0.5 * np.diff(places)[:, None]
    cell = np.searchsorted(edges, middle.ravel()) - 1
    return (middle + half * _NODES).ravel(), (half * _WEIGHTS).ravel(), np.repeat(cell, _NODES.size)


class TendonFriction:
    """Friction cells of a finger's tendons, between the ends of its elements.

    ``states`` (K,) belong to the cells; None: the tendons have slid since the finger was unloaded.
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
    def _drawn_in(self) -> Array:
        """Tendon length that bending from rest draws in along the halves of each cell (K, 2), per base offset."""
        channel = self._shape.channels[0]
        profile = self._shape.profile
        ends = np.append(np.stack([self.edges[:-1], self.edges[:-1] + 0.5 * self._widths], axis=1), self.edges[-1])
        s, weights, half = cell_nodes(ends, profile.breaks, channel.shape.breaks)
        return np.bincount(half, weights * self._shape.elastic(s) * channel.shape(s), ends.size - 1).reshape(-1, 2)

    @cached_property
    def _turned(self) -> Array:
        """Unsigned turn (K,) of the finger along each cell, where the tendons run [rad].

        It follows the law of the verified model: rounded off, summed over the parts on which the finger is smooth.
        """
        channel, profile = self._shape.channels[0], self._shape.profile
        inside = np.concatenate([self.edges, profile.breaks, channel.shape.breaks])
        ends = np.unique(inside[(inside >= self.edges[0]) & (inside <= self.edges[-1])])
        s, weights, part = cell_nodes(ends, profile.breaks, channel.shape.breaks)
        turned = np.bincount(part, weights * self._shape.curvature(s) * (channel.shape(s) != 0.0), ends.size - 1)
        cell = np.searchsorted(self.edges, 0.5 * (ends[1:] + ends[:-1])) - 1
        rounding = 1e-3 * (self._widths / self.edges[-1])[cell]
        return np.bincount(cell, turned**2 / np.sqrt(turned**2 + rounding**2), self._widths.size)

    @cached_property
    def pulled(self) -> Array:
        """States (K,) of tendons that have slid since the finger was unloaded, from the length drawn in beyond the
        middle of each cell.
        """
        early, late = self._drawn_in.T
        beyond = np.append(np.cumsum((early + late)[::-1])[::-1][1:], 0.0) + late
        # 1e-3: bend beyond a friction cell from which on it slides [rad]: that of the law that is verified, whose
        # cubic is flat there
        slid = np.clip(beyond / 1e-3, -1.0, 1.0)
        return np.asarray(0.5 * slid * (3.0 - slid**2))

    @cached_property
    def losses(self) -> Array:
        """Change (K,) of the logarithm of the tension across each cell, of a tendon on the -X side."""
        return np.asarray(self._setup.tendons.friction * self._turned * self.states)

    def _shares(self, arm: float) -> tuple[Array, Array]:
        """Change of a tendon's tension across each cell, and its mean tension there per that at the base."""
        losses = math.copysign(1.0, arm) * self.losses
        return losses, np.exp(-(np.cumsum(losses) - 0.5 * losses)) * (1.0 + losses**2 / 24.0)

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
            losses, mean = self._shares(arm)
            moment += arm * tension * mean[cell] * (1.0 - losses[cell] * across)
        return np.asarray(moment * channel.shape(s))


class DryBending:
    """The cells of a finger with dry friction in bending, and the moment in each.

    ``states`` (K,) go cell after cell, branch by branch; None: of a finger that was bent from rest on.
    """

    def __init__(self, setup: FingerSetup, shape: FingerShape, states: Array | None = None) -> None:
        branches = setup.finger.damping.dry_friction
        self._shape = shape
        self._profile = setup.finger.profile
        self._stiffness = np.array([branch.stiffness for branch in branches])
        self._most = np.array([branch.moment for branch in branches])
        parts = [np.linspace(a, b, setup.bending_cells + 1)[:-1] for a, b in pairwise(shape.joints)]
        self.edges = np.append(np.concatenate(parts), shape.joints[-1])
        self.states = self.pulled if states is None else states

    @cached_property
    def _cells(self) -> tuple[Array, Array]:
        """Mean curvature (C,) above rest of each cell [1/m], and its harmonic mean stiffness per that at the base."""
        s, weights, cell = cell_nodes(self.edges, self._profile.breaks)
        stiffness = self._profile.bending_stiffness
        widths = np.diff(self.edges)
        softness = weights * stiffness(np.zeros(1)) / stiffness(s)
        return np.bincount(cell, weights * self._shape.elastic(s)) / widths, widths / np.bincount(cell, softness)

    @cached_property
    def pulled(self) -> Array:
        """States (K,) of a finger that was bent from its shape at rest on."""
        return np.asarray(np.clip(self._stiffness / self._most * self._cells[0][:, None], -1.0, 1.0).ravel())

    @cached_property
    def moments(self) -> Array:
        """Moment (C,) of each cell against the bending [N m]."""
        return np.asarray(np.reshape(self.states, (-1, self._most.size)) @ self._most * self._cells[1])

    def moment(self, s: Array) -> Array:
        """Moment (G,) against the bending at positions [m]."""
        return np.asarray(self.moments[np.clip(np.searchsorted(self.edges, s) - 1, 0, self.edges.size - 2)])

    @property
    def couples(self) -> list[tuple[float, float]]:
        """Places [m] and couples [N m] that exert on an elastic rod what this friction does."""
        return list(zip(self.edges[1:].tolist(), np.diff(np.append(self.moments, 0.0)).tolist(), strict=True))

    @property
    def sticking(self) -> Array:
        """Stiffness (C,) against the turn of a cell of the branches that stick, of a finger bent from rest on [N m]."""
        sticks = np.abs(self.pulled.reshape(-1, self._most.size)) < 1.0
        return np.asarray(sticks @ self._stiffness * self._cells[1] / np.diff(self.edges))


def friction_of(
    setup: FingerSetup, shape: FingerShape, states: Array | None = None
) -> tuple[TendonFriction | None, DryBending | None]:
    """Friction of the tendons and in bending, None where there is none; ``states`` (K,) belong to the tendons, then
    to the bending, None: of a finger that was pulled from its shape at rest on.
    """
    count = setup.tendon_friction_states
    of_tendons, of_bending = (None, None) if states is None else (states[:count], states[count:])
    tendons = TendonFriction(setup, shape, of_tendons) if count else None
    return tendons, DryBending(setup, shape, of_bending) if setup.bending_cells else None


def extreme_states(fingers: Iterable[tuple[FingerSetup, FingerShape]]) -> Array:
    """States (S, K) of fingers with friction that were pulled all along, and released, then of some pulled and others
    released.
    """
    both = (friction_of(setup, shape) for setup, shape in fingers)
    pulled = [
        np.concatenate([np.where(each.pulled < 0.0, -1.0, 1.0) for each in pair if each is not None]) for pair in both
    ]
    ways = sorted(product((1.0, -1.0), repeat=len(pulled)), key=lambda way: len(set(way)))
    return np.array([np.concatenate([w * states for w, states in zip(way, pulled, strict=True)]) for way in ways])


def state_cells(scene: GraspScene) -> list[NDArray[np.bool_]]:
    """Groups of friction states (K,) of all fingers that turn together: of one cell of the tendons, or all branches of
    one cell in bending.
    """
    cells: list[list[int]] = []
    for setup in (setup for setup in scene.setups if setup.name in scene.state_columns):
        columns = scene.state_columns[setup.name]
        bending = columns.start + setup.tendon_friction_states
        branches = max(len(setup.finger.damping.dry_friction), 1)
        cells += [[k] for k in range(columns.start, bending)]
        cells += [[*range(k, k + branches)] for k in range(bending, columns.stop, branches)]
    size = max((columns.stop for columns in scene.state_columns.values()), default=0)
    return [np.isin(np.arange(size), cell) for cell in cells]
