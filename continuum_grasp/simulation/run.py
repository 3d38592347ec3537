"""Motion of a scene in time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np

from continuum_grasp.base import Array, InputError, Interrupted, NumericalError, check_arguments, interruptible
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import FAMILIES, INTEGRATORS, Scene, Timing
from continuum_grasp.simulation.initial import initial_state
from continuum_grasp.simulation.slack import tension_warnings
from continuum_grasp.simulation.spectrum import (
    contact_frequency,
    grows,
    pressed_radius,
    representative_states,
    spectral_radius,
)
from continuum_grasp.simulation.stepping import Motion, Stepper, SteppingPlan, Stop
from continuum_grasp.simulation.trajectory import Trajectory

Progress = Callable[[float], None]

_FAST = "rk4"
"""Method that ``time.method: auto`` chooses between and ``stiff_method``."""
_IMPLICIT_FROM = 40
"""Least number of sub-steps per output step that selects the implicit method."""
_MOST_SUBSTEPS = 10_000
"""Sub-steps per output step beyond which an explicit method is refused."""
_MOST_IMPLICIT = 256
"""Sub-steps per output step of an implicit method, which contacts need to be resolved."""
_GROWTH = (1.3, 16.0)
"""Least and greatest factor from one number of sub-steps to the next that keeps the tolerance."""
_MARGIN = 1.25
"""Factor on the number of sub-steps that is foreseen."""
_MOST_WORK = {_FAST: 4_000_000, "rodas": 400_000, "extrapolated_euler": 400_000}
"""Greatest number of sub-steps in pursuit of the tolerance: some 10 s of compiled code for fingers with contacts."""


@interruptible()
@check_arguments
def integrate(scene: Scene, *, progress: Progress | None = None) -> Trajectory:
    """Integrate the motion of a scene without ``fidelity.tolerance``; see `continuum_grasp.simulate`."""
    if scene.time is None:
        raise InputError("a simulation needs time: {duration: ..., step: ...}", key="time")
    model = FingerModel(scene)
    return _Run(scene, scene.time, model, progress).trajectory()


class _Run:
    """A simulation run."""

    def __init__(self, scene: Scene, time: Timing, model: FingerModel, progress: Progress | None) -> None:
        self._progress = progress
        self._scene = scene
        self._time = time
        self._model = model
        self._p = np.array(model.p_nominal)
        self._stepper = Stepper(scene, time, model, progress or (lambda share: None))
        self._system, self._core, self._signals = self._stepper.system, self._stepper.core, self._stepper.signals
        self._implicit_substeps = 1

    def trajectory(self) -> Trajectory:
        """Integrate and check."""
        started = perf_counter()
        took = 0.0
        x0 = initial_state(self._scene, self._stepper.moving)
        if wider := self._wider(self._use(self._result(x0[None]))):
            return wider.trajectory()
        plan: SteppingPlan | None = self._choose(x0)
        while plan is not None:
            used = plan
            self._stepper.prepare(plan)
            began = perf_counter()
            motion = self._stepper.run(x0, plan)
            took += perf_counter() - began
            plan, error = self._judged(plan, motion)
        # A motion that left its range is credible up to twice the range.
        if not isinstance(error, Interrupted) and (
            wider := self._wider(np.minimum(self._use(self._result(motion.states)), 2.0))
        ):
            return wider.trajectory()
        with Interrupted.after("the motion") as late:
            result, error = self._finished(motion, error, used, took, started)
        error = error or late()
        if error is not None:
            error.result = result
            raise error
        return result

    def _finished(
        self, motion: Motion, error: Stop | None, used: SteppingPlan, took: float, started: float
    ) -> tuple[Trajectory, Stop | None]:
        """Return the meaningful part of the motion, with warnings and statistics, and the reason of its end."""
        states = motion.states
        result = self._result(states)
        use = self._use(result)
        lost = np.flatnonzero(np.any(use > 1.0, axis=1))
        if lost.size:
            k = int(np.argmax(use[lost[0]]))
            limit = f"{self._model.ranges[k]:.3g} rad, the greatest range of its model"
            advice = "take more elements, or lower the loads"
            if lost[0] == 0:
                raise InputError(f"the initial shape bends element {k + 1} beyond {limit}: {advice}", key="initial")
            result = self._result(states[: lost[0]])
            use = use[: lost[0]]
            last = result.x[-1]
            beyond = NumericalError(
                f"element {k + 1} is about to bend beyond {limit}, after t = {result.t[-1]:g} s (state "
                f"{last.tolist()}): {advice}",
                time=float(result.t[-1]),
                state=last,
            )
            beyond.__cause__, error = error, beyond
        statistics = {
            "method": used.method,
            "substeps": used.substeps,
            "start_substeps": used.start.substeps,
            "steps_taken": self._stepper.taken,
            "spectral_radius": used.radius,
            "code": str(self._stepper.code(used)),
            "integration_s": took,
            "real_time_factor": (len(states) - 1) * self._time.step / max(took, 1e-12),
            "total_s": perf_counter() - started,
        }
        status = "finished" if error is None else "stopped"
        jumps = self._signals.warnings(self._time.step / used.substeps, self._time.duration)
        jumps = () if used.method == "reference" else jumps  # it restarts at every knot
        at_start = _start_warnings(self._scene, self._model)
        limits = self._model.limit_warnings(use, result.t)
        inexact = self._error_warnings(used, motion)
        body = self._scene.object
        poses = result.object_pose
        contacts = result.contacts
        overlap = ""
        if body is not None and poses is not None and contacts is not None:
            half = self._model.finger.profile.half_thickness
            overlap = contacts.overlap_text(result, body, poses, half, 100)
        through = f"between the stations that touch, the finger overlaps the object by {overlap}: add contacts"
        pulled = tension_warnings(self._model.finger, result.t, result.tensions)
        warnings = (*at_start, *jumps, *inexact, *limits, *pulled, *((through,) if overlap else ()))
        result = replace(result, status=status, warnings=warnings, statistics=statistics, time_error=motion.time_error)
        return result, error

    @staticmethod
    def _use(result: Trajectory) -> Array:
        """Share of its bending range that each element uses at each instant (T, elements)."""
        return np.asarray(result.core.batch("range_use", result.q, result.acting, None))

    def _wider(self, use: Array) -> _Run | None:
        """Return a run with ranges that cover the bends; None if they do already, or cannot grow."""
        peaks = use.max(axis=0)
        # 1.25: range per bend of a motion that left the range before
        model = self._model.reaching(1.25 * peaks * self._model.ranges) if peaks.max() > 1.0 else self._model
        wider = peaks.max() > 1.0 and model.ranges != self._model.ranges
        return _Run(self._scene, self._time, model, self._progress) if wider else None

    def _choose(self, x0: Array) -> SteppingPlan:
        """Choose method and sub-steps from the spectral radius about the start, at the extreme instants of the
        inputs.
        """
        shapes = self._model.sample_shapes(x0[: self._model.n])
        bent = np.tile(x0, (4, 1))
        bent[1:, : self._model.n] = shapes[1:4]
        radius = max(self._radius(shapes, np.zeros_like(shapes)), self._of_contacts(pressed_radius, bent))
        asked = self._time.method
        # Implicit steps are stable whatever the finger does, but must resolve the springs of contacts to meet them, and
        # those of gears to meet their flanks.
        flanks = [motor for motor in self._model.structure.motors if motor.gear]
        met = [math.sqrt(motor.held_stiffness / float(motor.inertia)) for motor in flanks]
        self._implicit_substeps = self._wanted(max(self._of_contacts(contact_frequency, bent), *met, 0.0))
        if self._model.friction_names:
            # 32: implicit step up to which friction is followed, per that of methods implicit in part: stops have
            # kinks, and steps of three times that ran away
            longest = 32.0 * self._model.structure.partial_step
            self._implicit_substeps = max(self._implicit_substeps, math.ceil(self._time.step / longest))
        if asked == "reference":
            return SteppingPlan(asked, 1, radius)
        wanted = self._wanted(radius)
        if asked == "auto":
            asked = self._stiff if wanted > _IMPLICIT_FROM else _FAST
        return self._planned(asked, radius)

    @property
    def _stiff(self) -> str:
        """The method for stiff motions."""
        return self._model.structure.stiff_method(sweeps=self._core.model.sweeps)

    def _judged(self, plan: SteppingPlan, motion: Motion) -> tuple[SteppingPlan | None, Stop | None]:
        """Return a finer plan after steps that were too long, or the fault if no finer plan exists."""
        states, error = motion.states, motion.error
        if isinstance(error, Interrupted):
            return None, error
        if error is None and motion.time_error > plan.tolerance:
            return self._finer(plan, motion), None
        unknown = error is None and math.isinf(motion.time_error)
        if unknown and INTEGRATORS[plan.method].partial and plan.substeps < _MOST_IMPLICIT:
            # Steps of twice the length, which they are compared with, are not stable where the motion has been.
            return self._controlled(replace(plan, substeps=2 * plan.substeps)), None
        if plan.stable is None:
            # A linearly implicit step cannot foresee contacts, stops, friction and quadratic damping.
            if plan.method == "reference" or not isinstance(error, NumericalError):
                return None, error
            # 4: factor on their number if a motion with contacts is not finite
            self._implicit_substeps = 4 * plan.substeps
            finer = self._planned(plan.method, plan.radius) if self._implicit_substeps <= _MOST_IMPLICIT else None
            return finer, error
        # The motion may have reached stiffer shapes than at the start, so its shapes are checked again.
        n = self._model.n
        some = states[:: max(1, len(states) // 12)]
        radius = max(plan.radius, self._radius(some[:, :n], some[:, n : 2 * n]))
        if self._system is not None:
            at = np.arange(len(states)) * self._time.step
            looked = representative_states(self._core, states, self._signals.u(at), self._signals.w(at))
            radius = max(radius, self._of_contacts(pressed_radius, looked))
        wanted = self._wanted(radius)
        if error is None and radius * self._time.step / plan.substeps <= plan.stable:
            return None, None
        if self._time.method == "auto" and (wanted > _IMPLICIT_FROM or wanted <= plan.substeps):
            return self._planned(self._stiff, radius), error
        if plan.substeps < wanted <= _MOST_SUBSTEPS:
            return self._planned(plan.method, radius), error
        if wanted > _MOST_SUBSTEPS:
            end = (len(states) - 1) * self._time.step
            message = (
                f"stopped at t = {end:g} s: the scene is too stiff for {plan.method}, up to {radius:.3g} rad/s, which "
                f"needs more than {_MOST_SUBSTEPS} sub-steps per time.step of {self._time.step:g} s: use "
                f"time.method: {self._stiff} "
                "or a smaller time.step"
            )
            return None, NumericalError(message, time=end, state=states[-1])
        return None, error

    def _planned(self, method: str, radius: float) -> SteppingPlan:
        """The method in sub-steps that are stable."""
        explicit = INTEGRATORS[method].stable is not None
        wanted, limit = (
            (self._wanted(radius), _MOST_SUBSTEPS) if explicit else (self._implicit_substeps, _MOST_IMPLICIT)
        )
        made = self._model.structure
        u = self._signals.u(0.0)[0]
        w = self._signals.w(0.0)[0, : self._model.nw]
        if INTEGRATORS[method].partial and (made.own_tendons or self._model.friction_names):
            # What drives and friction add must be stable in steps of twice the length too, which are compared with.
            # Quadratic damping is left out: steps from rest overshoot by it, which is bounded, and nothing grows.
            finger = self._scene.finger.replaced(damping=self._scene.finger.damping.replaced(quadratic=0.0))
            linear = FingerModel(self._scene.replaced(finger=finger)) if made.has_law("damping") else self._model
            core = Core(linear, compiled=False)
            straight = np.zeros(self._model.n)
            while wanted < limit and grows(core, method, straight, u, w, self._p, 2.0 * self._time.step / wanted):
                wanted *= 2
        return self._controlled(SteppingPlan(method, min(wanted, limit), radius))

    def _controlled(self, plan: SteppingPlan, final: bool = False) -> SteppingPlan:
        """The plan with longer steps to compare with and, where the tolerance is pursued, the error to give up at."""
        auto = self._time.method == "auto"
        steps = self._stepper.steps
        # Steps of twice the length must fit into the motion, or nothing is compared.
        if auto and steps == 1 and plan.substeps % 2:
            plan = replace(plan, substeps=plan.substeps + 1)
        step = self._time.step / plan.substeps
        smooth = self._smooth(plan)
        # 2.0: product of step and spectral radius up to which longer steps are compared with; they are stable up to 2.7
        tame = math.inf if plan.stable is None else 2.0 / (plan.radius * step)
        # One sub-step and smooth: comparing with steps of four times the length costs a quarter in place of a half.
        sparse = auto and smooth and plan.stable is not None and plan.substeps == 1
        halvings = 2 if sparse and min(steps, tame) >= 4 else 1
        observed = smooth and 2 ** (halvings + 1) <= min(tame, steps * plan.substeps)
        plan = replace(plan, halvings=halvings, observed=observed)
        if not auto:
            return plan
        return replace(plan, tolerance=math.inf if final else self._time.tolerance, corrected=smooth)

    def _smooth(self, plan: SteppingPlan) -> bool:
        """Whether the method has its order: no contacts, no kinks of inputs or loads."""
        return self._system is None and self._signals.smooth(self._time.step / plan.substeps, self._time.duration)

    def _finer(self, plan: SteppingPlan, motion: Motion) -> SteppingPlan:
        """Sub-steps that should keep the tolerance, or as many as are taken at the most."""
        done = len(motion.states) - 1
        steps = self._stepper.steps
        # A motion that fails its first check begins faster than it may continue.
        begun = done <= plan.every and done < steps
        taken, share = (plan.start.substeps, 1.0) if begun else (plan.substeps, done / steps)
        excess = motion.time_error / (self._time.tolerance * share)
        # Error goes with step^order on smooth motions, with the step where there are contacts and kinks: so many more
        # sub-steps; a multiple of four for steps of four times the length.
        factor = _MARGIN * excess ** (1.0 / plan.order if self._smooth(plan) else 1.0)
        wanted = 4 * math.ceil(0.25 * taken * float(np.clip(factor, *_GROWTH)))
        substeps = min(wanted, max(taken, _MOST_WORK[plan.method] // (1 if begun else steps)))
        finer = replace(plan, start_substeps=substeps) if begun else replace(plan, substeps=substeps)
        return self._controlled(finer, final=substeps < wanted)

    def _error_warnings(self, plan: SteppingPlan, motion: Motion) -> tuple[str, ...]:
        """Warnings about a time error beyond the tolerance."""
        error = motion.time_error
        tolerance = self._time.tolerance
        if error <= tolerance or plan.method == "reference" or motion.error is not None:
            return ()
        step = self._time.step / plan.substeps
        if math.isnan(error):
            return (f"the time error is not known: there is one step of {step:g} s; take a smaller time.step",)
        size = f"about {error:.2g} of the length" if math.isfinite(error) else "an error that cannot be estimated"
        if self._time.method == "auto":
            advice = "the motion is too sensitive for more: take a shorter duration, or a greater time.tolerance"
        else:
            advice = "take time.method: auto, or a smaller time.step"
        return (f"steps of {step:.3g} s leave {size} (time.tolerance is {tolerance:g}): {advice}",)

    def _wanted(self, radius: float) -> int:
        """Sub-steps, one more than the most at the most."""
        return max(1, math.ceil(min(radius * self._time.step / INTEGRATORS[_FAST].target, _MOST_SUBSTEPS + 1)))

    def _radius(self, shapes: Array, rates: Array) -> float:
        """Spectral radius over shapes, at time zero, and over the first of them whenever inputs or loads turn."""
        sane = np.all(np.isfinite(shapes) & np.isfinite(rates), axis=1)
        finite, moving = shapes[sane], rates[sane]
        # Later instants use only the start, the straight finger and two random shapes, because eigenvalues are slow.
        core = Core(self._model, compiled=False)
        signals = self._signals
        radius = 0.0
        for k, t in enumerate(signals.instants(self._time.duration)):
            some, qd = (finite, moving) if k == 0 else (finite[:4], moving[:4])
            w = signals.w(t)[0, : self._model.nw]
            radius = max(radius, spectral_radius(core, some, signals.u(t)[0], w, self._p, qd))
        return radius

    def _of_contacts(self, rate: Callable[[Core, Array, Array, Array, Array], float], states: Array) -> float:
        """Spectral radius or frequency of finger, object and contacts over some states; zero without an object."""
        if self._system is None:
            return 0.0
        core = Core(self._system, compiled=False)
        return rate(core, states, self._signals.u(0.0)[0], self._signals.w(0.0)[0], self._p)

    def _result(self, states: Array) -> Trajectory:
        t: Array = np.linspace(0.0, (len(states) - 1) * self._time.step, len(states))
        return Trajectory(t, states, self._signals.u(t), self._signals.w(t), self._model, self._scene, self._system)


def _start_warnings(scene: Scene, model: FingerModel) -> tuple[str, ...]:
    """Warnings about a start that a matched tip cannot have."""
    if not model.structure.matched or not scene.tip_moment_jumps:
        return ()
    return (
        f"the motion starts with the tip curvature that the moments on the tip impose on {model.family}, not with that "
        f"of the initial pose: use fidelity.family: {FAMILIES.default(free_tip=True)}, or moments that grow from zero",
    )
