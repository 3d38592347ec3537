"""From the references of a scene, or from functions of time, to set-points of the controller's nodes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.control.arrays import numbers, shown
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.stages import Stages
from continuum_grasp.errors import InputError
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.loads import Samples
from continuum_grasp.scene.reference import CircleReference, RowSamples
from continuum_grasp.simulation.signals import interpolate

__all__ = ["SetPoints", "set_points"]

Array = NDArray[np.float64]
Function: TypeAlias = Callable[[float], ArrayLike]
_Given: TypeAlias = "CircleReference | RowSamples | tuple[float, ...] | Function"

FOLLOWED = ("tip", "bending", "shape", "contact_force", "input")
"""What a reference can say, by the names of ``scene.reference``."""


class SetPoints:
    """Set-points over time, in the order of a controller's ``r_names``.

    Attributes
    ----------
    names : tuple of str
        Name and unit of each entry of a row.
    """

    def __init__(self, names: tuple[str, ...], blocks: list[tuple[int, _Given | None]]) -> None:
        self.names = names
        self._blocks = blocks

    def rows(self, times: ArrayLike) -> Array:
        """Set-points (len(times), nr) at instants [s].

        Raises
        ------
        InputError
            If a function of time gives another number of entries, or one that is not finite.
        """
        instants = np.atleast_1d(np.asarray(times, dtype=float))
        return np.hstack([_rows(given, width, instants) for width, given in self._blocks])


def set_points(
    scene: ControlScene,
    stages: Stages,
    prediction: Prediction,
    functions: Mapping[str, Function] | None = None,
) -> SetPoints:
    """Set-points of a scene.

    Parameters
    ----------
    scene : ControlScene
        Its ``reference`` says what is to be followed; what it leaves out is zero, tensions are the least.
    stages : Stages
        The controller's problem.
    prediction : Prediction
        Its model.
    functions : mapping of str to callable, optional
        Functions of time [s] that take the place of ``reference.tip``, ``bending``, ``shape``, ``contact_force`` or
        ``input``, each giving all entries of one row.

    Returns
    -------
    SetPoints

    Raises
    ------
    InputError
        If a reference has another number of entries than what it is for, or if nothing tracks it.
    """
    cost, reference = scene.controller.cost, scene.reference
    elements = len(prediction.system.finger_model.lengths)
    tendons = scene.finger.tendons
    given: dict[str, _Given | None] = {name: getattr(reference, name) for name in FOLLOWED}
    widths = {
        "tip": 2 if cost.tip is not None else 0,
        "bending": elements if cost.bending is not None else 0,
        "shape": 2 * len(cost.shape.at) if cost.shape is not None else 0,
        "contact_force": len(scene.followed_contacts),
        "speed": elements if cost.speed is not None else 0,
        "input": prediction.nu if cost.effort else 0,
        "input_rate": prediction.nu if cost.input_rate else 0,
    }
    for name, function in (functions or {}).items():
        if name not in FOLLOWED:
            raise InputError(f"expected one of {', '.join(FOLLOWED)}, got {name!r}", key="functions")
        if not widths[name]:
            raise InputError(f"is tracked by nothing: give controller.cost.{name} a weight", key=f"functions.{name}")
        given[name] = function
    if given["input"] is None and tendons is not None:
        given["input"] = (tendons.min_tension,) * 2
    blocks: list[tuple[int, _Given | None]] = []
    for name, width in widths.items():
        if width:
            value = given.get(name)
            _check_width(name, value, width)
            blocks.append((width, value))
    if sum(width for width, _ in blocks) != stages.nr:
        raise InputError(f"set-points of {sum(width for width, _ in blocks)} entries do not fit {stages.r_names}")
    return SetPoints(stages.r_names, blocks)


def _check_width(name: str, given: _Given | None, width: int) -> None:
    size = given.width if isinstance(given, RowSamples) else len(given) if isinstance(given, tuple) else width
    if size != width:
        raise InputError(f"expected {width} entries, got {size}", key=f"reference.{name}")


def _rows(given: _Given | None, width: int, t: Array) -> Array:
    if given is None:
        return np.zeros((len(t), width))
    if isinstance(given, CircleReference):
        turned = given.phase + 2.0 * math.pi * given.frequency * np.maximum(t - given.start, 0.0)
        around = np.stack([np.cos(turned), np.sin(turned)], axis=1)
        return np.asarray(np.array(given.center) + given.radius * around)
    if isinstance(given, RowSamples):
        return _sampled(given, t)
    if callable(given):
        return _called(given, width, t)
    return np.tile(np.array(given, dtype=float), (len(t), 1))


def _sampled(given: RowSamples, t: Array) -> Array:
    if given.interpolation == "hold":
        last = np.searchsorted(np.array(given.times), t * (1 + 1e-12) + 1e-12, side="right") - 1
        return np.array(given.values)[np.maximum(last, 0)]
    columns = (
        Samples(times=given.times, values=column, interpolation=given.interpolation)
        for column in zip(*given.values, strict=True)
    )
    return np.stack([interpolate(samples, t)[0] for samples in columns], axis=1)


def _called(function: Function, width: int, t: Array) -> Array:
    rows = np.empty((len(t), width))
    for k, instant in enumerate(t.tolist()):
        given = function(instant)
        try:
            row = numbers(given).reshape(-1)
        except (TypeError, ValueError):
            raise InputError(f"a set-point at t = {instant:g} s: expected numbers, got {shown(given)}") from None
        if row.size != width or not np.all(np.isfinite(row)):
            raise InputError(f"a set-point at t = {instant:g} s: expected {width} finite entries, got {shown(given)}")
        rows[k] = row
    return rows
