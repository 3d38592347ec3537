"""Motion of a scene in time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core import Core
from continuum_grasp.core.integrators import RK4_STABLE
from continuum_grasp.errors import InputError, NumericalError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.simulate import Scene, Timing
from continuum_grasp.simulation.reference import integrate_reference
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.spectrum import TARGET_RADIUS, sample_shapes, spectral_radius
from continuum_grasp.simulation.statics import equilibrium
from continuum_grasp.simulation.trajectory import Trajectory

__all__ = ["initial_state", "simulate"]

Array = NDArray[np.float64]
Progress = Callable[[float], None]

_IMPLICIT_FROM = 40
"""Sub-steps per output step from which on the implicit method is chosen."""
_MOST_SUBSTEPS = 1e6
_LOST = 3.0
"""Multiple of the declared bending range at which a run is stopped."""
_CHUNK = 200_000
"""Sub-steps between two calls of ``progress``."""


def simulate(scene: Scene, *, progress: Progress | None = None) -> Trajectory:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene
        With ``time``.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    Trajectory
        States at every output step. Its ``warnings`` tell when an element left its declared bending range.

    Raises
    ------
    InputError
        If the scene has no time, or a state that does not fit.
    NumericalError
        If the motion does not stay finite or the step is too large for it; ``result`` is the trajectory until then.
    SolverError
        If an initial equilibrium is not found.
    """
    if scene.time is None:
        raise InputError("a simulation needs time: {duration: ..., step: ...}", key="time")
    model = FingerModel(scene)
    return _Run(scene, scene.time, model, progress).trajectory()


def initial_state(scene: Scene, model: FingerModel) -> Array:
    """State of a scene at time zero.

    Parameters
    ----------
    scene : Scene
        The scene.
    model : FingerModel
        Its model.

    Returns
    -------
    (nx,) ndarray

    Raises
    ------
    InputError
        If ``initial.q`` or ``initial.qd`` has the wrong size.
    SolverError
        If an initial equilibrium is not found.
    """
    signals = Signals(scene, model)
    u = signals.u(0.0)[0]
    initial, n = scene.initial, model.n
    q, qd = np.zeros(n), np.zeros(n)
    if initial.q is not None:
        q = np.array(initial.q, dtype=float)
        qd = np.zeros(n) if initial.qd is None else np.array(initial.qd, dtype=float)
        for name, value in (("q", q), ("qd", qd)):
            if value.shape != (n,):
                raise InputError(
                    f"{name} has {value.size} entries, the {model.family} model has {n}: {', '.join(model.q_names)}",
                    key=f"initial.{name}",
                )
    elif initial.pose == "equilibrium":
        q = equilibrium(_as_modelled(scene, model), extra_loads=initial.held_by).q
    elif initial.pose == "rest":
        bare = scene.model_copy(update={"loads": (), "actuation": None, "gravity": (0.0, 0.0)})
        q = equilibrium(_as_modelled(bare, model)).q
    if model.nx == 2 * n:
        return np.concatenate([q, qd])
    tendons = scene.finger.tendons
    moment = (u[0] - u[1]) * tendons.offset if tendons is not None else 0.0
    return np.concatenate([q, qd, [moment, 0.0]])


def _as_modelled(scene: Scene, model: FingerModel) -> Scene:
    """The scene with the family that the model resolved."""
    return scene.model_copy(update={"fidelity": scene.fidelity.model_copy(update={"family": model.family})})


@dataclass(frozen=True)
class _Plan:
    """How to integrate."""

    method: str
    substeps: int
    radius: float


