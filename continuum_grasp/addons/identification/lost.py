"""Find readings that no finger produces: lost markers that a camera logged as a number, and frozen sensors.

Loggers write 0, -1, 9999 or the last value if a sensor has no reading. Such a number would count as a measurement, so
every reader of measurements warns of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.addons.identification.data import KIND_OF, UNIT_OF, Data, Poses
from continuum_grasp.base import Array
from continuum_grasp.scene import Scene

_BEYOND = 3.0
"""A jump off and back of more than this times the greatest step between other readings is no motion [1]: the peak of a
vibration differs from its neighbors by less than one step."""
_RARE = 0.02
"""Greatest share of lost readings with different numbers [1]: more jumps are a fast motion with few samples."""
_LEAST = 8
"""Fewest readings that show a usual step [1]; with fewer nothing is suspected."""
FROZEN = 20
"""A frozen sensor has at least this many equal readings in a row [1]: noise does not repeat itself."""
_MOVES = 0.2
"""A repeated reading is frozen if another channel moves by at least this share of its range meanwhile [1]."""
_CATCHES_UP = 5.0
"""Least jump after equal readings, per following step [1]: a frozen sensor catches up with all missed samples, whereas
a finger that stuck moves on slowly."""
_LEVELS = 1000.0
"""With fewer levels of a sensor in the range of its readings, different shapes may give equal readings [1]."""


class LoggedReading(NamedTuple):
    """Readings (T,) of a quantity; NaN marks missing readings."""

    name: str
    unit: str
    values: Array


class LostReadings(NamedTuple):
    """Warning about readings that were probably lost or frozen, with their share of the quantity's readings [1]."""

    text: str
    share: float

    @property
    def explain_misfits(self) -> bool:
        """Whether the share is large enough to explain a misfit of the model."""
        return self.share > _RARE


def lost_of(data: Data) -> list[LostReadings]:
    """Warn of readings of the shape that were probably lost or frozen."""
    shape = [reading for reading in data.measured if reading.quantity in KIND_OF]
    channels = [
        LoggedReading(reading.what, UNIT_OF[reading.quantity], np.asarray(reading.values, dtype=float))
        for reading in shape
    ]
    if isinstance(data, Poses):
        lost = [*_alike(channels, data.conditions)]
        return [each._replace(text=f"{data.name}: {each.text}") for each in lost]
    moved = [] if data.scene is None else _commands(data.scene, np.asarray(data.t, dtype=float))
    return [each._replace(text=f"{data.name}: {each.text}") for each in lost_in(channels, moved)]


def lost_in(channels: Sequence[LoggedReading], moved: Sequence[Array] = ()) -> list[LostReadings]:
    """Warn of lost or frozen readings along a motion; commands (T,) ``moved`` the finger meanwhile."""
    found = list[LostReadings]()
    values = [channel.values for channel in channels]
    for k, channel in enumerate(channels):
        others = values[:k] + values[k + 1 :]
        rows = jumps(channel.values, others)
        longest = 0 if rows.any() else frozen_rows(channel.values, others, moved)
        if rows.any():
            found.append(LostReadings(_words(channel, rows), float(np.mean(rows))))
        elif longest:
            text = f"{channel.name}: {longest} readings in a row are the same while the finger moves, as if the sensor "
            found.append(LostReadings(text + "froze: leave their cells empty", longest / channel.values.size))
    return found


def _words(channel: LoggedReading, rows: NDArray[np.bool_]) -> str:
    values = np.unique(channel.values[rows])
    same = f" to {values[0]:.6g} {channel.unit}" if values.size == 1 else ""
    return (
        f"{channel.name}: {np.count_nonzero(rows)} of {np.count_nonzero(np.isfinite(channel.values))} readings jump "
        f"off{same} and back, as if a marker was lost: leave their cells empty"
    )


def jumps(values: Array, others: Sequence[Array] = ()) -> NDArray[np.bool_]:
    """Find readings (T,) that jump off and back by far more than the steps between all other readings.

    They repeat one number, or are rare. A reading at the start or end of a motion, which cannot jump back, counts if
    ``others`` have that number too.
    """
    left = np.isfinite(values)
    numbers, counts = np.unique(values[left], return_counts=True)
    again = dict(zip(numbers.tolist(), (counts > 1).tolist(), strict=True))
    everywhere = np.any([other == values for other in others], axis=0) if others else np.zeros(values.size, bool)
    none = np.zeros(values.size, dtype=bool)
    lost = dict[bool, NDArray[np.bool_]]()
    while (number := _farthest(values[left], everywhere[left])) is not None:
        rows = values == number
        lost[again[number]] = lost.get(again[number], none) | rows
        left &= ~rows
    if False in lost and lost[False].sum() > _RARE * counts.sum():
        del lost[False]
    return reduce(np.logical_or, lost.values(), none)


