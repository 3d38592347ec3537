"""Motion of a scene in time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from os import PathLike
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from continuum_grasp import interrupt
from continuum_grasp.core import Core
from continuum_grasp.core.integrators import RK4_STABLE
from continuum_grasp.errors import InputError, Interrupted, NumericalError
from continuum_grasp.model import FingerModel, System
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.simulate import Scene, Timing
from continuum_grasp.simulation.contact_spectrum import contact_frequency, pressed_radius, telling_states
from continuum_grasp.simulation.initial import initial_state, start_warnings
from continuum_grasp.simulation.limits import LOST, limit_warnings, overlap_warnings
from continuum_grasp.simulation.reference import integrate_reference
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.spectrum import TARGET_RADIUS, sample_shapes, spectral_radius
from continuum_grasp.simulation.trajectory import Trajectory

__all__ = ["simulate"]

Array = NDArray[np.float64]
Progress = Callable[[float], None]

_IMPLICIT_FROM = 40
"""Sub-steps per output step from which on the implicit method is chosen."""
_MOST_SUBSTEPS = 10_000
"""Sub-steps per output step beyond which rk4 is refused."""
_MOST_IMPLICIT = 256
"""Sub-steps per output step of the implicit method, which contacts need to be resolved."""
_FINER = 4
"""Factor by which they grow where a motion with contacts is not finite."""
_CHUNK = 200_000
"""Sub-steps between two calls of ``progress``."""


@interrupt.listening()
def simulate(scene: Scene | str | PathLike[str], *, progress: Progress | None = None) -> Trajectory:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, with ``time``, or its YAML file.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    Trajectory
        States at every output step, with those of an object that moves and of the contacts' friction. Its ``warnings``
        tell when an element left its declared bending range or exceeded the strain limit, and where the finger passes
        through the object between the stations that touch it.

    Raises
    ------
    InputError
        If the scene has no time, or a state that does not fit.
    NumericalError
        If the motion does not stay finite, or is too stiff for the method that was asked for; ``result`` is the
        trajectory until then.
    SolverError
        If an initial equilibrium is not found.
    Interrupted
        On Ctrl-C; ``result`` is the trajectory until then.
    """
    scene = scene_of(scene)
    if scene.time is None:
        raise InputError("a simulation needs time: {duration: ..., step: ...}", key="time")
    model = FingerModel(scene)
    return _Run(scene, scene.time, model, progress).trajectory()


@dataclass(frozen=True)
class _Plan:
    """How to integrate."""

    method: str
    substeps: int
    radius: float


_Stop = NumericalError | Interrupted