class _Run:
    """One simulation."""

    def __init__(self, scene: Scene, time: Timing, model: FingerModel, progress: Progress | None) -> None:
        self._scene, self._time, self._model = scene, time, model
        self._progress = progress or (lambda share: None)
        self._core = Core(model)
        self._signals = Signals(scene, model)
        self._steps = round(time.duration / time.step)
        self._p = np.array(model.p_nominal)

    def trajectory(self) -> Trajectory:
        """Integrate and check."""
        started = perf_counter()
        x0 = initial_state(self._scene, self._model)
        plan: _Plan | None = self._choose(x0)
        while plan is not None:
            used = plan
            if plan.method != "reference":
                self._core.prepare_rollout(plan.method)
            began = perf_counter()
            states, error = self._integrate(x0, plan)
            took = perf_counter() - began
            plan = self._revised(plan, states, error)
        result = self._result(states)
        use = self._range_use(result)
        lost = np.flatnonzero(np.any(use > _LOST, axis=1))
        if lost.size:
            if lost[0] == 0:
                raise InputError(
                    f"the initial shape bends an element {use[0].max():.3g} times its range", key="initial"
                )
            result, use = self._result(states[: lost[0]]), use[: lost[0]]
            lost_error = self._lost_error(result, use)
            lost_error.__cause__ = error
            error = lost_error
        statistics = {
            "method": used.method,
            "substeps": used.substeps,
            "spectral_radius": used.radius,
            "compiled": self._core.compiled,
            "integration_s": took,
            "real_time_factor": (len(states) - 1) * self._time.step / max(took, 1e-12),
            "total_s": perf_counter() - started,
        }
        status = "finished" if error is None else "stopped"
        warnings = tuple(self._range_warnings(result, use))
        result = replace(result, status=status, warnings=warnings, statistics=statistics)
        if error is not None:
            raise NumericalError(str(error), time=error.time, state=error.state, result=result) from error
        return result

    def _choose(self, x0: Array) -> _Plan:
        """Method and sub-steps from the spectral radius about the start, over the instants at which inputs turn."""
        radius = self._radius(sample_shapes(self._model, x0[: self._model.n]))
        asked = self._time.method
        if asked in ("implicit", "reference"):
            return _Plan(asked, 1, radius)
        wanted = self._wanted(radius)
        if asked == "auto" and wanted > _IMPLICIT_FROM:
            return _Plan("implicit", 1, radius)
        return _Plan("rk4", wanted, radius)

    def _revised(self, plan: _Plan, states: Array, error: NumericalError | None) -> _Plan | None:
        """A finer plan where the motion turned out to be faster than the explicit method can follow."""
        if plan.method != "rk4":
            return None
        shapes = states[:: max(1, len(states) // 12), : self._model.n]
        radius = max(plan.radius, self._radius(shapes))
        wanted = self._wanted(radius)
        if error is None and radius * self._time.step / plan.substeps <= RK4_STABLE:
            return None
        if self._time.method == "auto" and (wanted > _IMPLICIT_FROM or wanted <= plan.substeps):
            return _Plan("implicit", 1, radius)
        return _Plan("rk4", wanted, radius) if wanted > plan.substeps else None

    def _wanted(self, radius: float) -> int:
        return max(1, math.ceil(min(radius * self._time.step / TARGET_RADIUS, _MOST_SUBSTEPS)))

    def _radius(self, shapes: Array) -> float:
        """Spectral radius over shapes, at time zero, and over the first of them whenever inputs or loads turn."""
        finite = shapes[np.all(np.isfinite(shapes), axis=1)]
        core, signals, radius = Core(self._model, compiled=False), self._signals, 0.0
        for k, t in enumerate(signals.instants(self._time.duration)):
            some = finite if k == 0 else finite[:4]
            radius = max(radius, spectral_radius(core, some, signals.u(t)[0], signals.w(t)[0], self._p))
        return radius

    def _integrate(self, x0: Array, plan: _Plan) -> tuple[Array, NumericalError | None]:
        """States, whole or until the error."""
        method, substeps, h = plan.method, plan.substeps, self._time.step
        parts, start = [x0[None]], 0
        chunk = max(1, _CHUNK // substeps)
        while start < self._steps:
            count = min(chunk, self._steps - start)
            u, w = self._inputs(start * h, count, substeps)
            try:
                if method == "reference":
                    part = integrate_reference(self._model, parts[-1][-1], h, u, w)
                else:
                    part = self._core.rollout(parts[-1][-1], count, h, u=u, w=w, substeps=substeps, method=method)
            except NumericalError as error:
                parts.append(error.result[1:])
                time = start * h + (error.time or 0.0)
                states = np.concatenate(parts)
                reason = (
                    str(error)
                    if method == "reference"
                    else f"the motion is not finite after t = {time:g} s (last state {states[-1].tolist()}; {method}, "
                    f"{substeps} sub-steps of {h / substeps:g} s): take a smaller time.step or time.method: implicit; "
                    "if the finger bends beyond its range, raise fidelity.bending_range or lower the loads"
                )
                stopped = NumericalError(reason, time=time, state=states[-1])
                stopped.__cause__ = error
                return states, stopped
            parts.append(part[1:])
            start += count
            self._progress(start / self._steps)
        return np.concatenate(parts), None

    def _inputs(self, start: float, count: int, substeps: int) -> tuple[Array, Array]:
        """Inputs and forces at half sub-steps, or one row where nothing varies."""
        if self._signals.constant and self._time.method != "reference":
            return self._signals.u(start)[0], self._signals.w(start)[0]
        t = start + np.arange(2 * count * substeps + 1) * (0.5 * self._time.step / substeps)
        return self._signals.u(t), self._signals.w(t)

    def _result(self, states: Array) -> Trajectory:
        t: Array = np.linspace(0.0, (len(states) - 1) * self._time.step, len(states))
        return Trajectory(t, states, self._signals.u(t), self._signals.w(t), self._model, self._scene)

    def _range_use(self, result: Trajectory) -> Array:
        """Share of the declared bending range that each element uses (T, elements)."""
        return np.asarray(self._core.batch("range_use", result.q, result.acting, None))

    def _lost_error(self, result: Trajectory, use: Array) -> NumericalError:
        k = int(np.argmax(use[-1]))
        reach, last = self._model.ranges[k], result.x[-1]
        return NumericalError(
            f"element {k + 1} is about to bend beyond {_LOST:g} times its declared range of {reach:.3g} rad after "
            f"t = {result.t[-1]:g} s (state {last.tolist()}), where the model means nothing: raise "
            "fidelity.bending_range, or lower the loads",
            time=float(result.t[-1]),
            state=last,
        )

    def _range_warnings(self, result: Trajectory, use: Array) -> list[str]:
        """What the user must know of bends beyond the declared range and of strains beyond the limit."""
        model, limit = self._model, self._scene.finger.curvature_limit
        warnings = []
        for k in range(use.shape[1]):
            curvature = use[:, k] * (model.ranges[k] / model.lengths[k])
            strained, beyond = np.flatnonzero(curvature > limit * (1 + 1e-9)), np.flatnonzero(use[:, k] > 1.0)
            if strained.size:
                warnings.append(
                    f"element {k + 1} exceeds the strain limit at t = {result.t[strained[0]]:g} s "
                    f"(greatest: {curvature.max() / limit:.2f} times the limit; the model is meant for less)"
                )
            if beyond.size and model.ranges[k] < limit * model.lengths[k] * (1 - 1e-9):
                warnings.append(
                    f"element {k + 1} left its declared bending range of {model.ranges[k]:.3g} rad at "
                    f"t = {result.t[beyond[0]]:g} s (greatest: {use[:, k].max():.2f} times the range), where the model "
                    "loses its accuracy: raise fidelity.bending_range"
                )
        return warnings
