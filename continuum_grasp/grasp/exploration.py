"""Record of a search: basins of the estimated tension, and the record of all that was tried."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from continuum_grasp.grasp.starts.values import Start


@dataclass
class Basin:
    """A basin of the estimated tension, whether it was tried, and whether a verified grasp was found from it."""

    start: Start
    tried: bool = False
    solved: bool = False


@dataclass(frozen=True)
class Exploration:
    """Record of a search.

    Attributes
    ----------
    modes, sampled : int
        Sets of contacts, and those of whose postures samples were tried: the others are scanned.
    places, postures : int
        Places of contacts on the object that were scanned, and touching postures there whose forces were balanced.
    basins : int
        Minima of the estimated tension among these.
    starts_solved, starts_failed : int
        Starts of the solver that led to a verified grasp, and the others. A failure proves nothing.
    open : int
        Basins without a verified grasp that are estimated to take at least 2 % less tension than the result; of fingers
        with more than two elements, whose tension the estimates do not tell, those that were not tried.
    best_open : float
        Least of their estimates [N]; NaN where there is none.
    pruned : dict of str to int
        Starts that were not tried, by the reason.
    """

    modes: int = 0
    sampled: int = 0
    places: int = 0
    postures: int = 0
    basins: int = 0
    starts_solved: int = 0
    starts_failed: int = 0
    open: int = 0
    best_open: float = math.nan
    pruned: dict[str, int] = field(default_factory=dict)
