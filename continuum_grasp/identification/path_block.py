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
from continuum_grasp.identification.rows import Rows, Shapes, observation, runtime_names
from continuum_grasp.identification.unknowns import DEADBAND, Unknown
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.families import default_family
from continuum_grasp.scene.simulate import Scene
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
        if model.nx > 2 * model.n and model.structure.matched:
            free = default_family(free_tip=True)
            raise InputError(f"paths of tendons with a time constant need fidelity.family: {free}", key=data.name)
        family = scene.fidelity.model_copy(update={"family": model.family})
        self._scene = scene.model_copy(update={"fidelity": family})
        self._signals = Signals(scene, model)
        self._rows = Rows(self._scene, unknowns, {}, 1, data.name)
        self._start = _Start(self._scene, unknowns, data.name)
        t = column(f"{data.name}.t", data.t)
        self._t = t
        quantities = [key for key, values in (("x", data.x), ("y", data.y)) if values is not None]
        self._observe = observation(model, [(key, data.at) for key in quantities]).map(t.size)
        values = np.array([one.start for one in unknowns])
        self._acting = self._signals.u(t), self._signals.w(t)
        self._motion = Motion(model, self._signals, self._slope(values), t)
        where = "tip" if data.at is None else f"{data.at:g} m"
        group = "positions on paths" if data.sigma is None else f"{data.name}: positions"
        columns = [np.asarray(data.x if key == "x" else data.y, dtype=float) for key in quantities]
        self.entries = [
            Entry(f"{key} of {where} at {at:g} s", group, "m", float(numbers[k]), data.fitted, data.sigma, float(at))
            for k, at in enumerate(t)
            for key, numbers in zip(quantities, columns, strict=True)
        ]

    def predict(self, values: Array) -> tuple[Array, Array]:
        """As of ``Block``."""
        z, _ = self._rows.at(0, values)
        p, slope = self._rows.split(z)[2], self._slope(values)
        x, by_values = self._motion.at(*self._begin(values), p)
        n, count = self._model.n, len(x)
        acting = np.hstack([*self._acting, np.tile(p, (count, 1))])
        y, by_q, by_z = (np.array(v) for v in self._observe(x[:, :n].T, acting.T))
        size, start = y.shape[0], self._model.nu + self._model.nw
        by_q = by_q.reshape(size, count, n).transpose(1, 0, 2)
        by_p = by_z.reshape(size, count, acting.shape[1]).transpose(1, 0, 2)[:, :, start:]
        derivative = by_q @ by_values[:, :n] + by_p @ slope
        return y.T.ravel(), derivative.reshape(size * count, len(self._unknowns))

    def warnings(self, values: Array) -> tuple[str, ...]:
        """As of ``Block``."""
        p = self._rows.split(self._rows.at(0, values)[0])[2]
        q = self._motion.at(*self._begin(values), p)[0][:, : self._model.n]
        use = np.array(self._model.range_use.map(len(q))(q.T, self._acting[0].T, np.tile(p, (len(q), 1)).T)).T
        return limit_warnings(self._model, use, self._t)

    def _slope(self, values: Array) -> Array:
        """Derivative of p with respect to the unknowns."""
        _, derivative = self._rows.at(0, values)
        return derivative[len(derivative) - self._model.np :]

    def _begin(self, values: Array) -> tuple[Array, Array]:
        """State (nx,) at time zero, and its derivative (nx, unknowns)."""
        model, (q, by_q) = self._model, self._start.at(values)
        x, slope = np.zeros(model.nx), np.zeros((model.nx, len(self._unknowns)))
        x[: model.n], slope[: model.n] = q, by_q
        rates = self._scene.initial.qd
        if rates is not None:
            x[model.n : 2 * model.n] = rates
        if model.nx > 2 * model.n:
            u = self._signals.u(0.0)[0]
            offsets = [k for k, one in enumerate(self._unknowns) if one.target == "tendon_offset"]
            tendons = self._scene.finger.tendons
            offset = values[offsets[0]] if offsets else (tendons.offset if tendons is not None else 0.0)
            x[2 * model.n] = (u[0] - u[1]) * offset
            slope[2 * model.n, offsets] = u[0] - u[1]
        return x, slope


