"""What least squares tell about the parameters: standard deviations, intervals, and what the data cannot see.

A model with twice the elements says whether the model's own error matters beside these deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.identification.unknowns import Unknown
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.simulate import Scene

Array = NDArray[np.float64]

_BLIND = 1e-7
"""Singular value, relative to the largest, below which a direction is not seen at all [1]: a digit above the error of
the derivatives, which is below 1e-8."""
_PART = 1e-3
"""Component of a parameter in such a direction from which it is not seen either [1]: smaller ones are rounding of the
singular vectors."""
_WEAK = 0.5
"""Standard deviation, relative to the size, from which a parameter is hardly seen [1]: its 95 % interval then reaches
zero."""
_ALIKE = 0.99
"""Correlation [1] from which two parameters can hardly be distinguished: each interval is then seven
times as wide as with the other known."""
_TINY = 1e-300
"""In place of zero in a denominator."""
_MOST = 12
"""Elements beyond which a model is not refined to see its error: twice as many take far longer than the search."""


class Inference(NamedTuple):
    """Uncertainty of the n parameters; infinite where the data do not see them."""

    deviations: Array
    intervals: Array
    """(n, 2), 95 %, by Student's t."""
    correlation: Array
    singular_values: Array
    """(n,), of the Jacobian in standard deviations of the data per typical size of the parameters."""
    freedom: int
    warnings: tuple[str, ...]


def infer(
    unknowns: Sequence[Unknown], values: Array, jacobian: Array, residuals: Array, inflation: float = 1.0
) -> Inference:
    """Uncertainty at the minimum, from the weighted residuals (m,) of what was fitted and their Jacobian (m, n).

    The mean square of the residuals scales the covariance; ``inflation`` is a further factor, for a robust loss.
    """
    from scipy.special import stdtrit

    count, rows = len(unknowns), len(residuals)
    sizes = np.array([one.typical for one in unknowns])
    freedom = rows - count
    # with fewer rows than parameters, the full basis has the directions that no row sees
    _, singular, directions = np.linalg.svd(jacobian * sizes, full_matrices=rows < count)
    singular = np.append(singular, np.zeros(count - len(singular)))
    blind = singular <= _BLIND * max(float(singular[0]), _TINY)
    seen, unseen = directions[~blind], directions[blind]
    lost = np.any(np.abs(unseen) > _PART, axis=0)
    covariance, spread, quantile = np.full((count, count), np.inf), np.full(count, np.inf), np.inf
    if freedom > 0:
        variance = inflation * float(residuals @ residuals) / freedom
        # the pseudo-inverse of J^T J: a direction that is not seen has no finite variance, and is reported as such
        covariance = variance * (seen.T @ (seen / singular[~blind, None] ** 2))
        spread, quantile = np.sqrt(np.diag(covariance)), float(stdtrit(freedom, 0.975))
    spread[lost] = np.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = covariance / np.outer(spread, spread)
    correlation[~np.isfinite(correlation)] = np.nan
    correlation[lost[:, None] | lost] = np.nan
    np.fill_diagonal(correlation, 1.0)
    deviations = spread * sizes
    reach = quantile * deviations
    intervals = np.stack([values - reach, values + reach], axis=1)
    warnings = _blindness(unknowns, unseen, jacobian * sizes)
    warnings += _weakness(unknowns, values, deviations, correlation, lost)
    warnings += [
        f"{one.name} is at its bound of {value:g} {one.unit}: its interval means little"
        for one, value, gone in zip(unknowns, values, lost, strict=True)
        if not gone and (value <= one.lower or value >= one.upper)
    ]
    if freedom <= 0:
        warnings.append(f"{rows} fitted numbers for {count} parameters: nothing is left to tell their uncertainty")
    return Inference(deviations, intervals, correlation, singular, freedom, tuple(warnings))


def _blindness(unknowns: Sequence[Unknown], directions: Array, scaled: Array) -> list[str]:
    """Parameters that the data do not see, alone or in the combinations (k, n) that no prediction changes with."""
    lengths = np.linalg.norm(scaled, axis=0)
    unseen = lengths <= _BLIND * max(float(lengths.max(initial=0.0)), _TINY)
    found = [
        f"the data cannot see {one.name}: no prediction changes with it; its value is the start value"
        for one, gone in zip(unknowns, unseen, strict=True)
        if gone
    ]
    for direction in directions:
        parts = [int(k) for k in np.flatnonzero(np.abs(direction) > _PART) if not unseen[k]]
        if len(parts) > 1:
            names = " and ".join(unknowns[k].name for k in parts)
            ratio = ", ".join(f"{unknowns[k].name} by {100 * direction[k] / direction[parts[0]]:+.3g} %" for k in parts)
            found.append(
                f"the data see only a combination of {names}: changing {ratio} (of typical sizes) changes no "
                "prediction; fix all but one of them"
            )
    return found


def _weakness(
    unknowns: Sequence[Unknown], values: Array, deviations: Array, correlation: Array, lost: NDArray[np.bool_]
) -> list[str]:
    """Parameters that the data hardly see, or hardly distinguish."""
    found = []
    for k, one in enumerate(unknowns):
        size = max(abs(float(values[k])), one.typical)
        if not lost[k] and np.isfinite(deviations[k]) and deviations[k] > _WEAK * size:
            found.append(
                f"the data hardly see {one.name}: its standard deviation is {deviations[k]:.2g} {one.unit}, "
                f"{100 * deviations[k] / size:.0f} % of its size"
            )
        for j in range(k):
            if np.isfinite(correlation[k, j]) and abs(correlation[k, j]) > _ALIKE:
                found.append(
                    f"{unknowns[j].name} and {one.name} can hardly be distinguished: their estimates are correlated by "
                    f"{correlation[k, j]:+.4f}"
                )
    return found


def refined(scene: Scene) -> Scene | None:
    """The scene with every element cut in two; None where it has many already."""
    model = FingerModel(Scene(**{name: getattr(scene, name) for name in Scene.model_fields}))
    if len(model.lengths) > _MOST:
        return None
    halves = tuple(0.5 * h for h in model.lengths for _ in range(2))
    fidelity = scene.fidelity.model_copy(update={"family": model.family, "elements": halves})
    return scene.model_copy(update={"fidelity": fidelity})


def model_error_warnings(
    unknowns: Sequence[Unknown], deviations: Array, jacobian: Array, predictions: Array, finer: Array
) -> tuple[str, ...]:
    """Parameters that a finer model would move by more than their deviations.

    ``predictions`` and ``finer`` (m,), of the model and of one with twice the elements at the same parameters, and the
    Jacobian (m, n) of the former are of what was fitted, per standard deviation.
    """
    # a Gauss-Newton step of the finer model, by the coarse one's Jacobian: the error of that is of higher order
    moved = np.linalg.lstsq(jacobian, predictions - finer, rcond=None)[0]
    shares = np.abs(moved) / np.maximum(deviations, _TINY)
    seen = [k for k in range(len(unknowns)) if np.isfinite(deviations[k]) and shares[k] > 1.0]
    if not seen:
        return ()
    parts = ", ".join(f"{unknowns[k].name} by {moved[k]:.2g} ({shares[k]:.1f} deviations)" for k in seen)
    return (
        f"twice the elements would move {parts}: the intervals leave the model's own error out; take more elements",
    )
