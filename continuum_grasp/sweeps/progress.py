"""How far a sweep is, how fast it goes, and how long it will take."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

_WINDOW = 60.0
"""Time over which the pace is averaged [s]: scenes of a grid differ in cost, neighbors do not."""


@dataclass(frozen=True)
class Progress:
    """Where a sweep stands.

    Attributes
    ----------
    done, total : int
        Rows in the table, and rows that there will be.
    new : int
        Rows of this call.
    seconds : float
        Since it began [s].
    rate : float
        Rows per second of the last minute; 0 before the first.
    remaining : float or None
        Time left at this rate [s].
    counts : mapping of str to int
        Rows by status.
    """

    done: int
    total: int
    new: int
    seconds: float
    rate: float
    remaining: float | None
    counts: Mapping[str, int]

    @property
    def text(self) -> str:
        """In words."""
        left = "" if self.remaining is None else f", {_clock(self.remaining)} left"
        kinds = ", ".join(f"{count} {status}" for status, count in sorted(self.counts.items()))
        return f"{self.done} of {self.total}, {self.rate:.3g}/s{left}" + (f" ({kinds})" if kinds else "")


class Pace:
    """Measures the rate over the last minute."""

    def __init__(self, total: int, done: int) -> None:
        self._total, self._first, self._began = total, done, time.monotonic()
        self._marks: deque[tuple[float, int]] = deque([(self._began, done)])

    def progress(self, done: int, counts: Mapping[str, int]) -> Progress:
        """The progress with so many rows."""
        now = time.monotonic()
        if self._marks[-1][1] == self._first < done:  # workers needed their time to start
            self._marks.clear()
        self._marks.append((now, done))
        while len(self._marks) > 2 and now - self._marks[0][0] > _WINDOW:
            self._marks.popleft()
        since, before = self._marks[0]
        rate = (done - before) / (now - since) if done > before and now > since else 0.0
        remaining = (self._total - done) / rate if rate > 0 else None
        return Progress(done, self._total, done - self._first, now - self._began, rate, remaining, dict(counts))


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
