"""Inputs and loads of a scene as rows over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import SAME, ForceLoad, Load, Samples, Scene, VectorSamples

_OF_MOTION = 5
"""Entries of ``w`` of a support that moves: shift, its rate, rate of turn [1]."""
Value = float | tuple[float, float] | Samples | VectorSamples


def interpolate(samples: Value, t: ArrayLike) -> tuple[Array, Array, Array]:
    """Value, rate and acceleration of a function that is constant or sampled.

    ``smooth`` is a monotone piecewise quintic with continuous rate and acceleration, both zero at both ends; its slopes
    are the harmonic means of F. N. Fritsch and J. Butland (1984, doi:10.1137/0905021). ``linear`` has no acceleration,
    ``hold`` no rate either. Outside the samples the value is held. Instants are (T,) [s], values (T,) or (T, 2).
    """
    instants = np.asarray(t, dtype=float)
    if not isinstance(samples, Samples | VectorSamples):
        value = np.tile(np.asarray(samples, dtype=float), (*instants.shape, *[1] * np.ndim(samples)))
        return value, np.zeros_like(value), np.zeros_like(value)
    at, values = np.asarray(samples.times, dtype=float), np.asarray(samples.values, dtype=float)
    if values.ndim == 2:
        columns = [_interpolate(at, v, samples.interpolation, instants) for v in values.T]
        value, rate, acceleration = (np.stack(parts, axis=-1) for parts in zip(*columns, strict=True))
        return value, rate, acceleration
    return _interpolate(at, values, samples.interpolation, instants)


def _interpolate(at: Array, values: Array, kind: str, t: Array) -> tuple[Array, Array, Array]:
    if kind == "hold":
        # Instants are sums of rounded periods: one that is an instant of the samples to rounding has its value already.
        last = np.searchsorted(at, t * (1 + 1e-12) + 1e-12, side="right") - 1
        return values[np.maximum(last, 0)], np.zeros_like(t), np.zeros_like(t)
    secants = np.diff(values) / np.diff(at)
    k = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(secants) - 1)
    inside = (t >= at[0]) & (t < at[-1])
    h = np.diff(at)[k]
    s = np.clip((t - at[k]) / h, 0.0, 1.0)
    if kind == "linear":
        return values[k] + secants[k] * h * s, np.where(inside, secants[k], 0.0), np.zeros_like(s)
    slopes = _monotone_slopes(np.diff(at), secants)
    # Quintic through both ends with their slopes and no acceleration there.
    a, b, rise = slopes[k] * h, slopes[k + 1] * h, secants[k] * h
    c3, c4, c5 = 10 * rise - 6 * a - 4 * b, -15 * rise + 8 * a + 7 * b, 6 * rise - 3 * (a + b)
    value = values[k] + s * (a + s**2 * (c3 + s * (c4 + s * c5)))
    rate = (a + s**2 * (3 * c3 + s * (4 * c4 + s * 5 * c5))) / h
    acceleration = s * (6 * c3 + s * (12 * c4 + s * 20 * c5)) / h**2
    return value, np.where(inside, rate, 0.0), np.where(inside, acceleration, 0.0)


def _monotone_slopes(steps: Array, secants: Array) -> Array:
    """Slopes at the samples: weighted harmonic means, no more than twice the smaller secant, zero at ends and peaks."""
    slopes = np.zeros(len(secants) + 1)
    before, after = secants[:-1], secants[1:]
    monotone = before * after > 0.0
    # Fritsch and Butland: the harmonic mean, weighted towards the shorter interval, keeps the interpolant monotone.
    weight = (steps[:-1] + 2.0 * steps[1:]) / (3.0 * (steps[:-1] + steps[1:]))
    blend = np.where(monotone, weight * after + (1.0 - weight) * before, 1.0)
    mean = np.where(monotone, before * after / blend, 0.0)
    limit = 2.0 * np.minimum(np.abs(before), np.abs(after))
    slopes[1:-1] = np.clip(mean, -limit, limit)
    return slopes


class Signals:
    """Inputs ``u`` and forces ``w`` of a model in its scene.

    ``loads`` are the values of the model's loads, one for each, its own where not given. ``nw`` is the size of ``w``,
    which begins with the model's; behind them are, of an object that moves, what pulls at it, the height of its
    table and how supports move. Raises InputError where an input would move a matched tip with
    infinite acceleration.
    """

    def __init__(
        self, scene: Scene, model: FingerModel, loads: Sequence[Load] | None = None, *, nw: int | None = None
    ) -> None:
        self._model = model
        self._nw = model.nw if nw is None else nw
        commands = [0.0] * len(model.finger.inputs) if scene.actuation is None else scene.actuation.values
        self._values: list[float | Samples] = [*commands]
        placed = list(zip(model.loads if loads is None else loads, model.load_entries, strict=True))
        couples = [load for load, (vector, _) in placed if vector == "u"]
        self._values += [load.moment for load in couples if not isinstance(load, ForceLoad)]
        self._forces: list[tuple[Value, int, int]] = [
            (load.value, start, 0) for load, (vector, start) in placed if vector == "w"
        ]
        """Values, each with its first entry of ``w``, and the order of the derivative that is there."""
        if self._nw > model.nw:
            pulls = scene.object_load
            pulled = ((0.0, 0.0), 0.0) if pulls is None else (pulls.force, pulls.moment)
            outside = zip((*pulled, scene.table_height), (0, 2, 3), strict=True)
            motions = list(scene.support_motion.values())
            first = self._nw - _OF_MOTION * len(motions)
            self._forces += [(value, model.nw + k, 0) for value, k in outside if model.nw + k < first]
            for k, motion in enumerate(motions):
                at = first + _OF_MOTION * k
                self._forces += [(motion.shift, at, 0), (motion.shift, at + 2, 1), (motion.turn, at + 4, 1)]
        self._rates = model.structure.inputs.rates
        for value in self._values:
            if self._rates and isinstance(value, Samples) and value.interpolation != "smooth":
                raise InputError(
                    f"an input with interpolation {value.interpolation} has kinks or jumps, at which the tip of "
                    "matched_clothoid jumps: use interpolation: smooth, tendons.time_constant, or fidelity.family: "
                    "clothoid"
                )

    @property
    def constant(self) -> bool:
        """Whether nothing varies."""
        return not self._sampled

    @property
    def jumps(self) -> bool:
        """Whether something holds its values from instant to instant."""
        return any(value.interpolation == "hold" for value in self._sampled)

    def instants(self, duration: float) -> list[float]:
        """Return zero and up to 15 more sample instants of inputs and loads [s]."""
        # Each costs the eigenvalues of some shapes, so not more than some 15 of them.
        times = {t for value in self._sampled for t in value.times}
        later = sorted(t for t in times if 0.0 < t <= duration)
        return [0.0, *later[:: max(1, math.ceil(len(later) / 15))]]

    def knots(self, start: float, end: float) -> list[float]:
        """Return the sample instants of inputs and loads inside a span [s]."""
        least = SAME * (end - start)  # rounding of its ends
        times = {t for value in self._sampled for t in value.times}
        return sorted(t for t in times if start + least < t < end - least)

    def warnings(self, step: float, duration: float) -> tuple[str, ...]:
        """Warnings about samples that change within less than a step, unless a slower lag takes them up."""
        # A lag rounds off what a tension does; a tenth of it resolves its exponential.
        pulled = zip(self._values, self._model.finger.tendon_list, strict=False)
        drive = [tension for tension, tendon in pulled if step <= 0.1 * (tendon.time_constant or 0.0)]
        felt = [value for value in self._sampled if not any(value is tension for tension in drive)]
        shortest = min((gap for value in felt for gap in _changes(value, duration)), default=math.inf)
        if not shortest < step * (1 - SAME):
            return ()
        return (
            f"an input or load changes within {shortest:.3g} s, which steps of {step:.3g} s follow with an error of "
            "the order of its change times a step: let it change more slowly, or take a smaller time.step",
        )

    def smooth(self, step: float, duration: float) -> bool:
        """Whether a method of order 4 keeps its order: no kinks, and no changes within a step."""
        return not self.warnings(step, duration) and all(value.interpolation == "smooth" for value in self._sampled)

    @property
    def _sampled(self) -> list[Samples | VectorSamples]:
        values = [*self._values, *(value for value, *_ in self._forces)]
        return [value for value in values if isinstance(value, (Samples, VectorSamples))]

    def u(self, t: ArrayLike) -> Array:
        """Inputs (T, nu) at instants (T,)."""
        instants = np.atleast_1d(np.asarray(t, dtype=float))
        blocks = np.zeros((3, len(instants), len(self._values)))
        for k, value in enumerate(self._values):
            blocks[:, :, k] = interpolate(value, instants)
        return np.concatenate(list(blocks), axis=1) if self._rates else blocks[0]

    def w(self, t: ArrayLike) -> Array:
        """Forces (T, nw) at instants (T,)."""
        instants = np.atleast_1d(np.asarray(t, dtype=float))
        rows = np.zeros((len(instants), self._nw))
        for value, start, order in self._forces:
            values = interpolate(value, instants)[order].reshape(len(instants), -1)
            rows[:, start : start + values.shape[1]] = values
        return rows


def _changes(value: Samples | VectorSamples, duration: float) -> list[float]:
    """Yield the durations of changes within the motion [s]; values that are held jump and have none."""
    if value.interpolation == "hold":
        return []
    samples = list(zip(value.times, value.values, strict=True))
    return [b - a for (a, v), (b, w) in pairwise(samples) if v != w and b > 0.0 and a < duration]
