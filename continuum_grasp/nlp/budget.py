"""What a search may spend: iterations, so that a busy machine gives the same result; the clock is for emergencies."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from continuum_grasp.scene.solver import SolverOptions

__all__ = ["Budget"]


@dataclass
class Budget:
    """Iterations that are left, shared by all solver runs of a search.

    Attributes
    ----------
    left : float
        Iterations that may still be spent; a run spends one more than it reports, for its first evaluation.
    until : float
        ``time.monotonic()`` of the emergency stop [s].
    stopped : bool
        Whether the emergency stop cut something short.

    Examples
    --------
    >>> from continuum_grasp.nlp import Budget
    >>> budget = Budget(left=100)
    >>> with budget.share(60) as part:
    ...     part.left -= 11
    >>> budget.left, budget.over
    (89, False)
    """

    left: float = float("inf")
    until: float = float("inf")
    stopped: bool = False

    @classmethod
    def of(cls, options: SolverOptions) -> Budget:
        """The budget that a scene gives, from now on."""
        return cls(options.max_total_iterations, time.monotonic() + options.time_limit)

    @contextmanager
    def share(self, iterations: int | None) -> Iterator[Budget]:
        """Spend at most so many iterations (all that are left by default) on what runs in the block."""
        granted = min(iterations or self.left, self.left)
        part = Budget(granted + 1, self.until)
        try:
            yield part
        finally:
            self.left -= min(granted, granted + 1 - part.left)
            self.stopped |= part.stopped

    @property
    def late(self) -> bool:
        """Whether it is time for the emergency stop; who asks acts on it, so that it counts as one."""
        self.stopped |= time.monotonic() > self.until
        return self.stopped

    @property
    def over(self) -> bool:
        """Whether there is nothing left to spend, or the emergency stop came."""
        return self.left <= 0 or self.late

    @property
    def cut(self) -> str:
        """What cut the search short: ``clock``, ``iterations``, or nothing."""
        return "clock" if self.stopped else "iterations" if self.left <= 0 else ""
