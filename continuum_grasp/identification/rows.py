"""Inputs, forces and parameters of each row of measurements as functions of the unknowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.identification.data import column
from continuum_grasp.identification.unknowns import DEADBAND, Unknown
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.loads import Load
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.signals import Signals

__all__ = ["Rows", "runtime_names"]

Array = NDArray[np.float64]

_ROUNDING = 0.01
"""Width over which the corner of the deadband is rounded off [N], for a derivative there:
a hundredth of a typical deadband."""


def runtime_names(scene: Scene, unknowns: Sequence[Unknown], more: Sequence[str] = ()) -> tuple[str, ...]:
    """Parameters that the model keeps as run-time arguments."""
    own = (one.target for one in unknowns if one.target != DEADBAND)
    return tuple(dict.fromkeys((*scene.parameters, *own, *more)))


class Rows:
    """The argument z = [u, w, p] of a model in every row, and its derivative with respect to the unknowns.

    Parameters
    ----------
    scene : Scene
        Values of what no row says, at time zero.
    unknowns : sequence of Unknown
    conditions : mapping of str to (R,) array_like
        Values by row.
    rows : int
        Number of rows R.
    name : str
        Of the data, for errors.
    loads : sequence of loads, optional
        In place of the scene's.

    Attributes
    ----------
    model : FingerModel
    scene : Scene
        With these loads.

    Raises
    ------
    InputError
        If a condition is unknown, or is to be estimated.
    """

    def __init__(
        self,
        scene: Scene,
        unknowns: Sequence[Unknown],
        conditions: Mapping[str, ArrayLike],
        rows: int,
        name: str,
        loads: Sequence[Load] | None = None,
    ) -> None:
        self.scene = scene if loads is None else scene.model_copy(update={"loads": tuple(loads)})
        self._unknowns = list(unknowns)
        plain = FingerModel(self.scene, parameters=runtime_names(scene, unknowns), input_rates=False)
        entries = [label.split(" [")[0] for label in (*plain.u_names, *plain.w_names)]
        more = [key for key in conditions if key not in entries]
        for key in more:
            if key in {one.target for one in unknowns if not one.added}:
                raise InputError(f"{key} is to be estimated, and given by the data", key=f"{name}.conditions")
        try:
            self.model = FingerModel(
                self.scene, parameters=runtime_names(scene, unknowns, more), input_rates=False, family=plain.family
            )
        except InputError as error:
            where = f"inputs and forces: {', '.join(entries)}" if entries else "no inputs and forces"
            raise InputError(f"{error.message}; {where}", key=f"{name}.conditions") from None
        signals = Signals(self.scene, self.model)
        self._nominal = np.concatenate([signals.u(0.0)[0], signals.w(0.0)[0], self.model.p_nominal])
        model = self.model
        self.names = [label.split(" [")[0] for label in (*model.u_names, *model.w_names, *model.p_names)]
        self._table = np.tile(self._nominal, (rows, 1))
        for key, values in conditions.items():
            self._table[:, self._index(key, name)] = column(f"{name}.conditions.{key}", values, rows)
        self._derivative, self._own = self._derivatives()

    @property
    def nominal(self) -> Array:
        """Values of the scene."""
        return self._nominal

    def split(self, z: Array) -> tuple[Array, Array, Array]:
        """The parts u, w and p of z."""
        u, w = self.model.nu, self.model.nu + self.model.nw
        return z[:u], z[u:w], z[w:]

    def at(self, row: int, values: Array) -> tuple[Array, Array]:
        """Values (nz,) of a row and their derivative (nz, unknowns)."""
        z = self._own * self._table[row] + self._derivative @ values
        derivative = self._derivative
        for k, one in enumerate(self._unknowns):
            if one.target == DEADBAND:
                derivative = derivative.copy()
                z[:2], derivative[:2, k] = _behind_deadband(z[0], z[1], values[k])
        return z, derivative

    def _derivatives(self) -> tuple[Array, Array]:
        """dz/dvalues (nz, unknowns), and one (nz,) for each entry that has its own value too."""
        derivative = np.zeros((len(self.names), len(self._unknowns)))
        own = np.ones(len(self.names))
        for k, one in enumerate(self._unknowns):
            if one.target == DEADBAND:
                continue
            at = self.names.index(one.target)
            derivative[at, k] = one.factor
            own[at] = 1.0 if one.added else 0.0
        return derivative, own

    def _index(self, key: str, name: str) -> int:
        if key not in self.names:
            raise InputError(f"no entry {key!r}; expected one of {', '.join(self.names)}", key=f"{name}.conditions")
        return self.names.index(key)


def _behind_deadband(first: float, second: float, deadband: float) -> tuple[Array, Array]:
    """Tensions that the finger feels, and their derivatives with respect to the deadband.

    The greater tension loses the deadband, but no more than its lead over the other; the corner is rounded off.
    """
    lead = abs(first - second)
    excess = lead - deadband
    root = float(np.hypot(excess, _ROUNDING))
    left, slope = 0.5 * (excess + root), -0.5 * (1.0 + excess / root)
    if first >= second:
        return np.array([second + left, second]), np.array([slope, 0.0])
    return np.array([first, first + left]), np.array([0.0, slope])
