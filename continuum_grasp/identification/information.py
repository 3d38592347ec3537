"""Fisher's information of experiments, and the experiments that tell most about what is unknown.

Readings whose derivatives by the unknowns are J, per standard deviation, have the information J^T J: of independent
experiments it adds up, and its inverse is the least covariance that estimates can have (C. R. Rao, 1945). Shapes at
rest, parts of a motion, and what is measured or known already are summed alike.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arrays import Array


def information(jacobian: Array, sizes: Array) -> Array:
    """Information (..., n, n) of readings whose derivatives (..., readings, n) are per deviation, per typical size."""
    scaled = jacobian * sizes
    return np.asarray(np.einsum("...ri,...rj->...ij", scaled, scaled))


def allotted(
    each: Array, known: Array, shared: int, budgets: Sequence[tuple[NDArray[np.intp], int]]
) -> NDArray[np.intp]:
    """Choose how often (E,) each experiment is made, so that the variances of the first unknowns have the least sum.

    Experiments are added one by one, the best one first, and then exchanged in pairs as long as that helps (V. Fedorov,
    1972, for the A-criterion). ``each`` (E, n, n) is the information of every experiment, once, ``known`` (n, n) that
    there is already. The first ``shared`` unknowns count; the others are those of single sets. ``budgets`` are numbers
    (K,) of experiments that share one, and how many of them may be made in all.
    """
    # 1e3: standard deviation, per typical size, with which an unknown is known before anything is measured: so wide
    # that it tells nothing, and the information has an inverse from the first experiment on
    counts, total = np.zeros(len(each), dtype=np.intp), known + np.eye(len(known)) / 1e3**2

    def variance(matrices: Array) -> Array:
        return np.asarray(np.einsum("...ii->...", np.linalg.inv(matrices)[..., :shared, :shared]))

    def best(members: NDArray[np.intp], without: Array) -> tuple[float, int]:
        sums = variance(without + each[members])
        k = int(np.argmin(sums))
        return float(sums[k]), int(members[k])

    for members, budget in budgets:
        for _ in range(budget):
            _, pick = best(members, total)
            counts[pick] += 1
            total = total + each[pick]
    reached, exchanged = float(variance(total)), True
    while exchanged:
        exchanged = False
        for members, _ in budgets:
            for pick in members[counts[members] > 0]:
                variance_sum, other = best(members, total - each[pick])
                # 1e-9: relative decrease of the sum of variances from which an exchange is made: above the rounding of
                # the inverses
                if variance_sum < (1.0 - 1e-9) * reached:
                    counts[pick] -= 1
                    counts[other] += 1
                    total, reached, exchanged = total - each[pick] + each[other], variance_sum, True
    return counts
