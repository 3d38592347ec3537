"""Measurements beside what a model predicts of them: errors by channel, and what pictures of both need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arrays import Array
from continuum_grasp.identification.blocks import Drawn, Entry
from continuum_grasp.labels import SHOWN_IN
from continuum_grasp.results.declared import Dimension, Picture, Stored
from continuum_grasp.results.result import Result
from continuum_grasp.scene.simulate import Scene


@dataclass(frozen=True)
class Channel:
    """Prediction errors of one quantity at one place of one set, or of what shares a standard deviation.

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
    def of(cls, name: str, unit: str, fitted: bool, missed: Array, length: float | None = None) -> Channel:
        """Errors of predictions that miss measurements (R,), also per the length of the finger where that is given."""
        rms = float(np.sqrt(np.mean(missed**2)))
        share = None if length is None else rms / length
        return cls(name, unit, fitted, rms, float(np.abs(missed).max()), float(missed.mean()), share, missed.size)

    @property
    def texts(self) -> tuple[str, ...]:
        """Name and errors as a table shows them: lengths in mm, angles in degrees."""
        factor, unit = SHOWN_IN.get(self.unit, (1.0, self.unit))
        errors = (f"{factor * value:.3g}" for value in (self.rms, self.largest, self.mean))
        share = "" if self.share is None else f"{100.0 * self.share:.2g} %"
        return (f"{self.name}{'' if self.fitted else ' (hold-out)'}", *errors, unit, share, str(self.count))


HEADINGS = ("channel", "r.m.s.", "at most", "mean", "unit", "of the length", "numbers")
"""Headings of a table of `Channel.texts`."""


@dataclass(frozen=True)
class Predicted(Result):
    """Measured numbers with their predictions, set by set; what comparisons and fits share.

    Attributes
    ----------
    entries : tuple of Entry
        The m measured numbers: label, group, unit, value, whether fitted.
    blocks : tuple of (str, int)
        Name of each set of measurements and how many entries it has.
    drawn : tuple of Drawn
        Predicted backbones of each set in some rows or at some instants.
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
        Picture("shapes", "plotting.identification:plot_shapes", needs="has_shapes", panels=True),
        Picture("series", "plotting.identification:plot_series", panels=True),
    )

    predicted: ClassVar[str] = "simulated"
    """Word of pictures for predictions."""

    entries: tuple[Entry, ...]
    predictions: Array
    blocks: tuple[tuple[str, int], ...]
    drawn: tuple[Drawn, ...]
    scene: Scene

    @property
    def has_shapes(self) -> bool | None:
        """True where both coordinates of a point of the finger were measured."""
        return bool(self.points) or None

    @property
    def measurement_names(self) -> tuple[str, ...]:
        """Name and unit of each measured number."""
        return tuple(f"{entry.label} [{entry.unit}]" for entry in self.entries)

    @cached_property
    def measured(self) -> Array:
        """Measured values (m,)."""
        return np.array([entry.value for entry in self.entries])

    @cached_property
    def fitted(self) -> NDArray[np.bool_]:
        """Mask of the entries that were fitted (m,)."""
        return np.array([entry.fitted for entry in self.entries], dtype=bool)

    @property
    def residuals(self) -> Array:
        """Predictions less measurements (m,), in the units of the entries."""
        return self.predictions - self.measured

    @property
    def labels(self) -> tuple[str, ...]:
        """Name of each entry."""
        return tuple(entry.label for entry in self.entries)

    @property
    def errors(self) -> tuple[Channel, ...]:
        """Errors of what was fitted, by what shares a standard deviation."""
        return self._errors(fitted=True)

    @property
    def holdout_errors(self) -> tuple[Channel, ...]:
        """Errors of what was predicted and not fitted, by what shares a standard deviation."""
        return self._errors(fitted=False)

    def _errors(self, *, fitted: bool) -> tuple[Channel, ...]:
        groups = np.array([entry.group for entry in self.entries])
        units = {entry.group: entry.unit for entry in self.entries}
        missed = {group: self.residuals[(groups == group) & (self.fitted == fitted)] for group in units}
        return tuple(Channel.of(group, units[group], fitted, errors) for group, errors in missed.items() if errors.size)

    @property
    def series(self) -> dict[tuple[str, str], NDArray[np.intp]]:
        """Entries (R,) of each set's name and quantity at a place, in their order."""
        series: dict[tuple[str, str], list[int]] = {}
        for row, (name, entry) in enumerate(zip(self.set_of, self.entries, strict=True)):
            series.setdefault((name, entry.series), []).append(row)
        return {key: np.array(rows) for key, rows in series.items()}

    @property
    def points(self) -> dict[tuple[str, float, float, float], tuple[int, int]]:
        """Entries of x and y of each measured point, by set, row or instant, position along the finger and offset
        [m].
        """
        points: dict[tuple[str, float, float, float], dict[str, int]] = {}
        for row, (name, entry) in enumerate(zip(self.set_of, self.entries, strict=True)):
            if entry.quantity in ("x", "y") and entry.place is not None:
                points.setdefault((name, entry.at, entry.place, entry.offset), {})[entry.quantity] = row
        return {key: (of["x"], of["y"]) for key, of in points.items() if len(of) == 2}

    @property
    def paths(self) -> set[str]:
        """Names of the sets whose entries are along a motion."""
        return {name for (name, _), lines in zip(self.blocks, self.drawn, strict=True) if lines.over_time}

    @property
    def set_of(self) -> list[str]:
        """Name of the set of each entry."""
        return [name for name, count in self.blocks for _ in range(count)]

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Errors of each quantity at each place of each set, hold-outs apart, and of the distances of points."""
        kinds = [
            (f"{name}: {what}", self.entries[rows[0]].unit, rows, self.residuals[rows])
            for (name, what), rows in self.series.items()
        ]
        places = dict[str, list[tuple[int, int]]]()
        for (name, _, place, _), (x, y) in self.points.items():
            beside = "".join(self.entries[x].series.partition(",")[1:])
            places.setdefault(f"{name}: distance at {place:g} m{beside}", []).append((x, y))
        for what, pairs in places.items():
            rows, across = np.array(pairs).T
            kinds.append((what, "m", rows, np.hypot(self.residuals[rows], self.residuals[across])))
        channels = []
        for what, unit, rows, missed in kinds:
            length = self.scene.finger.rod.length if self.entries[rows[0]].quantity in ("x", "y") else None
            for fitted in (True, False):
                errors = missed[self.fitted[rows] == fitted]
                if errors.size:
                    channels.append(Channel.of(what, unit, fitted, errors, length))
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
