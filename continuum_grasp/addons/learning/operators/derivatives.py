"""Functions and recursions of many rows with their derivatives, which are functions and recursions again.

Tangents are carried forward and cotangents back by functions that CasADi derives from the instructions of the model;
no Jacobian is stored. Since each derivative is an operator itself, derivatives of any order follow.

What a toolkit needs of an operator, beside calling it on arrays of doubles with the rows first:

    residuals   inputs and outputs at which its derivatives are taken
    push        the operator and arrays that carry tangents of the inputs to tangents of the outputs
    pull        the same of cotangents, from outputs to inputs, and which entries of its outputs these are
    split       residuals and tangents, of the arrays of ``push``
    shapes      shapes of the outputs, from the shapes of the inputs
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import casadi as ca

from continuum_grasp.base import Array, CheckedArgument, InputError
from continuum_grasp.core import Core, differentiated_step, step_function, straight_function
from continuum_grasp.scene import INTEGRATORS

Arrays = list[Any]
"""Arrays of a toolkit, rows first."""
Check = Callable[[Sequence[Array]], None]
Pick = Callable[[Arrays], Arrays]


class RowFunction:
    """A function of columns, on rows (count, size)."""

    def __init__(
        self, function: ca.Function, core: Core, check: Check | None = None, origin: Operator | None = None
    ) -> None:
        self.name = function.name()
        self.function = function
        self.origin = origin
        self._core = core
        self._check = check
        self._batch = core.on_rows(function)

    def __call__(self, arrays: Sequence[Array]) -> list[Array]:
        """Outputs of inputs."""
        if self._check is not None:
            self._check(arrays)
        return self._batch(len(arrays[0]), arrays)

    def shapes(self, shapes: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
        """Shapes of the outputs."""
        return [(shapes[0][0], self.function.nnz_out(k)) for k in range(self.function.n_out())]

    def residuals(self, inputs: Arrays, outputs: Arrays) -> Arrays:
        """The inputs."""
        return inputs

    def push(self, residuals: Arrays, tangents: Arrays) -> tuple[Operator, Arrays]:
        """Tangents forward."""
        return self.forward, [*residuals, *tangents]

    def pull(self, residuals: Arrays, cotangents: Arrays) -> tuple[Operator, Arrays, Pick]:
        """Cotangents back."""
        return self.reverse, [*residuals, *cotangents], list

    def split(self, arrays: Arrays) -> tuple[Arrays, Arrays]:
        """Residuals and tangents."""
        count = self.function.n_in()
        return arrays[:count], arrays[count:]

    @cached_property
    def forward(self) -> RowFunction:
        """(inputs, tangents) -> tangents of the outputs."""
        symbols, tangents, results = derivative(self.function, forward=True)
        return RowFunction(_function(f"{self.name}_jvp", [*symbols, *tangents], results), self._core, origin=self)

    @cached_property
    def reverse(self) -> RowFunction:
        """(inputs, cotangents) -> cotangents of the inputs."""
        symbols, cotangents, results = derivative(self.function, forward=False)
        return RowFunction(_function(f"{self.name}_vjp", [*symbols, *cotangents], results), self._core)


class Recursion:
    """The function of a step, (carry, *signals) -> (next carry, *results), with its derivatives.

    ``like`` is, per result, the number of the signal that has as many rows in time. ``back``: from the last step on.
    """

    def __init__(self, function: ca.Function, core: Core, like: Sequence[int] = (), back: bool = False) -> None:
        self.function = function
        self.like = tuple(like)
        self.back = back
        self._core = core
        self._operators: dict[tuple[int, Check | None], Rollout] = {}
        self.scan = core.over_steps(function)

    def over(self, steps: int, check: Check | None = None, origin: Operator | None = None) -> Rollout:
        """The operator of a number of steps: each time the same one, by which toolkits find what they compiled."""
        key = steps, check
        if key not in self._operators:
            self._operators[key] = Rollout(self, steps, check, origin)
        return self._operators[key]

    @cached_property
    def forward(self) -> Recursion:
        """(tangent of the carry, carry, *signals, *their tangents) -> tangents."""
        symbols, tangents, results = derivative(self.function, forward=True)
        made = _function(f"{self.function.name()}_jvp", [tangents[0], *symbols, *tangents[1:]], results)
        return Recursion(made, self._core, [k + 1 for k in self.like], self.back)

    @cached_property
    def reverse(self) -> Recursion:
        """(cotangent of the next carry, carry, *signals, own cotangent of the carry, cotangents of the results).

        Results are the cotangents of the signals; it goes in the other direction.
        """
        symbols, cotangents, (carry, *results) = derivative(self.function, forward=False)
        carry_cotangent = type(carry).sym("own", carry.shape[0])
        inputs = [cotangents[0], *symbols, carry_cotangent, *cotangents[1:]]
        made = _function(f"{self.function.name()}_vjp", inputs, [carry + carry_cotangent, *results])
        return Recursion(made, self._core, [k + 1 for k in range(len(symbols) - 1)], not self.back)


class Rollout:
    """A recursion over a number of steps: of a carry (count, size) and signals (count, rows, size)."""

    def __init__(self, recursion: Recursion, steps: int, check: Check | None, origin: Operator | None) -> None:
        self.name = recursion.function.name()
        self.recursion = recursion
        self.steps = steps
        self.origin = origin
        self._check = check

    def __call__(self, arrays: Sequence[Array]) -> list[Array]:
        """The carry's trajectory (count, steps + 1, size), then results (count, rows, size)."""
        rows = [arrays[1 + k].shape[1] for k in self.recursion.like]
        outputs = self.recursion.scan(self.steps, arrays, rows, self.recursion.back)
        if self._check is not None:
            self._check([*arrays, outputs[0]])
        return outputs

    def shapes(self, shapes: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
        f = self.recursion.function
        count = shapes[0][0]
        times = [self.steps + 1, *(shapes[1 + k][1] for k in self.recursion.like)]
        return [(count, time, f.nnz_out(k)) for k, time in enumerate(times)]

    def _parts(self, trajectory: Any) -> tuple[Any, Any]:
        """States of a trajectory before each step, and after the last, in the direction of the recursion."""
        return (trajectory[:, 1:], trajectory[:, 0]) if self.recursion.back else (trajectory[:, :-1], trajectory[:, -1])

    def residuals(self, inputs: Arrays, outputs: Arrays) -> Arrays:
        """The carry before each step, and the signals."""
        return [self._parts(outputs[0])[0], *inputs[1:]]

    def push(self, residuals: Arrays, tangents: Arrays) -> tuple[Operator, Arrays]:
        operator = self.recursion.forward.over(self.steps, origin=self)
        return operator, [tangents[0], *residuals, *tangents[1:]]

    def pull(self, residuals: Arrays, cotangents: Arrays) -> tuple[Operator, Arrays, Pick]:
        per_step, last = self._parts(cotangents[0])
        operator = self.recursion.reverse.over(self.steps)
        first = -1 if self.recursion.back else 0
        arrays = [last, *residuals, per_step, *cotangents[1:]]
        return operator, arrays, lambda pulled: [pulled[0][:, first], *pulled[1:]]

    def split(self, arrays: Arrays) -> tuple[Arrays, Arrays]:
        """Residuals and tangents."""
        count = self.recursion.function.n_in()
        return arrays[1 : 1 + count], [arrays[0], *arrays[1 + count :]]


Operator = RowFunction | Rollout
"""A differentiable function of arrays; ``origin`` names the operator whose push it is."""


def derivative(function: ca.Function, *, forward: bool) -> tuple[list[Any], list[Any], list[Any]]:
    """Symbols of the inputs and of tangents (cotangents), and the expressions of those that result, as columns."""
    straight = function.is_a("SXFunction")
    kind: Any = ca.SX if straight else ca.MX
    ins = [(function.name_in(k), function.size_in(k)) for k in range(function.n_in())]
    outs = [(function.name_out(k), function.size_out(k)) for k in range(function.n_out())]
    symbols: list[Any] = [kind.sym(name, *size) for name, size in ins]
    # Straight-line derivatives compute anew what they need of the outputs. Inlined, calls stay those of such functions.
    values = [kind(*size) for _, size in outs] if straight else function.call(symbols, True)
    seeds = [kind.sym(f"d_{name}", size[0] * size[1]) for name, size in (ins if forward else outs)]
    shaped = [ca.reshape(seed, *size) for seed, (_, size) in zip(seeds, ins if forward else outs, strict=True)]
    derived = function.forward(1) if forward else function.reverse(1)
    results = derived.call([*symbols, *values, *shaped], True)
    return symbols, seeds, [ca.vec(ca.densify(value)) for value in results]


def _function(name: str, symbols: list[Any], results: list[Any]) -> ca.Function:
    straight = all(isinstance(value, ca.SX) for value in results)
    return ca.Function(name, symbols, ca.cse(results) if straight else results)


METHODS = tuple(name for name, each in INTEGRATORS.items() if each.simulates or each.differentiates)
"""Methods by which operators integrate."""


def held_step(model: Any, method: str) -> ca.Function:
    """``(x, u, w, p, h) -> xn``: one step h [s] of a method during which inputs and forces hold.

    Of methods that are written as calls of straight-line functions their derivatives are, too, so that the dynamics and
    its derivatives are compiled once instead of once per stage, in lanes.
    """
    CheckedArgument("method", method).choice(METHODS)
    dynamics = model.forward_dynamics
    sizes = {"x": model.nx, "u": model.nu, "w": model.nw, "p": model.np}
    symbols = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    x, u, w, p = symbols.values()
    h = ca.MX.sym("h")
    if INTEGRATORS[method].differentiates and dynamics.is_a("SXFunction"):
        inputs = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        rate = dynamics(*inputs.values())
        # The explicit method needs no Jacobian.
        by = ca.SX(model.nx, model.nx) if method == "rk4" else ca.jacobian(rate, inputs["x"])
        slope = straight_function("slope", inputs, {"rate": rate, "jacobian": by})
        (end,) = differentiated_step(method, "held", slope, x, (u, w, p), h, instants=0)
    elif INTEGRATORS[method].simulates:
        end = step_function(model, method)(x, u, u, u, w, w, w, p, h)
    else:
        raise InputError(
            f"{method} unrolls the elimination of its equations, which takes too long with this many elements: use "
            "rk4, rodas or extrapolated_euler",
            key="method",
        )
    return ca.Function(f"{method}_held", [*symbols.values(), h], [end], [*sizes, "h"], ["xn"])
