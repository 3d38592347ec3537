"""Base of the operators of all toolkits: names, shapes, defaults, checks, and how arrays become rows."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from typing import Any, ClassVar, Literal

import numpy as np

from continuum_grasp.addons.learning.operators.derivatives import Operator, Recursion, RowFunction, held_step
from continuum_grasp.base import (
    Array,
    CheckedArgument,
    InputError,
    NumericalError,
    Summarized,
    check_arguments,
    install_line,
)
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel, Remade, System
from continuum_grasp.scene import INTEGRATORS


class Operators(Remade, Summarized, ABC):
    """The functions of a model on arrays of a toolkit; see its subclasses."""

    TOOLKIT: ClassVar[tuple[str, str]]
    """Package of the toolkit, and how it is called."""

    @check_arguments
    def __init__(
        self,
        model: FingerModel | System,
        *,
        nonfinite: Literal["raise", "nan"] = "raise",
        compiled: bool = True,
    ) -> None:
        self._toolkit = toolkit(*self.TOOLKIT)
        self._names = type(model).function_names()
        self.model: Any = model
        self.nonfinite = CheckedArgument("nonfinite", nonfinite).choice(("raise", "nan"))
        self._core = Core(model, compiled=compiled)
        self._points: dict[str, RowFunction] = {}
        self._recursions: dict[str, Recursion] = {}
        self._checks: dict[str, Callable[[Sequence[Array]], None]] = {}

    def headline(self) -> str:
        return self._core.headline()

    def pairs(self) -> dict[str, str]:
        return self._core.pairs()

    # -- what a toolkit gives -------------------------------------------------------------------------------------

    @abstractmethod
    def _arrays(self, given: Mapping[str, Any]) -> tuple[dict[str, Any], Callable[[Array], Any]]:
        """Arrays of one floating-point type from given values, and a function that makes such an array of one of
        numpy.
        """

    @abstractmethod
    def _expand(self, array: Any, shape: tuple[int, ...]) -> Any:
        """An array broadcast to a shape."""

    @abstractmethod
    def _apply(self, operator: Operator, arrays: list[Any]) -> list[Any]:
        """A differentiable call; all arrays have the same number of rows."""

    # -- functions ------------------------------------------------------------------------------------------------

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_"):  # copy and pickle ask for private names before there are any functions
            raise AttributeError(name)
        if name not in self._names:
            raise AttributeError(f"no operator {name!r}: expected one of {', '.join(self._names)}, rollout, step")
        return partial(self._function, name)

    def _function(self, name: str, /, *arguments: Any, **named: Any) -> Any:
        function = getattr(self.model, name)
        inputs = function.name_in()
        if len(arguments) > len(inputs):
            raise InputError(f"{name}: {len(inputs)} inputs expected, got {len(arguments)}")
        by_name = dict(zip(inputs, arguments, strict=False))
        for key, value in named.items():
            if key not in inputs:
                raise InputError(f"{name}: unknown input {key!r}, expected {', '.join(inputs)}")
            if key in by_name:
                raise InputError(f"{name}: {key} is given twice")
            by_name[key] = value
        sizes = {key: function.nnz_in(k) for k, key in enumerate(inputs)}
        arrays, _ = self._complete(by_name, sizes)
        batch = _batch(name, {key: tuple(arrays[key].shape) for key in inputs}, sizes)
        rows = [self._rows(arrays[key], batch, arrays[key].shape[-1:]) for key in inputs]
        results = self._apply(self._point(name), rows)
        return _shaped(function, [value.reshape(*batch, value.shape[-1]) for value in results])

    def _complete(
        self, given: Mapping[str, Any], sizes: Mapping[str, int]
    ) -> tuple[dict[str, Any], Callable[[Array], Any]]:
        """Arrays by name, zero or nominal where none is given, and what makes such an array of one of numpy."""
        arrays, convert = self._arrays({key: value for key, value in given.items() if value is not None})
        for key, size in sizes.items():
            if key not in arrays:
                default = self.model.p_nominal if key == "p" else np.zeros(size)
                arrays[key] = convert(np.array(default, dtype=float))
            elif not arrays[key].shape and size == 1:
                arrays[key] = arrays[key].reshape(1)
        return arrays, convert

    def _point(self, name: str) -> RowFunction:
        if name not in self._points:
            function = getattr(self.model, name)
            self._points[name] = RowFunction(function, self._core, self._core.check_of(name))
        return self._points[name]

    def _rows(self, array: Any, batch: tuple[int, ...], shape: tuple[int, ...]) -> Any:
        """An array with its leading dimensions made one."""
        return self._expand(array, (*batch, *shape)).reshape(math.prod(batch), *shape)

    # -- motion ---------------------------------------------------------------------------------------------------

    def rollout(
        self,
        x0: Any,
        steps: int,
        step: float,
        *,
        u: Any = None,
        w: Any = None,
        p: Any = None,
        substeps: int = 1,
        method: str = "rk4",
    ) -> Any:
        """Integrate from one state or from many; differentiable by state, inputs, forces and parameters.

        Parameters
        ----------
        x0 : (..., nx) array
            Initial states.
        steps : int
            Number of steps to keep.
        step : float
            Time between them [s].
        u, w : array, optional
            Inputs and forces: (size,) for all of the motion, or (..., rows, size) with rows that each hold equally
            long, ``rows`` being a divisor of ``steps``; by default zero.
        p : (..., np) array, optional
            Parameters; by default nominal.
        substeps : int
            Steps of the method per step.
        method : str
            rk4, rodas, implicit_midpoint, extrapolated_euler, sdirk2 or sdirk2_contact, the last two for models of few
            elements.

        Returns
        -------
        array
            (..., steps + 1, nx).

        Raises
        ------
        InputError
            If shapes do not fit, numbers are not finite, or the tip moment varies where the model takes it to be
            constant.
        NumericalError
            If a state is not finite, unless ``nonfinite`` is ``nan``.
        """
        model = self.model
        steps = CheckedArgument("steps", steps).whole()
        step = CheckedArgument("step", step).number()
        substeps = CheckedArgument("substeps", substeps).whole()
        if x0 is None:
            raise InputError("expected an array, got None", key="x0")
        sizes = {"x0": model.nx, "u": model.nu, "w": model.nw, "p": model.np}
        arrays, convert = self._complete({"x0": x0, "u": u, "w": w, "p": p}, sizes)
        for key in ("u", "w"):
            if len(arrays[key].shape) == 1:
                arrays[key] = arrays[key].reshape(1, -1)
            rows = arrays[key].shape[-2] if len(arrays[key].shape) > 1 else 0
            if rows < 1 or steps % rows:
                raise InputError(
                    f"expected (..., rows, {sizes[key]}) with a number of rows in time that divides the {steps} steps, "
                    f"got {tuple(arrays[key].shape)}; a constant input has one row",
                    key=key,
                )
        for key in ("x0", "p"):
            if not arrays[key].shape:
                raise InputError(f"rollout: {key} has {sizes[key]} entries, got an array of shape ()")
        arrays["p"] = arrays["p"].reshape(*arrays["p"].shape[:-1], 1, arrays["p"].shape[-1])
        leading = {key: (*array.shape[: -1 if key == "x0" else -2], *array.shape[-1:]) for key, array in arrays.items()}
        batch = _batch("rollout", leading, sizes)
        rows_of = [self._rows(arrays["x0"], batch, arrays["x0"].shape[-1:])]
        rows_of += [self._rows(arrays[key], batch, arrays[key].shape[-2:]) for key in ("u", "w", "p")]
        rows_of.append(self._rows(convert(np.full((1, 1), step / substeps)), batch, (1, 1)))
        if method not in self._recursions:
            self._recursions[method] = Recursion(held_step(model, method), self._core)
        operator = self._recursions[method].over(steps * substeps, self._check(method))
        states = self._apply(operator, rows_of)[0][:, ::substeps]
        return states.reshape(*batch, steps + 1, model.nx)

    def step(
        self,
        x: Any,
        step: float,
        *,
        u: Any = None,
        w: Any = None,
        p: Any = None,
        substeps: int = 1,
        method: str = "rk4",
    ) -> Any:
        """The state (..., nx) after one step [s], from one state or from many.

        Inputs u, forces w and parameters p (..., size) hold during it; everything else is as in ``rollout``.
        """
        if x is None:
            raise InputError("expected an array, got None", key="x")
        arrays, _ = self._arrays({key: value for key, value in {"x": x, "u": u, "w": w}.items() if value is not None})
        held = {key: arrays[key][..., None, :] if arrays[key].shape else arrays[key] for key in arrays if key != "x"}
        states = self.rollout(arrays["x"], 1, step, **held, p=p, substeps=substeps, method=method)
        return states[..., -1, :]

    def _check(self, method: str) -> Callable[[Sequence[Array]], None]:
        """Check of a rollout's arguments: the same function each time, since an operator is known by it."""
        if method not in self._checks:
            self._checks[method] = partial(_check_rollout, self._core, method, self.nonfinite == "raise")
        return self._checks[method]


