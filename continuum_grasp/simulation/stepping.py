"""Steps in time, checked against longer steps (L. F. Richardson, Phil. Trans. A 210, 1911, doi:10.1098/rsta.1911.0009).

1. Integrate a chunk in the plan's steps, and side by side in steps of twice or four times that length.
2. Compare positions at common instants; the differences, and how they shrink, give the error of the shortest steps.
3. Give up if this error exceeds the tolerance; the caller plans shorter steps.
4. On request, subtract the leading errors from the output states; each step length continues with its own states.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, Interrupted, NumericalError, interrupts_held
from continuum_grasp.core import CodeKind, Core
from continuum_grasp.model import FingerModel, System
from continuum_grasp.scene import INTEGRATORS, Scene, Timing
from continuum_grasp.simulation.contacts import greatest_motion
from continuum_grasp.simulation.signals import Signals

Stop = NumericalError | Interrupted

_BESIDE = 2e-9
"""Distance from a jump for its values on both sides [s]: twice the least time between samples."""

_KNOWN_SHRINK = 0.6
"""Factor on the error by half the step length that is assumed where none is observed: as for order 1, which contacts
and kinks can have, with a margin for steps so long that twice their length is unstable (4 and 6 clothoids let go: the
true error was up to 1.33 times the error of order 1)."""
_CHUNK = 200_000
"""Sub-steps between two calls of ``progress``, and between two looks at the error [1]."""
_LEAST_CHUNK, _LOOKS = 1_000, 16
"""Sub-steps of the shortest chunk, and looks at the error over a motion that is to keep a tolerance: a look takes about
0.2 ms, as long as 500 sub-steps of two clothoids."""
_RELATIVE, _ABSOLUTE = 1e-11, 1e-12
"""Tolerances of CVODES [1; units of the states]: motions of 0.2 s have errors below 1e-9 (test_simulation.py)."""


@dataclass(frozen=True)
class SteppingPlan:
    """Plan of an integration: method and steps."""

    method: str  # name in ``INTEGRATORS``, or ``reference``
    substeps: int  # steps of the method per output step
    radius: float  # spectral radius [1/s]
    halvings: int = 1  # log2 of the length of the compared steps, per length of the steps
    observed: bool = False  # whether steps of twice that length are taken too, to observe how the error shrinks
    tolerance: float = math.inf  # greatest error per length of the finger [1]; beyond it, the motion is given up
    corrected: bool = False  # whether to remove the leading errors from the states (Richardson's extrapolation)
    start_substeps: int = 0  # steps of the method in the first output step, where these are more

    @property
    def start(self) -> SteppingPlan:
        """Plan of the first output step: a released finger may at first move far faster than later."""
        return replace(self, substeps=max(self.substeps, self.start_substeps))

    @property
    def order(self) -> int:
        """Power of the step in the error of smooth motions."""
        return INTEGRATORS[self.method].order

    @property
    def stable(self) -> float | None:
        """Greatest product of step and spectral radius; None where any step is stable."""
        return None if self.method == "reference" else INTEGRATORS[self.method].stable

    @property
    def ratios(self) -> tuple[int, ...]:
        """Lengths of the longer steps, per length of the steps."""
        return tuple(2 ** (self.halvings + k) for k in range(2 if self.observed else 1))

    @property
    def every(self) -> int:
        """Output steps from one instant to the next that long and short steps share."""
        return 1 if self.method == "reference" else self.ratios[-1] // math.gcd(self.substeps, self.ratios[-1])

    @property
    def weights(self) -> Array:
        """Weights of the longer steps in the sum that is free of the leading powers of the step in the error."""
        # All step weights add up to one; their sums for the errors of order p, p + 1 are zero.
        ratios = np.array([1, *self.ratios], dtype=float)
        powers = np.array([0, *range(self.order, self.order + len(self.ratios))])
        return np.asarray(np.linalg.solve(ratios ** powers[:, None], powers == 0)[1:])

    def estimate(self, differences: list[float]) -> float:
        """Error of the steps from the differences to longer ones and, where observed, of these to yet longer ones.

        With a factor r on the error by half the step length, and k halvings, these are as r (1 - r^k) / (1 - r).
        """
        if self.method == "reference":
            return differences[0]
        shrink = _KNOWN_SHRINK
        if self.observed and differences[0] < differences[1]:
            quotient = differences[0] / differences[1]
            # (1 - r^k) cancels in the quotient: r for one halving, r + r^2 for two.
            shrink = quotient if self.halvings == 1 else math.sqrt(0.25 + quotient) - 0.5
        elif self.observed:
            return differences[0]
        least = 2.0 ** (1 - self.order)  # twice the factor of the order: a few observed motions prove nothing better
        shrink = max(shrink, least) ** self.halvings
        return differences[0] * shrink / (1.0 - shrink)


@dataclass(frozen=True)
class Motion:
    """States (T, nx), whole or until they were given up, what stopped them, and the estimate of their error.

    ``time_error`` is the greatest error of position so far per length of the finger [1]; nan where no instant was
    compared.
    """

    states: Array
    error: Stop | None
    time_error: float


class Stepper:
    """Integrates a scene from a state; the core belongs to the system, or to the finger without an object.

    ``steps`` are output steps, ``taken`` counts steps of fixed-step methods so far, with longer ones and steps of
    plans that were given up.
    """

    def __init__(self, scene: Scene, time: Timing, model: FingerModel, progress: Callable[[float], None]) -> None:
        self._time = time
        self._model = model
        self._progress = progress
        self.system = System(scene, reached=model.ranges) if scene.object is not None else None
        self.moving = self.system or model
        self.core, self.signals = Core(self.moving), Signals(scene, model, nw=self.moving.nw)
        self._positions = self.core if self.system is None else Core(model)
        self._failure = ""
        self.steps = round(time.duration / time.step)
        self.taken = 0

    def prepare(self, plan: SteppingPlan) -> None:
        """Compile what a plan needs."""
        # Before the motion is timed; the positions' function is compiled by its first call.
        self._ends(np.zeros((1, self._model.nx)), np.zeros((1, self._model.nu)))
        if plan.method != "reference":
            steps = self.steps * plan.substeps
            self.core.prepare_rollout(plan.method, steps=sum(steps / ratio for ratio in (1, *plan.ratios)))

    def code(self, plan: SteppingPlan) -> CodeKind:
        """Kind of code that takes the steps of a plan."""
        return CodeKind.INTERPRETED if plan.method == "reference" else self.core.rollouts(plan.method).code.kind

    def run(self, x0: Array, plan: SteppingPlan) -> Motion:
        """Integrate until the end, an error, Ctrl-C, or a time error beyond the plan's tolerance."""
        parts = [x0[None]]
        differences = _Differences(plan)
        error: Stop | None
        try:
            error = self._advance(parts, differences, plan)
        except KeyboardInterrupt as stop:
            if isinstance(stop, Interrupted):
                parts.append(stop.result[1:])
            end = (sum(map(len, parts)) - 1) * self._time.step
            error = Interrupted(f"interrupted after t = {end:g} s of {self._time.duration:g} s")
            error.__cause__ = stop
        return Motion(np.concatenate(parts), error, differences.estimate)

    def _advance(self, parts: list[Array], differences: _Differences, plan: SteppingPlan) -> NumericalError | None:
        """Add the states after the last one and their differences, and say what stopped them."""
        substeps = plan.substeps
        h = self._time.step
        start = 0
        wanted = _CHUNK if math.isinf(plan.tolerance) else max(_LEAST_CHUNK, self.steps * substeps // _LOOKS)
        # 100: instants of a chunk that are compared: positions cost as much as a sub-step
        ends = [parts[0][0]] * (1 + len(plan.ratios))
        looked = 100 * (_LOOKS if math.isinf(plan.tolerance) else 1)
        while start < self.steps:
            now = plan if start else plan.start
            # Chunks end where steps of all lengths do; the first is as short as can be, to find out how fast it begins.
            limit = max(1, min(wanted, _CHUNK) // (substeps * plan.every)) if start else 1
            count = min(limit * now.every, self.steps - start)
            levels = self._levels(ends if differences.finite else ends[:1], start, count, now)
            part = corrected = levels[0]
            if len(part) <= count:
                parts.append(part[1:])
                return self._stopped(now, start + len(part) - 1, part[-1])
            shared = part[:: now.every]
            differences.finite = differences.finite and all(len(level) == len(shared) for level in levels[1:])
            if differences.finite and len(shared) > 1:
                levels[0] = shared
                differences.add(self._distances(levels, start * h, now.every, looked))
                ends = [level[-1] for level in levels]
                # The corrected states are output only: the levels go on uncorrected, each with its own error.
                if plan.corrected:
                    longer = zip(plan.weights, levels[1:], strict=True)
                    missed = sum((k * (level - shared) for k, level in longer), np.zeros_like(shared))
                    corrected = part + _between(missed, now.every, len(part))
            ends[0] = part[-1]
            parts.append(corrected[1:])
            start += count
            self._progress(start / self.steps)
            if differences.estimate > plan.tolerance:
                return None
        return None

    def _levels(self, ends: list[Array], start: int, count: int, plan: SteppingPlan) -> list[Array]:
        """States at every output step by the steps, and at the shared ones by longer ones; the finite ones of them."""
        if plan.method == "reference":
            # 100.0: factor on the tolerances of the variable-step integrator with which its error is measured
            pairs = zip(ends, (1.0, 100.0), strict=False)
            model = self.core.model
            t: Array = (start + np.arange(count + 1, dtype=float)) * self._time.step
            runs = [_integrate_reference(model, x, t, self.signals, looser) for x, looser in pairs]
            self._failure = runs[0][1]
            return [states for states, _ in runs]
        u, w = self._inputs(start * self._time.step, count, plan)
        ratios = (1, *plan.ratios)[: len(ends)]
        h = self._time.step / plan.substeps
        run = self.core.rollouts(plan.method)
        p = np.array(self.core.model.p_nominal, dtype=float)
        states, valid = run.levels(np.array(ends), ratios, plan.every, count, plan.substeps, h, u, w, p)
        self.taken += sum(count * plan.substeps // ratio for ratio in ratios)
        return [x[: last + 1] for x, last in zip(states, valid, strict=True)]

    def _stopped(self, plan: SteppingPlan, index: int, state: Array) -> NumericalError:
        """Error about a motion that is not finite after an output step."""
        time = index * self._time.step
        other = "reference" if self._time.method == "auto" else "auto"
        reason = (
            f"{self._failure} (after t = {time:g} s)"
            if plan.method == "reference"
            else (
                f"{INTEGRATORS[plan.method].failure} after t = {time:g} s (last state {state.tolist()}; {plan.method}, "
                f"{plan.substeps} sub-steps of {self._time.step / plan.substeps:g} s): take a smaller time.step or "
                f"time.method: {other}"
            )
        )
        return NumericalError(reason, time=time, state=state)

    def _inputs(self, start: float, count: int, plan: SteppingPlan) -> tuple[Array, Array]:
        """Return inputs and forces at half sub-steps, or one row if nothing varies."""
        if self.signals.constant:
            return self.signals.u(start)[0], self.signals.w(start)[0]
        t = start + np.arange(2 * count * plan.substeps + 1) * (0.5 * self._time.step / plan.substeps)
        if not self.signals.jumps:
            return self.signals.u(t), self.signals.w(t)
        # The mean of both values where one jumps, at which one step ends and another begins: what each is off cancels,
        # up to the second power of the step.
        sides = np.maximum(t - _BESIDE, _BESIDE), t + _BESIDE
        u, w = (np.mean([signal(side) for side in sides], axis=0) for signal in (self.signals.u, self.signals.w))
        return u, w

    def _distances(self, levels: list[Array], start: float, every: int, looked: int) -> list[float]:
        """Greatest distance of the elements' ends, and of the object's points, per length, from level to level [1]."""
        # Backwards, so that the last instant, where errors are largest, is always among them.
        some = np.arange(len(levels[0]))[:: -max(1, len(levels[0]) // looked)]
        u = self.signals.u(start + some * (self._time.step * every))
        levels = [level[some] for level in levels]
        ends = [self._ends(x, u) for x in levels]
        distances = [np.hypot(*(a - b).transpose(1, 0, 2)).max() for a, b in pairwise(ends)]
        around = None if self.system is None else self.system.surroundings
        if self.system is not None and around is not None and around.object is not None and around.object_moves:
            poses = [level[:, self.system.object_states] for level in levels]
            moved = [greatest_motion(around.object, *pair) for pair in pairwise(poses)]
            distances = [max(pair) for pair in zip(distances, moved, strict=True)]
        return [float(distance) / self._model.finger.rod.length for distance in distances]

    def _ends(self, x: Array, u: Array) -> Array:
        """Ends of the elements (T, 2, N) [m]."""
        acting = self._model.acting_input(x.T, u.T).T
        return np.asarray(self._positions.batch("joints", x[:, : self._model.n], acting, None)[0])


@dataclass
class _Differences:
    """Greatest differences so far between steps of several lengths, per length of the finger [1]."""

    plan: SteppingPlan
    greatest: list[float] = field(default_factory=list)
    finite: bool = True

    def add(self, steps: list[float]) -> None:
        """Note the differences of some more instants."""
        self.greatest = [max(pair) for pair in zip(self.greatest or steps, steps, strict=True)]

    @property
    def estimate(self) -> float:
        """Error; nan without a comparison."""
        if not self.finite:
            return math.inf
        return self.plan.estimate(self.greatest) if self.greatest else math.nan


def _between(rows: Array, every: int, count: int) -> Array:
    """Interpolate rows at every few instants to ``count`` rows, linearly; the last row is held."""
    if every == 1:
        return rows
    at = np.arange(count)
    known = np.arange(len(rows)) * every
    return np.stack([np.interp(at, known, column) for column in rows.T], axis=1)


_NODES = np.linspace(0.0, 1.0, 6)
"""Number of places in a part between two knots that sample the inputs [1]: enough for the quintics between samples."""


def _integrate_reference(
    model: FingerModel | System, x0: Array, t: Array, signals: Signals, looser: float
) -> tuple[Array, str]:
    """Integrate with CVODES (backward differentiation) to states (T, nx) at instants t (T,) [s], the first being x0.

    It restarts at every instant, and at every knot of inputs and loads between, because of possible kinks; ``looser``
    is a factor on its tolerances. If a state is not finite, return the states before it and the reason. Interrupted has
    these states as ``result``.
    """
    integrator = _reference_part(model, looser)
    states = np.empty((len(t), model.nx))
    states[0] = x0
    with interrupts_held(quietly=True) as pressed:
        for k, (begin, end) in enumerate(pairwise(t.tolist())):
            x = states[k]
            reason = "the state is not finite"
            for a, b in pairwise([begin, *signals.knots(begin, end), end]):
                at = a + (b - a) * _NODES
                if signals.jumps:
                    at = np.clip(at, a + _BESIDE, b - _BESIDE)
                rows = np.concatenate([[b - a], signals.u(at).ravel(), signals.w(at).ravel()])
                try:
                    x = np.array(integrator(x0=x, p=rows)["xf"]).ravel()
                except RuntimeError as error:
                    x = x * np.nan
                    reason = f"the reference integrator failed: {str(error).splitlines()[-1]}"
                    break
            states[k + 1] = x
            if pressed():  # CasADi's integrators would report it as a failure of the motion
                raise Interrupted("interrupted", result=states[: k + 1])
            if not np.all(np.isfinite(x)):
                return states[: k + 1], reason
    return states, ""


def _reference_part(model: FingerModel | System, looser: float) -> ca.Function:
    """CVODES over a part without knots, by its length [s] and the inputs and forces at its nodes as parameters."""
    x = ca.MX.sym("x", model.nx)
    part = ca.MX.sym("t")
    count = len(_NODES)
    given = ca.MX.sym("given", 1 + count * (model.nu + model.nw))
    length, *blocks = ca.vertsplit(given, [0, *np.cumsum([1, *[model.nu] * count, *[model.nw] * count]).tolist()])
    # Lagrange polynomials, which are the pieces of samples themselves.
    weights = [math.prod((part - other) / (at - other) for other in _NODES if other != at) for at in _NODES]
    u = sum((k * b for k, b in zip(weights, blocks[:count], strict=True)), ca.MX.zeros(model.nu))
    w = sum((k * b for k, b in zip(weights, blocks[count:], strict=True)), ca.MX.zeros(model.nw))
    rate = length * model.forward_dynamics(x, u, w, ca.DM(model.p_nominal))
    options: Any = {"max_num_steps": 200_000, "newton_scheme": "direct"}
    options |= {"abstol": looser * _ABSOLUTE, "reltol": looser * _RELATIVE}
    problem: Any = {"x": x, "t": part, "p": given, "ode": rate}
    return ca.integrator("reference", "cvodes", problem, 0.0, 1.0, options)
