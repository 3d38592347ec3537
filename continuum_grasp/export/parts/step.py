"""Part ``step``: the classical Runge-Kutta method of order 4, calling the dynamics."""

from __future__ import annotations

import numpy as np

from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Array, Call, Code, Part, Rows
from continuum_grasp.export.parts.model import codes_of, dynamics_kernel
from continuum_grasp.export.strict_math import c_source
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill

__all__ = ["moment_note", "step"]


def moment_note(subject: Subject) -> str:
    """What a caller must know of a tip moment that changes; empty where the model follows it."""
    structure = subject.model.structure
    if structure.moment_is_constant:
        return (
            "The tip moment must be the same in every step of a motion: this model (matched_clothoid without input "
            "rates) takes it to be constant, and no code says when it is not. Changed from step to step, as by a ramp "
            "of 0.05 N m in 0.2 s on a rod of 0.6 m, it costs 8.9 mm r.m.s. For inputs that vary export family "
            "clothoid, a finger with tendons.time_constant, or a model with input rates."
        )
    if structure.inputs.rates:
        return (
            "The input has rates and accelerations: give those of the middle of the step, and zero only where the "
            "moment is constant. The tip does not follow moments that jump."
        )
    return ""


_STEP = "State after a step of h under constant input and forces, by the Runge-Kutta method of order 4."


def step(subject: Subject) -> Part:
    """The part for a subject."""
    kernel, real = dynamics_kernel(subject), subject.real
    coarse = real.rounded(subject.accurate_step)

    def reference(rows: Rows) -> tuple[Array, Array]:
        h = rows["h"]
        result = runge_kutta(rows)
        codes = codes_of(subject, rows, result)
        coarse_ones = (codes == Code.OK) & (h[:, 0] > real.dtype(coarse))
        codes = np.where(coarse_ones, Code.WARN_COARSE_STEP, codes)
        left = (codes >= 0) & subject.out_of_range({**rows, "x": result})
        return result, np.where(left, Code.WARN_LEFT_RANGE, codes)

    def runge_kutta(rows: Rows) -> Array:
        t = real.dtype
        x, part = rows["x"], rows["h"] / t(subject.substeps)
        half, sixth = t(0.5) * part, part / t(6)
        for _ in range(subject.substeps):
            point, total = x, np.zeros_like(x)
            for weight, ahead in ((1, half), (2, half), (2, part), (1, half)):
                rate = kernel.evaluate(real, **{**rows, "x": point})["xd"]
                with np.errstate(all="ignore"):
                    total = total + t(weight) * rate
                    point = x + ahead * rate
            with np.errstate(all="ignore"):
                x = x + sixth * total
        return x

    words = {
        "p": subject.prefix,
        "P": subject.prefix.upper(),
        "dynamics": kernel.call(subject.prefix, x="point", u="u", w="w", p="p", xd="rate"),
        "zero": real.literal(0.0),
        "one": real.literal(1.0),
        "two": real.literal(2.0),
        "six": real.literal(6.0),
        "half": real.literal(0.5),
        "substeps": real.literal(subject.substeps),
        "accurate": real.literal(coarse),
        "left_range": subject.left_range("result"),
        "forces_declared": f"const {subject.prefix}_forces *forces, " if subject.forces else "",
        "forces_missing": " || !forces" if subject.forces else "",
        "forces_at": "&forces[at], " if subject.forces else "",
    }
    call = Call(
        "step",
        " ".join([_STEP, moment_note(subject)]).strip(),
        (*subject.acting(), subject.step_argument()),
        Argument("next", subject.state, "result"),
        fill("step.c", words),
        reference,
        subject.guard_source,
        (Code.WARN_COARSE_STEP, Code.WARN_LEFT_RANGE, Code.ERR_STEP),
    )
    constants = {
        "SUBSTEPS": f"{subject.substeps}",
        "LONGEST_STEP": real.literal(subject.longest_step),
        "ACCURATE_STEP": real.literal(coarse),
    }
    return Part(
        "step",
        "one step in time",
        (kernel, *subject.kernels),
        (call,),
        constants,
        definitions=_batch(subject, kernel, words),
        declarations=fill("batch.h", words),
    )


def _batch(subject: Subject, kernel: Kernel, words: dict[str, str]) -> str:
    """Many steps at once."""
    fields = {"x": subject.state, "u": subject.input, "w": subject.forces, "p": subject.parameters}
    held = {name: struct.size for name, struct in fields.items() if struct is not None}
    narrow = [name for name in kernel.inputs if name != "p"]
    more = {
        "strict": c_source(kernel.calls, subject.real, subject.prefix),
        "helpers": kernel.lane_helpers(subject.real),
        "kernel": kernel.lane_source(subject.real),
        "arrays": ", ".join(f"{name}[{size}] = {{0}}" for name, size in held.items()),
        "lanes": ", ".join(f"v{name}[{size}]" for name, size in held.items() if name in kernel.inputs or name == "x"),
        "gather": "\n      ".join(
            f"for (i = 0; i < {held[name]}; ++i) v{name}[i][k] = {name}[i];" for name in dict.fromkeys(["x", *narrow])
        ),
        "spread": f"\n    for (i = 0; i < {held['p']}; ++i) vp[i] = same(p[i]);" if "p" in kernel.inputs else "",
        "passed": "".join(f", {name}" for name in ("p", "x", "u", "w") if name in held),
        "again": "\n      read_input(&inputs[first + k], u);" if subject.guard and "u" in subject.guard.inputs else "",
        "call": ", ".join([*("point" if name == "x" else f"v{name}" for name in kernel.inputs), "rate"]),
    }
    return fill("batch.c", {**words, **more})
