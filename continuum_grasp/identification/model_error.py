"""Whether the model's own error matters beside the deviations of what was estimated through it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.model import FingerModel
from continuum_grasp.scene.simulate import Scene

__all__ = ["model_error_warnings", "refined"]

Array = NDArray[np.float64]

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
