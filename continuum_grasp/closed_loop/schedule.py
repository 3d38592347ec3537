"""Schedule of a closed loop, phase by phase."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError


@dataclass(frozen=True)
class Phase:
    """A part of a closed loop with its own setpoints.

    Attributes
    ----------
    rows : callable
        Setpoints (T, nr) at instants (T,) since the phase began [s].
    duration : float
        [s]
    """

    name: str
    rows: Callable[[Array], Array]
    duration: float = math.inf


@dataclass
class Schedule:
    """Phases one after the other: the index of the present one, when it began [s], and when each began."""

    phases: Sequence[Phase]
    current: int = 0
    start: float = 0.0
    events: list[tuple[float, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.phases:
            raise InputError("a closed loop needs one phase at least", key="schedule")

    @property
    def phase(self) -> Phase:
        return self.phases[self.current]

    @property
    def duration(self) -> float:
        """Time of all phases [s]."""
        return sum(phase.duration for phase in self.phases)

    def enter(self, t: float, controller: Any, plant: Any, phase: int = 0) -> None:
        """Begin a phase, at first the first one."""
        self.current, self.start = phase, t
        if len(self.phases) > 1:
            self.events.append((t, self.phase.name))

    def advance(self, t: float, controller: Any, plant: Any, command: Any) -> bool:
        """Begin the next phase where the present one is over, and the one after it where that is over at once; False
        after the last.
        """
        # Times are sums of rounded periods.
        while t - self.start > self.phase.duration * (1 - 1e-9) - 1e-9:
            if self.current + 1 == len(self.phases):
                return False
            self.enter(t, controller, plant, self.current + 1)
        return True

    def rows(self, t: Array) -> Array:
        """Setpoints (T, nr) at instants (T,) [s], those of later phases too."""
        k, start = self.current, self.start
        rows = self.phases[k].rows(t - start)
        while k + 1 < len(self.phases):
            start, k = start + self.phases[k].duration, k + 1
            later = t >= start - 1e-9
            if not np.any(later):
                break
            rows[later] = self.phases[k].rows(t[later] - start)
        return rows
