"""Setpoints of a controller's nodes from the references of a scene, or from functions of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError
from continuum_grasp.control.ocp.cost_terms import TERMS, Outputs
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene import CircleReference, Cost, Reference, RowSamples, Samples
from continuum_grasp.simulation import interpolate

Function: TypeAlias = Callable[[float], ArrayLike]
_Given: TypeAlias = "CircleReference | RowSamples | tuple[float, ...] | Function | _Rows"

SETPOINTS = {term.reference: term.key for term in TERMS if term.reference}
"""Weight in ``controller.cost`` by the name of its setpoint in ``reference``."""


class _Rows(NamedTuple):
    """Rows (K, width) one stage apart [s] from an instant [s] on; between them linear, then the last one."""

    since: float
    stage: float
    values: Array

    def at(self, t: Array) -> Array:
        # Instants are sums of rounded periods: one that is a node to rounding has its row.
        places = (t - self.since) / self.stage
        nearest = np.round(places)
        places = np.where(np.abs(places - nearest) < 1e-9, nearest, places)
        count = np.arange(len(self.values))
        return np.stack([np.interp(places, count, column) for column in self.values.T], axis=1)


def _replacement(key: str, value: Any, width: int, since: float, stage: float, check: bool) -> _Given:
    if callable(value):
        function: Function = value
        return function
    try:
        entries = CheckedArgument(None, value).doubles()
    except (TypeError, ValueError):
        raise CheckedArgument(key, value).refused("expected numbers or a function of time") from None
    if check and not np.all(np.isfinite(entries)):
        raise CheckedArgument(key, value).refused("expected finite numbers")
    if entries.size == width and entries.ndim <= 1:
        return tuple(entries.ravel().tolist())
    if width == 1 and entries.ndim == 1:
        entries = entries[:, None]
    if entries.ndim != 2 or entries.shape[1] != width or not len(entries):
        raise InputError(
            f"expected ({width},) or a row per node from now on, (count, {width}), got {entries.shape}", key=key
        )
    return _Rows(since, stage, entries)


class Setpoints:
    """Setpoints over time, in the order of a controller's ``r_names``, which are its ``names``."""

    def __init__(
        self,
        names: tuple[str, ...],
        blocks: list[tuple[int, _Given | None]],
        keys: tuple[str, ...] = (),
        check: Callable[[str, Mapping[str, Any]], None] = lambda key, given: None,
    ) -> None:
        # Terms without a setpoint of their own, which is always zero, have an empty key.
        self.names, self._blocks, self._keys, self._check = names, blocks, keys, check

    @staticmethod
    def of(outputs: Outputs, reference: Reference, functions: Mapping[str, Function] | None = None) -> Setpoints:
        """Collect the setpoints of tracked quantities; see ``Controller.setpoints``.

        Entries without a reference are zero, for inputs ``rest_input`` of the scene. InputError if a reference
        has another number of entries than its cost term or is out of reach, or if no term tracks it.
        """
        references: dict[str, _Given | None] = {name: getattr(reference, name) for name in SETPOINTS}
        scene = outputs.model.scene
        # Tensions cannot be zero: effort is what exceeds the least ones.
        if references["input"] is None:
            references["input"] = scene.rest_input
        for name, function in (functions or {}).items():
            known = ", ".join(term.reference for term in outputs.terms if term.reference)
            if name not in known.split(", "):
                raise InputError(
                    f"expected some of {known}, which have a weight in controller.cost, got {name!r}", key="functions"
                )
            if not callable(function):
                raise CheckedArgument(f"functions.{name}", function).refused("expected a function of time")
            references[name] = function
        blocks: list[tuple[int, _Given | None]] = []
        for term in outputs.terms:
            value = references.get(term.reference)
            width = len(term.names(outputs.cost, outputs.model))
            size = value.width if isinstance(value, RowSamples) else len(value) if isinstance(value, tuple) else width
            if size != width:
                raise InputError(f"expected {width} entries, got {size}", key=f"reference.{term.reference}")
            blocks.append((width, value))
        keys = tuple(term.reference for term in outputs.terms)
        check = outputs.reach.check
        check("reference", {key: value for key, (_, value) in zip(keys, blocks, strict=True)})
        return Setpoints(outputs.names, blocks, keys, check)

    @staticmethod
    def of_cost(cost: Cost, model: Prediction, reference: Reference, without: str = "") -> tuple[Outputs, Setpoints]:
        """Quantities that a cost tracks, except a term by its key, and their setpoints."""
        every = Outputs.of(cost, model)
        outputs = replace(every, terms=tuple(term for term in every.terms if term.key != without))
        return outputs, Setpoints.of(outputs, reference)

    @property
    def parts(self) -> dict[str, slice]:
        """Slice of the entries of each setpoint, by name."""
        ends = np.cumsum([0, *(width for width, _ in self._blocks)]).tolist()
        return {key: slice(a, b) for key, a, b in zip(self._keys, ends[:-1], ends[1:], strict=True) if key}

    def replaced(self, given: Mapping[str, Any], since: float, stage: float, *, check: bool = True) -> Setpoints:
        """Replace setpoints by name: numbers, a function of time, or rows one stage apart [s] from an instant [s] on.

        ``InputError`` for unknown names, for a wrong number of entries, and with ``check`` for setpoints that are not
        finite or out of reach.
        """
        blocks, keys = list(self._blocks), list(self._keys)
        for key, value in given.items():
            if key not in keys or not key:
                known = ", ".join(self.parts) or "none"
                raise InputError(f"expected setpoints of weighted quantities ({known}), got {key!r:.60}", key=key)
            at = keys.index(key)
            width = blocks[at][0]
            blocks[at] = width, _replacement(key, value, width, since, stage, check)
            if check:
                self._check("", {key: blocks[at][1]})
        return Setpoints(self.names, blocks, self._keys, self._check)

    @property
    def by_functions(self) -> bool:
        """Whether there are functions of time among them."""
        return any(callable(setpoint) for _, setpoint in self._blocks)

    def rows(self, times: ArrayLike, *, check: bool = True) -> Array:
        """Evaluate setpoints (len(times), nr) at instants [s].

        Values of functions of time must fit, and with ``check`` be finite.
        """
        instants = np.atleast_1d(CheckedArgument("times", times).array())
        return np.hstack([_rows(setpoint, width, instants, check) for width, setpoint in self._blocks])


