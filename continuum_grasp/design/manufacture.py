"""Errors of manufacture: what the greatest ones make of a design, and which of them its search must consider."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from continuum_grasp.design.evaluation import DesignProblem, Evaluation, Signs
from continuum_grasp.design.grasps import LostGrasp
from continuum_grasp.design.result import WorstCase

HOLDS = 1e-6
"""Violation up to which a limit holds, as a part of it."""


def worst_cases(problem: DesignProblem, best: Evaluation) -> tuple[WorstCase, ...]:
    """Cost and limits at the worst combinations of errors: to first order, and as they are at the corners; none without
    tolerances. The grasps of the problem are those of the last corner then.
    """
    space = problem.space
    if not space.tolerated:
        return ()
    n = len(space.coordinates)
    nominal = [row for row in best.costs if not any(row.signs)]
    bound = max(row.value + float(np.abs(row.slope[n:]).sum()) for row in nominal)
    scenarios = problem.scenarios
    cases: list[WorstCase] = []
    for signs in _corners(problem, best):
        problem.scenarios = [signs]
        try:
            there = problem.evaluate(best.coordinates)
        except LostGrasp as error:
            cases.append(WorstCase(signs, np.inf, np.inf, bound, str(error)))
            continue
        cases.append(WorstCase(signs, there.cost, there.violation, bound, ""))
    problem.scenarios = scenarios
    return tuple(sorted(cases, key=lambda case: (-case.violation if case.violation > HOLDS else 0.0, -case.cost)))


def _corners(problem: DesignProblem, best: Evaluation) -> list[Signs]:
    """Combinations of greatest errors: all of them where these are few, else those that first order calls worst."""
    m, n = len(problem.space.tolerated), len(problem.space.coordinates)
    # 6: tolerated numbers up to which all combinations of their greatest errors are tried: 64
    if m <= 6:
        return [tuple(signs) for signs in product((-1.0, 1.0), repeat=m)]
    rows = [*(row.slope[n:] for row in best.costs), *(-row.slope[n:] for row in best.limits)]
    return list(dict.fromkeys(tuple(np.where(slope >= 0.0, 1.0, -1.0).tolist()) for slope in rows))


def worse_than_known(worst: Sequence[WorstCase], known: Sequence[Signs], best: Evaluation, same: float) -> list[Signs]:
    """The combination of errors with the greatest cost and that with the greatest violation, each where it is worse
    than the best design with those that are ``known``; costs closer than ``same`` are equal.
    """
    bad = [case for case in worst if case.signs not in known and np.isfinite(case.cost)]
    if not bad:
        return []
    costly, broken = max(bad, key=lambda case: case.cost), max(bad, key=lambda case: case.violation)
    change = max(abs(case.cost - best.cost) for case in bad)
    # 0.02: cost by which a combination of errors must exceed those at hand to count, as a part of what errors change
    add = [costly.signs] if costly.cost > best.cost + max(0.02 * change, same) else []
    return [*add, broken.signs] if broken.violation > max(best.violation, 0.0) + HOLDS else add
