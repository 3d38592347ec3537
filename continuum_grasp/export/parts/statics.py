"""Part ``statics``: what is missing for equilibrium, and the tangent stiffness."""

from __future__ import annotations

import casadi as ca

from continuum_grasp.export.fields import Field, Struct
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Array, Call, Part, Rows
from continuum_grasp.export.parts.dynamics import codes_of
from continuum_grasp.export.subject import Subject

__all__ = ["statics"]


def statics(subject: Subject) -> Part:
    """The part for a subject."""
    n, unit = subject.n, "N m" if subject.model.family == "arc" else "N m2"
    balance = Struct(
        "balance",
        "Balance of the finger at rest: what is missing for equilibrium.",
        (
            Field("residual", unit, "generalised force that is missing, by coordinate", shape=(n,)),
            Field("stiffness", f"{unit} per unit of the coordinate", "derivative of the residual", shape=(n, n)),
        ),
    )
    u, w, p = (subject.model.statics.sx_in(k) for k in range(1, 4))
    x = ca.SX.sym("x", subject.nx)
    missing, stiffness = subject.model.statics(x[:n], u, w, p)
    both = ca.vertcat(missing, ca.vec(stiffness.T))
    kernel = Kernel(
        "statics", ca.Function("statics", [x, u, w, p], [both], ["x", "u", "w", "p"], ["balance"]), "Statics."
    )

    def reference(rows: Rows) -> tuple[Array, Array]:
        result = kernel.evaluate(subject.real, **rows)["balance"]
        return result, codes_of(subject, rows, result)

    call = Call(
        "statics",
        "Balance of the finger at rest in a state, whose rates are not read.",
        subject.acting(),
        Argument("balance", balance, "result"),
        f"  {kernel.call(subject.prefix, x='x', u='u', w='w', p='p', balance='result')}\n",
        reference,
        subject.guard_source,
    )
    return Part("statics", "equilibrium residual and tangent stiffness", (kernel, *subject.kernels), (call,))
