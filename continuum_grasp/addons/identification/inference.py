"""Inference about parameters from least squares: deviations, intervals, combinations that the data cannot see.

Least squares weigh all rows as if they were independent. Where residuals follow one another in time and are correlated,
the estimates scatter by the sandwich B M B, with B = (J^T J)^-1 and M = J^T G J, where G is the covariance of the
residuals: here their own autocovariance, of all readings of a motion with each other, tapered by Parzen's window (E.
Parzen, 1957), which leaves M without negative variances (W. K. Newey, K. D. West, 1987, doi:10.2307/1913610).

Before anything is measured, J^T J is Fisher's information: of independent experiments it adds up, and its inverse is
the least covariance that estimates can have (C. R. Rao, 1945). Shapes at rest, parts of a motion, and prior
knowledge are summed alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.unknowns import Unknown
from continuum_grasp.base import Array

FALSE_ALARMS = 2e-3
"""Probability with which noise alone makes a single verdict [1]: the four of them then make one in 1 % of data sets."""
_BLIND = 1e-7
"""Singular value, relative to the largest, below which a direction is not seen at all [1]: a digit above the error of
the derivatives, which is below 1e-8."""
_PART = 1e-3
"""Component of a parameter in such a direction from which it is not seen either [1]: smaller ones are rounding of the
singular vectors."""
WEAK = 0.5
"""Standard deviation, relative to the size, from which a parameter is hardly seen [1]: its 95 % interval then reaches
zero."""
_TINY = float(np.finfo(float).tiny)
"""In place of zero in a denominator."""


class Inference(NamedTuple):
    """Uncertainty of the n parameters; infinite where the data do not see them."""

    deviations: Array
    intervals: Array
    """(n, 2), 95 %, by Student's t."""
    correlation: Array
    singular_values: Array
    """(n,), of the Jacobian in standard deviations of the data per typical size of the parameters."""
    freedom: float
    warnings: tuple[str, ...]


def infer(
    unknowns: Sequence[Unknown],
    values: Array,
    jacobian: Array,
    residuals: Array | None,
    series: Sequence[NDArray[np.intp]] = (),
) -> Inference:
    """Uncertainty at the minimum, from the weighted residuals (m,) of what was fitted and their Jacobian (m, n).

    The mean square of the residuals scales the covariance. Warnings leave out the unknowns of single sets, the last
    ones. Each of ``series`` has the rows (T, readings) that follow one another in time, whose residuals may be
    correlated: they count as fewer numbers then. Without residuals, before anything is measured, they scatter as
    stated.
    """
    from scipy.special import stdtrit

    count = jacobian.shape[1]
    rows = len(jacobian)
    sizes = np.array([unknown.typical for unknown in unknowns])
    # with fewer rows than parameters, the full basis has the directions that no row sees
    _, singular, directions = np.linalg.svd(jacobian * sizes, full_matrices=rows < count)
    singular = np.append(singular, np.zeros(count - len(singular)))
    blind = singular <= _BLIND * max(float(singular[0]), _TINY)
    seen = directions[~blind]
    unseen = directions[blind]
    lost = np.any(np.abs(unseen) > _PART, axis=0)
    covariance = np.full((count, count), np.inf)
    spread = np.full(count, np.inf)
    quantile = np.inf
    # the pseudo-inverse of J^T J: a direction that is not seen has no finite variance, and is reported as such
    inverse = seen.T @ (seen / singular[~blind, None] ** 2)
    if residuals is None:
        independent = math.inf
        scattered = inverse
        freedom = math.inf
    else:
        independent, scattered, freedom = _independent(jacobian * sizes, residuals, inverse, series)
    if freedom > 0:
        # as the parameters take of the sum of squares
        covariance = scattered / (1.0 - count / independent)
        spread = np.sqrt(np.diag(covariance))
        quantile = float(stdtrit(freedom, 0.975))
    spread[lost] = np.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = covariance / np.outer(spread, spread)
    correlation[~np.isfinite(correlation)] = np.nan
    correlation[lost[:, None] | lost] = np.nan
    np.fill_diagonal(correlation, 1.0)
    deviations = spread * sizes
    reach = quantile * deviations
    intervals = np.stack([values - reach, values + reach], axis=1)
    reported = [unknown for unknown in unknowns if unknown.per != "set"]
    warnings = _blindness(unknowns, unseen, jacobian * sizes, len(reported))
    warnings += _weakness(reported, values, deviations, correlation, lost)
    warnings += [
        f"{unknown.name} is at its bound of {value:g} {unknown.unit}: its interval means little"
        for unknown, value, gone in zip(reported, values, lost, strict=False)
        if not gone and (value <= unknown.lower or value >= unknown.upper)
    ]
    warnings += [
        f"{unknown.name} comes out negative ({value:.2g}), but friction cannot: the finger bends more toward its tip "
        "than the model, which has too few elements or a wrong law of stiffness"
        for unknown, value, deviation in zip(reported, values, deviations, strict=False)
        if unknown.target == "tendon_friction" and value < -surely(freedom) * deviation
    ]
    if freedom <= 0:
        numbers = f"{rows} fitted numbers" + (f", correlated, that count as {independent:.0f}," if series else "")
        warnings.append(f"{numbers} for {count} parameters: too few to estimate their uncertainty")
    return Inference(deviations, intervals, correlation, singular, freedom, tuple(warnings))


