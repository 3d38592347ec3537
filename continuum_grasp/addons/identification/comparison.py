"""Measurements beside what a model predicts of them: errors by channel, and what pictures of both need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.blocks import Drawn
from continuum_grasp.addons.identification.data import OF_MODES
from continuum_grasp.addons.identification.numbers import SHOWN_IN, MeasuredColumn, MeasuredNumbers, MeasuredSet
from continuum_grasp.addons.identification.vibrations import damped_sine
from continuum_grasp.base import Array
from continuum_grasp.results import Dimension, Picture, Result, Stored
from continuum_grasp.scene import Scene


@dataclass(frozen=True)
class ComparedChannel:
    """Prediction errors of one quantity at one place of one set, or of readings that share a standard deviation.

    Attributes
    ----------
    name, unit : str
    fitted : bool
        False: a hold-out.
    rms, largest, mean : float
        Root mean square, largest size, and mean with its sign.
    share : float or None
        R.m.s. of a position per length of the finger [1]; None for other quantities.
    count : int
    """

    name: str
    unit: str
    fitted: bool
    rms: float
    largest: float
    mean: float
    share: float | None
    count: int

    @classmethod
    def of(cls, name: str, unit: str, fitted: bool, missed: Array, length: float | None = None) -> ComparedChannel:
        """Errors of predictions that miss measurements (R,), also per the length of the finger where that is given."""
        rms = float(np.sqrt(np.mean(missed**2)))
        share = None if length is None else rms / length
        return cls(name, unit, fitted, rms, float(np.abs(missed).max()), float(missed.mean()), share, missed.size)

    @property
    def texts(self) -> tuple[str, ...]:
        """Name and errors as a table shows them: lengths in mm, angles in degrees."""
        factor, unit = SHOWN_IN.get(self.unit, (1.0, self.unit))
        # 1e-9: share of the greatest error that is rounding, as the mean where a constant offset was fitted
        mean = self.mean if abs(self.mean) > 1e-9 * self.largest else 0.0
        errors = (f"{factor * value:.3g}" for value in (self.rms, self.largest, mean))
        share = "" if self.share is None else f"{100.0 * self.share:.2g} %"
        return (f"{self.name}{'' if self.fitted else ' (hold-out)'}", *errors, unit, share, str(self.count))


HEADINGS = ("channel", "r.m.s.", "at most", "mean", "unit", "of the length", "numbers")
"""Headings of a table of `ComparedChannel.texts`."""


@dataclass(frozen=True)
class Predicted(MeasuredNumbers, Result):
    """Measured numbers with their predictions, set by set; what comparisons and fits share.

    Attributes
    ----------
    sets : tuple of Measured
        The m measured numbers, a table for each set of measurements.
    drawn : tuple of Drawn
        Predicted backbones of each set in some rows or at some instants, where there are any.
    scene : Scene
    """

    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("measured", "(measurement,)", "", "measured numbers"),
        Stored("predictions", "(measurement,)", "", "predictions of the model"),
        Stored("residuals", "(measurement,)", "", "predictions less measurements"),
        Stored("fitted", "(measurement,)", "1", "whether it was fitted"),
        Stored("labels", "(measurement,)", "text", "name of each measured number"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("measurement", "measured numbers, set by set", "measurement_names"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture(
            "shapes", "continuum_grasp.addons.identification.pictures:plot_shapes", needs="has_shapes", panels=True
        ),
        Picture("series", "continuum_grasp.addons.identification.pictures:plot_series", panels=True),
        Picture(
            "ring_downs",
            "continuum_grasp.addons.identification.pictures:plot_ring_downs",
            needs="has_ring_downs",
            panels=True,
        ),
    )

    predicted: ClassVar[str] = "simulated"
    """Word of pictures for predictions."""

    sets: tuple[MeasuredSet, ...]
    predictions: Array
    drawn: tuple[Drawn, ...]
    scene: Scene

    @property
    def has_shapes(self) -> bool | None:
        """True where both coordinates of a point of the finger were measured."""
        return bool(self.points) or None

    @property
    def ring_downs(self) -> list[tuple[str, Any, float, float, Array]]:
        """Name of the set, signal, predicted frequency [Hz] and decay rate [1/s], and the damped sine of these that is
        nearest to the signal (T,), of each record of a vibration.
        """
        predicted = {
            (k, column.quantity): self.predictions[rows] for k, column, rows in self.by_column if self.sets[k].signals
        }
        records = []
        for k, of in enumerate(self.sets):
            for row, signal in enumerate(of.signals):
                frequency, decay_rate = (float(predicted[k, quantity][row]) for quantity in OF_MODES)
                nearest = damped_sine(signal.t, signal.values, frequency, decay_rate)
                records.append((of.name, signal, frequency, decay_rate, nearest))
        return records

    @property
    def has_ring_downs(self) -> bool | None:
        """True where records of vibrations are there."""
        return bool(self.ring_downs) or None

    @property
    def measurement_names(self) -> tuple[str, ...]:
        """Name and unit of each measured number."""
        return tuple(f"{label} [{of.unit}]" for label, of in zip(self.labels, self.described, strict=True))

    @property
    def blocks(self) -> tuple[tuple[str, int], ...]:
        """Name of each set of measurements and how many numbers it has."""
        return tuple((of.name, of.values.size) for of in self.sets)

    @property
    def residuals(self) -> Array:
        """Predictions less measurements (m,), in their units."""
        return self.predictions - self.measured

    @property
    def errors(self) -> tuple[ComparedChannel, ...]:
        """Errors of what was fitted, by what shares a standard deviation."""
        return self._errors(fitted=True)

    @property
    def holdout_errors(self) -> tuple[ComparedChannel, ...]:
        """Errors of what was predicted and not fitted, by what shares a standard deviation."""
        return self._errors(fitted=False)

    def _errors(self, *, fitted: bool) -> tuple[ComparedChannel, ...]:
        members = {name: numbers & (self.fitted == fitted) for name, numbers in self.groups.items()}
        return tuple(
            ComparedChannel.of(name, self.described[int(chosen.argmax())].unit, fitted, self.residuals[chosen])
            for name, chosen in members.items()
            if chosen.any()
        )

    @property
    def points(self) -> dict[tuple[str, float, float, float], tuple[int, int]]:
        """Numbers of x and y of each measured point, by set, row or instant, position along the finger and offset
        [m].
        """
        points: dict[tuple[str, float, float, float], dict[str, int]] = {}
        for of, rows in zip(self.sets, self.slices, strict=True):
            offsets = np.broadcast_to(of.offsets, of.values.shape)
            for number, (row, j) in enumerate(np.ndindex(of.values.shape), rows.start):
                column = of.columns[j]
                if column.quantity in ("x", "y") and column.place is not None:
                    key = of.name, float(of.at[row]), column.place, float(offsets[row, j])
                    points.setdefault(key, {})[column.quantity] = number
        return {key: (of["x"], of["y"]) for key, of in points.items() if len(of) == 2}

    @property
    def series(self) -> dict[tuple[str, str], tuple[MeasuredColumn, bool, NDArray[np.intp]]]:
        """Column, whether along a motion, and numbers (R,) by each set's name and quantity at a place."""
        series: dict[tuple[str, str], tuple[MeasuredColumn, bool, NDArray[np.intp]]] = {}
        for k, column, rows in self.by_column:
            key = self.sets[k].name, column.name
            before = series[key][-1] if key in series else rows[:0]
            series[key] = column, self.sets[k].moves, np.append(before, rows)
        return series

    @property
    def channels(self) -> tuple[ComparedChannel, ...]:
        """Errors of each quantity at each place of each set, hold-outs apart, and of the distances of points."""
        kinds = [
            (f"{name}: {what}", column, rows, self.residuals[rows])
            for (name, what), (column, _, rows) in self.series.items()
        ]
        places = dict[str, list[tuple[int, int]]]()
        for (name, _, place, _), pair in self.points.items():
            beside = "".join(self.described[pair[0]].name.partition(",")[1:])
            places.setdefault(f"{name}: distance at {place:g} m{beside}", []).append(pair)
        for what, pairs in places.items():
            rows, across = np.array(pairs).T
            missed = np.hypot(self.residuals[rows], self.residuals[across])
            kinds.append((what, self.described[rows[0]], rows, missed))
        channels = []
        for what, column, rows, missed in kinds:
            length = self.scene.finger.rod.length if column.quantity in ("x", "y") else None
            for fitted in (True, False):
                errors = missed[self.fitted[rows] == fitted]
                if errors.size:
                    channels.append(ComparedChannel.of(what, column.unit, fitted, errors, length))
        return tuple(channels)

    def details(self) -> dict[str, Any]:
        """Errors of each channel, and sets of measurements, as plain data."""
        sets = [{"name": name, "entries": count} for name, count in self.blocks]
        return {"channels": [dict(vars(channel)) for channel in self.channels], "blocks": sets}


@dataclass(frozen=True)
class Comparison(Predicted):
    """Measurements beside the simulation of a scene as it is: nothing was estimated.

    Attributes
    ----------
    status : {"compared"}
    warnings : tuple of str
    statistics : mapping

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> found = cg.compare("configs/identify/own_finger.yaml")
    >>> found.channels[0].name, found.status
    ('own_finger_weights: x at tip', 'compared')
    """

    kind: ClassVar[str] = "compare"

    status: str = "compared"
    warnings: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)

    def pairs(self) -> dict[str, str]:
        """Errors of the first channels."""
        return {
            channel.name: f"{channel.texts[1]} {channel.texts[4]} r.m.s. {channel.texts[5]}".strip()
            for channel in self.channels[:6]
        }
