"""Equilibria that are followed while loads and parameters change, and how they move with them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.identification.rows import Rows
from continuum_grasp.model import FingerModel
from continuum_grasp.simulation.statics import equilibrium
from continuum_grasp.simulation.trajectory import limit_warnings

__all__ = ["Shapes", "observation"]

Array = NDArray[np.float64]

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
