"""Inputs, forces, parameters and equilibrium of each row of measurements as functions of the unknowns.

Equilibria are followed while loads and parameters change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.identification.data import column
from continuum_grasp.identification.unknowns import DEADBAND, Unknown
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.loads import Load
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.statics import equilibrium
from continuum_grasp.simulation.trajectory import limit_warnings

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


_TOLERANCE = 1e-11
"""Last Newton step per bending range [1]: the search for parameters, which converges to 1e-9, must not see it."""
_ITERATIONS = 25
"""Of Newton's method, which takes a handful where it converges quadratically."""
_SHORTEST = 1.0 / 1024.0
"""Step along the path to new parameters [1] below which it is lost: at a fold no step is short enough."""


class Shapes:
    """Equilibria of the rows of measurements.

    Each is followed from the last one that was found for its row, in shorter steps of z where Newton's method fails.

    Parameters
    ----------
    rows : Rows
        Model, inputs, forces and parameters.
    count : int
        Number of rows.

    Raises
    ------
    SolverError
        If the scene has no equilibrium.
    """

    def __init__(self, rows: Rows, count: int) -> None:
        self._model = rows.model
        self._reach = self._model.structure.family.coordinate_size(min(self._model.ranges), max(self._model.lengths))
        start = equilibrium(rows.scene, model=self._model)
        self._last: list[tuple[Array, Array]] = [(start.q, rows.nominal)] * count

    @cached_property
    def _balance(self) -> ca.Function:
        """(q, z) -> missing force, its derivatives with respect to q and z."""
        model = self._model
        q, u, w, p = (ca.SX.sym(name, size) for name, size in _sizes(model))
        missing = model.inverse_dynamics(q, ca.SX(model.n, 1), ca.SX(model.n, 1), u, w, p)
        z = ca.vertcat(u, w, p)
        outputs = [ca.densify(v) for v in (missing, ca.jacobian(missing, q), ca.jacobian(missing, z))]
        return ca.Function("balance", [q, z], ca.cse(outputs), ["q", "z"], ["Q", "K", "P"])

    def at(self, row: int, z: Array) -> tuple[Array, Array]:
        """Equilibrium (n,) of a row and its derivative (n, nz) with respect to z.

        Raises
        ------
        SolverError
            If it cannot be followed there.
        """
        q, before = self._last[row]
        done, step = 0.0, 1.0
        while done < 1.0:
            step = min(step, 1.0 - done)
            target = z if step == 1.0 - done else before + (done + step) * (z - before)
            found = self._newton(q, target)
            if found is None:
                step *= 0.5
                if step < _SHORTEST:
                    raise SolverError(
                        "the equilibrium cannot be followed to these parameters",
                        status="path lost",
                        advice="bound the parameters, or start nearer to their values; a finger that buckles has no "
                        "single shape",
                    )
                continue
            q, done, step = found, done + step, 2.0 * step
        self._last[row] = (q, z)
        _, stiffness, slope = self._evaluate(q, z)
        return q, np.asarray(-np.linalg.solve(stiffness, slope))

    def warnings(self, rows: Rows, count: int, values: Array) -> tuple[str, ...]:
        """What the user must know of shapes beyond the bending range or the strain limit."""
        use = []
        for row in range(count):
            z, _ = rows.at(row, values)
            u, _, p = rows.split(z)
            use.append(np.array(self._model.range_use(self.at(row, z)[0], u, p)).ravel())
        return limit_warnings(self._model, np.array(use))

    def _newton(self, q: Array, z: Array) -> Array | None:
        for _ in range(_ITERATIONS):
            missing, stiffness, _ = self._evaluate(q, z)
            try:
                change = np.linalg.solve(stiffness, -missing)
            except np.linalg.LinAlgError:
                return None
            size = float(np.abs(change).max()) / self._reach
            if not size < 0.5:  # NaN too
                return None
            q = q + change
            if size <= _TOLERANCE:
                return q
        return None

    def _evaluate(self, q: Array, z: Array) -> tuple[Array, Array, Array]:
        missing, stiffness, slope = self._balance(q, z)
        return np.array(missing).ravel(), np.array(stiffness), np.array(slope)


def observation(model: FingerModel, places: Sequence[tuple[str, float | None]]) -> ca.Function:
    """What is measured as a function (q, z) -> y, with its derivatives with respect to q and z.

    Parameters
    ----------
    model : FingerModel
    places : sequence of (str, float or None)
        Quantity and position along the finger [m]; None: the tip.

    Raises
    ------
    InputError
        If a position is not on the finger.
    """
    q, u, w, p = (ca.SX.sym(name, size) for name, size in _sizes(model))
    length, values = model.finger.rod.length, []
    for quantity, at in places:
        s = length if at is None else at
        if not 0.0 <= s <= length * (1 + 1e-9):
            raise InputError(f"{quantity} at {s:g} m is not on the finger of {length:g} m", key="measured")
        if quantity in ("x", "y"):
            values.append(model.position(q, u, s, p)["xy".index(quantity)])
        else:
            base = model.orientation(q, u, 0.0, p) if quantity == "bend" else 0.0
            values.append(model.orientation(q, u, s, p) - base)
    y, z = ca.vertcat(*values), ca.vertcat(u, w, p)
    outputs = [ca.densify(v) for v in (y, ca.jacobian(y, q), ca.jacobian(y, z))]
    return ca.Function("observation", [q, z], ca.cse(outputs), ["q", "z"], ["y", "C", "E"])


def _sizes(model: FingerModel) -> list[tuple[str, int]]:
    return [("q", model.n), ("u", model.nu), ("w", model.nw), ("p", model.np)]
