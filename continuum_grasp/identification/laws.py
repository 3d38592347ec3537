"""Laws that are tried one after the other, and chosen by what they predict of data that they were not fitted to.

A law with more numbers always fits better. What counts is the error of rows and motions that are held out. Of laws
whose errors differ by less than their scatter the one with the fewest numbers is taken, and the others are named (rule
of one standard error; L. Breiman et al., 1984).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple, cast

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError, NumericalError, SolverError
from continuum_grasp.identification.inference import middle
from continuum_grasp.identification.problem import Problem, Solution

_SURE = 0.975
"""Probability, to one side, from which a difference of errors tells two laws apart [1]."""


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
    candidates: Mapping[str, Problem], report: Callable[[float], None]
) -> tuple[str, Solution, tuple[LawTrial, ...]]:
    """Name and fit of the law that is chosen, of problems by the names of laws, and how all of them did.

    InputError if there is nothing to hold out, SolverError if no law can be fitted.
    """
    names, problems = list(candidates), list(candidates.values())
    if problems[0].fitted.all():
        raise InputError("laws are chosen by what they predict: hold rows or a set out", key="laws")
    fits, failed, fitted = list[Solution | None](), list[str](), problems[0].fitted
    for k, problem in enumerate(problems):
        solution, why = None, ""
        try:
            solution = problem.solve(lambda share: None)
        except (SolverError, NumericalError) as error:
            why = f"not fitted: {error}"
        fits.append(solution)
        failed.append(why)
        report((k + 1) / len(problems))
    sigma = np.min([fit.sigma for fit in fits if fit is not None], axis=0, initial=math.inf)
    missed = [None if fit is None else (fit.predictions - problems[0].measured) / sigma for fit in fits]
    squares = [np.full(len(fitted), math.inf) if off is None else off**2 for off in missed]
    within, errors = ([float(np.sqrt(np.mean(of[rows]))) for of in squares] for rows in (fitted, ~fitted))
    best = int(np.argmin(errors))
    if not math.isfinite(errors[best]):
        raise SolverError("no law could be fitted", status="no fit", violated=failed, advice="fit them one by one")
    numbers = [problem.shared for problem in problems]
    alike = [
        k
        for k, squared in enumerate(squares)
        if k == best or (fits[k] is not None and not _differ(problems[best], squared - squares[best]))
    ]
    chosen = min(alike, key=lambda k: (numbers[k], errors[k]))
    verdicts = [
        failed[k] or ("chosen" if k == chosen else "alike" if k in alike else "worse") for k in range(len(fits))
    ]
    trials = tuple(map(LawTrial._make, zip(names, numbers, within, errors, verdicts, strict=True)))
    return names[chosen], cast(Solution, fits[chosen]), trials


def _differ(problem: Problem, more: Array) -> bool:
    """Whether squared errors of one law are surely greater, by ``more`` (m,), than those of another, of hold-outs."""
    from scipy.special import stdtrit

    total, variance, freedom = 0.0, 0.0, 0.0
    for block, part, _ in problem.parts:
        differences, at = more[part], np.array([entry.at for entry in block.entries])
        there = ~problem.fitted[part]
        # readings of one row or instant depend on one another
        rows = np.array([differences[there & (at == instant)].sum() for instant in np.unique(at[there])])
        if rows.size:
            total += float(rows.sum())
            about = (rows - rows.mean())[:, None]
            spread, worth = middle(np.ones((rows.size, 1, 1)), about) if rows.size > 1 else (np.zeros((1, 1)), 1.0)
            variance, freedom = variance + float(spread[0, 0]), freedom + worth
    return freedom > 2.0 and total > float(stdtrit(freedom - 1.0, _SURE)) * math.sqrt(variance)
