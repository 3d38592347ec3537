"""State from which a measured motion starts: the smoothest shape and rates through its first samples."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.errors import SolverError
from continuum_grasp.identification.data import START_SAMPLES, Reading, column
from continuum_grasp.identification.least_squares import least_squares
from continuum_grasp.identification.observation import at_rest
from continuum_grasp.identification.rows import symbols, with_slopes
from continuum_grasp.model import FingerModel

_SMOOTH = 1e-4
"""Weight of the squared coordinates per range beside that of the squared readings per length [1]: what moves a reading
by less than a hundredth of the length stays small, and what is seen is off by a thousandth."""
_SETTLED = 1e-12
"""Last step of Newton's method per range [1]."""
_ITERATIONS = 20
"""Most steps of Newton's method, which begins at the minimum of least squares."""


class MeasuredStart:
    """Coordinates q and rates qd (n,) that minimize, with J the derivative of the readings with respect to q,

    ``|readings(q) - y|^2 + s |q / reach|^2`` and ``|J qd - v|^2 + s |qd slow / reach|^2``,

    where y and v are value and slope of a parabola through the first samples of each reading, positions per length of
    the finger, and ``slow`` is a time scale of bending [s].
    """

    def __init__(self, model: FingerModel, readings: Sequence[Reading], t: Array, name: str) -> None:
        self._model, self._name = model, name
        readings = [one for one in readings if not one.of_drive]
        self.inputs = model.nu + model.nw
        n, length = model.n, model.finger.rod.length
        self.reach = model.structure.family.coordinate_size(min(model.ranges), max(model.lengths))
        rod = model.finger.rod
        self.slow = length**2 * float(np.sqrt(rod.mass_per_length / rod.stiffness))
        first = np.stack([column(name, one.values)[:START_SAMPLES] for one in readings])
        after = t[:START_SAMPLES] - t[0]
        # value, slope and curvature of a parabola
        parabola = np.linalg.lstsq(np.vander(after / after[-1], 3, increasing=True), first.T, rcond=None)[0]
        scale = np.array([1.0 / length if one.quantity in ("x", "y") else 1.0 for one in readings])
        value, slope = scale * parabola[0], scale * parabola[1] / after[-1]
        self._scale, self._value = scale, value
        _, u, w, p = symbols(model)
        q, qd = ca.SX.sym("q", n), ca.SX.sym("qd", n)
        z = ca.vertcat(u, w, p)
        y, by_q, _ = with_slopes("observation", at_rest(model, readings, q, u, p), q, z)(q, z)
        target = ca.SX.sym("target", value.size)
        near = ca.vertcat(scale * y - target, np.sqrt(_SMOOTH) / self.reach * q)
        missed = ca.substitute(near, target, ca.DM(value))
        moved = ca.vertcat(scale * (by_q @ qd) - slope, np.sqrt(_SMOOTH) * self.slow / self.reach * qd)
        self._residuals = ca.Function("missed", [q, z, target], [near, ca.jacobian(near, q)])
        state = ca.vertcat(q, qd)
        # qd minimizes the second sum alone: it has no say in q
        still = ca.vertcat(ca.gradient(0.5 * ca.sumsqr(missed), q), ca.gradient(0.5 * ca.sumsqr(moved), qd))
        outputs = ca.cse([still, ca.densify(ca.jacobian(still, state)), ca.densify(ca.jacobian(still, z))])
        self._still = ca.Function("still", [state, z], outputs)
        self._last = np.zeros(n)

    def at(self, z: Array) -> tuple[Array, Array]:
        """State [q, qd] (2 n,) at z = [u, w, p], and its derivative (2 n, nz) with respect to z.

        Raises
        ------
        SolverError
            If no shape of the finger comes near the readings.
        """
        n = self._model.n
        state = np.concatenate([self._near(self._last, z, self._value), np.zeros(n)])
        size = np.concatenate([np.full(n, self.reach), np.full(n, self.reach / self.slow)])
        for _ in range(_ITERATIONS):
            still, by_state, by_z = (np.array(part) for part in self._still(state, z))
            change = np.linalg.solve(by_state, -still.ravel())
            state = state + change
            # rates may be many ranges per time scale
            if np.all(np.abs(change) <= _SETTLED * np.maximum(size, np.abs(state))):
                self._last = state[:n]
                return state, np.linalg.solve(by_state, -by_z)
        raise SolverError(
            f"{self._name}: no shape of the finger goes through the first samples",
            status="no start",
            advice="check units, signs and positions of the readings, and the base's position",
        )

    def before(self, readings: Array, z: Array) -> list[Array]:
        """Shapes (n,) through readings (K, readings) of sections before the start, at z = [u, w, p]."""
        found: list[Array] = []
        q = np.zeros(self._model.n)
        for row in readings:
            q = self._near(q, z, self._scale * row)
            found.append(q)
        return found

    def _near(self, q: Array, z: Array, target: Array) -> Array:
        def missed(q: Array) -> tuple[Array, Array]:
            near, slope = (np.array(part) for part in self._residuals(q, z, target))
            return near.ravel(), slope

        free = np.full(q.size, np.inf)
        return least_squares(missed, q, -free, free, np.full(q.size, self.reach)).values
