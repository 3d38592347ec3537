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
class Moment:
    """An instant of a closed loop: time since the phase began [s], plant, last command."""

    t: float
    plant: Any
    command: Any


@dataclass(frozen=True)
class Phase:
    """A part of a closed loop with its own setpoints.

    Attributes
    ----------
    rows : callable
        Setpoints (T, nr) at instants (T,) since the phase began [s].
    duration, until : float, callable
        Longest time [s], and whether the phase is over before that; while this is open, the horizon sees it go on.
    p : (np,) ndarray, optional
        Parameters of the controller in this phase; nominal where not given.
    begin : callable, optional
        Called with controller and plant when the phase begins: to change weights, to let something go.
    """

    name: str
    rows: Callable[[Array], Array]
    duration: float = math.inf
    until: Callable[[Moment], bool] | None = None
    p: Array | None = None
    begin: Callable[[Any, Any], None] | None = None


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
        """The present phase."""
        return self.phases[self.current]

    @property
    def duration(self) -> float:
        """Longest time of all phases [s]."""
        return sum(phase.duration for phase in self.phases)

    def enter(self, t: float, controller: Any, plant: Any, phase: int = 0) -> None:
        """Begin a phase, at first the first one."""
        self.current, self.start = phase, t
        if len(self.phases) > 1:
            self.events.append((t, self.phase.name))
        if self.phase.begin is not None:
            self.phase.begin(controller, plant)

    def advance(self, t: float, controller: Any, plant: Any, command: Any) -> bool:
        """Begin the next phase where the present one is over, and the one after it where that is over at once; False
        after the last.
        """
        while self._over(t, plant, command):
            if self.current + 1 == len(self.phases):
                return False
            self.enter(t, controller, plant, self.current + 1)
        return True

    def _over(self, t: float, plant: Any, command: Any) -> bool:
        phase, since = self.phase, t - self.start
        # Times are sums of rounded periods.
        over = since > phase.duration * (1 - 1e-9) - 1e-9
        return over or (phase.until is not None and phase.until(Moment(since, plant, command)))

    def rows(self, t: Array) -> Array:
        """Setpoints (T, nr) as they are foreseen now at instants (T,) [s]."""
        k, start = self.current, self.start
        rows = self.phases[k].rows(t - start)
        # What ends at a time is foreseen; what ends at an event is foreseen to go on.
        while self.phases[k].until is None and k + 1 < len(self.phases):
            start, k = start + self.phases[k].duration, k + 1
            later = t >= start - 1e-9
            if not np.any(later):
                break
            rows[later] = self.phases[k].rows(t[later] - start)
        return rows
