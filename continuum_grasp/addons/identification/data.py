"""Measurements as arrays, in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.addons.identification.scene import OF_BENDS
from continuum_grasp.base import Array, CheckedArgument, InputError
from continuum_grasp.scene import Scene

UNIT_OF = {
    "x": "m",
    "y": "m",
    "angle": "rad",
    "bend": "rad",
    "tension": "N",
    "length": "m",
    "motor_angle": "rad",
    "torque": "N m",
    "frequency": "Hz",
    "decay_rate": "1/s",
}
"""SI units of the quantities that are measured at a section, at a drive, and of a natural mode."""
KIND_OF = {"x": "positions", "y": "positions", "angle": "angles", "bend": "angles"}
"""Quantities at sections, which share a standard deviation; quantities of drives and modes have one each."""
OF_MODES = ("frequency", "decay_rate")
"""Quantities of small free vibrations about rest."""
STARTS = ("scene", "estimated")
"""Starts of the motion of a path."""
START_SAMPLES = 7
"""Samples that an estimated start is read from [1]: a parabola through them halves the noise of the position and leaves
the rate with a third of what two samples would."""


@dataclass(frozen=True)
class Reading:
    """Measured quantity at one section or drive, or of one natural mode, in every row.

    Attributes
    ----------
    quantity : {"x", "y", "angle", "bend", "tension", "length", "motor_angle", "torque", ...}
        World position [m], angle of the section in the world [rad], angle between base and section [rad]; tension at
        the drive [N]; cable wound up [m]; angle [rad] and torque [N m] of a motor; "frequency" [Hz] and
        "decay_rate" [1/s] of the amplitude of a free vibration that is damped.
    values : (R,) array_like
    at : float, optional
        Position along the finger [m]; by default the tip.
    sigma : float, optional
        Standard deviation, where known.
    since : float, optional
        Position from which a bend counts [m]; by default the base.
    of : int, optional
        Number of the tendon, drive or mode, from 1; by default the first.
    offset : float or (R,) array_like
        Distance of a marker from the backbone [m], along the section's X axis: to the right, seen from base to tip.
    """

    quantity: str
    values: ArrayLike
    at: float | None = None
    sigma: float | None = None
    since: float | None = None
    of: int | None = None
    offset: ArrayLike = 0.0

    def selected(self, rows: NDArray[np.bool_]) -> Reading:
        """Copy of the reading with some rows (R,) alone."""
        offset = np.asarray(self.offset)[rows] if np.ndim(self.offset) else self.offset
        return replace(self, values=np.asarray(self.values)[rows], offset=offset)

    @property
    def of_drive(self) -> bool:
        """Whether it was measured at a drive."""
        return self.quantity not in (*KIND_OF, *OF_MODES)

    @property
    def of_mode(self) -> bool:
        """Whether this reading is the frequency or the decay rate of a natural mode."""
        return self.quantity in OF_MODES

    @property
    def what(self) -> str:
        """Quantity and place, for labels."""
        if self.of_mode:
            return f"{self.quantity.replace('_', ' ')} of mode {self.of or 1}"
        if self.of_drive:
            return f"{self.quantity} {self.of or 1}"
        end = "tip" if self.at is None else f"{self.at:g} m"
        beside = f", {self.offset:+g} m beside" if np.ndim(self.offset) == 0 and self.offset else ""
        return f"{self.quantity} of {end if self.since is None else f'{self.since:g} to {end}'}{beside}"

    @property
    def kind(self) -> str:
        """Kind of readings that share a standard deviation."""
        return KIND_OF.get(self.quantity, self.quantity)


class Signal(NamedTuple):
    """Record of a free vibration, from which frequency and decay rate of a row were read: T instants [s] and values."""

    name: str
    t: Array
    values: Array


@dataclass(frozen=True)
class Poses:
    """Shapes at rest, and vibrations about them: R rows.

    Attributes
    ----------
    measured : sequence of Reading
    conditions : mapping of str to (R,) array_like
        Inputs, forces or parameters of the model under which each row was measured, by name; all others are the
        scene's.
    fitted : (R,) array_like of bool, optional
        False for rows that are predicted and not fitted.
    scene : Scene, optional
        Scene of these data, where it differs from the scene of the identification.
    name : str
    sequence : bool
        Whether the rows follow one another, so that the friction of each comes from the rows before it.
    plane : float, optional
        Direction in which the finger bends, about its straight axis [rad], for estimates ``per: plane``.
    signals : sequence of Signal
        Records that the rows were read from, which pictures show; none where these are not known.
    notes, unread : sequence of str
        Warnings of the reader of a file, such as rows that were sorted; and columns of files that nothing reads.
    """

    measured: Sequence[Reading]
    conditions: Mapping[str, ArrayLike] = field(default_factory=dict)
    fitted: ArrayLike | None = None
    scene: Scene | None = None
    name: str = "poses"
    sequence: bool = False
    plane: float | None = None
    signals: Sequence[Signal] = ()
    notes: Sequence[str] = ()
    unread: Sequence[str] = ()

    def __post_init__(self) -> None:
        _check_readings(self.name, self.measured)
        for key, values in self.conditions.items():
            column(f"{self.name}.conditions.{key}", values, self.rows)
        if self.fitted is not None and np.shape(self.fitted) != (self.rows,):
            message = f"expected {self.rows} truth values, got shape {np.shape(self.fitted)}"
            raise InputError(message, key=f"{self.name}.fitted")

    @property
    def rows(self) -> int:
        """Number of rows R."""
        return int(np.size(self.measured[0].values))


@dataclass(frozen=True)
class TipPath:
    """Readings along a motion, such as the path of the tip: T instants.

    Attributes
    ----------
    t : (T,) array_like
        Instants [s], increasing, counted from the start of the scene's motion.
    measured : sequence of Reading
        Readings, T values each.
    start : {"scene", "estimated"}
        Start of the motion: at time zero as ``initial`` of the scene says, or at ``t[0]`` in a shape and rates that
        are estimated with the parameters, from the smoothest ones through the first samples on.
    start_sigma : (2,) sequence of float, optional
        Standard deviations of an estimated start from the start in the first samples: of the bend of every element
        [rad] and of its rate [rad/s]; where not given, any start is as likely.
    before : sequence of Reading
        The same as ``measured``, before the first instant: shapes that the friction of a finger goes through before an
        estimated start, from the first on, which was reached as ``initial.reached_by`` of the scene says.
    fitted : bool
        False: predicted and not fitted.
    scene : Scene, optional
        Scene of these data, where it differs from the scene of the identification.
    name : str
    plane : float, optional
        Direction in which the finger bends, about its straight axis [rad], for estimates ``per: plane``.
    notes, unread : sequence of str
        Warnings of the reader of a file, such as rows that were sorted; and columns of files that nothing reads.
    """

    t: ArrayLike
    measured: Sequence[Reading]
    fitted: bool = True
    scene: Scene | None = None
    name: str = "path"
    start: str = "scene"
    before: Sequence[Reading] = ()
    start_sigma: tuple[float, float] | None = None
    plane: float | None = None
    notes: Sequence[str] = ()
    unread: Sequence[str] = ()

    def __post_init__(self) -> None:
        t = column(f"{self.name}.t", self.t)
        if t.size < 2 or np.any(np.diff(t) <= 0.0) or t[0] < 0.0:
            raise InputError("expected two or more instants that increase from 0 on", key=f"{self.name}.t")
        _check_readings(self.name, self.measured, t.size)
        if any(reading.of_mode for reading in self.measured):
            raise InputError("vibrations are about rest: give them as Poses", key=f"{self.name}.measured")
        if self.start not in STARTS:
            raise InputError(f"expected one of {', '.join(STARTS)}, got {self.start!r:.60}", key=f"{self.name}.start")
        if self.start != "scene" and t.size < START_SAMPLES:
            raise InputError(f"an estimated start takes {START_SAMPLES} samples, got {t.size}", key=f"{self.name}.t")
        if self.start_sigma is not None:
            key = f"{self.name}.start_sigma"
            if self.start != "estimated" or np.shape(self.start_sigma) != (2,):
                raise InputError("expected two numbers for an estimated start", key=key)
            for deviation in self.start_sigma:
                CheckedArgument(key, deviation).number()


Data = Poses | TipPath


def column(key: str, values: ArrayLike, count: int | None = None) -> Array:
    """A row of ``count`` finite numbers; anything else is an `InputError`."""
    array = CheckedArgument(key, values).array().reshape(np.shape(values))
    if array.ndim != 1 or (count is not None and array.size != count):
        wanted = "a row of numbers" if count is None else f"{count} numbers"
        raise InputError(f"expected {wanted}, got an array of shape {array.shape}", key=key)
    broken = np.flatnonzero(~np.isfinite(array))
    if broken.size:
        raise InputError(f"expected finite numbers, entry {broken[0]} is {array[broken[0]]}", key=key)
    return array


def _check_readings(name: str, readings: Sequence[Reading], count: int | None = None) -> None:
    if not isinstance(readings, Sequence) or not readings or not all(isinstance(entry, Reading) for entry in readings):
        raise InputError("expected at least one reading, such as Reading('x', values)", key=f"{name}.measured")
    count = count or int(np.size(readings[0].values))
    for k, reading in enumerate(readings):
        if reading.quantity not in UNIT_OF:
            message = f"expected one of {', '.join(UNIT_OF)}, got {reading.quantity!r}"
            raise InputError(message, key=f"{name}.measured[{k}].quantity")
        if reading.of is not None:
            CheckedArgument(f"{name}.measured[{k}].of", reading.of).whole()
        if reading.what in [other.what for other in readings[:k]]:
            raise InputError(f"{reading.what} is given twice: it would count twice", key=f"{name}.measured[{k}]")
        OF_BENDS.check(reading, f"{name}.measured[{k}]", {"since": reading.since is not None})
        values = column(f"{name}.measured[{k}].values", reading.values, count)
        if reading.quantity == "frequency" and np.any(values <= 0.0):
            raise InputError("expected frequencies above 0 Hz", key=f"{name}.measured[{k}].values")
        if reading.sigma is not None:
            CheckedArgument(f"{name}.measured[{k}].sigma", reading.sigma).number()
        if np.ndim(reading.offset):
            column(f"{name}.measured[{k}].offset", reading.offset, count)
