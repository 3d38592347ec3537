"""A finger with its drives as functions whose derivatives by the unknowns ride along with the motion, and the state
from which a measured motion starts: the smoothest shape and rates through its first samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import casadi as ca
import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.errors import SolverError
from continuum_grasp.identification.data import START_SAMPLES, Reading, column
from continuum_grasp.identification.least_squares import least_squares
from continuum_grasp.identification.observation import observed
from continuum_grasp.identification.rows import runtime_names, set_by, symbols, with_slopes
from continuum_grasp.identification.unknowns import DELAY, LAG, START, Unknown
from continuum_grasp.labels import split_unit
from continuum_grasp.model import FingerModel
from continuum_grasp.model.memory import clipped
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.static_shape import friction_history
from continuum_grasp.simulation.statics import friction_of
from continuum_grasp.simulation.trajectory import acting_input

_INSTANT = 1e-6
"""Half the distance of the instants between which a late command is differentiated by its delay [s]."""


class Driven:
    """The model of a scene with the unknowns as run-time arguments; its state is x.

    Inputs are the commands, and behind them their derivatives by a delay where that is unknown. ``passed`` (K, n) are
    shapes that it goes through before the start, as friction remembers them. Derivatives are by all unknowns, or ``by``
    those of some numbers alone, which takes less code.
    """

    def __init__(
        self,
        scene: Scene,
        unknowns: Sequence[Unknown],
        readings: Sequence[Reading],
        passed: Sequence[Array] = (),
        by: Sequence[int] | None = None,
    ) -> None:
        targets = [unknown.target for unknown in unknowns]
        if LAG in targets and not scene.finger.winches:
            constant = unknowns[targets.index(LAG)].start
            scene = scene.model_copy(update={"finger": scene.finger.with_lags(constant)})
        self.scene = scene
        self.model = model = FingerModel(scene, parameters=runtime_names(scene, unknowns))
        self.signals = Signals(scene, model)
        self.size = model.nx
        self._late = targets.index(DELAY) if DELAY in targets else None
        self.by = list(range(len(unknowns))) if by is None else list(by)
        self._own, self.turned = set_by(unknowns, [split_unit(label)[0] for label in model.p_names])
        x, u, w, p = symbols(model, "x")
        self.variational = self._with_slopes("variational", model.forward_dynamics(x, u, w, p), x, u, w, p)

        def drives() -> list[ca.SX]:
            return [model.tensions()(x, u, p)[0], x[2 * model.n : model.nx - len(model.friction_names)]]

        y = observed(model, readings, x[: model.n], acting_input(model, x, u, p), p, drives)
        self.readings = self._with_slopes("readings", y, x, u, w, p)
        q = ca.SX.sym("q", model.n)
        history = ca.SX.sym("history", model.structure.friction_states + bool(model.friction_names))
        past = (history,) if model.friction_names else ()
        parts = [ca.SX(model.drives_at_rest()(q, u, p, *past))]
        if model.friction_names:
            # From shape to shape friction stays where it is, or slides.
            slid = [model.sliding()(shape, u, p) for shape in (*map(ca.SX, passed), q)]
            # Of a tendon's state in a motion friction acts by the cubic, of which this is the inverse.
            count = model.structure.tendon_friction_states
            of_tendons = 2.0 * ca.sin(ca.asin(history[:count]) / 3.0)
            states = ca.SX(clipped(ca.vertcat(of_tendons, history[count:-1]) + history[-1] * slid[0]))
            for before, now in pairwise(slid):
                states = ca.SX(clipped(states + now - before))
            parts.append(states)
        self._start = with_slopes("start", ca.vertcat(*parts), q, u, p, history)
        self._passed = tuple(passed)

    def _with_slopes(self, name: str, y: ca.SX, x: ca.SX, u: ca.SX, w: ca.SX, p: ca.SX) -> ca.Function:
        """[y, Y] of [x, X], commands, w and [p, B]; X and B are the derivatives of x and p by unknowns."""
        moved, turned = (ca.SX.sym(name, size.numel(), len(self.by)) for name, size in (("X", x), ("B", p)))
        commands, by_delay = u, ca.SX(u.numel(), len(self.by))
        if self._late is not None:
            late = ca.SX.sym("late", u.numel())
            commands = ca.vertcat(u, late)
            if self._late in self.by:
                by_delay[:, self.by.index(self._late)] = late
        slope = ca.jtimes(y, ca.vertcat(x, u, p), ca.vertcat(moved, by_delay, turned)) if self.by else ca.SX()
        outputs = ca.cse([ca.densify(ca.vertcat(y, ca.vec(slope)))])
        inputs = [ca.vertcat(x, ca.vec(moved)), commands, w, ca.vertcat(p, ca.vec(turned))]
        return ca.Function(name, inputs, outputs, ["x", "u", "w", "p"], ["xd"])

    def parameters(self, values: Array) -> Array:
        """Run-time parameters of the model (np,), whose derivatives by the unknowns are ``turned``."""
        return np.asarray(self._own * self.model.p_nominal + self.turned @ values)

    def delay(self, values: Array) -> float:
        """Time before a command reaches the drive [s]."""
        return 0.0 if self._late is None else float(values[self._late])

    def commands(self, t: Array, delay: float) -> Array:
        """Commands (T, nu) that reach the drive, and behind them their derivatives by an unknown delay."""
        at = self.signals.u(t - delay)
        if self._late is None:
            return at
        after, before = (self.signals.u(t - delay - side * _INSTANT) for side in (1.0, -1.0))
        return np.hstack([at, (after - before) / (2.0 * _INSTANT)])

    def begin(self, t: float, delay: float, q: Array, by_values: Array, p: Array) -> tuple[Array, Array]:
        """State of drives that have reached their commands at an instant, and of friction, with their derivatives.

        ``by_values`` are the derivatives of q by all values.
        """
        row = self.commands(np.array([t]), delay)[0]
        u = row[: self.model.nu]
        # Friction is that of the first shape, and goes on from there.
        how = friction_of(self.scene.initial, self.model, needed=False)
        history = friction_history(self.model, (*self._passed, q)[0], u, p, **how)
        state, by_q, by_u, by_p = (np.array(part) for part in self._start(q, u, p, history)[:4])
        slope = by_q @ by_values + by_p @ self.turned
        if self._late is not None:
            slope[:, self._late] += by_u @ row[self.model.nu :]
        return state.ravel(), slope


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
