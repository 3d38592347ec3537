"""Readings that no finger has: markers that a camera lost and wrote as a number, and sensors that froze.

Readers of logs write 0, -1, 9999 or the last value where a sensor has none. Such a number counts as a measurement, so
every reader of measurements names it.
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
"""Jump off and back per greatest step of all other readings, from which it is no motion [1]: the peaks of a vibration
stand out from their neighbors by less than one step."""
_RARE = 0.02
"""Share of readings that may jump to a number of their own [1]: more are a fast motion in few samples."""
_LEAST = 8
"""Readings below which nothing is suspected [1]: fewer have no usual step."""
FROZEN = 20
"""Equal readings in a row of a sensor that is frozen [1]: noise does not repeat itself."""
_MOVES = 0.2
"""Part of its range by which something else moves meanwhile, from which a repeated reading is frozen [1]."""
_CATCHES_UP = 5.0
"""Jump at the end of equal readings per step behind it [1]: a sensor that was frozen catches up with all samples that
it missed, a finger that stuck moves on as slowly as it began."""
_LEVELS = 1000.0
"""Levels of a sensor in the range of its readings, below which different shapes may well be read alike [1]."""


class LoggedReading(NamedTuple):
    """Readings (T,) of a quantity, NaN where there are none."""

    name: str
    unit: str
    values: Array


class LostReadings(NamedTuple):
    """Readings that were probably lost or frozen: a warning, and their share of all readings of the quantity [1]."""

    text: str
    share: float

    @property
    def explain_misfits(self) -> bool:
        """Whether they are so many that a model misses the data because of them."""
        return self.share > _RARE


def lost_of(data: Data) -> list[LostReadings]:
    """Warnings about readings of the shape that were probably lost or frozen."""
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
    """Warnings about readings along a motion, by the commands (T,) that ``moved`` the finger meanwhile."""
    found = list[LostReadings]()
    values = [channel.values for channel in channels]
    for k, channel in enumerate(channels):
        others = values[:k] + values[k + 1 :]
        rows = jumps(channel.values, others)
        longest = 0 if rows.any() else frozen_rows(channel.values, others, moved)
        if rows.any():
            found.append(LostReadings(_words(channel, rows), float(np.mean(rows))))
        elif longest:
            text = (
                f"{channel.name}: {longest} readings in a row are the same while the finger moves, as where a sensor "
            )
            found.append(LostReadings(text + "freezes: leave their cells empty", longest / channel.values.size))
    return found


def _words(channel: LoggedReading, rows: NDArray[np.bool_]) -> str:
    values = np.unique(channel.values[rows])
    same = f" to {values[0]:.6g} {channel.unit}" if values.size == 1 else ""
    return (
        f"{channel.name}: {np.count_nonzero(rows)} of {np.count_nonzero(np.isfinite(channel.values))} readings jump "
        f"off{same} and back, as where a marker is lost: leave their cells empty"
    )


def jumps(values: Array, others: Sequence[Array] = ()) -> NDArray[np.bool_]:
    """Readings (T,) that jump off and back by far more than all others move from one to the next.

    They have one number again and again, or are rare. At the begin and the end of a motion, where a reading need not
    come back, it counts where ``others`` have that number, too.
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
    """Number that is farthest from its neighbors among readings (T,), where that is beyond the steps of all others.

    A motion may pass by a number that comes again and again, so the median of its distances counts.
    """
    begins = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)  # equal readings in a row are one level
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
    """Distance (L,) of each level from the middle two of its four neighbors; zero where it is between them.

    Those at the ends, which have fewer neighbors, count where they ``may_end``.
    """
    padded = np.concatenate([levels[2:0:-1], levels, levels[-2:-4:-1]])
    neighbors = np.sort(np.stack([padded[k : k + levels.size] for k in (0, 1, 3, 4)]), axis=0)
    away: Array = np.maximum(np.maximum(neighbors[1] - levels, levels - neighbors[2]), 0.0)
    away[[0, -1]] *= may_end[[0, -1]]
    return away


def frozen_rows(values: Array, others: Sequence[Array], moved: Sequence[Array] = ()) -> int:
    """Length of the longest run of equal readings (T,) of a frozen sensor, while ``others`` or commands move; 0: none.

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
    """Whether something moves in some rows by a good part of its range."""
    inside = values[rows]
    inside = inside[np.isfinite(inside)]
    whole = values[np.isfinite(values)]
    return bool(inside.size and np.ptp(whole) > 0.0 and np.ptp(inside) > _MOVES * np.ptp(whole))


def _commands(scene: Scene, t: Array) -> list[Array]:
    """Commands (T,) of the scene that change with time."""
    commands = () if scene.actuation is None else scene.actuation.values
    return [np.interp(t, of.times, of.values) for of in commands if not isinstance(of, (int, float))]


def _alike(channels: Sequence[LoggedReading], conditions: Mapping[str, ArrayLike]) -> Iterator[LostReadings]:
    """Shapes at rest that are equal to the last digit under different conditions: lost markers, or a frozen camera.

    One reading alone is often equal by chance.
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
                f"rows {listed} have the very same readings under different conditions ({values}), as where a marker "
                "is lost or a camera froze: leave their cells empty"
            )
            yield LostReadings(text, len(rows) / len(shapes))


def _is_coarse(values: Array) -> bool:
    """Whether readings are multiples of a power of ten so large that different shapes may well be read alike."""
    for digits in range(7):
        scaled = values * 10.0**digits
        if np.allclose(scaled, np.round(scaled), rtol=0.0, atol=1e-6):
            return bool(np.ptp(scaled) < _LEVELS)
    return False
