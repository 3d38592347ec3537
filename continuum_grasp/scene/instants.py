"""Order of instants in a log: rows that came late are sorted, two runs in one log are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import InputError

_RUN = 10
"""Rows in order from which they are a run of their own [1]: messages that queues of a network delay come late by a few
places, and a shuffled table has ten in order once in 10! = 3.6 million rows."""


def in_order(
    instants: NDArray[Any], rows: str, refused: Callable[[str, int], InputError]
) -> tuple[NDArray[np.intp], str]:
    """Order (K,) that sorts instants (K,), and what to report of it; empty where they are in order.

    Equal instants remain in the order of the log. Where a run begins while the instants of an earlier one go on,
    sorting would mix two runs: it raises what ``refused`` makes of a message and the number of the row.
    """
    order = np.argsort(instants, kind="stable")
    late = int(np.count_nonzero(instants < np.maximum.accumulate(instants))) if instants.size else 0
    if not late:
        return order, ""
    again = _second_run(instants, order)
    if again is not None:
        message = (
            f"a second run begins at number {again + 1} of {instants.size} {rows}, while instants of the run before"
        )
        raise refused(f"{message} go on; expected one run: give each run a file of its own", again)
    return order, f"{late} of {instants.size} {rows} come after later ones: sorted by their instants"


def _second_run(instants: NDArray[Any], order: NDArray[np.intp]) -> int | None:
    """Row at which a second run begins whose instants overlap with those before; None where there is none."""
    rank = np.empty(order.size, dtype=np.intp)
    rank[order] = np.arange(order.size)
    begins = np.flatnonzero(np.diff(instants) < 0) + 1
    ends = np.append(begins[1:], instants.size)
    # of the rows before a row, at least as many are later as it is moved up by sorting
    moved = begins - rank[begins]
    longs = (ends - begins >= _RUN) & (moved >= _RUN)
    for begin, end in zip(begins[longs], ends[longs], strict=True):
        before = instants[:begin]
        run = instants[begin:end]
        inside = np.count_nonzero((before >= run[0]) & (before <= run[-1]))
        if inside >= _RUN and np.count_nonzero(run <= before.max()) >= _RUN:
            return int(begin)
    return None
