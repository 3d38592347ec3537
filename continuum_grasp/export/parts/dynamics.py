"""Part ``dynamics``: the state's rate of change."""

from __future__ import annotations

import numpy as np

from continuum_grasp.export.codes import Code
from continuum_grasp.export.descriptions import rate_unit
from continuum_grasp.export.fields import Field, Struct
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Array, Call, Part, Rows
from continuum_grasp.export.subject import Subject

__all__ = ["codes_of", "dynamics", "dynamics_kernel"]


def dynamics_kernel(subject: Subject) -> Kernel:
    """The kernel of the equations of motion."""
    return Kernel("dynamics", subject.model.forward_dynamics, "Rate of change xd of the state x; equation of motion.")


def codes_of(subject: Subject, rows: Rows, result: Array) -> Array:
    """Codes of a function of the state without warnings of its own."""
    codes = np.where(np.isfinite(result).all(axis=1), Code.OK, Code.ERR_RESULT)
    return np.asarray(np.where(subject.refused(rows), Code.ERR_RANGE, codes))


def dynamics(subject: Subject) -> Part:
    """The part for a subject."""
    kernel = dynamics_kernel(subject)
    rates = tuple(Field(f.name, rate_unit(f.unit)) for f in subject.state.fields)
    rate = Struct("rate", "Rate of change of each entry of the state.", rates)

    def reference(rows: Rows) -> tuple[Array, Array]:
        result = kernel.evaluate(subject.real, **rows)["xd"]
        return result, codes_of(subject, rows, result)

    body = f"  {kernel.call(subject.prefix, x='x', u='u', w='w', p='p', xd='result')}\n"
    call = Call(
        "dynamics",
        "Rate of change of the state: accelerations of the finger under input and forces.",
        subject.acting(),
        Argument("rate", rate, "result"),
        body,
        reference,
        subject.guard_source,
    )
    return Part("dynamics", "rate of change of the state", (kernel, *subject.kernels), (call,))
