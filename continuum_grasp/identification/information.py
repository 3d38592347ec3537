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
from continuum_grasp.identification.unknowns import Unknown


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


class Choice:
    """Experiments on unknowns, of which those are chosen that show most of the first ``shared``, those of all sets.

    ``values`` are those at which experiments are judged, ``rows`` (rows, n) the derivatives of what is known already,
    per standard deviation. ``made`` are numbers of those that are made, of what is ``offered``, as often as they are.
    """

    def __init__(self, unknowns: Sequence[Unknown], shared: int, rows: Array) -> None:
        self.unknowns, self.shared, self.rows = list(unknowns), shared, rows
        self.values, self._sizes = (
            np.array(column) for column in zip(*((v.start, v.typical) for v in unknowns), strict=True)
        )
        self.offered, self._cautious, self.made = list[Array](), list[Array](), list[int]()
        self._budgets = list[tuple[NDArray[np.intp], int]]()

    def offer(self, jacobians: Array, most: int) -> None:
        """Offer K experiments, of which so many are made, by their derivatives (values, K, readings, n).

        The first of the values are those that are assumed. An experiment is chosen by the values at which it shows
        least: a shape that is about to buckle is most sensitive, to what is assumed as well.
        """
        self._budgets.append((len(self.offered) + np.arange(jacobians.shape[1]), most))
        self.offered += list(jacobians[0])
        least = np.argmin(np.linalg.norm(jacobians * self._sizes, axis=(2, 3)), axis=0)
        self._cautious += list(jacobians[least, np.arange(least.size)])

    def choose(self, along: Sequence[Array]) -> None:
        """Choose among what is offered, beside what is read along a motion (readings, n)."""
        offered = np.array([information(jacobian, self._sizes) for jacobian in self._cautious])
        known = information(np.vstack([self.rows, *along]), self._sizes)
        counts = allotted(offered, known, self.shared, self._budgets)
        self.made = np.repeat(np.arange(counts.size), counts).tolist()
