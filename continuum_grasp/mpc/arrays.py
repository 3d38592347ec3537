"""What users give to controllers and estimators, as scenes and arrays of the right size."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.core.checks import finite
from continuum_grasp.errors import InputError
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.load import load

__all__ = ["control_scene", "real", "slices", "vector"]

Array = NDArray[np.float64]


def control_scene(given: ControlScene | str | PathLike[str]) -> ControlScene:
    """The scene itself, or that of a file.

    Raises
    ------
    InputError
        If it is none of a controller.
    """
    scene = given if isinstance(given, ControlScene) else load(given)  # type: ignore[arg-type]
    if not isinstance(scene, ControlScene):
        raise InputError(f"expected a closed loop (finger, controller, ...), got a {type(scene).__name__}")
    return scene


def vector(name: str, value: ArrayLike, size: int, *, check: bool = True) -> Array:
    """A vector, finite unless that is not to be checked.

    Raises
    ------
    InputError
        If it has another size, or is not finite.
    """
    try:
        array = real(value).flatten()
    except (TypeError, ValueError) as error:
        raise InputError(f"expected {size} numbers, got {value!r:.60}", key=name) from error
    if array.size != size:
        raise InputError(f"expected {size} entries, got {array.size}", key=name)
    return finite(name, array) if check else array


def real(value: ArrayLike) -> Array:
    """An array of doubles; numpy alone would drop the imaginary parts of complex numbers.

    Raises
    ------
    TypeError, ValueError
        If it is no array of real numbers.
    """
    array = np.asarray(value)
    if array.dtype.kind == "c":
        raise TypeError("complex numbers")
    return np.asarray(array, dtype=float)


def slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Where each of the named vectors lies, one after the other."""
    ends = np.cumsum([0, *sizes.values()])
    return {name: slice(int(a), int(b)) for name, a, b in zip(sizes, ends[:-1], ends[1:], strict=True)}
