"""Numbers of a bench and of the model: readings and commands through the lines of a mounting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError
from continuum_grasp.scene import Connection, Mounting


class Affine(NamedTuple):
    """Numbers of the bench (..., K) from the model's numbers (..., K): matrix times these, plus shift."""

    matrix: Array
    shift: Array

    def __call__(self, model: ArrayLike) -> Array:
        """Numbers of the bench; a number that is missing (NaN) takes along only what needs it."""
        return _times(self.matrix, np.asarray(model, dtype=float)) + self.shift

    def back(self, bench: ArrayLike) -> Array:
        """Numbers of the model, from the bench's numbers."""
        return _times(np.linalg.inv(self.matrix), np.asarray(bench, dtype=float) - self.shift)


def _times(matrix: ArrayLike, values: Array) -> Array:
    weights = np.asarray(matrix, dtype=float)
    return np.asarray(np.where(weights != 0.0, weights * values[..., None, :], 0.0).sum(axis=-1))


@dataclass(frozen=True)
class Wiring:
    """Readings and commands of a bench from the model's."""

    TIP: ClassVar[tuple[str, str]] = ("tip_x [m]", "tip_y [m]")
    """Readings of the camera."""

    readings: Affine
    commands: Affine

    @staticmethod
    def of(mounting: Mounting | None, reading_names: Sequence[str], command_names: Sequence[str], key: str) -> Wiring:
        """Wiring by the names and units of readings and commands; ``key`` is where the mounting stands in its scene."""
        known = Mounting() if mounting is None else mounting
        readings = Affine(np.eye(len(reading_names)), np.zeros(len(reading_names)))
        if set(Wiring.TIP) <= set(reading_names):
            rows = [reading_names.index(name) for name in Wiring.TIP]
            turn = camera_axes(known.camera.angle, known.camera.mirrored) * known.camera.scale
            readings.matrix[np.ix_(rows, rows)] = turn
            readings.shift[rows] = -turn @ known.camera.position
        pulled = [reading_names.index(name) for name in command_names if name in reading_names]
        _connect(readings, known.tensions, pulled, f"{key}.tensions")
        commands = Affine(np.eye(len(command_names)), np.zeros(len(command_names)))
        _connect(commands, known.drives, list(range(len(command_names))), f"{key}.drives")
        return Wiring(readings, commands)


def camera_axes(angle: float, mirrored: bool) -> Array:
    """Matrix (2, 2) from world directions to the directions of a camera without scale."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [s, -c] if mirrored else [-s, c]])


def _connect(to: Affine, lines: Sequence[Connection], rows: Sequence[int], key: str) -> None:
    if lines and len(lines) != len(rows):
        raise InputError(f"expected {len(rows)} lines, one for each tendon, got {len(lines)}", key=key)
    for row, line in zip(rows, lines, strict=False):
        to.matrix[row] = 0.0
        to.matrix[row, rows[line.of - 1]] = line.sign
        to.shift[row] = line.zero
