"""A finger with the lag of its tendons as functions whose derivatives by the unknowns ride along with the motion."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.identification.data import Reading
from continuum_grasp.identification.rows import observation, runtime_names, symbols
from continuum_grasp.identification.unknowns import DELAY, LAG, Unknown
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.signals import Signals

Array = NDArray[np.float64]

_INSTANT = 1e-6
"""Half the distance of the instants between which a late command is differentiated by its delay [s]."""


class Driven:
    """The state is that of the model and, of each tendon with a lag, its tension [N] and rate [N/s].

    The lag is critically damped and of second order, as that of the model, but of each tendon and with a time constant
    that may be unknown; it gives a matched tip the rates of its moment. Parameters are those of the model, and the time
    constants [s]; inputs are commands, and their derivatives by a delay where that is unknown.
    """

    def __init__(self, scene: Scene, unknowns: Sequence[Unknown], readings: Sequence[Reading]) -> None:
        finger, names = scene.finger, runtime_names(scene, unknowns)
        targets = [one.target for one in unknowns]
        constants = [tendon.time_constant for tendon in finger.tendon_list]
        if LAG in targets:
            constants = [unknowns[targets.index(LAG)].start] * len(constants)
        self._lagged = [k for k, one in enumerate(constants) if one is not None]
        self.constants = np.array([constants[k] for k in self._lagged], dtype=float)
        family = FingerModel(scene, parameters=names).family
        if any(tendon.time_constant is not None for tendon in finger.tendon_list):
            keys = [f"[{k}]" for k in range(len(constants))] if isinstance(finger.tendons, tuple) else [""]
            scene = scene.changed({f"finger.tendons{key}.time_constant": None for key in keys})
        scene = scene.model_copy(update={"fidelity": scene.fidelity.model_copy(update={"family": family})})
        self.scene = scene
        self.model = model = FingerModel(scene, parameters=names)
        self.signals = Signals(scene, model)
        self.size = model.nx + 2 * len(self._lagged)
        self._late = targets.index(DELAY) if DELAY in targets else None
        self._count = len(unknowns)
        # dp/dvalues of the time constants, which all are the unknown one
        self.slope = np.zeros((len(self._lagged), len(unknowns)))
        if LAG in targets:
            self.slope[:, targets.index(LAG)] = 1.0
        self._build(readings)

    def _build(self, readings: Sequence[Reading]) -> None:
        model, lagged = self.model, self._lagged
        _, commands, w, p = symbols(model)
        x, tension = ca.SX.sym("x", model.nx), ca.SX.sym("tension", 2, len(lagged))
        constants = ca.SX.sym("constants", len(lagged))
        u, rates = ca.SX(commands), []
        for j, k in enumerate(lagged):
            pole = 1.0 / constants[j]
            acceleration = pole**2 * (commands[k] - tension[0, j]) - 2.0 * pole * tension[1, j]
            u[k] = tension[0, j]
            if model.structure.inputs.rates:
                count = model.structure.inputs.count
                u[count + k], u[2 * count + k] = tension[1, j], acceleration
            rates += [tension[1, j], acceleration]
        state = ca.vertcat(x, ca.vec(tension))
        rate = ca.vertcat(model.forward_dynamics(x, u, w, p), *rates)
        y = observation(model, readings)(x[: model.n], ca.vertcat(u, w, p))[0]
        parameters = ca.vertcat(p, constants)
        self.variational = self._with_slopes("variational", rate, state, commands, w, parameters)
        self.readings = self._with_slopes("readings", y, state, commands, w, parameters)
        self.inputs = ca.Function("inputs", [state, commands, parameters], [u])

    def _with_slopes(self, name: str, y: ca.SX, state: ca.SX, commands: ca.SX, w: ca.SX, p: ca.SX) -> ca.Function:
        """[y, Y] of [x, X], commands, w and [p, B]; X and B are the derivatives of x and p by the unknowns."""
        moved = ca.SX.sym("X", state.numel(), self._count)
        turned = ca.SX.sym("B", p.numel(), self._count)
        given, by_delay, late = commands, ca.SX(commands.numel(), self._count), self._late
        if late is not None:
            by_delay[:, late] = ca.SX.sym("late", commands.numel())
            given = ca.vertcat(commands, by_delay[:, late])
        slope = ca.jtimes(y, ca.vertcat(state, commands, p), ca.vertcat(moved, by_delay, turned))
        outputs = ca.cse([ca.densify(ca.vertcat(y, ca.vec(slope)))])
        inputs = [ca.vertcat(state, ca.vec(moved)), given, w, ca.vertcat(p, ca.vec(turned))]
        return ca.Function(name, inputs, outputs, ["x", "u", "w", "p"], ["xd"])

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

    def begin(self, t: float, delay: float) -> tuple[Array, Array]:
        """Tensions and rates of a lag that has reached its command at an instant, and their derivatives."""
        row = self.commands(np.array([t]), delay)[0]
        state, slope = np.zeros(2 * len(self._lagged)), np.zeros((2 * len(self._lagged), self._count))
        state[::2] = row[self._lagged]
        if self._late is not None:
            slope[::2, self._late] = row[self.model.nu + np.array(self._lagged, dtype=int)]
        return state, slope

    def check(self, unknowns: Sequence[Unknown], name: str) -> None:
        """Refuse a delay of inputs that do not vary.

        Raises
        ------
        InputError
        """
        if self.signals.constant and any(one.target == DELAY for one in unknowns):
            raise InputError("a delay needs tensions that vary: actuation.tensions of the set", key=name)
