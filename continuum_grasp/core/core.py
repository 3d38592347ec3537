"""A model as compiled code: the same functions on numpy arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError, NumericalError, Summarized, check_arguments
from continuum_grasp.core.batches import Batch, Scan
from continuum_grasp.core.caller import Caller, section_check, shaped
from continuum_grasp.core.code import Backend, FunctionCode
from continuum_grasp.core.integrators import step_function
from continuum_grasp.core.rollouts import HalfStepSignal, Rollouts, row
from continuum_grasp.core.source import CSource
from continuum_grasp.model import Model, Remade
from continuum_grasp.scene import INTEGRATORS

_ROUNDING = 1e-12
"""Greatest variation of a constant moment, per greatest input [1]."""


@check_arguments
def compile(model: Model, functions: Sequence[str] | None = None) -> Core:
    """Compile a model for this machine.

    Parameters
    ----------
    model : FingerModel or System
        The model.
    functions : sequence of str, optional
        Functions to compile now; the others are compiled when they are first called. The forward dynamics
        where not given.

    Returns
    -------
    Core
        The model's functions on numpy arrays.

    Raises
    ------
    InputError
        If it is no model, or a function is unknown.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> finger = cg.Finger(rod=cg.Rod(length=0.18, linear_density=0.02, bending_stiffness=0.01))
    >>> core = cg.compile(cg.FingerModel(finger, family="arc", elements=2))
    >>> abs(core.tip([0.0, 0.0]).round(6)).tolist()  # straight, pointing along +y [m]
    [0.0, 0.18]
    """
    core = Core(model)
    if isinstance(functions, str) or not isinstance(functions, Iterable | None):
        raise InputError(f"functions: expected a list of names, got {functions!r:.60}")
    for name in ("forward_dynamics",) if functions is None else functions:
        core.prepare(name)
    return core


class Core(Remade, Summarized):
    """Functions of a model on numpy arrays, compiled if a C compiler is available.

    Every function of the model is a method of the same name, with the model's inputs as positional or keyword
    arguments and arrays as results. Missing arguments are zero, ``p`` is nominal; the ``history`` of a finger with
    friction must be given. Without a C compiler the same calls run on CasADi's virtual machine, with one warning.

    Attributes
    ----------
    model : FingerModel or System
    compiled : bool
        Whether the code is compiled.

    Parameters
    ----------
    model : FingerModel or System
        The model.
    compiled : bool
        False: run on the virtual machine all the same, which is faster for a few calls of a large model.
    """

    @check_arguments
    def __init__(self, model: Model, *, compiled: bool = True) -> None:
        self._names = type(model).function_names()
        self.model: Any = model
        self.backend = Backend(compiled)
        self._callers: dict[str, Caller] = {}
        self._batches: dict[str, Batch] = {}
        self._rollouts: dict[tuple[str, bool], Rollouts] = {}
        self._steps: dict[str, ca.Function] = {}

    def headline(self) -> str:
        """Backend that the core runs on."""
        return "compiled" if self.compiled else "on the virtual machine"

    def pairs(self) -> dict[str, str]:
        """The core's model."""
        return {"model": f"{type(self.model).__name__} {self.model.headline()}", **self.model.pairs()}

    @property
    def compiled(self) -> bool:
        """Whether the code is compiled."""
        return self.backend.compiler is not None

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_"):  # copy and pickle ask for private names before there are any functions
            raise AttributeError(name)
        if not isinstance(name, str) or name not in self._names:
            raise AttributeError(f"a core has no {name!r}; its functions are {', '.join(self._names)}")
        return self._caller(name)

    def prepare(self, name: str) -> Caller:
        """Compile a function and give its caller.

        Raises
        ------
        InputError
            If the model has no such function.
        """
        return self._caller(name).prepare()

    def _caller(self, name: str) -> Caller:
        """Caller of a function that may not be compiled yet."""
        if not isinstance(name, str) or name not in self._names:
            raise InputError(f"unknown function {name!r}: expected one of {', '.join(self._names)}")
        if name not in self._callers:
            function = getattr(self.model, name)
            nominal = np.array(self.model.p_nominal)
            source = partial(CSource([function]).of_core, function.name())
            code = FunctionCode(function, source, self.backend, from_python=True)
            self._callers[name] = Caller(function, code, nominal, self.check_of(name))
        return self._callers[name]

    def check_of(self, name: str) -> Callable[[Sequence[Any]], None] | None:
        """Check that positions ``s`` of a function are on the finger, of the rows of its inputs; None without any."""
        function = getattr(self.model, name)
        return section_check(self.model, function) if "s" in function.name_in() else None

    def check_moment(self, u: Array) -> None:
        """Refuse inputs in time (rollouts, rows, nu) whose tip moment varies where the model has a constant one."""
        structure = self.model.structure
        if not structure.matched or structure.inputs.rates or u.shape[1] < 2:
            return
        values = list(np.moveaxis(u[:, :, : structure.inputs.count], -1, 0))
        for source in structure.sources:
            driven, couples = source.amplitudes(values, len(structure.finger.inputs))
            # A lag determines the rates of its own moment, not the rates of another couple.
            known = 0.0 if source.lags else source.gain * driven
            amplitude = np.broadcast_to(known + couples, values[0].shape)
            largest = max([1.0] * bool(source.couples) + [abs(source.gain * arm) for arm in source.arms])
            if np.ptp(amplitude, axis=1).max() > _ROUNDING * np.abs(u).max() * largest:
                break
        else:
            return
        raise InputError(
            "u: the tip moment varies, and the tip of this matched_clothoid cannot follow it (a model without input "
            "rates assumes a constant moment): use family='clothoid', input_rates=True with rows of values, rates "
            "and accelerations, or tendons.time_constant"
        )

    def batch(self, name: str, *arguments: ArrayLike | None) -> Array | tuple[Array, ...]:
        """A function of many states in one call.

        Parameters
        ----------
        name : str
            Function of the model.
        *arguments : array_like or None
            Per input a row per state, (count, size), or one row for all, (size,); None for zero (nominal ``p``). A
            ``history``, of fingers with friction, must be given.

        Returns
        -------
        ndarray or tuple of ndarray
            Per output (count, size), or (count, rows, columns) for a matrix.

        Raises
        ------
        InputError
            If shapes do not fit.
        """
        caller = self._caller(name)
        function, rows = caller.function, caller.rows(arguments)
        counts = {len(row) for row in rows if row.ndim == 2}
        if len(counts) != 1:
            raise InputError(f"{name}: one number of states expected, got {sorted(counts)}")
        count = counts.pop()
        if name not in self._batches:
            self._batches[name] = self.on_rows(function)
        outputs = self._batches[name](count, rows)
        results = tuple(shaped(function, k, out) for k, out in enumerate(outputs))
        return results[0] if len(results) == 1 else results

    def on_rows(self, function: ca.Function) -> Batch:
        """A function of columns, applied to many rows on the backend of this core."""
        return Batch(function, self.backend)

    def over_steps(self, function: ca.Function) -> Scan:
        """A recursion over steps, of many rows, on the backend of this core."""
        return Scan(function, self.backend)

    def backbones(self, q: Array, u: Array, points: int, p: Array | None = None) -> Array:
        """World positions (T, points, 2) along the backbones of shapes q (T, n), evenly spaced from base to tip [m]."""
        s = np.tile(np.linspace(0.0, self.model.finger.rod.length, points), len(q))[:, None]
        rows = (np.repeat(each, points, axis=0) for each in (q, u))
        return np.asarray(self.batch("position", *rows, s, p)).reshape(len(q), points, 2)

    def step_function(self, method: str) -> ca.Function:
        """The CasADi function of one step of a method; see ``core.integrators`` for its inputs.

        Raises
        ------
        InputError
            If the method is unknown.
        """
        known = [name for name, integrator in INTEGRATORS.items() if integrator.simulates]
        if method not in known:
            raise InputError(f"unknown method {method!r}: expected one of {', '.join(known)}")
        if method not in self._steps:
            self._steps[method] = step_function(self.model, method)
        return self._steps[method]

    def rollout(
        self,
        x0: ArrayLike,
        steps: int,
        step: float,
        *,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        p: ArrayLike | None = None,
        substeps: int = 1,
        method: str = "rk4",
    ) -> Array:
        """Integrate from one state or from many, in one call per rollout.

        Parameters
        ----------
        x0 : (nx,) or (count, nx) array_like
            Initial state or states.
        steps : int
            Number of steps to keep.
        step : float
            Time between them [s].
        u, w : array_like, optional
            Inputs and forces: one row (constant), or ``2 * steps * substeps + 1`` rows at half sub-steps; zero where
            not given. With many states also (count, size), a constant row for each, or (count, rows, size), which
            alone is taken where count equals the number of rows.
        p : (np,) array_like, optional
            Parameters; by default nominal.
        substeps : int
            Steps of the method per step.
        method : str
            Name of an integrator of simulations, as in ``time.method``.

        Returns
        -------
        ndarray
            (steps + 1, nx), or (count, steps + 1, nx).

        Raises
        ------
        InputError
            If shapes do not fit, numbers of steps are not whole, something given is not finite, or the tip moment
            varies where the model takes it to be constant (``input_rates`` of ``FingerModel``).
        NumericalError
            If a state is not finite; ``result`` holds the states before it.
        """
        model, start = self.model, CheckedArgument("x0", x0).array(finite=True)
        single = start.ndim == 1
        if start.ndim not in (1, 2) or start.shape[-1] != model.nx or not len(start):
            raise InputError(f"x0: expected ({model.nx},) or (count, {model.nx}), got shape {start.shape}")
        start = np.atleast_2d(start)
        steps, step = CheckedArgument("steps", steps).whole(), CheckedArgument("step", step).number()
        substeps = CheckedArgument("substeps", substeps).whole()
        rows = 2 * steps * substeps + 1
        inputs = HalfStepSignal.of("u", u, model.nu, rows, None if single else len(start))
        self.check_moment(inputs.rows)
        forces = HalfStepSignal.of("w", w, model.nw, rows, None if single else len(start))
        parameters = row("p", model.p_nominal if p is None else p, model.np)
        run = self.rollouts(method, single)
        states, valid = run(start, steps, substeps, step / substeps, inputs, forces, parameters)
        if np.any(valid < steps):
            first = int(np.argmin(valid))
            reached, broken = states[first, : valid[first] + 1], np.count_nonzero(valid < steps)
            which = "" if single else f" in {broken} of {len(start)} rollouts, first in {first},"
            raise NumericalError(
                f"{INTEGRATORS[method].failure}{which} after t = {valid[first] * step:g} s (last finite state "
                f"{reached[-1].tolist()}): the step is too large for this scene, or the finger left the range of the "
                "model; try a smaller step, more substeps or method='rodas'",
                time=valid[first] * step,
                state=reached[-1],
                result=reached if single else states,
            )
        return states[0] if single else states

    def rollouts(self, method: str = "rk4", single: bool = True) -> Rollouts:
        """Caller of the rollouts of a method, from one state or from many."""
        step = self.step_function(method)
        if (method, single) not in self._rollouts:
            self._rollouts[method, single] = Rollouts(step, self.backend, single)
        return self._rollouts[method, single]

    def prepare_rollout(self, method: str = "rk4", single: bool = True, steps: float = math.inf) -> Rollouts:
        """Compile the rollouts of a method, if the number of steps pays for it, and return their caller."""
        rollouts = self.rollouts(method, single)
        rollouts.code.expect(steps)
        return rollouts