class _Start:
    """Shape at time zero as a function of the unknowns, as ``initial`` of the scene says."""

    def __init__(self, scene: Scene, unknowns: Sequence[Unknown], name: str) -> None:
        self._initial, self._count = scene.initial, len(unknowns)
        loads = (*scene.loads, *scene.initial.held_by)
        if scene.initial.pose == "rest":
            scene, loads = scene.model_copy(update={"gravity": (0.0, 0.0), "actuation": None}), ()
        self._rows = Rows(scene, unknowns, {}, 1, name, loads=loads)
        if scene.initial.pose in ("equilibrium", "rest"):
            self._shapes = Shapes(self._rows, 1)

    def at(self, values: Array) -> tuple[Array, Array]:
        """Shape (n,) and its derivative (n, unknowns)."""
        n = self._rows.model.n
        if self._initial.pose in ("equilibrium", "rest"):
            z, slope = self._rows.at(0, values)
            q, by_z = self._shapes.at(0, z)
            return q, by_z @ slope
        q = np.zeros(n) if self._initial.q is None else np.array(self._initial.q, dtype=float)
        if q.shape != (n,):
            raise InputError(f"q has {q.size} entries, the model has {n}", key="initial.q")
        return q, np.zeros((n, self._count))


_MOST_STEPS = 200_000
"""Of a path: seconds per evaluation, of which a search takes dozens."""
_FINER = 2.0
"""Steps per step of a simulation [1]: a sixteenth of its error, so that the steps do not pass for parameters."""
_CHANGE = 0.1
"""Relative change of parameters from which the steps are chosen anew; smaller ones are within their margin."""
_SHAPES = 6
"""Sampled shapes, the initial one among them, whose stiffest mode limits the steps."""