def _rows(setpoint: _Given | None, width: int, t: Array, check: bool) -> Array:
    if setpoint is None:
        return np.zeros((len(t), width))
    if isinstance(setpoint, CircleReference):
        turned = setpoint.phase + 2.0 * math.pi * setpoint.frequency * np.maximum(t - setpoint.start, 0.0)
        around = np.stack([np.cos(turned), np.sin(turned)], axis=1)
        return np.asarray(np.array(setpoint.center) + setpoint.radius * around)
    if isinstance(setpoint, RowSamples):
        return _sampled(setpoint, t)
    if isinstance(setpoint, _Rows):
        return setpoint.at(t)
    if callable(setpoint):
        return _called(setpoint, width, t, check)
    return np.tile(np.array(setpoint, dtype=float), (len(t), 1))


def _sampled(sampled: RowSamples, t: Array) -> Array:
    columns = (
        Samples(times=sampled.times, values=column, interpolation=sampled.interpolation)
        for column in zip(*sampled.values, strict=True)
    )
    return np.stack([interpolate(samples, t)[0] for samples in columns], axis=1)


def _called(function: Function, width: int, t: Array, check: bool) -> Array:
    rows = np.empty((len(t), width))
    for k, instant in enumerate(t.tolist()):
        output = function(instant)
        try:
            row = CheckedArgument(None, output).doubles().reshape(-1)
        except (TypeError, ValueError):
            raise CheckedArgument(None, output).refused(f"a setpoint at t = {instant:g} s: expected numbers") from None
        if row.size != width or (check and not np.all(np.isfinite(row))):
            raise CheckedArgument(None, output).refused(
                f"a setpoint at t = {instant:g} s: expected {width} finite entries"
            )
        rows[k] = row
    return rows
