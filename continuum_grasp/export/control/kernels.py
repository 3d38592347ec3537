"""Kernels of estimator and controller, and how the C of ``control/c`` calls them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from continuum_grasp.control import SharedSlope
from continuum_grasp.core import CSource, straight_function
from continuum_grasp.export.fields import fill
from continuum_grasp.export.kernel import Kernel

_TEXTS = {
    "slope": "Rate of change with its Jacobian.",
    "first": "From the first slope of a step to the next one, with derivatives.",
    "again": "From a later slope of a step to the next one, with derivatives.",
    "predict": "The first Newton iteration of an implicit slope.",
    "refine": "A Newton iteration of an implicit slope between the first and the last one.",
    "last": "The second Newton iteration of the last slope, and the end of the step, with derivatives.",
    "derivatives": "The end of a step with its derivatives, as the horizon or the filter takes them.",
    "end": "The end of a step.",
    "values": "What is tracked and bounded, with its Jacobian.",
    "expanded": "Cost with gradient and Hessian; bounded rows with their Jacobian.",
    "outputs": "What is compared with measurements, with its derivative.",
    "parameters": "Parameters with the disturbances.",
    "forces": "Normal forces at the contacts.",
}
"""Descriptions of kernels, by the last word of their names."""


@dataclass(frozen=True)
class Adapter:
    """A straight-line function of ``control/c`` around a kernel.

    ``given`` has the C of the kernel's arguments by name, made of ``arg`` and ``res``, and ``unused`` of as many
    numbers, which holds what the function does not need. ``behind`` is the place of the second result from this number
    on, or null with it.
    """

    function: ca.Function
    kernel: Kernel | None
    given: Mapping[str, str]
    unused: int = 0
    behind: int = 0

    def c_source(self, prefix: str) -> str:
        """C with the names of ``control/c``."""
        kernel = self.kernel
        words = {
            "name": self.function.name(),
            "adapter": self,
            "behind": kernel is not None and "behind" in {self.given[name] for name in kernel.outputs},
            "call": "" if kernel is None else kernel.call(prefix, **self.given),
        }
        return fill("control/adapter.c", words)


def adapters_of(functions: Sequence[ca.Function]) -> list[Adapter]:
    """Adapters of the functions and of those that they call; the slopes of stages and filter are one kernel where they
    agree.
    """
    straight = {f.name(): f for f in CSource(functions).straight}
    shared = _slopes(straight.get("stage_slope"), straight.get("estimator_slope"))
    return [shared[name] if name in shared else _own(function) for name, function in straight.items()]


def _own(function: ca.Function) -> Adapter:
    name = function.name()
    expressions = {n: f"arg[{k}]" for k, n in enumerate(function.name_in())}
    expressions |= {n: f"res[{k}]" for k, n in enumerate(function.name_out())}
    # What has no result, parameters where there are none, needs no kernel.
    kernel = Kernel(name, function, _TEXTS[name.rpartition("_")[2]], called=True) if function.nnz_out() else None
    return Adapter(function, kernel, expressions)


def _slopes(stage: ca.Function | None, filtered: ca.Function | None) -> dict[str, Adapter]:
    """Adapters of the slope by state and input, and of that by state and disturbances; none if there is one alone."""
    shared_slope = SharedSlope.of(stage, filtered)
    if shared_slope is None or stage is None or filtered is None:
        return {}
    kernel = Kernel("slope", straight_function("slope", *shared_slope), _TEXTS["slope"], called=True)
    by_x, by_u = (shared_slope.found[name].nnz() for name in ("by_x", "by_u"))
    expressions = {"z": "arg[0]", "u": "arg[1]", "p": "arg[2]", "rate": "res[0]", "by_x": "res[1]"}
    return {
        stage.name(): Adapter(
            stage, kernel, expressions | {"nominal": "arg[2]", "by_u": "behind", "by_d": "0"}, behind=by_x
        ),
        filtered.name(): Adapter(
            filtered,
            kernel,
            expressions | {"nominal": "arg[3]", "by_u": "unused", "by_d": "behind"},
            max(by_u, 1),
            by_x,
        ),
    }
