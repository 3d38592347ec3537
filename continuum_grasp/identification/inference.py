"""What least squares tell about the parameters: standard deviations, intervals, and what the data cannot see.

A model with twice the elements says whether the model's own error matters beside these deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Inference:
    """Uncertainty of the parameters; infinite where the data do not see them.

    Attributes
    ----------
    deviations : (n,) ndarray
    intervals : (n, 2) ndarray
        95 %, by Student's t.
    correlation : (n, n) ndarray
    singular_values : (n,) ndarray
        Of the Jacobian in standard deviations of the data per typical size of the parameters.
    directions : (n, n) ndarray
        Rows: the combinations of parameters, in typical sizes, that belong to them.
    freedom : int
        Degrees of freedom.
    warnings : tuple of str
    """

    deviations: Array
    intervals: Array
    correlation: Array
    singular_values: Array
    directions: Array
    freedom: int
    warnings: tuple[str, ...]


def infer(
    unknowns: Sequence[Unknown], values: Array, jacobian: Array, residuals: Array, inflation: float = 1.0
) -> Inference:
    """Uncertainty at the minimum.

    Parameters
    ----------
    unknowns : sequence of Unknown
    values : (n,) ndarray
        Estimates.
    jacobian : (m, n) ndarray
        Of the weighted residuals of what was fitted.
    residuals : (m,) ndarray
        Weighted residuals; their mean square scales the covariance.
    inflation : float
        Further factor of the covariance, for a robust loss.
    """
    from scipy.special import stdtrit

    count, rows = len(unknowns), len(residuals)
    sizes = np.array([one.typical for one in unknowns])
    freedom = rows - count
    _, singular, directions = np.linalg.svd(jacobian * sizes, full_matrices=rows < count)
    singular = np.append(singular, np.zeros(count - len(singular)))
    blind = singular <= _BLIND * max(float(singular[0]), 1e-300)
    variance = inflation * float(residuals @ residuals) / freedom if freedom > 0 else np.inf
    seen = directions[~blind]
    covariance = (
        variance * (seen.T @ (seen / singular[~blind, None] ** 2)) if freedom > 0 else np.full((count,) * 2, np.inf)
    )
    lost = np.any(np.abs(directions[blind]) > _PART, axis=0)
    spread = np.sqrt(np.diag(covariance)) if freedom > 0 else np.full(count, np.inf)
    spread[lost] = np.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = covariance / np.outer(spread, spread)
    correlation[~np.isfinite(correlation)] = np.nan
    correlation[np.outer(lost, lost) | np.outer(lost, ~lost) | np.outer(~lost, lost)] = np.nan
    np.fill_diagonal(correlation, 1.0)
    deviations = spread * sizes
    reach = stdtrit(freedom, 0.975) * deviations if freedom > 0 else np.full(count, np.inf)
    intervals = np.stack([values - reach, values + reach], axis=1)
    warnings = [*_blindness(unknowns, directions[blind], jacobian * sizes)]
    warnings += _weakness(unknowns, values, deviations, correlation, lost)
    warnings += _limits(unknowns, values, lost)
    if freedom <= 0:
        warnings.append(f"{rows} fitted numbers for {count} parameters: nothing is left to tell their uncertainty")
    return Inference(deviations, intervals, correlation, singular, directions, freedom, tuple(warnings))


def _blindness(unknowns: Sequence[Unknown], directions: Array, scaled: Array) -> list[str]:
    found = []
    lengths = np.linalg.norm(scaled, axis=0)
    unseen = lengths <= _BLIND * max(float(lengths.max(initial=0.0)), 1e-300)
    for one in (unknowns[int(k)] for k in np.flatnonzero(unseen)):
        found.append(f"the data cannot see {one.name}: no prediction changes with it; its value is the start value")
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


def _limits(unknowns: Sequence[Unknown], values: Array, lost: NDArray[np.bool_]) -> list[str]:
    return [
        f"{one.name} is at its bound of {value:g} {one.unit}: its interval means little"
        for one, value, unseen in zip(unknowns, values, lost, strict=True)
        if not unseen and (value <= one.lower or value >= one.upper)
    ]


_MOST = 12
"""Elements beyond which a model is not refined to see its error: twice as many take far longer than the search."""


def refined(scene: Scene) -> Scene | None:
    """The scene with every element cut in two; None where it has many already."""
    model = FingerModel(Scene(**{name: getattr(scene, name) for name in Scene.model_fields}))
    if len(model.lengths) > _MOST:
        return None
    halves = tuple(0.5 * h for h in model.lengths for _ in range(2))
    fidelity = scene.fidelity.model_copy(update={"family": model.family, "elements": halves})
    return scene.model_copy(update={"fidelity": fidelity})


def model_error_warnings(
    names: Sequence[str], deviations: Array, jacobian: Array, predictions: Array, finer: Array
) -> tuple[str, ...]:
    """Parameters that a finer model would move by more than their deviations.

    Parameters
    ----------
    names : sequence of str
    deviations : (n,) ndarray
        Of the estimates.
    jacobian : (m, n) ndarray
        Of the predictions that were fitted, per their standard deviations.
    predictions, finer : (m,) ndarray
        Of the model and of one with twice the elements at the same parameters, per standard deviation.
    """
    moved = np.linalg.lstsq(jacobian, predictions - finer, rcond=None)[0]
    shares = np.abs(moved) / np.maximum(deviations, 1e-300)
    seen = [k for k in range(len(names)) if np.isfinite(deviations[k]) and shares[k] > 1.0]
    if not seen:
        return ()
    parts = ", ".join(f"{names[k]} by {moved[k]:.2g} ({shares[k]:.1f} deviations)" for k in seen)
    return (
        f"twice the elements would move {parts}: the intervals leave the model's own error out; take more elements",
    )
