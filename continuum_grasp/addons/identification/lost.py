"""Readings that no finger has: markers that a camera lost and wrote as a number, and sensors that froze.

Readers of logs write 0, -1, 9999 or the last value where a sensor has none. Such a number counts as a measurement, so
every reader of measurements names it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.data import KIND_OF, UNIT_OF, Data, Poses
from continuum_grasp.base import Array
from continuum_grasp.scene import Scene

_JUMP = 10.0
"""Jump off and back per median step, from which a reading is suspected [1]: normal noise has none of 7 in 1e9."""
_BEYOND = 3.0
"""Jump per greatest step of the readings that are not suspected, from which it is no motion [1]: the peaks of a
vibration stand out from their neighbors by less than one step."""
_LEAST = 8
"""Readings below which nothing is suspected [1]: fewer have no usual step."""
FROZEN = 20
"""Equal readings in a row of a sensor that is frozen [1]: noise does not repeat itself."""
_MOVES = 0.2
"""Part of its range by which something else moves meanwhile, from which a repeated reading is frozen [1]."""
_COARSE = 1e-3
"""Resolution per range, from which equal readings of different shapes are those of a coarse sensor [1]."""


class Channel(NamedTuple):
    """Readings (T,) of a quantity, NaN where there are none."""

    name: str
    unit: str
    values: Array


def lost_of(data: Data) -> list[str]:
    """Warnings about readings of the shape that were probably lost or frozen."""
    shape = [reading for reading in data.measured if reading.quantity in KIND_OF]
    channels = [
        Channel(reading.what, UNIT_OF[reading.quantity], np.asarray(reading.values, dtype=float)) for reading in shape
    ]
    if isinstance(data, Poses):
        return [f"{data.name}: {text}" for text in _alike(channels, data.conditions)]
    moved = [] if data.scene is None else _commands(data.scene, np.asarray(data.t, dtype=float))
    return [f"{data.name}: {text}" for text in lost_in(channels, moved)]


def lost_in(channels: Sequence[Channel], moved: Sequence[Array] = ()) -> list[str]:
    """Warnings about readings along a motion, by the commands (T,) that ``moved`` the finger meanwhile."""
    lost = [jumps(channel.values) for channel in channels]
    texts = list[str]()
    for channel, rows in zip(channels, lost, strict=True):
        if rows.any():
            texts.append(_words(channel, rows))
    for k, channel in enumerate(channels):
        others = [other.values for j, other in enumerate(channels) if j != k]
        longest = frozen_rows(channel.values, [*others, *moved])
        if longest and not lost[k].any():
            texts.append(f"{channel.name} is the same in {longest} samples in a row while the finger moves: frozen?")
    return texts


def _words(channel: Channel, rows: NDArray[np.bool_]) -> str:
    values = np.unique(channel.values[rows])
    same = f" to {values[0]:.6g} {channel.unit}" if values.size == 1 else ""
    return (
        f"{channel.name}: {np.count_nonzero(rows)} of {np.count_nonzero(np.isfinite(channel.values))} readings jump "
        f"off{same} and back, as where a marker is lost: leave their cells empty"
    )


def jumps(values: Array) -> NDArray[np.bool_]:
    """Readings (T,) that jump off and back by far more than the others move from one to the next."""
    lost = np.zeros(values.size, dtype=bool)
    there = np.flatnonzero(np.isfinite(values))
    if there.size < _LEAST:
        return lost
    run = np.cumsum(np.diff(values[there], prepend=values[there[0]]) != 0.0)  # equal readings in a row
    levels = values[there[np.unique(run, return_index=True)[1]]]
    away = _away(levels)
    steps = np.abs(np.diff(levels))
    suspected = away > _JUMP * np.median(steps) if steps.size else np.zeros(levels.size, dtype=bool)
    # readings that are equal to a suspected one are suspected as well
    suspected |= np.isin(levels, levels[suspected])
    remaining = levels[~suspected]
    if remaining.size < _LEAST // 2:
        return lost
    usual = float(np.abs(np.diff(remaining)).max())
    suspected &= away > _BEYOND * usual
    lost[there] = suspected[run]
    return lost


def _away(levels: Array) -> Array:
    """Distance (L,) of each level from the middle two of its four neighbors; zero where it is between them."""
    padded = np.concatenate([levels[2:0:-1], levels, levels[-2:-4:-1]]) if levels.size > 3 else levels
    if levels.size <= 3:
        return np.zeros(levels.size)
    neighbors = np.sort(np.stack([padded[k : k + levels.size] for k in (0, 1, 3, 4)]), axis=0)
    return np.maximum(np.maximum(neighbors[1] - levels, levels - neighbors[2]), 0.0)


def frozen_rows(values: Array, others: Sequence[Array]) -> int:
    """Length of the longest run of equal readings (T,) while something else moves; 0 where no sensor is frozen.

    A sensor that is slower than the log repeats every reading, which is no fault.
    """
    there = np.flatnonzero(np.isfinite(values))
    if there.size < 2 * FROZEN:
        return 0
    begins = np.flatnonzero(np.diff(values[there], prepend=np.nan) != 0.0)
    lengths = np.diff(begins, append=there.size)
    if np.median(lengths) > 1.0:
        return 0
    longest = 0
    for begin, length in zip(begins, lengths, strict=True):
        if length < max(FROZEN, longest):
            continue
        rows = there[begin : begin + length]
        if any(_moves(other, rows) for other in others):
            longest = int(length)
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


def _alike(channels: Sequence[Channel], conditions: Mapping[str, object]) -> Iterator[str]:
    """Shapes at rest that are equal to the last digit under different conditions: lost markers, or a frozen camera."""
    fine = [channel for channel in channels if not _is_coarse(channel.values)]
    if len(fine) < 1 or not conditions:
        return
    under = np.column_stack(
        [np.broadcast_to(np.asarray(of, dtype=float), fine[0].values.shape) for of in conditions.values()]
    )
    shapes = np.column_stack([channel.values for channel in fine])
    _, group, counts = np.unique(shapes, axis=0, return_inverse=True, return_counts=True)
    for number in np.flatnonzero(counts > 1):
        rows = np.flatnonzero(group.ravel() == number)
        if len(np.unique(under[rows], axis=0)) > 1 and len(rows) < len(shapes):
            listed = ", ".join(str(row + 1) for row in rows[:6]) + (", ..." if rows.size > 6 else "")
            values = ", ".join(f"{channel.name} {channel.values[rows[0]]:.6g} {channel.unit}" for channel in fine)
            yield (
                f"rows {listed} have the very same readings under different conditions ({values}), as where a marker "
                "is lost or a camera froze: leave their cells empty"
            )


def _is_coarse(values: Array) -> bool:
    """Whether readings have so few levels that different shapes may well be read alike."""
    levels = np.unique(values[np.isfinite(values)])
    return levels.size < 3 or float(np.diff(levels).min()) > _COARSE * float(np.ptp(levels))
