"""Prediction of paths of points of the finger along one motion as a function of the unknowns.

Motions and their derivatives come from the variational equations of the model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from types import SimpleNamespace
from typing import cast

import casadi as ca
import numpy as np

from continuum_grasp.addons.identification.blocks import Bent, MeasuredBlock, PosesBlock, measured_of
from continuum_grasp.addons.identification.data import Data, Poses, TipPath, column
from continuum_grasp.addons.identification.observation import MeasuredStart, check_tensions, observed
from continuum_grasp.addons.identification.rows import Chained, Dual, RestShapes, runtime_names, set_by, symbols
from continuum_grasp.addons.identification.unknowns import DELAY, LAG, Unknown
from continuum_grasp.base import Array, InputError, NumericalError, split_unit
from continuum_grasp.core import Core, Rollouts
from continuum_grasp.model import FingerModel, Parameters
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import (
    Signals,
    explicit_rate,
)


def block_of(scene: Scene, data: Data, unknowns: Sequence[Unknown]) -> MeasuredBlock:
    """The set of measurements of a kind, predicted by the model of a scene."""
    return (PosesBlock if isinstance(data, Poses) else PathBlock)(scene, data, unknowns)  # type: ignore[arg-type]


def of_one_code(pairs: Sequence[tuple[Scene, Data]], unknowns: Sequence[Unknown]) -> list[Scene]:
    """The scene of each set; of motions, it has numbers in which scenes differ, such as a mass, as run-time arguments.

    Models that differ in nothing else have the same code, which is compiled once. What would change the family or the
    states of a model stays as it is.
    """
    scenes = [scene for scene, _ in pairs]
    moving = [k for k, (_, data) in enumerate(pairs) if isinstance(data, TipPath)]
    values = {k: Parameters.nominal_values(scenes[k].finger, scenes[k].gravity, ()) for k in moving}
    known = dict.fromkeys(name for own in values.values() for name in own)
    first = values[moving[0]] if moving else {}
    differ = [name for name in known if any(own.get(name) != first.get(name) for own in values.values())]
    if not differ:
        moving = []
    for k in moving:
        scene = scenes[k]
        names = dict.fromkeys((*scene.parameters, *(name for name in differ if name in values[k])))
        changed = scene.model_copy(update={"parameters": tuple(names)})
        with suppress(InputError):
            plain = FingerModel(scene, parameters=runtime_names(scene, unknowns))
            model = FingerModel(changed, parameters=runtime_names(changed, unknowns))
            if (model.family, model.x_names) == (plain.family, plain.x_names):
                scenes[k] = changed
    return scenes


MOST_STEPS = 200_000
"""Steps of a path: a search takes dozens of evaluations, each of which takes seconds."""
_INSTANT = 1e-6
"""Half the distance of the instants between which a late command is differentiated by its delay [s]."""
_SHAPES = 6
"""Sampled shapes, the initial one among them, whose stiffest mode limits the steps."""


class PathBlock(MeasuredBlock):
    """Readings along one motion of the finger; ``own`` are the coordinates and rates of a start that is estimated.

    Unknowns are run-time arguments of the model, whose state is x. Inputs are the commands, and behind them their
    derivatives by a delay where that is unknown. Derivatives by some of the unknowns alone take less code.
    """

    def __init__(
        self, scene: Scene, data: TipPath, unknowns: Sequence[Unknown], by: Sequence[int] | None = None
    ) -> None:
        super().__init__(scene, data, unknowns, by)
        self._asked = unknowns, by
        self._take(None)

    def _widened(self, bent: Bent) -> bool:
        """Extend the ranges of the elements to the shapes of a motion; return whether a range has grown."""
        use = np.array(self._range_use(bent.q.T, bent.u.T, bent.p.T)).max(axis=1)
        if not use.max() > 1.0:
            return False
        # 1.5: range per bend: other values of the unknowns bend further; a motion is credible up to twice the range
        wider = self.model.reaching(1.5 * np.minimum(use, 2.0) * self.model.ranges)
        if wider.ranges == self.model.ranges:
            return False
        self._take(wider.ranges)
        return True

    def _take(self, reached: Sequence[float] | None) -> None:
        """Make the functions of a model of the finger, which covers the bends ``reached`` (elements,) [rad]."""
        scene, data, (unknowns, by) = self.scene, cast(TipPath, self.data), self._asked
        readings = data.measured
        self._t = column(f"{data.name}.t", data.t)
        targets = [of.target for of in unknowns]
        if LAG in targets and not scene.finger.winches:
            constant = unknowns[targets.index(LAG)].start
            scene = scene.model_copy(update={"finger": scene.finger.with_lags(constant)})
        self._late = targets.index(DELAY) if DELAY in targets else None
        model = FingerModel(scene, parameters=runtime_names(scene, unknowns))
        self.model = model = model if reached is None else model.reaching(reached)
        self._signals = Signals(scene, model)
        self._initial = scene.initial
        self.kinked = bool(model.friction_names)
        self.free = self._signals.constant
        if self.free and self._late is not None:
            raise InputError("a delay needs commands that vary (actuation or conditions of the set)", key=data.name)
        check_tensions(model, readings, data.name)
        names = [split_unit(label)[0] for label in model.p_names]
        self._passed = list[Array]()
        if data.start == "estimated":
            at = self._t[:1]
            shares, slopes = set_by(unknowns, names)
            p = shares * model.p_nominal + slopes @ np.array([unknown.start for unknown in unknowns])
            acting = np.concatenate([self._signals.u(at)[0], self._signals.w(at)[0], p])
            measured = MeasuredStart(model, readings, self._t, acting, data.name)
            self.own = measured.unknowns(data.start_sigma)
            self._passed = measured.before(data.before) if self.kinked else []
        self._count = len(unknowns)
        self._begins = float(self._t[0]) if self.own else 0.0
        self._shape = None if self.own else _start_rows(scene, unknowns, data.name)
        self._by = list(range(len(unknowns) + len(self.own))) if by is None else list(by)
        self._share, self._turned = set_by([*unknowns, *self.own], names)
        self._start = _start_function(model, self._passed)
        x, u, w, p = symbols(model, "x")

        def drives() -> list[ca.SX]:
            return [model.tensions()(x, u, p)[0], x[2 * model.n : model.nx - len(model.friction_names)]]

        y = observed(model, readings, x[: model.n], model.acting_input(x, u, p), p, drives)
        self._read = self._with_slopes("readings", y, x, u, w, p).map(self._t.size)
        rate = self._with_slopes("variational", model.forward_dynamics(x, u, w, p), x, u, w, p)
        self._run = Rollouts.by("rk4", SimpleNamespace(forward_dynamics=rate))
        self._core = Core(model, compiled=False)
        self._range_use = model.range_use.map(self._t.size)
        # shapes at the start; and parameters, steps per second, and these steps
        self.followed = None if self._shape is None else self._shape.start, None
        self.measured = measured_of(data, self._t, np.full(self._t.size, data.fitted), scene.finger.rod.length)

    def _with_slopes(self, name: str, y: ca.SX, x: ca.SX, u: ca.SX, w: ca.SX, p: ca.SX) -> ca.Function:
        """Outputs [y, Y] of [x, X], commands, w and [p, B]; X and B are the derivatives of x and p by unknowns."""
        moved, turned = (ca.SX.sym(name, size.numel(), len(self._by)) for name, size in (("X", x), ("B", p)))
        commands = u
        by_delay = ca.SX(u.numel(), len(self._by))
        if self._late is not None:
            late = ca.SX.sym("late", u.numel())
            commands = ca.vertcat(u, late)
            if self._late in self._by:
                by_delay[:, self._by.index(self._late)] = late
        slope = ca.jtimes(y, ca.vertcat(x, u, p), ca.vertcat(moved, by_delay, turned)) if self._by else ca.SX()
        outputs = ca.cse([ca.densify(ca.vertcat(y, ca.vec(slope)))])
        inputs = [ca.vertcat(x, ca.vec(moved)), commands, w, ca.vertcat(p, ca.vec(turned))]
        return ca.Function(name, inputs, outputs, ["x", "u", "w", "p"], ["xd"])

    def predict(self, values: Array, until: float = math.inf) -> tuple[Array, Array]:
        states, p, delay = self._moved(values, until)
        if math.isinf(until) and self._widened(self._bent(states, p, delay)):
            return self.predict(values)
        count = len(self._by)
        instants = self._t.size
        inputs = self._commands(self._t, delay), self._signals.w(self._t), np.tile(p, (instants, 1))
        both = np.array(self._read(states.T, *(rows.T for rows in inputs))).reshape(1 + count, -1, instants)
        return both[0].T.ravel(), both[1:].transpose(2, 1, 0).reshape(both[0].size, count)

    def bent(self, values: Array) -> Bent:
        return self._bent(*self._moved(values))

    def _bent(self, states: Array, p: Array, delay: float) -> Bent:
        model = self.model
        t = self._t
        p = p[: self.model.np]
        commands = self._commands(t, delay)[:, : model.nu]
        u = model.acting_input(states[:, : model.nx].T, commands.T, p)
        rows = np.broadcast_to(np.array(u).T, (t.size, model.nu)), np.tile(p, (t.size, 1))
        return Bent(model, states[:, : model.n], *rows)

    def _commands(self, t: Array, delay: float) -> Array:
        """Commands (T, nu) that reach the drive, and behind them their derivatives by an unknown delay."""
        at = self._signals.u(t - delay)
        if self._late is None:
            return at
        after, before = (self._signals.u(t - delay - side * _INSTANT) for side in (1.0, -1.0))
        return np.hstack([at, (after - before) / (2.0 * _INSTANT)])

    def _moved(self, values: Array, until: float = math.inf) -> tuple[Array, Array, float]:
        """States with their derivatives (T, ...) up to an instant, the parameters with theirs, and the delay.

        By the classical Runge-Kutta method. NumericalError if the motion does not stay finite, or is too stiff.
        """
        p = np.asarray(self._share * self.model.p_nominal + self._turned @ values)
        # time before a command reaches the drive [s]
        delay = 0.0 if self._late is None else float(values[self._late])
        start, slope = self._begin(values, delay, p)
        grid = self._settle(start, p)
        acting = np.concatenate([p, self._turned[:, self._by].ravel(order="F")])
        steps = grid.steps_to(until - self._begins)
        constant = self._signals.constant
        whole = np.concatenate([start, slope[:, self._by].ravel(order="F")])[None]
        # a Runge-Kutta step takes inputs and forces at its start, middle and end
        halves: Array = np.linspace(0.0, steps * grid.spacing, 2 * steps * grid.substeps + 1) + self._begins
        at = halves[:1] if constant else halves
        u = self._commands(at, delay)
        w = self._signals.w(at)
        u, w = (values[0] if constant else values for values in (u, w))
        step = grid.spacing / grid.substeps
        states, finished = self._run(whole, steps, grid.substeps, step, u, w, acting)
        if finished[0] < steps:
            time = self._begins + float(finished[0]) * grid.spacing
            raise NumericalError(f"the motion is not finite after t = {time:g} s", time=time)
        return grid.pick(states[0]), acting, delay

    def _begin(self, values: Array, delay: float, p: Array) -> Dual:
        """State where the motion starts: drives have reached their commands, and friction fits the shape."""
        model = self.model
        n = self.model.n
        count = self._count
        x = np.zeros(model.nx)
        slope = np.zeros((model.nx, len(values)))
        history: Array | None = None
        if self.own:
            x[: 2 * n], slope[: 2 * n, count:] = values[count:], np.eye(2 * n)
        elif self._shape is not None:
            last, settled = self.followed
            (resting,) = shapes = self._shape.all(values, last)
            history = resting.history.value
            self.followed = shapes, settled
            x[:n], slope[:n] = resting.q
        elif self._initial.q is not None:
            model.structure.check_initial(self._initial)
            x[:n] = self._initial.q
        if not self.own and self._initial.qd is not None:
            x[n : 2 * n] = self._initial.qd
        row = self._commands(np.array([self._begins]), delay)[0]
        late = np.zeros((model.nu, len(values)))
        if self._late is not None:
            late[:, self._late] = row[model.nu :]
        u = row[: model.nu]
        if history is None:
            how = model.structure.friction_of(self._initial, needed=False)
            # friction is that of the first shape, and goes on from there
            history = model.friction_history((*self._passed, x[:n])[0], u, p, **how)
        friction = model.history_of_states(history)
        x[2 * n :], slope[2 * n :] = self._start(Dual(x[:n], slope[:n]), Dual(u, late), Dual(p, self._turned), friction)
        return Dual(x, slope)

    def _settle(self, start: Array, p: Array) -> _Grid:
        """Steps that are short enough for parameters p; they stay while these change little.

        Other steps have another error, which a search would take for a change of the parameters.
        """
        # 0.1: relative change of parameters from which the steps are chosen anew; smaller ones are within their margin
        shapes, settled = self.followed
        if settled is not None and np.allclose(p, settled[0], rtol=0.1, atol=0.0):
            return cast(_Grid, settled[2])
        signals, model = self._signals, self.model
        sampled = model.sample_shapes(start[: model.n])[:_SHAPES]
        # 2.0: steps per step of a simulation: a sixteenth of its error, so that the steps do not pass for parameters
        rate = 2.0 * explicit_rate(self._core, sampled, signals.u(0.0)[0], signals.w(0.0)[0], p)
        if not np.isfinite(rate):
            raise NumericalError("the model's fastest rate is not finite at these parameters", time=0.0)
        if settled is not None and 0.5 * settled[1] < rate <= settled[1]:
            self.followed = shapes, (p, *settled[1:])
            return cast(_Grid, settled[2])
        grid = _Grid(self._t - self._begins, rate)
        count = grid.steps * grid.substeps
        if count > MOST_STEPS:
            raise NumericalError(
                f"this motion from {self._begins:g} to {self._t[-1]:g} s needs {count:.3g} steps at these parameters; "
                f"the limit is {MOST_STEPS}: use fewer elements, a shorter part of the data, bounds on stiffness and "
                "damping, or instants that count from the start of the motion (zero of t)",
                time=0.0,
            )
        self.followed = shapes, (p, rate, grid)
        return grid


def _start_rows(scene: Scene, unknowns: Sequence[Unknown], name: str) -> RestShapes | None:
    """The shape at time zero, where it is an equilibrium; None where the scene gives its coordinates."""
    pose = scene.initial.pose
    scene = scene.model_copy(update={"loads": (*scene.loads, *scene.initial.held_by)})
    if pose == "rest":
        scene = scene.model_copy(update={"gravity": (0.0, 0.0), "actuation": None, "loads": ()})
    return RestShapes(scene, unknowns, name) if pose in ("equilibrium", "rest") else None


def _start_function(model: FingerModel, passed: Sequence[Array]) -> Chained:
    """(q, u, p, history of states) -> states of drives and friction in a shape at rest.

    Friction remembers the shapes ``passed`` (K, n) that it goes through before that, from the first on.
    """
    q, u, _, p = symbols(model)
    if not model.friction_names:
        return Chained("start", ca.SX(model.drives_at_rest()(q, u, p)), q, u, p, ca.SX(0, 1))
    history = ca.SX.sym("history", model.structure.friction_states + 1)
    memory, count = model.structure.memory, model.structure.tendon_friction_states
    # Between two shapes, a friction state stays or slides.
    slid = [model.sliding()(shape, u, p) for shape in (*map(ca.SX, passed), q)]
    states = ca.SX(memory.clipped(history[:-1] + history[-1] * slid[0]))
    for before, now in pairwise(slid):
        states = ca.SX(memory.clipped(states + now - before))
    directions = ca.vertcat(memory.eased(states[:count]), states[count:], 0.0)
    return Chained("start", ca.vertcat(model.drives_at_rest()(q, u, p, directions), states), q, u, p, history)


class _Grid:
    """Equal steps on which the instants lie, or between which they are interpolated by cubics."""

    def __init__(self, t: Array, rate: float) -> None:
        instants = np.append(0.0, t) if t[0] > 0.0 else t
        gap = float(np.diff(instants).min())
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
            self._t = t

    def steps_to(self, until: float) -> int:
        """Steps to the first instant that is not before ``until``, or to the end."""
        return max(math.ceil(min(until / self.spacing, self.steps)), min(self.steps, 4))

    def pick(self, rows: Array) -> Array:
        """Rows at the instants, the last one behind it."""
        if self._even:
            return np.asarray(rows[self._index.clip(max=len(rows) - 1)])
        from scipy.interpolate import CubicSpline

        at = self.spacing * np.arange(len(rows))
        return np.asarray(CubicSpline(at, rows)(self._t.clip(max=at[-1])))
