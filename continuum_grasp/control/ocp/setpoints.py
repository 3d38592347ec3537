"""Setpoints of a controller's nodes from the references of a scene, or from functions of time, and errors from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError, real_array, shown
from continuum_grasp.control.arguments import numbers
from continuum_grasp.control.ocp.cost_terms import TERMS, Outputs, Tracked, tracked_groups
from continuum_grasp.scene import CircleReference, Reference, Rod, RowSamples, Samples, check_reach
from continuum_grasp.simulation import interpolate

Function: TypeAlias = Callable[[float], ArrayLike]
_Given: TypeAlias = "CircleReference | RowSamples | tuple[float, ...] | Function | _Rows"

SETPOINTS = {term.reference: term.key for term in TERMS if term.reference}
"""Weight in ``controller.cost`` by the name of its setpoint in ``reference``."""
FINAL = 0.1
"""Last share of the run over which the final error is averaged: noise averages out, and a step has settled."""
_STOOD = 6.5
"""Natural times of a finger for which a setpoint has to stand for its error at the end to count [1]: some periods of
its sway, 0.5 s of the hand finger."""
LEAST_FORCE = 5.0
"""Least size that a setpoint of a force counts with, per E I / L^2 of the finger [1]: 0.9 N of the hand finger."""
_OFF = 0.05
"""Error at the end from which on a setpoint is missed, per length of the finger [1]; of angles twice that [rad], which
moves the tip as far; of forces twice that share of them, or of a newton, as of weighted goals of plans."""
_NEARING = 0.95
"""Share of its distance a tenth of the time before up to which what is off is still on its way [1]: noise of a tip that
stays moves means over a tenth by less."""


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
        entries = numbers(value)
    except (TypeError, ValueError):
        raise InputError(f"expected numbers or a function of time, got {shown(value)}", key=key) from None
    if check and not np.all(np.isfinite(entries)):
        raise InputError(f"expected finite numbers, got {shown(value)}", key=key)
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

    @property
    def parts(self) -> dict[str, slice]:
        """Slice of the entries of each setpoint, by name."""
        ends = np.cumsum([0, *(width for width, _ in self._blocks)]).tolist()
        return {key: slice(a, b) for key, a, b in zip(self._keys, ends[:-1], ends[1:], strict=True) if key}

    def replaced(self, given: Mapping[str, Any], since: float, stage: float, *, check: bool = True) -> Setpoints:
        """Replace setpoints by name: numbers, a function of time, or rows one stage apart [s] from an instant [s] on.

        ``InputError`` for unknown names, for what has another number of entries, and with ``check`` for what is not
        finite or out of reach.
        """
        blocks, keys = list(self._blocks), list(self._keys)
        for key, value in given.items():
            if key not in keys or not key:
                known = ", ".join(self.parts) or "none"
                raise InputError(f"expected setpoints of what has a weight ({known}), got {key!r:.60}", key=key)
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

        What functions of time return must fit, and with ``check`` be finite.
        """
        instants = np.atleast_1d(real_array("times", times))
        return np.hstack([_rows(setpoint, width, instants, check) for width, setpoint in self._blocks])