def _independent(
    jacobian: Array, residuals: Array, inverse: Array, series: Sequence[NDArray[np.intp]]
) -> tuple[float, Array, float]:
    """Number of independent numbers that the rows count as, covariance (n, n) before the parameters are paid for, and
    degrees of freedom.

    The parameters take of the sum of squares what the covariance of the residuals has in their directions: n mean
    squares where the rows are independent, more where they are correlated.
    """
    rows, count = jacobian.shape
    total = float(residuals @ residuals)
    apart = np.ones(rows, dtype=bool)
    freedom = 0.0
    middles = np.zeros((count, count))
    for entries in series:
        product, own_freedom = middle(jacobian[entries], residuals[entries])
        middles, freedom, apart[entries] = middles + product, freedom + own_freedom, False
    middles += total / rows * jacobian[apart].T @ jacobian[apart]
    scattered = inverse @ middles @ inverse
    paid = float(np.sum(inverse * middles))
    independent = count * total / paid if series and paid > 0.0 else float(rows)
    return independent, scattered, min(freedom + float(apart.sum()), independent - count)


def _blindness(unknowns: Sequence[Unknown], directions: Array, scaled: Array, shared: int) -> list[str]:
    """Parameters that the data do not see, alone or in the combinations (k, n) that no prediction changes with.

    What concerns none of the first ``shared`` ones is left out.
    """
    lengths = np.linalg.norm(scaled, axis=0)
    unseen = lengths <= _BLIND * max(float(lengths.max(initial=0.0)), _TINY)
    messages = [
        f"the data cannot see {unknown.name}: no prediction changes with it; its value is the start value"
        for unknown, gone in zip(unknowns[:shared], unseen, strict=False)
        if gone
    ]
    for direction in directions:
        parts = [int(k) for k in np.flatnonzero(np.abs(direction) > _PART) if not unseen[k]]
        if len(parts) > 1 and parts[0] < shared:
            names = " and ".join(unknowns[k].name for k in parts)
            ratio = ", ".join(f"{unknowns[k].name} by {100 * direction[k] / direction[parts[0]]:+.3g} %" for k in parts)
            messages.append(
                f"the data see only a combination of {names}: changing {ratio} (of typical sizes) changes no "
                "prediction; fix all but one of them"
            )
    return messages


def _weakness(
    unknowns: Sequence[Unknown], values: Array, deviations: Array, correlation: Array, lost: NDArray[np.bool_]
) -> list[str]:
    """Parameters that the data hardly see, or hardly distinguish."""
    messages = []
    for k, unknown in enumerate(unknowns):
        size = max(abs(float(values[k])), unknown.typical)
        if not lost[k] and np.isfinite(deviations[k]) and deviations[k] > WEAK * size:
            messages.append(
                f"the data hardly see {unknown.name}: its standard deviation is {deviations[k]:.2g} {unknown.unit}, "
                f"{100 * deviations[k] / size:.0f} % of its size"
            )
        for j in range(k):
            # 0.99: correlation from which two parameters can hardly be distinguished: each interval is then seven times
            # as wide as with the other known
            if np.isfinite(correlation[k, j]) and abs(correlation[k, j]) > 0.99:
                messages.append(
                    f"{unknowns[j].name} and {unknown.name} can hardly be distinguished: their estimates are "
                    f"correlated by {correlation[k, j]:+.4f}"
                )
    return messages


