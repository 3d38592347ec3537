"""Prediction of the path of a point of the finger as a function of the unknowns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.identification.blocks import Block, Entry
from continuum_grasp.identification.data import TipPath, column
from continuum_grasp.identification.motion import Motion
from continuum_grasp.identification.rows import Rows, runtime_names
from continuum_grasp.identification.shape import Shapes, observation
from continuum_grasp.identification.unknowns import DEADBAND, Unknown
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.families import default_family
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.trajectory import limit_warnings

__all__ = ["PathBlock"]

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
