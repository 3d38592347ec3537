"""Record of a search."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Exploration:
    """Record of a search.

    Attributes
    ----------
    modes : int
        Sets of contacts.
    starts_solved, starts_failed : int
        Starts that led to a grasp, and the others; a failure proves nothing.
    settled : int
        Starts that hold the object, or come near to that.
    untried : int
        Starts that were not solved.
    """

    modes: int = 0
    starts_solved: int = 0
    starts_failed: int = 0
    settled: int = 0
    untried: int = 0
