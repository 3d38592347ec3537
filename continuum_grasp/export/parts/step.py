"""Part ``step``: the classical Runge-Kutta method of order 4, calling the dynamics."""

from __future__ import annotations

import numpy as np

from continuum_grasp.export.codes import Code
from continuum_grasp.export.part import Argument, Array, Call, Part, Rows
from continuum_grasp.export.parts.dynamics import codes_of, dynamics_kernel
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill

__all__ = ["step"]


def step(subject: Subject) -> Part:
    """The part for a subject."""
    kernel, real = dynamics_kernel(subject), subject.real
    coarse = real.rounded(subject.accurate_step)

    def twin(rows: Rows) -> tuple[Array, Array]:
        h = rows["h"]
        result = runge_kutta(rows)
        codes = codes_of(subject, rows, result)
        coarse_ones = (codes == Code.OK) & (h[:, 0] > real.dtype(coarse))
        codes = np.where(coarse_ones, Code.WARN_COARSE_STEP, codes)
        left = (codes >= 0) & subject.out_of_range(result)
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
        "one": real.literal(1.0),
        "two": real.literal(2.0),
        "six": real.literal(6.0),
        "half": real.literal(0.5),
        "substeps": real.literal(subject.substeps),
        "accurate": real.literal(coarse),
    }
    call = Call(
        "step",
        "State after a step of h under constant input and forces, by the Runge-Kutta method of order 4.",
        (*subject.acting(), subject.step_argument()),
        Argument("next", subject.state, "result"),
        subject.guarded(fill("step.c", words)),
        twin,
        (Code.WARN_COARSE_STEP, Code.WARN_LEFT_RANGE, Code.ERR_STEP),
    )
    constants = {
        "SUBSTEPS": f"{subject.substeps}",
        "LONGEST_STEP": real.literal(subject.longest_step),
        "ACCURATE_STEP": real.literal(coarse),
    }
    return Part("step", "one step in time", (kernel, *subject.kernels), (call,), constants)
