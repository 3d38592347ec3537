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
    "values": "What is tracked and bounded, or compared with measurements, with its derivatives.",
    "expanded": "Cost with gradient and Hessian; bounded rows with their Jacobian.",
    "parameters": "Parameters with the disturbances.",
    "forces": "Normal forces at the contacts.",
}
"""Descriptions of kernels, by the last word of their names."""


@dataclass(frozen=True)
class Adapter:
    """A straight-line function of ``control/c`` around a kernel.

    ``given`` has the C of the kernel's arguments by name, made of ``arg`` and ``res``, and ``unused`` of as many
    numbers, which holds what the function does not need. ``behind`` is the place of the second result from this number
    on, or null with it; ``x`` has ``states`` numbers: the first ``common`` of the first argument, then zeros.
    """

    function: ca.Function
    kernel: Kernel | None
    given: Mapping[str, str]
    unused: int = 0
    behind: int = 0
    states: int = 0
    common: int = 0

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
    """Adapters of the functions and of those that they call; of stages and filter the slopes are one kernel where they
    agree, and so are the values where most of them is the same.
    """
    straight = {f.name(): f for f in CSource(functions).straight}
    stage = straight.get("stage_slope")
    shared = _slopes(stage, straight.get("estimator_slope"))
    if stage is not None and {"stage_values", "estimator_values"} <= straight.keys():
        shared |= _values(straight["stage_values"], straight["estimator_values"], stage.size1_out(0))
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


def _values(stage: ca.Function, filtered: ca.Function, common: int) -> dict[str, Adapter]:
    """Adapters of what the stages track and of what the filter compares, as of one tip; none if they share little.

    The first ``common`` states belong to both. Stages ask for all but the last two results. The filter, once a
    period, computes the results of the stages, too.
    """
    s = {name: ca.SX.sym(name, stage.size1_in(k)) for k, name in enumerate(stage.name_in())}
    s["nominal"] = ca.SX.sym("nominal", filtered.size1_in(3))
    z = ca.vertcat(s["x"][:common], ca.SX(filtered.size1_in(0) - common, 1))
    of_stage = dict(zip(stage.name_out(), stage.call([s["x"], s["u"], s["p"]]), strict=True))
    of_filter = dict(zip(("seen", "by_z"), filtered.call([z, s["u"], s["p"], s["nominal"]]), strict=True))
    both = straight_function("values", s, of_stage | of_filter)
    sizes = [f.n_instructions() for f in (stage, filtered)]
    if both.n_instructions() > max(sizes) + min(sizes) / 2:
        return {}
    text = "Tracked and bounded quantities, then predicted measurements, with their derivatives."
    kernel = Kernel("values", both, text, called=True)
    asked = {name: f"res[{k}]" for k, name in enumerate(stage.name_out())} | {"seen": "0", "by_z": "0"}
    unused = dict.fromkeys(of_stage, "unused") | {"seen": "res[0]", "by_z": "res[1]"}
    most = max(value.nnz() for value in of_stage.values())
    return {
        stage.name(): Adapter(
            stage, kernel, {"x": "arg[0]", "u": "arg[1]", "p": "arg[2]", "nominal": "arg[2]"} | asked
        ),
        filtered.name(): Adapter(
            filtered,
            kernel,
            {"x": "x", "u": "arg[1]", "p": "arg[2]", "nominal": "arg[3]"} | unused,
            most,
            states=stage.size1_in(0),
            common=common,
        ),
    }
