"""Logs of a controller: instants, commands and measurements, as rows of a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from continuum_grasp.base import Array, InputError


@dataclass(frozen=True, eq=False)
class ControlLog:
    """Measurements and commands of a controller in K periods.

    Attributes
    ----------
    t : (K,) ndarray
        Instants [s], evenly spaced.
    u : (K, nu) ndarray
        Commands, each held until the next instant.
    y : (K, ny) ndarray
        Measurements that had arrived by then, NaN where a sensor had none.
    u_names, y_names : tuple of str
        Name and unit of each.
    name : str
        Name in reports.

    Raises
    ------
    InputError
        If shapes do not fit, instants are not evenly spaced, or a command is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from continuum_grasp.control import ControlLog
    >>> log = ControlLog(np.array([0.0, 0.01]), np.ones((2, 1)), np.zeros((2, 1)), ("tension_1 [N]",), ("tip_x [m]",))
    >>> print(log.text())
    t [s],commanded_tension_1 [N],tip_x [m]
    0,1,0
    0.01,1,0
    <BLANKLINE>
    """

    COMMANDED: ClassVar[str] = "commanded_"
    """Before the name of an input in the heading of a command: sensors of tensions have the names of inputs."""

    t: Array
    u: Array
    y: Array
    u_names: Sequence[str]
    y_names: Sequence[str]
    name: str = "log"

    def __post_init__(self) -> None:
        count = self.t.size
        for key, names in (("u", self.u_names), ("y", self.y_names)):
            if getattr(self, key).shape != (count, len(names)):
                got = getattr(self, key).shape
                raise InputError(f"{self.name}.{key}: expected ({count}, {len(names)}) numbers, got {got}", key="data")
        if count < 2 or not np.allclose(np.diff(self.t), self.period, rtol=0.0, atol=1e-3 * abs(self.period)):
            raise InputError(f"{self.name}: expected two or more evenly spaced instants", key="data")
        if self.period <= 0.0 or not np.all(np.isfinite(self.u)):
            raise InputError(f"{self.name}: expected instants that increase and finite commands", key="data")

    @property
    def period(self) -> float:
        """Time from one command to the next [s]."""
        return float(self.t[-1] - self.t[0]) / (self.t.size - 1)

    def text(self) -> str:
        """The log as CSV: ``t [s]``, a column per command, its name behind ``commanded_``, and one per measurement."""
        headings = ["t [s]", *(self.COMMANDED + name for name in self.u_names), *self.y_names]
        rows = np.column_stack([self.t, self.u, self.y])
        lines = [",".join(map(_cell, row)) for row in rows]
        return "\n".join([",".join(headings), *lines, ""])


def _cell(value: float) -> str:
    """Write a number for the table of a log; empty if it is missing."""
    return "" if np.isnan(value) else f"{value:.7g}"
