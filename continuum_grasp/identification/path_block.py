"""Prediction of paths of points of the finger along one motion as a function of the unknowns.

Motions and their derivatives come from the variational equations of the model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from types import SimpleNamespace
from typing import cast

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.core import Core
from continuum_grasp.core.integrators import step_function
from continuum_grasp.core.rollouts import Rollouts, signal
from continuum_grasp.errors import InputError, NumericalError
from continuum_grasp.identification.blocks import Bent, Block, PosesBlock, entries_of
from continuum_grasp.identification.data import Data, Poses, TipPath, column
from continuum_grasp.identification.driven import Driven, MeasuredStart
from continuum_grasp.identification.observation import check_tensions
from continuum_grasp.identification.rows import Shapes, runtime_names
from continuum_grasp.identification.unknowns import DELAY, Unknown
from continuum_grasp.model import FingerModel
from continuum_grasp.model.parameters import nominal_values
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.spectrum import TARGET_RADIUS, sample_shapes, spectral_radius
from continuum_grasp.simulation.trajectory import acting_input


def block_of(scene: Scene, data: Data, unknowns: Sequence[Unknown]) -> Block:
    """The set of measurements of a kind, predicted by the model of a scene."""
    return (PosesBlock if isinstance(data, Poses) else PathBlock)(scene, data, unknowns)  # type: ignore[arg-type]


def of_one_code(pairs: Sequence[tuple[Scene, Data]], unknowns: Sequence[Unknown]) -> list[Scene]:
    """The scene of each set; of motions, it has numbers in which scenes differ, such as a mass, as run-time arguments.

    Models that differ in nothing else have the same code, which is compiled once. What would change the family or the
    states of a model stays as it is.
    """
    scenes = [scene for scene, _ in pairs]
    moving = [k for k, (_, data) in enumerate(pairs) if isinstance(data, TipPath)]
    values = {k: nominal_values(scenes[k].finger, scenes[k].gravity, ()) for k in moving}
    known = dict.fromkeys(name for own in values.values() for name in own)
    differ = [name for name in known if any(own.get(name) != values[moving[0]].get(name) for own in values.values())]
    for k in moving if differ else ():
        scene = scenes[k]
        names = dict.fromkeys((*scene.parameters, *(name for name in differ if name in values[k])))
        changed = scene.model_copy(update={"parameters": tuple(names)})
        with suppress(InputError):
            plain, model = (FingerModel(of, parameters=runtime_names(of, unknowns)) for of in (scene, changed))
            if (model.family, model.x_names) == (plain.family, plain.x_names):
                scenes[k] = changed
    return scenes


_MOST_STEPS = 200_000
"""Steps of a path: seconds per evaluation, of which a search takes dozens."""
_SHAPES = 6
"""Sampled shapes, the initial one among them, whose stiffest mode limits the steps."""


class PathBlock(Block):
    """Readings along one motion of the finger; ``own`` are the coordinates and rates of a start that is estimated."""

    moves = ordered = True

    def __init__(
        self, scene: Scene, data: TipPath, unknowns: Sequence[Unknown], by: Sequence[int] | None = None
    ) -> None:
        super().__init__(scene, data, unknowns, by)
        readings = data.measured
        self._t = t = column(f"{data.name}.t", data.t)
        driven = Driven(scene, unknowns, readings, by=by)
        check_tensions(driven.model, readings, data.name)
        self._count, self._shape, self._initial, self._begins = len(unknowns), None, scene.initial, float(t[0])
        if data.start == "estimated":
            p = driven.parameters(np.array([unknown.start for unknown in unknowns]))
            acting = np.concatenate([driven.signals.u(t[:1])[0], driven.signals.w(t[:1])[0], p])
            measured = MeasuredStart(driven.model, readings, t, acting, data.name)
            self.own = measured.unknowns(data.start_sigma)
            passed = measured.before(data.before) if driven.model.friction_names else []
            driven = Driven(scene, [*unknowns, *self.own], readings, passed, by)
        else:
            self._begins, self._shape = 0.0, _start_rows(driven.scene, unknowns, data.name)
        if driven.signals.constant and any(unknown.target == DELAY for unknown in unknowns):
            raise InputError("a delay needs commands that vary: actuation, or conditions, of the set", key=data.name)
        self._driven, self._model = driven, driven.model
        self.kinked, self.free = bool(driven.model.friction_names), driven.signals.constant
        self._core = Core(driven.model, compiled=False)
        self._run = Rollouts.of(step_function(SimpleNamespace(forward_dynamics=driven.variational), "rk4"))
        # shapes at the start; and parameters, steps per second, and these steps
        self.followed = None if self._shape is None else self._shape.start, None
        self._read = driven.readings.map(t.size)
        self.entries = entries_of(data, t, np.full(t.size, data.fitted), scene.finger.rod.length)

    def predict(self, values: Array, until: float = math.inf) -> tuple[Array, Array]:
        states, p, delay = self._moved(values, until)
        count = len(self._driven.by)
        size = self._driven.readings.size1_out(0) // (1 + count)
        inputs = self._driven.commands(self._t, delay), self._driven.signals.w(self._t), np.tile(p, (self._t.size, 1))
        both = np.array(self._read(states.T, *(rows.T for rows in inputs)))
        slopes = both[size:].reshape(count, size, self._t.size)
        return both[:size].T.ravel(), slopes.transpose(2, 1, 0).reshape(size * self._t.size, count)

    def bent(self, values: Array) -> Bent:
        states, p, delay = self._moved(values)
        model, t, p = self._model, self._t, p[: self._model.np]
        commands = self._driven.commands(t, delay)[:, : model.nu]
        u = acting_input(model, states[:, : self._driven.size].T, commands.T, p)
        rows = np.broadcast_to(np.array(u).T, (t.size, model.nu)), np.tile(p, (t.size, 1))
        return Bent(model, t, states[:, : model.n], *rows, True)

    def _moved(self, values: Array, until: float = math.inf) -> tuple[Array, Array, float]:
        """States with their derivatives (T, ...) up to an instant, the parameters with theirs, and the delay.

        By the classical Runge-Kutta method. NumericalError if the motion does not stay finite, or is too stiff.
        """
        driven = self._driven
        p, delay = driven.parameters(values), driven.delay(values)
        start, slope = self._begin(values, delay, p)
        grid, acting = self._settle(start, p), np.concatenate([p, driven.turned[:, driven.by].ravel(order="F")])
        steps = grid.steps_to(until - self._begins)
        whole = np.concatenate([start, slope[:, driven.by].ravel(order="F")])[None]
        # a Runge-Kutta step takes inputs and forces at its start, middle and end
        halves: Array = np.linspace(0.0, steps * grid.spacing, 2 * steps * grid.substeps + 1) + self._begins
        at = halves[:1] if driven.signals.constant else halves
        u, w = driven.commands(at, delay), driven.signals.w(at)
        u, w = (values[0] if driven.signals.constant else values for values in (u, w))
        inputs = signal("u", u, u.shape[-1], len(halves), None), signal("w", w, w.shape[-1], len(halves), None)
        states, finished = self._run(whole, steps, grid.substeps, grid.spacing / grid.substeps, *inputs, acting)
        if finished[0] < steps:
            time = self._begins + float(finished[0]) * grid.spacing
            raise NumericalError(f"the motion is not finite after t = {time:g} s", time=time)
        return grid.pick(states[0]), acting, delay

    def _begin(self, values: Array, delay: float, p: Array) -> tuple[Array, Array]:
        """State where the motion starts, and its derivative by all values."""
        model, n, count = self._model, self._model.n, self._count
        x, slope = np.zeros(self._driven.size), np.zeros((self._driven.size, len(values)))
        if self.own:
            x[: 2 * n], slope[: 2 * n, count:] = values[count:], np.eye(2 * n)
        elif self._shape is not None:
            last, settled = self.followed
            (resting,) = shapes = self._shape.all(values, last)
            self.followed = shapes, settled
            x[:n], slope[:n] = resting.q, resting.by_q
        elif self._initial.q is not None:
            model.structure.check_initial(self._initial)
            x[:n] = self._initial.q
        if not self.own and self._initial.qd is not None:
            x[n : 2 * n] = self._initial.qd
        x[2 * n :], slope[2 * n :] = self._driven.begin(self._begins, delay, x[:n], slope[:n], p)
        return x, slope

    def _settle(self, start: Array, p: Array) -> _Grid:
        """Steps that are short enough for parameters p; they stay while these change little.

        Other steps have another error, which a search would take for a change of the parameters.
        """
        # 0.1: relative change of parameters from which the steps are chosen anew; smaller ones are within their margin
        shapes, settled = self.followed
        if settled is not None and np.allclose(p, settled[0], rtol=0.1, atol=0.0):
            return cast(_Grid, settled[2])
        signals, model = self._driven.signals, self._model
        sampled = sample_shapes(model, start[: model.n])[:_SHAPES]
        radius = spectral_radius(self._core, sampled, signals.u(0.0)[0], signals.w(0.0)[0], p)
        # 2.0: steps per step of a simulation: a sixteenth of its error, so that the steps do not pass for parameters
        rate = 2.0 * radius / TARGET_RADIUS
        if not np.isfinite(rate):
            raise NumericalError("the model has no usable numbers at these parameters", time=0.0)
        if settled is not None and 0.5 * settled[1] < rate <= settled[1]:
            self.followed = shapes, (p, *settled[1:])
            return cast(_Grid, settled[2])
        grid = _Grid(self._t - self._begins, rate)
        count = grid.steps * grid.substeps
        if count > _MOST_STEPS:
            raise NumericalError(
                f"{count:.3g} steps are needed to follow this motion from {self._begins:g} to {self._t[-1]:g} s at "
                f"these parameters; at most {_MOST_STEPS} are taken: use fewer elements, a shorter part of the data, "
                "bounds on stiffness and damping, or instants that count from the start of the motion (zero of t)",
                time=0.0,
            )
        self.followed = shapes, (p, rate, grid)
        return grid


def _start_rows(scene: Scene, unknowns: Sequence[Unknown], name: str) -> Shapes | None:
    """The shape at time zero, where it is an equilibrium; None where the scene gives its coordinates."""
    pose = scene.initial.pose
    scene = scene.model_copy(update={"loads": (*scene.loads, *scene.initial.held_by)})
    if pose == "rest":
        scene = scene.model_copy(update={"gravity": (0.0, 0.0), "actuation": None, "loads": ()})
    return Shapes(scene, unknowns, name) if pose in ("equilibrium", "rest") else None


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