def _check_rollout(core: Core, method: str, raises: bool, arrays: Sequence[Array]) -> None:
    """Refuse inputs that vary where they must not, and inputs that are not finite."""
    x0, u, w, p, h, states = arrays
    core.check_moment(u)
    if not raises:
        return
    for name, array in (("x0", x0), ("u", u), ("w", w), ("p", p)):
        CheckedArgument(name, array).array(finite=True)
    good = np.array(np.isfinite(states).all(axis=2))
    rows = np.flatnonzero(~good.all(axis=1))
    if not rows.size:
        return
    first = int(rows[0])
    at = int(good[first].argmin()) - 1
    raise NumericalError(
        f"{INTEGRATORS[method].failure} in {len(rows)} of {len(states)} rollouts, first in {first}, after t = "
        f"{at * h[first, 0, 0]:g} s (last finite state {states[first, at].tolist()}): the step is too large for this "
        "scene, or the finger left the range of the model; try a smaller step, more substeps, another method, or "
        "operators that are made with nonfinite='nan' to get NaN in these rows",
        time=at * float(h[first, 0, 0]),
        state=states[first, at],
        result=states,
    )


def _batch(name: str, shapes: Mapping[str, tuple[int, ...]], sizes: Mapping[str, int]) -> tuple[int, ...]:
    """Leading dimensions that inputs have in common."""
    for key, shape in shapes.items():
        if not shape or shape[-1] != sizes[key]:
            raise InputError(f"{name}: {key} has {sizes[key]} entries, got an array of shape {shape}")
    try:
        return np.broadcast_shapes(*(shape[:-1] for shape in shapes.values()))
    except ValueError:
        listing = ", ".join(f"{key} {shape}" for key, shape in shapes.items())
        raise InputError(f"{name}: leading dimensions do not match: {listing}") from None


def _shaped(function: Any, outputs: list[Any]) -> Any:
    """Outputs in their own shapes; CasADi is column-major."""
    shaped = []
    for k, value in enumerate(outputs):
        if f"{function.name()}.{function.name_out(k)}" in FingerModel.MATRICES:
            height, width = function.size_out(k)
            value = value.reshape(*value.shape[:-1], width, height).swapaxes(-1, -2)
        shaped.append(value)
    return shaped[0] if len(shaped) == 1 else tuple(shaped)


def toolkit(name: str, called: str) -> Any:
    """The package of a toolkit; InputError where it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        text = f"{called} is not installed: {install_line(name)}"
        raise InputError(text) from error


def not_an_array(name: str, value: Any, expected: str) -> InputError:
    """The error about an argument that is no array for a toolkit's operators."""
    return CheckedArgument(name, value).refused(f"expected {expected}")
