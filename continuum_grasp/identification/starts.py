"""The state from which a measured motion starts: the smoothest shape and rates through its first samples."""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.errors import SolverError
from continuum_grasp.identification.data import START_SAMPLES, Reading, column
from continuum_grasp.identification.least_squares import least_squares
from continuum_grasp.identification.observation import observed
from continuum_grasp.identification.rows import symbols
from continuum_grasp.identification.unknowns import START, Unknown
from continuum_grasp.labels import split_unit
from continuum_grasp.model import FingerModel


class MeasuredStart:
    """Coordinates q and rates qd (n,) that minimize, with J the derivative of the readings with respect to q,

    ``|readings(q) - y|^2 + s |q / reach|^2`` and ``|J qd - v|^2 + s |qd slow / reach|^2``,

    where y and v are value and slope of a parabola through the first samples of each reading, positions per length of
    the finger, and ``slow`` is a time scale of bending [s]. ``z`` are inputs, forces and parameters [u, w, p] there.
    """

    def __init__(self, model: FingerModel, readings: Sequence[Reading], t: Array, z: Array, name: str) -> None:
        self._model, self._name, self._z = model, name, z
        readings = [reading for reading in readings if not reading.of_drive]
        rod, length = model.finger.rod, model.finger.rod.length
        self._reach = model.structure.family.coordinate_size(min(model.ranges), max(model.lengths))
        self._slow = length**2 * float(np.sqrt(rod.mass_per_length / rod.stiffness))
        first = np.stack([column(name, reading.values)[:START_SAMPLES] for reading in readings])
        after = t[:START_SAMPLES] - t[0]
        # value, slope and curvature of a parabola
        parabola = np.linalg.lstsq(np.vander(after / after[-1], 3, increasing=True), first.T, rcond=None)[0]
        self._scale = np.array([1.0 / length if reading.quantity in ("x", "y") else 1.0 for reading in readings])
        self._value, self._slope = self._scale * parabola[0], self._scale * parabola[1] / after[-1]
        q, u, w, p = symbols(model)
        y = self._scale * observed(model, readings, q, u, p)
        inputs = [q, ca.vertcat(u, w, p), ca.SX.sym("target", self._value.size)]
        # 1e-4: weight of the squared coordinates per range beside that of the squared readings per length: what moves a
        # reading by less than a hundredth of the length stays small, and what is seen is off by a thousandth
        near = ca.vertcat(y - inputs[2], np.sqrt(1e-4) / self._reach * q)
        self._missed = ca.Function("missed", inputs, [near, ca.densify(ca.jacobian(near, q))])
        # least squares end near the minimum, from where Newton's method takes it to rounding: starts that repeat
        still = {"x": q, "p": ca.vertcat(*inputs[1:]), "g": ca.gradient(0.5 * ca.sumsqr(near), q)}
        self._still = ca.rootfinder("still", "newton", still, {"abstol": 1e-13})
        self._straight = np.zeros(model.n)

    def state(self) -> tuple[Array, Array]:
        """Coordinates and rates (n,) at the first sample; SolverError if no shape comes near the readings."""
        q = self._near(self._straight, self._value)
        try:
            q = np.array(self._still(q, np.append(self._z, self._value))).ravel()
        except RuntimeError as error:  # of the root finder
            raise self._lost() from error
        slope = np.array(self._missed(q, self._z, self._value)[1])
        slope[self._slope.size :] *= self._slow
        return q, np.linalg.lstsq(slope, np.append(self._slope, np.zeros(q.size)), rcond=None)[0]

    def unknowns(self, bends: tuple[float, float] | None) -> list[Unknown]:
        """Coordinates and rates at the first sample, to be estimated from those that are read there.

        ``bends`` are standard deviations about these, of the bend of an element [rad] and of its rate [rad/s].
        """
        model, known = self._model, [math.inf] * (2 * self._model.n)
        if bends is not None:
            family = model.structure.family
            element_lengths = [[h for k, h in enumerate(model.lengths) if i in family.local(k)] for i in range(model.n)]
            known = [family.coordinate_size(bend, max(lengths)) for bend in bends for lengths in element_lengths]
        sizes = [self._reach] * model.n + [self._reach / self._slow] * model.n
        rows = zip(model.x_names[: 2 * model.n], np.append(*self.state()).tolist(), sizes, known, strict=True)
        return [
            Unknown(*split_unit(label), START, start=value, typical=size, per="set", sigma=sigma)
            for label, value, size, sigma in rows
        ]

    def before(self, readings: Sequence[Reading]) -> list[Array]:
        """Shapes (n,) through readings of sections before the start, those of an instant each."""
        seen = [np.asarray(reading.values, dtype=float) for reading in readings if not reading.of_drive]
        shapes = [self._straight]
        for row in np.stack(seen, axis=1) if seen else ():
            if np.isfinite(row).all():
                shapes.append(self._near(shapes[-1], self._scale * row))
        return shapes[1:]

    def _near(self, q: Array, target: Array) -> Array:
        def missed(q: Array) -> tuple[Array, Array]:
            near, slope = (np.array(part) for part in self._missed(q, self._z, target))
            return near.ravel(), slope

        free = np.full(q.size, np.inf)
        minimum = least_squares(missed, q, -free, free, np.full(q.size, self._reach))
        if not minimum.converged:
            raise self._lost()
        return minimum.values

    def _lost(self) -> SolverError:
        return SolverError(
            f"{self._name}: no shape of the finger goes through the first samples",
            status="no start",
            advice="check units, signs and positions of the readings, and the base's position",
        )
