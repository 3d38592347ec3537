"""Prediction of the path of a point of the finger as a function of the unknowns.

Motions and their derivatives come from the variational equations of the model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core import Core
from continuum_grasp.core.integrators import step_function
from continuum_grasp.core.rollouts import Rollouts, signal
from continuum_grasp.errors import InputError, NumericalError
from continuum_grasp.identification.blocks import Block, Entry
from continuum_grasp.identification.data import TipPath, column
from continuum_grasp.identification.rows import Rows, Shapes, observation, runtime_names, symbols
from continuum_grasp.identification.unknowns import DEADBAND, Unknown
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.families import default_family
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.scene.tendons import Tendons
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.spectrum import TARGET_RADIUS, sample_shapes, spectral_radius
from continuum_grasp.simulation.trajectory import limit_warnings

Array = NDArray[np.float64]


class PathBlock(Block):
    """Path of a point of the finger."""

    horizons = True

    def __init__(self, scene: Scene, data: TipPath, unknowns: Sequence[Unknown]) -> None:
        if any(one.target == DEADBAND for one in unknowns):
            raise InputError(f"{DEADBAND} is for shapes at rest, not for paths", key="estimate")
        self.name = data.name
        self._unknowns = unknowns
        self._model = model = FingerModel(scene, parameters=runtime_names(scene, unknowns))
        # a tip that is matched to a lagging moment has its rate as an input, which the variational equations lack
        if model.nx > 2 * model.n and model.structure.matched:
            free = default_family(free_tip=True)
            raise InputError(f"paths of tendons with a time constant need fidelity.family: {free}", key=data.name)
        family = scene.fidelity.model_copy(update={"family": model.family})
        self._scene = scene = scene.model_copy(update={"fidelity": family})
        self._signals = Signals(scene, model)
        self._rows = Rows(scene, unknowns, data.name)
        self._start = _start_rows(scene, unknowns, data.name)
        self._t = t = column(f"{data.name}.t", data.t)
        columns = [(key, np.asarray(v, dtype=float)) for key, v in (("x", data.x), ("y", data.y)) if v is not None]
        self._observe = observation(model, [(key, data.at) for key, _ in columns]).map(t.size)
        self._acting = self._signals.u(t), self._signals.w(t)
        self._motion = _Motion(model, self._signals, self._slope(np.array([one.start for one in unknowns])), t)
        where = "tip" if data.at is None else f"{data.at:g} m"
        group = "positions on paths" if data.sigma is None else f"{data.name}: positions"
        self.entries = [
            Entry(f"{key} of {where} at {at:g} s", group, "m", float(numbers[k]), data.fitted, data.sigma, float(at))
            for k, at in enumerate(t)
            for key, numbers in columns
        ]

    def predict(self, values: Array) -> tuple[Array, Array]:
        x, by_values, p = self._moved(values)
        n, count = self._model.n, len(x)
        acting = np.hstack([*self._acting, np.tile(p, (count, 1))])
        y, by_q, by_z = (np.array(v) for v in self._observe(x[:, :n].T, acting.T))
        size, start = y.shape[0], self._model.nu + self._model.nw
        # a mapped function puts the matrices of all instants side by side
        by_q = by_q.reshape(size, count, n).transpose(1, 0, 2)
        by_p = by_z.reshape(size, count, acting.shape[1]).transpose(1, 0, 2)[:, :, start:]
        derivative = by_q @ by_values[:, :n] + by_p @ self._slope(values)
        return y.T.ravel(), derivative.reshape(size * count, len(self._unknowns))

    def warnings(self, values: Array) -> tuple[str, ...]:
        x, _, p = self._moved(values)
        q = x[:, : self._model.n]
        use = np.array(self._model.range_use.map(len(q))(q.T, self._acting[0].T, np.tile(p, (len(q), 1)).T)).T
        return limit_warnings(self._model, use, self._t)

    def _moved(self, values: Array) -> tuple[Array, Array, Array]:
        """States (T, nx), their derivatives (T, nx, unknowns) and the parameters p."""
        p = self._rows.split(self._rows.at(0, values)[0])[2]
        return *self._motion.at(*self._begin(values), p), p

    def _slope(self, values: Array) -> Array:
        """Derivative of p with respect to the unknowns."""
        _, derivative = self._rows.at(0, values)
        return derivative[len(derivative) - self._model.np :]

    def _begin(self, values: Array) -> tuple[Array, Array]:
        """State (nx,) at time zero as ``initial`` of the scene says, and its derivative (nx, unknowns)."""
        model, n, initial = self._model, self._model.n, self._scene.initial
        x, slope = np.zeros(model.nx), np.zeros((model.nx, len(self._unknowns)))
        if isinstance(self._start, Shapes):
            _, by_values, q, by_z = self._start.shape(0, values)
            x[:n], slope[:n] = q, by_z @ by_values
        elif initial.coordinates is not None:
            model.structure.check_initial(initial)
            x[:n] = initial.coordinates
        if initial.qd is not None:
            x[n : 2 * n] = initial.qd
        if model.nx > 2 * n:
            # the lagging moment of the tendons begins as their tensions give it
            lag = model.structure.lag_at(self._signals.u(0.0)[0])
            lagged = slice(2 * n, 2 * n + len(lag))
            x[lagged] = lag
            pair = self._scene.finger.tendons
            for k in [k for k, one in enumerate(self._unknowns) if one.target == "tendon_offset"]:
                # proportional to the offset, of which only that of a pair can be estimated
                slope[lagged, k] = x[lagged] / (pair.offset if isinstance(pair, Tendons) else 1.0)
                x[lagged] = slope[lagged, k] * values[k]
        return x, slope


def _start_rows(scene: Scene, unknowns: Sequence[Unknown], name: str) -> Shapes | None:
    """The shape at time zero, where it is an equilibrium; None where the scene gives its coordinates."""
    pose = scene.initial.pose
    scene = scene.model_copy(update={"loads": (*scene.loads, *scene.initial.held_by)})
    if pose == "rest":
        scene = scene.model_copy(update={"gravity": (0.0, 0.0), "actuation": None, "loads": ()})
    rows = Rows(scene, unknowns, name)
    return Shapes(rows) if pose in ("equilibrium", "rest") else None


_MOST_STEPS = 200_000
"""Of a path: seconds per evaluation, of which a search takes dozens."""
_FINER = 2.0
"""Steps per step of a simulation [1]: a sixteenth of its error, so that the steps do not pass for parameters."""
_CHANGE = 0.1
"""Relative change of parameters from which the steps are chosen anew; smaller ones are within their margin."""
_SHAPES = 6
"""Sampled shapes, the initial one among them, whose stiffest mode limits the steps."""


class _Motion:
    """Integrates x' = f(x, u, w, p) and its derivative X' = f_x X + f_p B by the classical Runge-Kutta method.

    B (np, unknowns) is the derivative of p with respect to the unknowns; instants t (T,) [s] are wanted, from 0 on.
    """

    def __init__(self, model: FingerModel, signals: Signals, slope: Array, t: Array) -> None:
        self._model, self._signals, self._slope, self._t = model, signals, slope, t
        self._core = Core(model, compiled=False)
        functions = SimpleNamespace(forward_dynamics=_variational(model, slope.shape[1]))
        self._run = Rollouts.of(step_function(functions, "rk4"))
        self._settled: tuple[Array, float] | None = None

    def at(self, start: Array, slope: Array, p: Array) -> tuple[Array, Array]:
        """States (T, nx) and their derivatives (T, nx, unknowns), from a start (nx,) with its derivative.

        Raises
        ------
        NumericalError
            If the motion does not stay finite, or is too stiff.
        """
        self._settle(start, p)
        grid, count, nx = self._grid, self._slope.shape[1], len(start)
        whole = np.concatenate([start, slope.ravel(order="F")])[None]
        arguments = np.concatenate([p, self._slope.ravel(order="F")])
        states, finished = self._run(
            whole, grid.steps, grid.substeps, grid.spacing / grid.substeps, self._u, self._w, arguments
        )
        if finished[0] < grid.steps:
            time = float(finished[0]) * grid.spacing
            raise NumericalError(f"the motion is not finite after t = {time:g} s", time=time)
        rows = grid.pick(states[0])
        return rows[:, :nx], rows[:, nx:].reshape(len(rows), count, nx).transpose(0, 2, 1)

    def _settle(self, start: Array, p: Array) -> None:
        """Steps that are short enough for parameters p; they stay while these change little.

        Other steps have another error, which a search would take for a change of the parameters.
        """
        if self._settled is not None and np.allclose(p, self._settled[0], rtol=_CHANGE, atol=0.0):
            return
        signals, model = self._signals, self._model
        shapes = sample_shapes(model, start[: model.n])[:_SHAPES]
        rate = _FINER * spectral_radius(self._core, shapes, signals.u(0.0)[0], signals.w(0.0)[0], p) / TARGET_RADIUS
        if not np.isfinite(rate):
            raise NumericalError("the model has no usable numbers at these parameters", time=0.0)
        if self._settled is not None and 0.5 * self._settled[1] < rate <= self._settled[1]:
            self._settled = (p, self._settled[1])
            return
        grid = _Grid(self._t, rate)
        count = grid.steps * grid.substeps
        if count > _MOST_STEPS:
            raise NumericalError(
                f"{count:.3g} steps are needed to follow this motion at these parameters; at most "
                f"{_MOST_STEPS} are taken: use fewer elements, a shorter part of the data, or bounds on stiffness and "
                "damping",
                time=0.0,
            )
        # a Runge-Kutta step takes inputs and forces at its start, middle and end
        halves = np.arange(2 * count + 1) * (0.5 * grid.spacing / grid.substeps)
        at = halves[:1] if signals.constant else halves
        u, w = (values[0] if signals.constant else values for values in (signals.u(at), signals.w(at)))
        self._u = signal("u", u, model.nu, len(halves), None)
        self._w = signal("w", w, model.nw, len(halves), None)
        self._grid, self._settled = grid, (p, rate)


class _Grid:
    """Equal steps on which the instants lie, or between which they are interpolated by cubics."""

    def __init__(self, t: Array, rate: float) -> None:
        gap = float(np.diff(np.append(0.0, t) if t[0] > 0.0 else t).min())
        shares = t / gap
        # instants as they stand in files, rounded
        self._even = bool(np.all(np.abs(shares - np.round(shares)) < 1e-6))
        if self._even:
            self.spacing = float(t[-1] / round(t[-1] / gap))
            self._index = np.round(t / self.spacing).astype(int)
            self.steps = int(self._index[-1])
            self.substeps = max(1, math.ceil(self.spacing * rate))
        else:
            # half a step between stored states, for the cubics between them
            self.spacing = 0.5 / rate
            self.substeps = 1
            self.steps = max(4, math.ceil(t[-1] / self.spacing))
            self._index = np.clip(np.floor(t / self.spacing).astype(int) - 1, 0, self.steps - 3)
            self._within = t / self.spacing - self._index

    def pick(self, rows: Array) -> Array:
        """Rows at the instants."""
        if self._even:
            return np.asarray(rows[self._index])
        s = self._within[:, None]
        total: Array = np.zeros((len(s), rows.shape[1]))
        for k in range(4):  # Lagrange's polynomials on the nodes 0 to 3
            weight = np.ones_like(s)
            for j in range(4):
                if j != k:
                    weight = weight * (s - j) / (k - j)
            total += weight * rows[self._index + k]
        return total


def _variational(model: FingerModel, count: int) -> ca.Function:
    """Dynamics of [x, X] with the parameters [p, B]."""
    _, u, w, p = symbols(model)
    x = ca.SX.sym("x", model.nx)
    moved, turned = ca.SX.sym("X", model.nx, count), ca.SX.sym("B", model.np, count)
    rate = model.forward_dynamics(x, u, w, p)
    slope = ca.jtimes(rate, ca.vertcat(x, p), ca.vertcat(moved, turned))
    outputs = ca.cse([ca.densify(ca.vertcat(rate, ca.vec(slope)))])
    inputs = [ca.vertcat(x, ca.vec(moved)), u, w, ca.vertcat(p, ca.vec(turned))]
    return ca.Function("variational", inputs, outputs, ["x", "u", "w", "p"], ["xd"])
