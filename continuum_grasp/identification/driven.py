"""A finger with its drives as functions whose derivatives by the unknowns ride along with the motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import casadi as ca
import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError
from continuum_grasp.identification.data import Reading
from continuum_grasp.identification.observation import moving
from continuum_grasp.identification.rows import runtime_names, set_by, symbols, with_slopes
from continuum_grasp.identification.unknowns import DELAY, LAG, Unknown
from continuum_grasp.labels import split_unit
from continuum_grasp.model import FingerModel
from continuum_grasp.model.memory import clipped
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.static_shape import friction_history
from continuum_grasp.simulation.statics import friction_of

_INSTANT = 1e-6
"""Half the distance of the instants between which a late command is differentiated by its delay [s]."""


class Driven:
    """The model of a scene with the unknowns as run-time arguments; its state is x.

    Inputs are the commands, and behind them their derivatives by a delay where that is unknown. ``passed`` (K, n) are
    shapes that it goes through before the start, as friction remembers them.
    """

    def __init__(
        self, scene: Scene, unknowns: Sequence[Unknown], readings: Sequence[Reading], passed: Sequence[Array] = ()
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
        self._count = len(unknowns)
        self._own, self.turned = set_by(unknowns, [split_unit(label)[0] for label in model.p_names])
        x, u, w, p = symbols(model, "x")
        self.variational = self._with_slopes("variational", model.forward_dynamics(x, u, w, p), x, u, w, p)
        self.readings = self._with_slopes("readings", moving(model, readings, x, u, p), x, u, w, p)
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
        """[y, Y] of [x, X], commands, w and [p, B]; X and B are the derivatives of x and p by the unknowns."""
        moved = ca.SX.sym("X", x.numel(), self._count)
        turned = ca.SX.sym("B", p.numel(), self._count)
        commands, by_delay, late = u, ca.SX(u.numel(), self._count), self._late
        if late is not None:
            by_delay[:, late] = ca.SX.sym("late", u.numel())
            commands = ca.vertcat(u, by_delay[:, late])
        slope = ca.jtimes(y, ca.vertcat(x, u, p), ca.vertcat(moved, by_delay, turned))
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

    def check(self, unknowns: Sequence[Unknown], name: str) -> None:
        """Raise an InputError for a delay of inputs that do not vary."""
        if self.signals.constant and any(unknown.target == DELAY for unknown in unknowns):
            raise InputError("a delay needs commands that vary: actuation, or conditions, of the set", key=name)
