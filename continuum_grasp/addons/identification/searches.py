"""Searches for the best fit: from other starts, before a misfit says that the data are wrong, and under other
laws, by what they predict of data that they were not fitted to.

A start ten times off can end at a local minimum, in another period of a vibration or where a load bends nothing. Its
residuals look like a mistake in the data:

1. Where a fit misses a part of what the measurements scatter, beyond their deviations, it may be such a minimum.
2. Starts are scanned over three decades, one parameter after the other, twice; the best, and those that were best
   before, are searched from.
3. A search ends where its first steps lead to no lower sum of squares than there is; a lower end is taken.

A law with more numbers always fits better. What counts is the error of rows and motions that are held out. Of laws
whose errors differ by less than their scatter the one with the fewest numbers is taken, and the others are named (rule
of one standard error; L. Breiman et al., 1984).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.inference import middle
from continuum_grasp.addons.identification.plausibility import misfits
from continuum_grasp.addons.identification.problem import FitProblem, Solution
from continuum_grasp.base import Array, InputError, NumericalError, SolverError

_FACTORS = tuple(10.0 ** (k / 2) for k in range(-3, 4) if k)
"""Factors on a start value [1], 0.03 to 30: half decades, from which searches over stiffness, mass and damping of rods
converge."""
_LESS = 0.99
"""Sum of squares per sum of the first fit [1] below which another minimum is lower, not the same one less exactly."""
_MISSED = 0.1
"""Misfit per scatter of the measurements about their means [1] up to which a minimum is taken for the least: what small
errors of the model leave, such as a hundredth of the motion, has no better start, and the search would take minutes."""
_SURE = 0.975
"""Probability, to one side, from which a difference of errors tells two laws apart [1]."""


def may_be_local(problem: FitProblem, solution: Solution) -> bool:
    """Whether a fit misses so much of the measurements, beyond their stated deviations, that it may be another minimum
    than the least.
    """
    return any(off.rms > max(_MISSED * off.scatter, off.stated) for off in misfits(problem, solution.predictions))


def restarted(problem: FitProblem, first: Solution | None) -> Solution | None:
    """The fit with the least sum of squares from other starts, where it is below the ``first`` sum; else the first fit.

    Predictions are followed from there afterwards.
    """
    best = first
    least = math.inf
    followed = problem.followed
    if first is not None:
        least = _LESS * problem.misfit(first.values)
    scaled = np.array([unknown.start > 0.0 and unknown.lower >= 0.0 for unknown in problem.unknowns])
    # 3: starts that are searched from: the best of the scan, and those before that were best for a time. A dozen steps
    # tell whether they lead anywhere lower: real data are missed by more than a tenth in their least minimum, too.
    for start in _scanned(problem, scaled)[-3:][::-1]:
        if best is not None and _near(start[scaled], best.values[scaled]):
            continue
        with suppress(SolverError, NumericalError):
            solution = problem.solve(lambda share: None, start, least)
            total = problem.misfit(solution.values)
            if total < least:
                best = solution
                least = _LESS * total
                followed = problem.followed
    problem.followed = followed  # shapes that buckled elsewhere do not lead back to these
    return best


def _near(start: Array, values: Array) -> bool:
    """Whether a start is one step of the scan from values, from which a search only comes back."""
    apart = np.abs(np.log10(start.clip(1e-300) / values.clip(1e-300)))
    return bool((apart <= 0.5).all())


def _scanned(problem: FitProblem, scaled: NDArray[np.bool_]) -> list[Array]:
    """Starts (n,), each of a lower sum of squares than that before, of parameters that are ``scaled``: angles and
    offsets have no decades.
    """
    from scipy.stats import qmc

    about = np.array([unknown.start for unknown in problem.unknowns])
    lower = np.array([unknown.lower for unknown in problem.unknowns])
    upper = np.array([unknown.upper for unknown in problem.unknowns])
    starts = list[Array]()
    least = problem.misfit(about, early=True)
    chosen = np.flatnonzero(scaled)

    def take_best(factors: Array, columns: NDArray[np.intp]) -> None:
        nonlocal about, least
        trials = np.tile(about, (len(factors), 1))
        trials[:, columns] *= factors
        trials = trials.clip(lower, upper)
        totals = [problem.misfit(trial, early=True) for trial in trials]
        if min(totals) < least:
            about = trials[int(np.argmin(totals))]
            least = min(totals)
            starts.append(about)

    if chosen.size > 1:
        # 5: power of two of starts with all parameters off at once: where friction and slack are both too large,
        # nothing moves, and no change of one of them is seen
        spread = 2.0 * qmc.Sobol(chosen.size, scramble=False).random_base2(5) - 1.0
        take_best(max(_FACTORS) ** spread, chosen)
    # 2: passes over all parameters: the first finds those that the data see most, the second the others beside them
    for k in np.tile(chosen, 2):
        take_best(np.array(_FACTORS)[:, None], np.array([k]))
    return starts


class LawTrial(NamedTuple):
    """A law and its errors, r.m.s. per standard deviation: of what it was fitted to, and of what was held out."""

    name: str
    numbers: int
    """Numbers that all sets share and that were estimated."""
    fitted: float
    held_out: float
    verdict: str
    """``chosen``, ``alike`` (the data cannot tell it from the chosen one), ``worse``, or why it could not be fitted."""


def choose_law(
    candidates: Mapping[str, FitProblem], report: Callable[[float], None]
) -> tuple[str, Solution, tuple[LawTrial, ...]]:
    """Name and fit of the law that is chosen, of problems by the names of laws, and how all of them did.

    InputError if there is nothing to hold out, SolverError if no law can be fitted.
    """
    any_of = next(iter(candidates.values()))
    if any_of.fitted.all():
        raise InputError("laws are compared by their predictions: hold out rows or a set", key="laws")
    fits = dict[str, Solution]()
    verdicts = dict[str, str]()
    for k, (name, problem) in enumerate(candidates.items()):
        try:
            fits[name] = problem.solve(lambda share: None)
        except (SolverError, NumericalError) as error:
            verdicts[name] = f"not fitted: {error}"
        report((k + 1) / len(candidates))
    if not fits:
        failed = [*verdicts.values()]
        raise SolverError("no law could be fitted", status="no fit", violated=failed, advice="fit them one by one")
    sigma = np.min([fit.sigma for fit in fits.values()], axis=0)
    squares = {name: ((fit.predictions - any_of.measured) / sigma) ** 2 for name, fit in fits.items()}

    def root_means(rows: NDArray[np.bool_]) -> dict[str, float]:
        of_fits = {name: float(np.sqrt(np.mean(of[rows]))) for name, of in squares.items()}
        return dict.fromkeys(candidates, math.inf) | of_fits

    within = root_means(any_of.fitted)
    errors = root_means(~any_of.fitted)
    best = min(fits, key=lambda name: errors[name])
    alike = [name for name in fits if name == best or not _differ(any_of, squares[name] - squares[best])]
    chosen = min(alike, key=lambda name: (candidates[name].shared, errors[name]))
    verdicts |= {name: "alike" if name in alike else "worse" for name in fits} | {chosen: "chosen"}
    trials = tuple(
        LawTrial(name, problem.shared, within[name], errors[name], verdicts[name])
        for name, problem in candidates.items()
    )
    return chosen, fits[chosen], trials


def _differ(problem: FitProblem, more: Array) -> bool:
    """Whether squared errors of one law surely exceed, by ``more`` (m,), the errors of another, of hold-outs."""
    from scipy.special import stdtrit

    # readings of one row or instant depend on one another
    rows_of = [
        more[part].reshape(of.values.shape)[~of.fitted].sum(axis=1)
        for of, part in zip(problem.sets, problem.slices, strict=True)
    ]
    every = np.concatenate(rows_of)
    variance = 0.0
    freedom = 0.0
    for rows in rows_of:
        if rows.size:  # about the mean of all: a set may have one row
            spread, worth = middle(np.ones((rows.size, 1, 1)), (rows - every.mean())[:, None])
            variance = variance + float(spread[0, 0])
            freedom = freedom + worth
    return freedom > 2.0 and float(every.sum()) > float(stdtrit(freedom - 1.0, _SURE)) * math.sqrt(variance)
