"""Part ``kinematics``: position and angle of a section, and their derivatives by the coordinates."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from continuum_grasp.export.codes import Code
from continuum_grasp.export.fields import Field, Struct, outside
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Array, Call, Part, Rows
from continuum_grasp.export.subject import Subject

__all__ = ["kinematics"]


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
            _twin(subject, tip_kernel),
            codes=codes,
        ),
        Call(
            "section_at",
            f"The section at a position s along the finger, from the base.{drawn}",
            (*acting, Argument("s", _position(subject), "s")),
            output,
            f"  {section_kernel.call(prefix, x='x', u='u', s='&s', p='p', at='result')}\n{warning}",
            _twin(subject, section_kernel),
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


def _twin(subject: Subject, kernel: Kernel) -> Callable[[Rows], tuple[Array, Array]]:
    def reference(rows: Rows) -> tuple[Array, Array]:
        result = kernel.evaluate(subject.real, **rows)["at"]
        codes = np.where(np.isfinite(result).all(axis=1), Code.OK, Code.ERR_RESULT)
        beyond = subject.out_of_range(rows) | outside(subject.input, rows["u"])
        return result, np.where((codes == Code.OK) & beyond, Code.WARN_LEFT_RANGE, codes)

    return reference