def surely(freedom: float = math.inf, chances: int = 1) -> float:
    """Student's t that noise exceeds, to either side, in one of so many chances with the probability of a verdict."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 1.0 - 0.5 * FALSE_ALARMS / chances))


def correlated(residuals: Array) -> tuple[int, float]:
    """Lag up to which residuals (T, readings) are correlated in time, 0 for noise, and how surely they are: the sum of
    their correlation over a span of lags per deviation of what noise makes of it.

    Spans double in length (G. Box and D. Pierce, 1970, test one): of a part that is slow and 0.3 of the noise, single
    lags show 0.08 alone.
    """
    count = len(residuals)
    variances = np.mean(residuals**2, axis=0)
    own = np.einsum("kii->ki", _autocovariance(residuals))[:, variances > 0.0] / variances[variances > 0.0]
    last = 0
    surest = 0.0
    end = 1
    while 4 * end <= count and own.size:
        span = own[end // 2 + 1 : end + 1]
        sure = abs(float(span.sum())) * math.sqrt(count / span.size)
        # 2.0: deviations from which a span counts: a window that noise makes too long costs degrees of freedom alone
        last = end if sure > 2.0 else last
        surest = max(surest, sure)
        end = 2 * end
    return last, surest


def middle(jacobian: Array, residuals: Array) -> tuple[Array, float]:
    """J^T G J (n, n) of one series, and its degrees of freedom.

    ``residuals`` are (T, readings), ``jacobian`` (T, readings, n).
    """
    from scipy.linalg import matmul_toeplitz

    count, readings, n = jacobian.shape
    last, _ = correlated(residuals)
    if last == 0:
        flat = jacobian.reshape(-1, n)
        return float(np.mean(residuals**2)) * flat.T @ flat, float(residuals.size)
    # 3.0: length of the window per lag at which the correlation ends: 90 % intervals then cover 0.83 to 0.90 for
    # residuals of five colors, 95 % ones 0.88 to 0.93 where 0.3 of white noise is slow, by 2.0 0.86; Parzen's window is
    # below a half from 0.36 of its length on
    length = min(3.0 * last + 1.0, float(count))
    tapered = _parzen(np.arange(count) / length)[:, None, None] * _autocovariance(residuals)
    total = np.zeros((n, n))
    for reading, other in np.ndindex(readings, readings):
        # G of the lags of both signs, those of one reading with the other
        lags = tapered[:, reading, other], tapered[:, other, reading]
        total += jacobian[:, reading].T @ matmul_toeplitz(lags, jacobian[:, other])
    # 3.71: degrees of freedom of a variance by Parzen's window, per length of the series over that of the window
    return 0.5 * (total + total.T), 3.71 * count / length


def _autocovariance(residuals: Array) -> Array:
    """Mean of r_i(t + lag) r_j(t), (lags, readings, readings), over T at all lags."""
    count = len(residuals)
    spectra = np.fft.rfft(residuals, 2 * count, axis=0)
    return np.fft.irfft(spectra[:, :, None] * spectra[:, None].conj(), 2 * count, axis=0)[:count] / count


def _parzen(x: Array) -> Array:
    near = 1.0 - 6.0 * x**2 + 6.0 * x**3
    far = 2.0 * np.maximum(1.0 - x, 0.0) ** 3
    return np.where(x <= 0.5, near, far)


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
    there is already. The first ``shared`` unknowns count; the others belong to single sets. ``budgets`` are numbers
    (K,) of experiments that share one, and how many of them may be made in all.
    """
    # 1e3: standard deviation, per typical size, with which an unknown is known before anything is measured: so wide
    # that it tells nothing, and the information has an inverse from the first experiment on
    counts = np.zeros(len(each), dtype=np.intp)
    total = known + np.eye(len(known)) / 1e3**2

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
    reached = float(variance(total))
    exchanged = True
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
                    total = total - each[pick] + each[other]
                    reached = variance_sum
                    exchanged = True
    return counts
