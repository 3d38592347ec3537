"""Whether shapes stay where the model means something: bending range, strain limit, and outside of an object."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.model import FingerModel
from continuum_grasp.simulation.contacts import ContactForces

__all__ = ["LOST", "limit_warnings", "overlap_warnings"]

LOST = 3.0
"""Multiple of the declared bending range beyond which the model means nothing."""
_THROUGH = 0.5
"""Overlap between stations that is reported, per the half thickness."""
_LOOKS = 50
"""Instants at which overlaps are looked for."""


def limit_warnings(model: FingerModel, use: NDArray[np.float64], t: ArrayLike | None = None) -> tuple[str, ...]:
    """What the user must know of bends beyond the declared range and of strains beyond the limit.

    Parameters
    ----------
    model : FingerModel
    use : (T, elements) ndarray
        Share of the bending range that each element uses.
    t : (T,) array_like, optional
        Instants [s], where the shapes are those of a motion.
    """
    limit, found = model.finger.curvature_limit, []

    def first(beyond: NDArray[np.intp]) -> str:
        return "" if t is None else f" at t = {np.asarray(t)[beyond[0]]:g} s"

    for k, (reach, length) in enumerate(zip(model.ranges, model.lengths, strict=True)):
        curvature = use[:, k] * (reach / length)
        strained, beyond = np.flatnonzero(curvature > limit * (1 + 1e-9)), np.flatnonzero(use[:, k] > 1.0)
        if strained.size:
            found.append(
                f"element {k + 1} exceeds the strain limit{first(strained)} "
                f"(greatest: {curvature.max() / limit:.2f} times the limit; the model is accurate for less)"
            )
        if beyond.size and reach < limit * length * (1 - 1e-9):
            found.append(
                f"element {k + 1} is bent beyond its declared range of {reach:.3g} rad{first(beyond)} "
                f"(greatest: {use[:, k].max():.2f} times the range), where the model loses its accuracy: raise "
                "fidelity.bending_range"
            )
    return tuple(found)


def overlap_warnings(
    t: NDArray[np.float64],
    contacts: ContactForces,
    overlap: Callable[[NDArray[np.intp]], NDArray[np.float64]],
    half_thickness: float,
) -> tuple[str, ...]:
    """Warn of a finger that is deeper in an object than its stations are pressed into it.

    Parameters
    ----------
    t : (T,) ndarray
        Instants [s].
    contacts : ContactForces
    overlap : callable
        Deepest overlap at some of the instants, given by their indices [m].
    half_thickness : float
        Of the finger [m].
    """
    looked = np.unique(np.linspace(0, len(t) - 1, _LOOKS).astype(int))
    own = [k for k, name in enumerate(contacts.names) if name.startswith("finger.")]
    pressed = np.maximum(0.0, -contacts.gap[looked][:, own].min(axis=1))
    beyond = overlap(looked) - pressed
    k = int(beyond.argmax())
    if beyond[k] <= _THROUGH * half_thickness:
        return ()
    return (
        f"between the stations that touch, the finger overlaps the object by {1e3 * beyond[k]:.2g} mm at "
        f"t = {t[looked[k]]:g} s: add contacts",
    )
