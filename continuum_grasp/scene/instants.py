"""Order the instants of a log: sort late rows, refuse two runs in one log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate

from continuum_grasp.base import InputError

_RUN = 10
"""Least number of consecutive rows in order that form a separate run: network queues delay messages by a few places,
and a shuffled table has ten rows in order once in 10! = 3.6 million rows."""


def in_order(instants: Sequence[float], rows: str, refused: Callable[[str, int], InputError]) -> tuple[list[int], str]:
    """Return the order (K,) that sorts instants (K,), and a note about it; the note is empty if they are in order.

    Equal instants remain in the order of the log. If a second run overlaps the instants of the first, sorting would mix
    them: the function raises the error that ``refused`` makes from a message and the number of the row.
    """
    count = len(instants)
    order = sorted(range(count), key=instants.__getitem__)
    late = sum(instant < latest for instant, latest in zip(instants, accumulate(instants, max), strict=True))
    if not late:
        return order, ""
    again = _second_run(instants, order)
    if again is not None:
        message = f"a second run begins at number {again + 1} of {count} {rows}, within the time of the first"
        raise refused(f"{message}; expected one run: give each run a file of its own", again)
    return order, f"{late} of {count} {rows} come after later ones: sorted by their instants"


def _second_run(instants: Sequence[float], order: Sequence[int]) -> int | None:
    """Find the first row of a second run whose instants overlap with the rows before; None without one."""
    count = len(instants)
    begins = [k for k in range(1, count) if instants[k] < instants[k - 1]]
    rank = dict(zip(order, range(count), strict=True))
    for begin, end in zip(begins, [*begins[1:], count], strict=True):
        # Sorting moves a row up by at most the number of later instants before it.
        if end - begin < _RUN or begin - rank[begin] < _RUN:
            continue
        first, last = instants[begin], instants[end - 1]
        before = instants[:begin]
        latest = max(before)
        inside = sum(first <= instant <= last for instant in before)
        if inside >= _RUN and sum(instants[k] <= latest for k in range(begin, end)) >= _RUN:
            return begin
    return None