class Motion:
    """Integrates x' = f(x, u, w, p) and its derivative X' = f_x X + f_p B by the classical Runge-Kutta method.

    Parameters
    ----------
    model : FingerModel
    signals : Signals
        Inputs and forces.
    slope : (np, unknowns) ndarray
        B, the derivative of p with respect to the unknowns.
    t : (T,) ndarray
        Instants that are wanted, from 0 on [s].
    """

    def __init__(self, model: FingerModel, signals: Signals, slope: Array, t: Array) -> None:
        self._model, self._signals, self._slope, self._t = model, signals, slope, t
        self._nx = model.nx
        self._core = Core(model, compiled=False)
        functions = SimpleNamespace(forward_dynamics=_variational(model, slope.shape[1]))
        self._run = Rollouts.of(step_function(functions, "rk4"))
        self._settled: tuple[Array, float] | None = None

    def _settle(self, start: Array, p: Array) -> None:
        """Steps that are short enough for parameters p; they stay while these change little."""
        if self._settled is not None and np.allclose(p, self._settled[0], rtol=_CHANGE, atol=0.0):
            return
        signals, model = self._signals, self._model
        shapes = sample_shapes(model, start[: model.n])[:_SHAPES]
        rate = _FINER * spectral_radius(self._core, shapes, signals.u(0.0)[0], signals.w(0.0)[0], p) / TARGET_RADIUS
        if not np.isfinite(rate):
            raise NumericalError("the model has no usable numbers at these parameters", time=0.0)
        if self._settled is not None and 0.5 * self._settled[1] < rate <= self._settled[1]:
            rate = self._settled[1]
        else:
            self._lay(_Grid(self._t, rate))
        self._settled = (p, rate)

    def _lay(self, grid: _Grid) -> None:
        """Take a grid, with inputs and forces on it."""
        if grid.steps * grid.substeps > _MOST_STEPS:
            raise NumericalError(
                f"{grid.steps * grid.substeps:.3g} steps are needed to follow this motion at these parameters; at most "
                f"{_MOST_STEPS} are taken: use fewer elements, a shorter part of the data, or bounds on stiffness and "
                "damping",
                time=0.0,
            )
        self._grid, signals, model = grid, self._signals, self._model
        halves = np.arange(2 * grid.steps * grid.substeps + 1) * (0.5 * grid.spacing / grid.substeps)
        at = halves[:1] if signals.constant else halves
        u, w = signals.u(at), signals.w(at)
        rows = len(halves)
        self._u = signal("u", u[0] if signals.constant else u, model.nu, rows, None)
        self._w = signal("w", w[0] if signals.constant else w, model.nw, rows, None)

    def at(self, start: Array, slope: Array, p: Array) -> tuple[Array, Array]:
        """States (T, nx) and their derivatives (T, nx, unknowns) at the instants that are wanted.

        Parameters
        ----------
        start : (nx,) ndarray
        slope : (nx, unknowns) ndarray
            Derivative of the start.
        p : (np,) ndarray

        Raises
        ------
        NumericalError
            If the motion does not stay finite, or is too stiff.
        """
        self._settle(start, p)
        grid, count = self._grid, self._slope.shape[1]
        whole = np.concatenate([start, slope.ravel(order="F")])[None]
        arguments = np.concatenate([p, self._slope.ravel(order="F")])
        states, finished = self._run(
            whole, grid.steps, grid.substeps, grid.spacing / grid.substeps, self._u, self._w, arguments
        )
        if finished[0] < grid.steps:
            time = float(finished[0]) * grid.spacing
            raise NumericalError(f"the motion is not finite after t = {time:g} s", time=time)
        rows = grid.pick(states[0])
        slopes = rows[:, self._nx :].reshape(len(rows), count, self._nx)
        return rows[:, : self._nx], slopes.transpose(0, 2, 1)


class _Grid:
    """Equal steps on which the instants lie, or between which they are interpolated by cubics.

    Attributes
    ----------
    spacing : float
        Time between stored states [s].
    steps, substeps : int
    """

    def __init__(self, t: Array, rate: float) -> None:
        gap = float(np.diff(np.append(0.0, t) if t[0] > 0.0 else t).min())
        shares = t / gap
        self._even = bool(np.all(np.abs(shares - np.round(shares)) < 1e-6))
        if self._even:
            self.spacing = float(t[-1] / round(t[-1] / gap))
            self._index = np.round(t / self.spacing).astype(int)
            self.steps = int(self._index[-1])
            self.substeps = max(1, math.ceil(self.spacing * rate))
        else:
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
        for k in range(4):
            weight = np.ones_like(s)
            for j in range(4):
                if j != k:
                    weight = weight * (s - j) / (k - j)
            total += weight * rows[self._index + k]
        return total


def _variational(model: FingerModel, count: int) -> ca.Function:
    """Dynamics of [x, X] with the parameters [p, B]."""
    x, u, w, p = (
        ca.SX.sym(name, size) for name, size in (("x", model.nx), ("u", model.nu), ("w", model.nw), ("p", model.np))
    )
    moved, turned = ca.SX.sym("X", model.nx, count), ca.SX.sym("B", model.np, count)
    rate = model.forward_dynamics(x, u, w, p)
    slope = ca.jtimes(rate, ca.vertcat(x, p), ca.vertcat(moved, turned))
    outputs = ca.cse([ca.densify(ca.vertcat(rate, ca.vec(slope)))])
    inputs = [ca.vertcat(x, ca.vec(moved)), u, w, ca.vertcat(p, ca.vec(turned))]
    return ca.Function("variational", inputs, outputs, ["x", "u", "w", "p"], ["xd"])