def _farthest(values: Array, everywhere: NDArray[np.bool_]) -> float | None:
    """Find the number that differs most from its neighbors among readings (T,), by more than all other steps.

    A motion may pass a number repeatedly, so the median of the differences counts.
    """
    begins = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)  # consecutive equal readings form one level
    levels = values[begins]
    if levels.size < _LEAST:
        return None
    away = _away(levels, everywhere[begins])
    own = levels == levels[np.argmax(away)]
    others = levels[~own]
    if others.size < _LEAST // 2 or np.median(away[own]) <= _BEYOND * np.abs(np.diff(others)).max():
        return None
    return float(levels[own][0])


def _away(levels: Array, may_end: NDArray[np.bool_]) -> Array:
    """Return the distance (L,) of each level from the middle two of its four neighbors; zero between these.

    Levels at the ends, with fewer neighbors, count if they ``may_end``.
    """
    padded = np.concatenate([levels[2:0:-1], levels, levels[-2:-4:-1]])
    neighbors = np.sort(np.stack([padded[k : k + levels.size] for k in (0, 1, 3, 4)]), axis=0)
    away: Array = np.maximum(np.maximum(neighbors[1] - levels, levels - neighbors[2]), 0.0)
    away[[0, -1]] *= may_end[[0, -1]]
    return away


def frozen_rows(values: Array, others: Sequence[Array], moved: Sequence[Array] = ()) -> int:
    """Return the longest run of equal readings (T,) of a frozen sensor, while ``others`` or commands move; 0: none.

    A sensor that is slower than the log repeats every reading, which is no fault.
    """
    there = np.flatnonzero(np.isfinite(values))
    if there.size < 2 * FROZEN:
        return 0
    begins = np.flatnonzero(np.diff(values[there], prepend=np.nan) != 0.0)
    lengths = np.diff(begins, append=there.size)
    if np.median(lengths) > 1.0:
        return 0
    steps = np.abs(np.diff(values[there]))
    longest = 0
    for begin, length in zip(begins.tolist(), lengths.tolist(), strict=True):
        end = begin + length
        rows = there[begin:end]
        if length < max(FROZEN, longest):
            continue
        if end == there.size:
            frozen = any(_moves(other, rows) for other in others)
        else:
            catches_up = steps[end - 1] > _CATCHES_UP * float(
                np.median(steps[end : end + 5] if end < steps.size else 0.0)
            )
            frozen = bool(catches_up) and any(_moves(other, rows) for other in (*others, *moved))
        longest = length if frozen else longest
    return longest


def _moves(values: Array, rows: NDArray[np.intp]) -> bool:
    """Whether a channel moves in some rows by a good part of its range."""
    inside = values[rows]
    inside = inside[np.isfinite(inside)]
    whole = values[np.isfinite(values)]
    return bool(inside.size and np.ptp(whole) > 0.0 and np.ptp(inside) > _MOVES * np.ptp(whole))


def _commands(scene: Scene, t: Array) -> list[Array]:
    """Return the commands (T,) of the scene that vary in time."""
    commands = () if scene.actuation is None else scene.actuation.values
    return [np.interp(t, of.times, of.values) for of in commands if not isinstance(of, (int, float))]


def _alike(channels: Sequence[LoggedReading], conditions: Mapping[str, ArrayLike]) -> Iterator[LostReadings]:
    """Find shapes at rest with equal digits under different conditions: lost markers, or a frozen camera.

    A single reading is often equal by chance.
    """
    if len(channels) < 2 or not conditions:
        return
    shapes = np.column_stack([channel.values for channel in channels])
    under = np.column_stack([np.broadcast_to(np.asarray(of, dtype=float), len(shapes)) for of in conditions.values()])
    fine = not all(_is_coarse(channel.values) for channel in channels)
    _, group, counts = np.unique(shapes, axis=0, return_inverse=True, return_counts=True)
    for number in np.flatnonzero(counts > 1):
        rows = np.flatnonzero(group.ravel() == number)
        one_number = np.ptp(shapes[rows[0]]) == 0.0
        if len(np.unique(under[rows], axis=0)) > 1 and len(rows) < len(shapes) and (fine or one_number):
            listed = ", ".join(str(row + 1) for row in rows[:6]) + (", ..." if rows.size > 6 else "")
            values = ", ".join(f"{channel.name} {channel.values[rows[0]]:.6g} {channel.unit}" for channel in channels)
            text = (
                f"rows {listed} have equal readings under different conditions ({values}), as if a marker "
                "was lost or a camera froze: leave their cells empty"
            )
            yield LostReadings(text, len(rows) / len(shapes))


def _is_coarse(values: Array) -> bool:
    """Whether the resolution of the readings, a power of ten, is so coarse that different shapes may give equal
    readings.
    """
    for digits in range(7):
        scaled = values * 10.0**digits
        if np.allclose(scaled, np.round(scaled), rtol=0.0, atol=1e-6):
            return bool(np.ptp(scaled) < _LEVELS)
    return False
