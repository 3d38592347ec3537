"""Part ``dynamics``: the state's rate of change."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from continuum_grasp.export.fields import Field, Struct, outside
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Array, Call, Code, Part, Rows
from continuum_grasp.export.ranges import rate_unit
from continuum_grasp.export.subject import Subject

__all__ = ["codes_of", "dynamics", "dynamics_kernel", "kinematics", "statics"]


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


def statics(subject: Subject) -> Part:
    """The part for a subject."""
    n, unit = subject.n, subject.model.structure.family.force_unit
    balance = Struct(
        "balance",
        "Balance of the finger at rest: what is missing for equilibrium.",
        (
            Field("residual", unit, "generalized force that is missing, by coordinate", shape=(n,)),
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


def kinematics(subject: Subject) -> Part:
    """The part for a subject."""
    eq, n = subject.equations, subject.n
    section = Struct(
        "section",
        "A section of the finger in the world.",
        (
            Field("x", "m"),
            Field("y", "m"),
            Field("angle", "rad", "its tangent is (-sin, cos) of it"),
            Field("dx", "m per unit of the coordinate", "derivative of x by each coordinate", shape=(n,)),
            Field("dy", "m per unit of the coordinate", "derivative of y by each coordinate", shape=(n,)),
        ),
    )
    arms = ca.horzcat(*[arm.column() for arm in eq.section_jacobian])
    at_s = ca.vertcat(eq.section_position.column(), eq.section_angle, ca.vec(arms.T))
    at_tip = ca.substitute(at_s, eq.s, ca.SX(sum(eq.lengths)))
    tip_kernel = Kernel("tip", subject.function("tip", "x u p", at=at_tip), "Section at the tip.")
    section_kernel = Kernel("section", subject.function("section", "x u s p", at=at_s), "Section at a position s.")
    acting, output = subject.acting(forces=False, drawn=True), Argument("section", section, "result")
    prefix, codes = subject.prefix, (Code.WARN_LEFT_RANGE,)
    beyond = f"check(u, input_low, input_high, {prefix.upper()}_NU) < 0 || {subject.left_range('x')}"
    warning = f"  if ({beyond}) code = {prefix.upper()}_WARN_LEFT_RANGE;\n"
    drawn = " A state that no step takes is drawn all the same, less accurately, with a warning."
    calls = (
        Call(
            "tip",
            f"The tip: position, angle, and derivatives by the bending coordinates.{drawn}",
            acting,
            output,
            f"  {tip_kernel.call(prefix, x='x', u='u', p='p', at='result')}\n{warning}",
            _reference(subject, tip_kernel),
            codes=codes,
        ),
        Call(
            "section_at",
            f"The section at a position s along the finger, from the base.{drawn}",
            (*acting, Argument("s", _position(subject), "s")),
            output,
            f"  {section_kernel.call(prefix, x='x', u='u', s='&s', p='p', at='result')}\n{warning}",
            _reference(subject, section_kernel),
            codes=codes,
        ),
    )
    kernels = (tip_kernel, section_kernel, *subject.kernels)
    return Part("kinematics", "position, angle and Jacobian of any section", kernels, calls)


def _position(subject: Subject) -> Field:
    fields = () if subject.parameters is None else subject.parameters.fields
    longest = sum(field.high for field in fields if field.name.startswith("element_lengths"))
    length = max(longest, subject.model.finger.rod.length)
    return Field("s", "m", "position along the finger", 0.0, length, length)


def _reference(subject: Subject, kernel: Kernel) -> Callable[[Rows], tuple[Array, Array]]:
    def reference(rows: Rows) -> tuple[Array, Array]:
        result = kernel.evaluate(subject.real, **rows)["at"]
        codes = np.where(np.isfinite(result).all(axis=1), Code.OK, Code.ERR_RESULT)
        beyond = subject.out_of_range(rows) | outside(subject.input, rows["u"])
        return result, np.where((codes == Code.OK) & beyond, Code.WARN_LEFT_RANGE, codes)

    return reference