def setpoints(outputs: Outputs, reference: Reference, functions: Mapping[str, Function] | None = None) -> Setpoints:
    """Collect the setpoints of what is tracked; see ``Controller.setpoints``.

    What a reference does not have is zero, and for inputs ``rest_input`` of the scene. InputError if a reference has
    another number of entries than its cost term or is out of reach, or if no term tracks it.
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
            raise InputError(f"expected a function of time, got {shown(function)}", key=f"functions.{name}")
        references[name] = function
    blocks: list[tuple[int, _Given | None]] = []
    for term in outputs.terms:
        value, width = references.get(term.reference), len(term.names(outputs.cost, outputs.model))
        size = value.width if isinstance(value, RowSamples) else len(value) if isinstance(value, tuple) else width
        if size != width:
            raise InputError(f"expected {width} entries, got {size}", key=f"reference.{term.reference}")
        blocks.append((width, value))
    keys, shape = tuple(term.reference for term in outputs.terms), outputs.cost.shape
    check = partial(
        check_reach,
        scene.finger,
        at=() if shape is None else shape.at,
        body=scene.surroundings.object if scene.surroundings else None,
        ranges=outputs.model.system.finger_model.ranges,
    )
    check("reference", {key: value for key, (_, value) in zip(keys, blocks, strict=True)})
    return Setpoints(outputs.names, blocks, keys, check)


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
    if sampled.interpolation == "hold":
        # Instants are sums of rounded periods: one that is an instant of the samples to rounding has its row already.
        last = np.searchsorted(np.array(sampled.times), t * (1 + 1e-12) + 1e-12, side="right") - 1
        return np.array(sampled.values)[np.maximum(last, 0)]
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
            row = numbers(output).reshape(-1)
        except (TypeError, ValueError):
            raise InputError(f"a setpoint at t = {instant:g} s: expected numbers, got {shown(output)}") from None
        if row.size != width or (check and not np.all(np.isfinite(row))):
            raise InputError(f"a setpoint at t = {instant:g} s: expected {width} finite entries, got {shown(output)}")
        rows[k] = row
    return rows


@dataclass(frozen=True)
class Tracking:
    """Distance from the setpoints: root of the mean square, greatest, and that of the mean over the last tenth."""

    name: str
    unit: str
    rms: float
    max: float
    final: float


def tracking_of(group: Tracked, error: Array) -> Tracking:
    """Evaluate the errors of one tracked quantity (K + 1, nr)."""
    errors = error[:, group.columns]
    last = errors[-max(1, round(FINAL * len(errors))) :].mean(axis=0)
    # A point's error is the length of its vector; other quantities are scalars, points of one dimension.
    size = 2 if group.of_points else 1
    sizes = np.linalg.norm(errors.reshape(len(errors), -1, size), axis=2)
    final = np.linalg.norm(last.reshape(-1, size), axis=1).max()
    return Tracking(group.label, group.unit, rms(sizes), float(sizes.max()), float(final))


def missed_setpoints(
    names: Sequence[str], tracked: Array, r: Array, t: Array, reference: Reference, rod: Rod
) -> tuple[str, ...]:
    """Say what ends how far from setpoints r (K + 1, nr) which stood long enough to be met, by names of columns."""
    messages = []
    for group in tracked_groups(names):
        rows, off = r[:, group.columns], tracking_of(group, tracked - r).final
        others = np.flatnonzero((rows != rows[-1]).any(axis=1))
        stood = t[-1] - t[others[-1] + 1 if others.size else 0]
        # Zeros that are not stated are a default, and no aim.
        aim = rows.any() or getattr(reference, group.reference) is not None
        force = max(LEAST_FORCE * rod.stiffness / rod.length**2, float(np.abs(rows[-1]).max()))
        limit = {"m": _OFF * rod.length, "rad": 2.0 * _OFF, "N": 2.0 * _OFF * force}[group.unit]
        # Instants are sums of rounded periods.
        if aim and off > limit and stood >= max(_STOOD * rod.natural_time, FINAL * t[-1]) * (1.0 - 1e-9):
            earlier = tracking_of(group, (tracked - r[-1])[: -max(1, round(FINAL * len(r)))]).final
            cause = (
                "it is still on its way, and needs more time or less damping"
                if off < _NEARING * earlier
                else "no posture that inputs within their bounds hold is there, something is in the way, the finger "
                "differs from the model (estimator.disturbances finds by how much), or tendons "
                "are slack, so that commands have no effect (give drive.pretension)"
            )
            messages.append(
                f"{group.label}: {amount(off, group.unit)} off a setpoint that stood; likely cause: {cause}"
            )
    return tuple(messages)


def rms(values: Array) -> float:
    """Root of the mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def amount(value: float, unit: str) -> str:
    """Format a value with a unit that people read."""
    times = (1e3, "ms") if abs(value) >= 1e-3 else (1e6, "us")
    factor, word = {"m": (1e3, "mm"), "s": times}.get(unit, (1.0, unit))
    return f"{value * factor:.3g} {word}".strip()
