"""Whether what is given to a core means something; cheap enough to ask every time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.model.finger_model import FUNCTIONS, FingerModel
from continuum_grasp.model.system import SYSTEM_FUNCTIONS, System

__all__ = ["Sections", "check_moment", "finite", "functions_of", "model_of", "positive", "whole"]

_SNAP = 1e-9
"""Part of the finger's length by which a position may lie off it."""
_ROUNDING = 1e-12
"""Part of the greatest input by which a constant moment may vary [1]."""


class Sections:
    """Refuses positions ``s`` that are not on the finger.

    The compiled functions hold them within the finger without a word, since they are free of branches.

    Parameters
    ----------
    model : FingerModel
    function : casadi.Function
        One of its functions, with ``s`` among its inputs.
    """

    def __init__(self, model: FingerModel, function: ca.Function) -> None:
        names = function.name_in()
        self._name = function.name()
        self._s, self._p = names.index("s"), names.index("p")
        self._length = sum(model.lengths)
        at = [k for k, label in enumerate(model.p_names) if label.startswith("element_lengths")]
        self._lengths = slice(at[0], at[-1] + 1) if at else None

    def check(self, rows: Sequence[Any]) -> None:
        """Check the inputs of a call, one row each or many, None where nothing was given.

        Raises
        ------
        InputError
            If a position is not on the finger.
        """
        s = rows[self._s]
        if s is None:
            return
        length: Any = self._length
        if self._lengths is not None and rows[self._p] is not None:
            length = rows[self._p][..., self._lengths].sum(axis=-1, keepdims=True)
        elif s.size == 1:
            s = s.item()
        within = (s >= -_SNAP * length) & (s <= (1.0 + _SNAP) * length)
        if within is True or np.all(within):
            return
        wrong = np.flatnonzero(~np.broadcast_to(within, np.shape(s)).ravel()) if np.size(s) > 1 else np.zeros(1, int)
        worst, its = (np.broadcast_to(v, np.shape(within)).ravel()[wrong[0]] for v in (s, length))
        raise InputError(f"{self._name}: s: expected a position from 0 to the length {its:g} m, got {worst:g}")


def check_moment(model: FingerModel, u: NDArray[np.float64]) -> None:
    """Refuse a tip moment that varies in time where the model takes it to be constant.

    Parameters
    ----------
    model : FingerModel
    u : (rollouts, rows, nu) ndarray
        Inputs in time.

    Raises
    ------
    InputError
        If it varies by more than rounding.
    """
    structure = model.structure
    if not structure.moment_is_constant or u.shape[1] < 2:
        return
    offset = model.finger.tendons.offset if model.finger.tendons is not None else 0.0
    moment = offset * (u[:, :, 0] - u[:, :, 1]) if structure.inputs.tendons else u[:, :, 0]
    couples = u[:, :, structure.inputs.count - structure.inputs.couples : structure.inputs.count].sum(axis=-1)
    if np.ptp(moment + couples, axis=1).max() <= _ROUNDING * np.abs(u).max() * (offset or 1.0):
        return
    raise InputError(
        "u: the tip moment varies, which the tip of this matched_clothoid would not follow (a model without input "
        "rates takes the moment to be constant): use family='clothoid', input_rates=True with rows of values, rates "
        "and accelerations, or tendons.time_constant"
    )


def model_of(given: Any) -> FingerModel:
    """The model itself.

    Raises
    ------
    InputError
        If it is something else.
    """
    if not isinstance(given, FingerModel):
        raise InputError(f"expected a FingerModel, got {type(given).__name__} {given!r:.60}")
    return given


def functions_of(given: Any) -> tuple[str, ...]:
    """Names of the functions of a model or system.

    Raises
    ------
    InputError
        If it is something else.
    """
    return SYSTEM_FUNCTIONS if isinstance(given, System) else FUNCTIONS if model_of(given) else ()


def whole(name: str, value: Any) -> int:
    """A whole number, 1 or more.

    Raises
    ------
    InputError
        If it is something else.
    """
    if (type(value) is not int and not isinstance(value, Integral)) or isinstance(value, bool) or value < 1:
        raise InputError(f"{name}: expected a whole number, 1 or more, got {value!r:.60}")
    return int(value)


def positive(name: str, value: Any) -> float:
    """A finite number above zero.

    Raises
    ------
    InputError
        If it is something else.
    """
    try:
        number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not 0.0 < number < math.inf:
        raise InputError(f"{name}: expected a finite number above 0, got {value!r:.60}")
    return number


def finite(name: str, array: NDArray[np.float64]) -> NDArray[np.float64]:
    """The array itself.

    Raises
    ------
    InputError
        If an entry is NaN or infinite.
    """
    if array.size and not np.isfinite(array).all():
        at = np.argwhere(~np.isfinite(array))[0]
        where = f"[{', '.join(map(str, at.tolist()))}]" if at.size else ""
        raise InputError(f"{name}{where}: expected a finite number, got {array[tuple(at)]}")
    return array
