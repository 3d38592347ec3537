"""Part of the model: ``implicit_step``, of stiff fingers, stiff cables and long steps.

It shares the kernels of the controllers' ``sdirk2``: two diagonally implicit stages, L-stable, of order 2, each by two
Newton iterations, so that a step takes the same time always.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.core import Sdirk2Stages, straight_function
from continuum_grasp.export.fields import fill
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Code, PackagePart, Rows
from continuum_grasp.export.parts.model import check_derivatives, codes_of, stepping
from continuum_grasp.export.subject import Subject
from continuum_grasp.model import column

LONGEST = 5e-3
"""Longest sub-step [s]; docs/drives.md has the errors of steps of 1 to 5 ms."""
_STEP = (
    "State after a step of h under constant input and forces, by two diagonally implicit stages (L-stable, of order "
    "2): for stiff fingers and cables."
)
SETTLED = 1e-3
"""Last correction of Newton's method, per range of a bending coordinate, above which a step is reported as coarse."""
_UNSOLVED = 1e-1
"""Last correction above which a step is refused: its equations are not solved."""


def implicit_step(subject: Subject) -> PackagePart:
    """Write the implicit step in time."""
    real, prefix = subject.real, subject.prefix
    check_derivatives(subject.moving, "implicit_step")
    slope, guess, first, last, size = kernels = _kernels(subject)
    substeps = subject.count or 1
    longest = real.rounded(substeps * LONGEST)

    def steps(rows: Rows) -> tuple[Array, Array, Array]:
        # The order of operations is that of implicit_step.c, for the same bits.
        part = rows["h"] / real.dtype(substeps)
        x = rows["x"]
        moved = np.zeros_like(part)
        for _ in range(substeps):
            base = x
            before = dict[str, Array]()
            for stage in (first, last):
                inputs = {"h": part, **slope.evaluate(real, **{**rows, "x": base})}
                ahead = guess.evaluate(real, start=base, **inputs)
                inputs = {"h": part, **slope.evaluate(real, **{**rows, "x": ahead["at"]})}
                results = stage.evaluate(real, start=x, k=ahead["k"], **inputs, **before)
                base = results["next"]
                before = {"before": results["rates"]} if stage is first else {}
            off = size.evaluate(real, x=base, at=ahead["at"])["off"]
            with np.errstate(invalid="ignore"):
                x = base
                moved = np.where(off > moved, off, moved)
        codes = np.where(moved[:, 0] > real.dtype(_UNSOLVED), Code.ERR_STEP, codes_of(x))
        return x, codes, moved[:, 0] > real.dtype(SETTLED)

    words = {
        "p": prefix,
        "nonzeros": slope.outputs["jacobian"],
        "substeps": real.literal(substeps),
        "settled": real.literal(SETTLED),
        "unsolved": real.literal(_UNSOLVED),
        "slope_base": slope.call(prefix, x="base"),
        "guess": guess.call(prefix, h="&part", start="base", at="ahead"),
        "slope_ahead": slope.call(prefix, x="ahead"),
        "first": first.call(prefix, h="&part", start="result", next="base", rates="before"),
        "last": last.call(prefix, h="&part", start="result", next="base"),
        "size": size.call(prefix, x="base", at="ahead", off="&off"),
        "left_range": subject.left_range("result"),
    }
    call = stepping(subject, "implicit_step", _STEP, longest, fill("implicit_step.c", words), steps)
    constants = {"IMPLICIT_SUBSTEPS": str(substeps), "LONGEST_IMPLICIT_STEP": real.literal(longest)}
    return PackagePart("implicit_step", (*kernels, *subject.kernels), (call,), constants)


def _kernels(subject: Subject) -> tuple[Kernel, Kernel, Kernel, Kernel, Kernel]:
    """Slope with its Jacobian; first guess of a stage; both stages; and the size of the last one's correction."""
    eq, moving = subject.equations, subject.moving
    rate = ca.densify(column(eq.state_rate))
    symbols = {"x": eq.x, "u": eq.u, "w": eq.w, "p": eq.p}
    slope = straight_function("slope", symbols, {"rate": rate, "jacobian": ca.jacobian(rate, eq.x)})
    stages = Sdirk2Stages(slope)
    x = ca.SX.sym("x", moving.nx)
    at = ca.SX.sym("at", moving.nx)
    off: ca.SX = ca.SX(0.0)
    for j, field in enumerate(subject.state.fields[: moving.n]):
        off = ca.fmax(off, ca.fabs((1.0 / field.high) * (x[j] - at[j])))

    def kernel(name: str, function: ca.Function, text: str) -> Kernel:
        return Kernel(f"implicit_{name}", function, text, called=True)

    def second(name: str) -> Kernel:
        function = stages.correct(name, is_first=name == "first", with_derivatives=False)
        return kernel(name, _whole(function), f"Second Newton iteration of the {name} stage.")

    return (
        kernel("slope", slope, "Rate of change of the state, and its derivative by the state."),
        kernel("guess", _whole(stages.predict("guess")), "First Newton iteration of a stage."),
        second("first"),
        second("last"),
        kernel(
            "size",
            straight_function("size", {"x": x, "at": at}, {"off": off}),
            "Last correction of a step, per range of the bending coordinates.",
        ),
    )


def _whole(function: ca.Function) -> ca.Function:
    """Function of a whole step, with the ends of both stages under one name."""
    symbols = {name: function.sx_in(k) for k, name in enumerate(function.name_in())}
    results = function.call({**symbols, "share": ca.SX(1.0)})
    named = {"next" if name == "end" else name: results[name] for name in function.name_out()}
    return straight_function(function.name(), {k: v for k, v in symbols.items() if k != "share"}, named)
