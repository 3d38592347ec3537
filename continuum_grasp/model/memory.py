"""Friction with a memory: states that slide at the end of their range, in motion, at rest and in implicit steps.

A state z follows how far something slides, per that from which on friction is full, as a stop operator does (M. A.
Krasnosel'skii, A. V. Pokrovskii, 1989, doi:10.1007/978-3-642-61302-9): loops close, nothing creeps at rest, and small
cycles of the load do not add up.

    z' = u' - (z - clip(z)) / time

The time is a share of the finger's own (`RETURN_SHARE`), so that fingers of all sizes lose equally little of their
friction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.model.planar import Scalar

RETURN_SHARE = 1.0 / 64.0
"""Time in which a friction state comes back to its range, per the rod's natural time [1]: 1.2 ms of a hand's finger of
180 mm, about one over the fastest frequency of two clothoids, so that steps are no shorter for it."""


@dataclass(frozen=True)
class Memory:
    """Knowledge of friction states: the one place that tells motion, rest and implicit steps apart.

    ``moved`` is a number h for a finger at rest. h = 1: states change to ``clip(z + u)`` with the sliding u since the
    unloaded shape, and friction acts as in a motion; zero states mean a finger that slid one way from its unloaded
    shape. h = 0: the states are the directions of friction, which are constant. ``part`` [s]: implicit part of a step.
    ``return_time`` [s]: time in which states return to their range. ``rounding``: width of the corners of the clip of a
    finger at rest, for second derivatives; 0: none.
    """

    return_time: float
    moved: Scalar | None = None
    part: Scalar = 0.0
    rounding: float = 0.0

    @staticmethod
    def clipped(z: Scalar) -> Scalar:
        """A state within its range."""
        return ca.fmin(ca.fmax(z, -1.0), 1.0)

    @staticmethod
    def direction(z: Scalar) -> Scalar:
        """Direction of tendon friction, from -1 to 1, for a state of a motion, with a continuous slope."""
        eased: Scalar = Memory.eased(Memory.clipped(z))
        return eased

    @staticmethod
    def eased(y: Any, share: Scalar = 1.0) -> Any:
        """A state within its range, a scalar or an array, moved by a share towards the cubic with flat ends."""
        half = 0.5 * share
        return y * ((1.0 + half) - half * (y * y))

    @staticmethod
    def state_of(way: NDArray[np.float64]) -> NDArray[np.float64]:
        """States of a motion under which tendon friction acts in ways from -1 to 1: the inverse of ``direction``."""
        return np.asarray(2.0 * np.sin(np.arcsin(way) / 3.0))

    def ways(
        self,
        states: Sequence[Scalar],
        travel: Callable[[], Sequence[Scalar]],
        *,
        eased: bool = False,
    ) -> list[Scalar]:
        """Directions of friction, from -1 to 1: the clipped states or, with ``eased``, their cubic."""
        moved: Scalar = 1.0
        given = states
        if self.moved is not None:
            moved = self.moved
            states = [z + moved * slid for z, slid in zip(states, travel(), strict=True)]
        limited = [self._limited(z) for z in states]
        if self.rounding:
            # Directions that are given reach 1, which rounded corners do not.
            pairs = zip(limited, given, strict=True)
            limited = [moved * y + (1.0 - moved) * self.clipped(z) for y, z in pairs]
        # Directions that are given and constant have no flat ends, at which a search over them would stop.
        return [self.eased(y, moved) for y in limited] if eased else limited

    def _limited(self, z: Scalar) -> Scalar:
        """A state within its range, with rounded corners."""
        if self.rounding == 0.0:
            return self.clipped(z)
        square = self.rounding * self.rounding
        upper, lower = z + 1.0, z - 1.0
        return 0.5 * (ca.sqrt(upper * upper + square) - ca.sqrt(lower * lower + square))

    def rate(self, z: Scalar, sliding: Scalar) -> Scalar:
        """Rate of a state [1/s] of a sliding [1/s]."""
        # What is beyond its range returns to it within an implicit step.
        pole = 1.0 / self.return_time
        return self._returning(sliding - (z - self.clipped(z)) * pole, pole, ca.fabs(z) > 1.0)

    def fading(self, z: Scalar, driven: Scalar, pole: Scalar) -> Scalar:
        """Rate of a state that follows what drives it, and fades with a pole [1/s]."""
        return self._returning(driven - pole * z, pole, 1.0)

    def _returning(self, rate: Scalar, pole: Scalar, where: Scalar) -> Scalar:
        if isinstance(self.part, float) and self.part == 0.0:
            return rate
        return rate / (1.0 + self.part * pole * where)


@dataclass(frozen=True)
class Instant:
    """State of a finger as laws see it: lengths of the elements [m], full coordinates and their rates, knowledge of
    friction states, and states and inputs by name and unit.
    """

    lengths: Sequence[Scalar]
    full: Sequence[Scalar]
    rates: Sequence[Scalar]
    memory: Memory
    named: Mapping[str, Scalar] = field(default_factory=dict)
