"""Searches from other starts, before a fit that misses the data says that the data are wrong.

A start ten times off can end at a local minimum, in another period of a vibration or where a load bends nothing. Its
residuals look like a mistake in the data. So starts are scanned over three decades, one parameter after the other, and
the best of them are searched from.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arrays import Array
from continuum_grasp.errors import NumericalError, SolverError
from continuum_grasp.identification.problem import Problem, Solution

_FACTORS = tuple(10.0 ** (k / 2) for k in range(-3, 4) if k)
"""Factors on a start value [1], 0.03 to 30: half decades, from which searches over stiffness, mass and damping of rods
converge."""
_TOGETHER = 5
"""Power of two of starts with all parameters off at once [1]: where friction and slack are both too large, nothing
moves, and no change of one of them is seen."""
_PASSES = 2
"""Passes over all parameters [1]: the first finds those that the data see most, the second the others beside them."""
_STARTS = 3
"""Starts that are searched from [1]: the best of the scan, and those before that were best for a time."""
_LESS = 0.99
"""Sum of squares per that of the first fit [1] below which another minimum is lower, not the same one less exactly."""


def restarted(problem: Problem, first: Solution | None) -> Solution | None:
    """The fit with the least sum of squares from other starts, where it is below that of the ``first``; else that."""
    best, least = first, math.inf if first is None else _LESS * problem.misfit(first.values)
    scaled = np.array([unknown.start > 0.0 and unknown.lower >= 0.0 for unknown in problem.unknowns])
    for start in _scanned(problem, scaled)[-_STARTS:][::-1]:
        if best is not None and _near(start[scaled], best.values[scaled]):
            continue
        with suppress(SolverError, NumericalError):
            solution = problem.solve(lambda share: None, start)
            total = problem.misfit(solution.values)
            if total < least:
                best, least = solution, _LESS * total
    return best


def _near(start: Array, values: Array) -> bool:
    """Whether a start is one step of the scan from values, from which a search only comes back."""
    apart = np.abs(np.log10(start.clip(1e-300) / values.clip(1e-300)))
    return bool((apart <= 0.5).all())


def _scanned(problem: Problem, scaled: NDArray[np.bool_]) -> list[Array]:
    """Starts (n,), each of a lower sum of squares than that before, of parameters that are ``scaled``: angles and
    offsets have no decades.
    """
    from scipy.stats import qmc

    about = np.array([unknown.start for unknown in problem.unknowns])
    lower, upper = (np.array([getattr(unknown, key) for unknown in problem.unknowns]) for key in ("lower", "upper"))
    starts, least, chosen = list[Array](), problem.misfit(about, early=True), np.flatnonzero(scaled)

    def take_best(factors: Array, columns: NDArray[np.intp]) -> None:
        nonlocal about, least
        trials = np.tile(about, (len(factors), 1))
        trials[:, columns] *= factors
        trials = trials.clip(lower, upper)
        totals = [problem.misfit(trial, early=True) for trial in trials]
        if min(totals) < least:
            about, least = trials[int(np.argmin(totals))], min(totals)
            starts.append(about)

    if chosen.size > 1:
        spread = 2.0 * qmc.Sobol(chosen.size, scramble=False).random_base2(_TOGETHER) - 1.0
        take_best(max(_FACTORS) ** spread, chosen)
    for k in np.tile(chosen, _PASSES):
        take_best(np.array(_FACTORS)[:, None], np.array([k]))
    return starts