class _Run:
    """One simulation."""

    def __init__(self, scene: Scene, time: Timing, model: FingerModel, progress: Progress | None) -> None:
        self._scene, self._time, self._model = scene, time, model
        self._progress = progress or (lambda share: None)
        self._system = System(scene) if scene.object is not None else None
        self._moving = self._system or model
        self._core = Core(self._moving)
        self._signals = Signals(scene, model, nw=self._moving.nw)
        self._steps = round(time.duration / time.step)
        self._p = np.array(model.p_nominal)
        self._implicit_substeps = 1

    def trajectory(self) -> Trajectory:
        """Integrate and check."""
        started = perf_counter()
        x0 = initial_state(self._scene, self._moving)
        plan: _Plan | None = self._choose(x0)
        while plan is not None:
            used = plan
            if plan.method != "reference":
                self._core.prepare_rollout(plan.method)
            began = perf_counter()
            states, error = self._integrate(x0, plan)
            took = perf_counter() - began
            plan, error = self._judged(plan, states, error)
        with interrupt.held(quietly=True) as pressed:  # the motion is there
            result, error = self._finished(states, error, used, took, started)
        if pressed() and error is None:
            error = Interrupted("interrupted after the end of the motion")
        if isinstance(error, Interrupted):
            raise Interrupted(str(error), result=result) from error.__cause__
        if error is not None:
            raise NumericalError(str(error), time=error.time, state=error.state, result=result) from error
        return result

    def _finished(
        self, states: Array, error: _Stop | None, used: _Plan, took: float, started: float
    ) -> tuple[Trajectory, _Stop | None]:
        """The motion as far as it means something, with warnings and statistics, and what stopped it."""
        result = self._result(states)
        use = self._range_use(result)
        lost = np.flatnonzero(np.any(use > LOST, axis=1))
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
        jumps = self._signals.warnings(self._time.step / used.substeps, self._time.duration)
        started_thrown, limits = start_warnings(self._scene, self._model), limit_warnings(self._model, use, result.t)
        warnings = (*started_thrown, *jumps, *limits, *overlap_warnings(result))
        return replace(result, status=status, warnings=warnings, statistics=statistics), error

    def _choose(self, x0: Array) -> _Plan:
        """Method and sub-steps from the spectral radius about the start, over the instants at which inputs turn."""
        shapes = sample_shapes(self._model, x0[: self._model.n])
        bent = np.tile(x0, (4, 1))
        bent[1:, : self._model.n] = shapes[1:4]
        radius = max(self._radius(shapes), self._contact_radius(bent))
        asked = self._time.method
        self._implicit_substeps = self._wanted(self._contact_frequency(bent))
        if asked == "reference":
            return _Plan(asked, 1, radius)
        wanted = self._wanted(radius)
        if asked == "implicit" or (asked == "auto" and wanted > _IMPLICIT_FROM):
            return self._implicit(radius)
        return _Plan("rk4", min(wanted, _MOST_SUBSTEPS), radius)

    def _judged(self, plan: _Plan, states: Array, error: _Stop | None) -> tuple[_Plan | None, _Stop | None]:
        """A finer plan where the motion turned out to be faster than rk4 can follow, and what is wrong if none is."""
        if plan.method == "implicit" and isinstance(error, NumericalError) and self._system is not None:
            self._implicit_substeps = _FINER * plan.substeps
            return (self._implicit(plan.radius) if self._implicit_substeps <= _MOST_IMPLICIT else None), error
        if plan.method != "rk4" or isinstance(error, Interrupted):
            return None, error
        shapes = states[:: max(1, len(states) // 12), : self._model.n]
        radius = max(plan.radius, self._radius(shapes))
        if self._system is not None:
            at = np.arange(len(states)) * self._time.step
            told = telling_states(self._core, states, self._signals.u(at), self._signals.w(at))
            radius = max(radius, self._contact_radius(told))
        wanted = self._wanted(radius)
        if error is None and radius * self._time.step / plan.substeps <= RK4_STABLE:
            return None, None
        if self._time.method == "auto" and (wanted > _IMPLICIT_FROM or wanted <= plan.substeps):
            return self._implicit(radius), error
        if plan.substeps < wanted <= _MOST_SUBSTEPS:
            return _Plan("rk4", wanted, radius), error
        if wanted > _MOST_SUBSTEPS:
            end = (len(states) - 1) * self._time.step
            message = (
                f"stopped at t = {end:g} s: the scene is too stiff for rk4, up to {radius:.3g} rad/s, which needs more "
                f"than {_MOST_SUBSTEPS} sub-steps per time.step of {self._time.step:g} s: use time.method: implicit "
                "or a smaller time.step"
            )
            return None, NumericalError(message, time=end, state=states[-1])
        return None, error

    def _implicit(self, radius: float) -> _Plan:
        return _Plan("implicit", min(self._implicit_substeps, _MOST_IMPLICIT), radius)

    def _wanted(self, radius: float) -> int:
        """Sub-steps, one more than the most at the most."""
        return max(1, math.ceil(min(radius * self._time.step / TARGET_RADIUS, _MOST_SUBSTEPS + 1)))

    def _radius(self, shapes: Array) -> float:
        """Spectral radius over shapes, at time zero, and over the first of them whenever inputs or loads turn."""
        finite = shapes[np.all(np.isfinite(shapes), axis=1)]
        core, signals, radius = Core(self._model, compiled=False), self._signals, 0.0
        for k, t in enumerate(signals.instants(self._time.duration)):
            some = finite if k == 0 else finite[:4]
            w = signals.w(t)[0, : self._model.nw]
            radius = max(radius, spectral_radius(core, some, signals.u(t)[0], w, self._p))
        return radius

    def _contact_radius(self, states: Array) -> float:
        """Spectral radius of finger, object and contacts over some states; zero without an object."""
        if self._system is None:
            return 0.0
        core = Core(self._system, compiled=False)
        return pressed_radius(core, states, self._signals.u(0.0)[0], self._signals.w(0.0)[0], self._p)

    def _contact_frequency(self, states: Array) -> float:
        """What implicit steps must resolve of the contacts [rad/s]; zero without an object."""
        if self._system is None:
            return 0.0
        core = Core(self._system, compiled=False)
        return contact_frequency(core, states, self._signals.u(0.0)[0], self._signals.w(0.0)[0], self._p)

    def _integrate(self, x0: Array, plan: _Plan) -> tuple[Array, _Stop | None]:
        """States, whole or until the error."""
        parts = [x0[None]]
        error: _Stop | None
        try:
            error = self._advance(parts, plan)
        except KeyboardInterrupt as stop:
            if isinstance(stop, Interrupted):
                parts.append(stop.result[1:])
            end = (sum(map(len, parts)) - 1) * self._time.step
            error = Interrupted(f"interrupted after t = {end:g} s of {self._time.duration:g} s")
            error.__cause__ = stop
        return np.concatenate(parts), error

    def _advance(self, parts: list[Array], plan: _Plan) -> NumericalError | None:
        """Add the states after the last one, and say what stopped them."""
        method, substeps, h = plan.method, plan.substeps, self._time.step
        chunk, start = max(1, _CHUNK // substeps), 0
        while start < self._steps:
            count = min(chunk, self._steps - start)
            u, w = self._inputs(start * h, count, substeps)
            try:
                if method == "reference":
                    part = integrate_reference(self._moving, parts[-1][-1], h, u, w)
                else:
                    part = self._core.rollout(parts[-1][-1], count, h, u=u, w=w, substeps=substeps, method=method)
            except NumericalError as error:
                parts.append(error.result[1:])
                time, state = start * h + (error.time or 0.0), parts[-1][-1] if len(parts[-1]) else parts[-2][-1]
                reason = (
                    str(error)
                    if method == "reference"
                    else f"the motion is not finite after t = {time:g} s (last state {state.tolist()}; {method}, "
                    f"{substeps} sub-steps of {h / substeps:g} s): take a smaller time.step or time.method: implicit; "
                    "if the finger bends beyond its range, raise fidelity.bending_range or lower the loads"
                )
                stopped = NumericalError(reason, time=time, state=state)
                stopped.__cause__ = error
                return stopped
            parts.append(part[1:])
            start += count
            self._progress(start / self._steps)
        return None

    def _inputs(self, start: float, count: int, substeps: int) -> tuple[Array, Array]:
        """Inputs and forces at half sub-steps, or one row where nothing varies."""
        if self._signals.constant and self._time.method != "reference":
            return self._signals.u(start)[0], self._signals.w(start)[0]
        t = start + np.arange(2 * count * substeps + 1) * (0.5 * self._time.step / substeps)
        return self._signals.u(t), self._signals.w(t)

    def _result(self, states: Array) -> Trajectory:
        t: Array = np.linspace(0.0, (len(states) - 1) * self._time.step, len(states))
        return Trajectory(t, states, self._signals.u(t), self._signals.w(t), self._model, self._scene, self._system)

    def _range_use(self, result: Trajectory) -> Array:
        """Share of the declared bending range that each element uses (T, elements)."""
        return np.asarray(result.core.batch("range_use", result.q, result.acting, None))

    def _lost_error(self, result: Trajectory, use: Array) -> NumericalError:
        k = int(np.argmax(use[-1]))
        reach, last = self._model.ranges[k], result.x[-1]
        return NumericalError(
            f"element {k + 1} is about to bend beyond {LOST:g} times its declared range of {reach:.3g} rad after "
            f"t = {result.t[-1]:g} s (state {last.tolist()}), where the model means nothing: raise "
            "fidelity.bending_range, or lower the loads",
            time=float(result.t[-1]),
            state=last,
        )
