"""Parts of the model: ``dynamics``, ``kinematics``, ``statics``, ``step``, and ``linearization``.

A step is one of the classical Runge-Kutta method of order 4, which calls the dynamics.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.export.fields import Field, Struct, fill, outside
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Call, Code, PackagePart, Rows
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.swept import SweptKernel
from continuum_grasp.model import FingerModel, Memory, System, column


def _dynamics_kernel(subject: Subject) -> Kernel:
    """The kernel of the equations of motion."""
    text = "Rate of change xd of the state x; equation of motion."
    if subject.moving.sweeps:
        driven = subject.model.drive_rates if subject.equations.drives_feel_motion else None
        return SweptKernel("dynamics", subject.moving.kernels(), text, driven)
    return Kernel("dynamics", subject.moving.forward_dynamics, text)


def codes_of(result: Array) -> Array:
    """Codes of results that are finite, and of others."""
    return np.where(np.isfinite(result).all(axis=1), Code.OK, Code.ERR_RESULT)


DRAWN = " A state that no step takes is drawn all the same, less accurately, with a warning."


def evaluating(
    subject: Subject,
    kernel: Kernel,
    name: str,
    text: str,
    inputs: tuple[Argument, ...],
    output: Argument,
    *,
    warns: bool,
) -> Call:
    """A public function that one kernel computes, whose outputs lie one behind the other.

    It refuses states out of range or, where it ``warns``, says that they are.
    """
    starts = np.cumsum([0, *kernel.outputs.values()])
    alone = len(kernel.outputs) == 1
    places = {n: "result" if alone else f"result + {k}" for n, k in zip(kernel.outputs, starts, strict=False)}
    numbers = {a.array: f"&{a.array}" for a in inputs if not a.is_struct}
    body = f"  {kernel.call(subject.prefix, **numbers, **places)}\n"

    def reference(rows: Rows) -> tuple[Array, Array]:
        result = np.concatenate(list(kernel.evaluate(subject.real, **rows).values()), axis=1)
        codes = codes_of(result)
        if not warns:
            return result, np.where(subject.refused(rows), Code.ERR_RANGE, codes)
        beyond = subject.out_of_range(rows) | outside(subject.input, rows["u"])
        return result, np.where((codes == Code.OK) & beyond, Code.WARN_LEFT_RANGE, codes)

    if not warns:
        return Call(name, text, inputs, output, body, reference, subject.guard_source)
    big = subject.prefix.upper()
    beyond = f"check(u, input_low, input_high, {big}_NU) < 0 || {subject.left_range('x')}"
    body += f"  if ({beyond}) code = {big}_WARN_LEFT_RANGE;\n"
    return Call(name, text, inputs, output, body, reference, codes=(Code.WARN_LEFT_RANGE,))


def _acted_on(subject: Subject, kernel: Kernel, name: str, text: str, output: Struct) -> Call:
    """A function of state, input and forces, which refuses states out of range."""
    return evaluating(
        subject, kernel, name, text, subject.acting(), Argument(output.name, output, "result"), warns=False
    )


def rate_fields(states: Sequence[Field]) -> tuple[Field, ...]:
    return tuple(
        Field(f.name, f"{f.unit.removesuffix('/s')}/s2" if f.unit.endswith("/s") else f"{f.unit}/s") for f in states
    )


def dynamics(subject: Subject) -> PackagePart:
    """Rate of change of the state."""
    kernel = _dynamics_kernel(subject)
    rate = Struct("rate", "Rate of change of each entry of the state.", rate_fields(subject.state.fields))
    text = "Rate of change of the state: accelerations of the finger under input and forces."
    call = _acted_on(subject, kernel, "dynamics", text, rate)
    return PackagePart("dynamics", (kernel, *subject.kernels), (call,))


def statics(subject: Subject) -> PackagePart:
    """Residual of equilibrium and its tangent stiffness."""
    n = subject.model.n
    unit = subject.model.structure.family.force_unit
    balance = Struct(
        "balance",
        "Balance of the finger at rest: the missing force for equilibrium.",
        (
            Field("residual", unit, "missing generalized force, by coordinate", shape=(n,)),
            Field("stiffness", f"{unit} per unit of the coordinate", "derivative of the residual", shape=(n, n)),
        ),
    )
    u, w, p = (subject.model.statics.sx_in(k) for k in range(1, 4))
    x = ca.SX.sym("x", subject.moving.nx)
    states = ca.vertsplit(x)[subject.model.nx - len(subject.model.friction_names) : subject.model.nx]
    sliding = subject.model.structure.tendon_friction_states
    states = [ca.SX(Memory.direction(z)) for z in states[:sliding]] + states[sliding:]
    history = [ca.vertcat(*states, 0.0)] if states else []
    missing, stiffness = subject.model.statics(x[:n], u, w, p, *history)
    both = ca.vertcat(missing, ca.vec(stiffness.T))  # CasADi is column-major, arrays of C are row-major
    kernel = Kernel.of("statics", {"x": x, "u": u, "w": w, "p": p}, {"balance": both}, "Statics.")
    text = "Balance of the finger at rest in a state, whose rates are not read."
    text += " What touches it is left out." if subject.touching is not None else ""
    call = _acted_on(subject, kernel, "statics", text, balance)
    return PackagePart("statics", (kernel, *subject.kernels), (call,))


def kinematics(subject: Subject) -> PackagePart:
    """Position, angle and derivatives of the tip and of any section."""
    eq = subject.equations
    n = subject.model.n
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
    at_s = ca.vertcat(eq.section_position.column(), eq.section_angle, ca.vec(eq.section_jacobian.T))
    # The tip is the section at the sum of the lengths, which may be run-time parameters.
    at_tip = ca.substitute(at_s, eq.s, ca.SX(sum(eq.lengths)))
    tip_kernel = subject.kernel("tip", "x u p", "Section at the tip.", at=at_tip)
    section_kernel = subject.kernel("section", "x u s p", "Section at a position s.", at=at_s)
    fields = () if subject.parameters is None else subject.parameters.fields
    longest = sum(field.high for field in fields if field.name.startswith("element_lengths"))
    length = max(longest, subject.model.finger.rod.length)  # of the longest finger that the parameters may make
    position = Field("s", "m", "position along the finger", 0.0, length, length)
    acting = subject.acting(forces=False, drawn=True)
    output = Argument("section", section, "result")
    at = (*acting, Argument("s", position, "s"))
    tip_text = f"The tip: position, angle, and derivatives by the bending coordinates.{DRAWN}"
    section_text = f"The section at a position s along the finger, from the base.{DRAWN}"
    calls = (
        evaluating(subject, tip_kernel, "tip", tip_text, acting, output, warns=True),
        evaluating(subject, section_kernel, "section_at", section_text, at, output, warns=True),
    )
    return PackagePart("kinematics", (tip_kernel, section_kernel, *subject.kernels), calls)


def linearization(subject: Subject) -> PackagePart:
    """Derivatives of the rates and of the tip by state, input and forces."""
    check_derivatives(subject.moving, "linearization")
    eq, n = subject.equations, subject.moving
    rate = ca.densify(column(eq.state_rate))
    tip = ca.vertcat(eq.section_position.column(), eq.section_angle)
    tip = ca.substitute(tip, eq.s, ca.SX(sum(eq.lengths)))
    by = {
        "rate_by_state": (rate, eq.x, "of each rate by each state", (n.nx, n.nx)),
        "rate_by_input": (rate, eq.u, "of each rate by each input", (n.nx, n.nu)),
        "rate_by_forces": (rate, eq.w, "of each rate by each force", (n.nx, n.nw)),
        "tip_by_state": (tip, eq.x, "of x, y and angle of the tip by each state", (3, n.nx)),
        "tip_by_input": (tip, eq.u, "of x, y and angle of the tip by each input", (3, n.nu)),
    }
    by = {name: entry for name, entry in by.items() if 0 not in entry[3]}
    struct = Struct(
        "linearization",
        "Derivatives of the equation of motion and of the tip, each in its SI unit per unit of the variable.",
        tuple(Field(name, "SI", text, shape=shape) for name, (_, _, text, shape) in by.items()),
    )
    # CasADi is column-major, arrays of C are row-major.
    flat = ca.vertcat(*(ca.vec(ca.densify(ca.jacobian(of, at)).T) for of, at, _, _ in by.values()))
    kernel = subject.kernel("linearization", "x u w p", "Linearization.", by=flat)
    text = "Derivatives of what dynamics and tip compute, by state, input and forces: xd = A x + B u around a point."
    call = _acted_on(subject, kernel, "linearize", text, struct)
    return PackagePart("linearization", (kernel, *subject.kernels), (call,))


def check_derivatives(model: FingerModel | System, name: str) -> None:
    """Refuse derivatives of a model by its states that are too much code for certain, before they are found."""
    # 0.3: least instructions that the derivative by one state adds, per those of the model: 0.33 to 0.51 of arcs and
    # clothoids, 4 to 15 elements
    Kernel.check_size(name, round(0.3 * model.nx * model.instructions))


def moment_note(subject: Subject) -> str:
    """Note about a tip moment that changes; empty where the model follows it."""
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
            "The input has rates and accelerations: give them for the middle of the step, and zero only where the "
            "moment is constant. The tip does not follow moments that jump."
        )
    return ""


Steps = Callable[[Rows], tuple[Array, Array, Array]]


def stepping(
    subject: Subject,
    name: str,
    text: str,
    longest: float,
    body: str,
    steps: Steps,
    compiled: Steps | None = None,
) -> Call:
    """A public function of steps up to the longest [s].

    ``steps`` gives rows of results, codes of results themselves, and which steps are too long to be accurate;
    ``compiled`` does the same by C.
    """

    def reference(rows: Rows, steps: Steps = steps) -> tuple[Array, Array]:
        result, codes, coarse = steps(rows)
        codes = np.where(subject.refused(rows), Code.ERR_RANGE, codes)
        codes = np.where((codes == Code.OK) & coarse, Code.WARN_COARSE_STEP, codes)
        left = (codes >= 0) & subject.out_of_range({**rows, "x": result})
        return result, np.where(left, Code.WARN_LEFT_RANGE, codes)

    # 1e-6: shortest step, per the longest, so that zero is refused
    length = Field("h", "s", "step", 1e-6 * longest, longest, longest)
    return Call(
        name,
        " ".join([text, moment_note(subject)]).strip(),
        (*subject.acting(), Argument("h", length, "h", Code.ERR_STEP)),
        Argument("next", subject.state, "result"),
        body,
        reference,
        subject.guard_source,
        (Code.WARN_COARSE_STEP, Code.WARN_LEFT_RANGE, Code.ERR_STEP),
        compiled and partial(reference, steps=compiled),
    )


_MANY = 8
"""Sub-steps from which compiling the dynamics takes less time than rows of steps by numpy [1]."""
_STEP = "State after a step of h under constant input and forces, by the Runge-Kutta method of order 4."


def step(subject: Subject) -> PackagePart:
    """Write the step in time."""
    kernel = _dynamics_kernel(subject)
    real = subject.real
    coarse, longest = subject.accurate_step, subject.longest_step

    def runge_kutta(rows: Rows, evaluate: Callable[..., dict[str, Array]]) -> tuple[Array, Array, Array]:
        # The order of operations is that of step.c, for the same bits.
        t = real.dtype
        x = rows["x"]
        part = rows["h"] / t(subject.substeps)
        half = t(0.5) * part
        sixth = part / t(6)
        with np.errstate(all="ignore"):  # rows that overflow are part of the vectors
            for _ in range(subject.substeps):
                point = x
                total = np.zeros_like(x)
                for weight, ahead in ((1, half), (2, half), (2, part), (1, half)):
                    rate = evaluate(**{**rows, "x": point})["xd"]
                    total = total + t(weight) * rate
                    point = x + ahead * rate
                x = x + sixth * total
        return x, codes_of(x), rows["h"][:, 0] > t(coarse)

    numbers = {"half": 0.5, "one": 1.0, "two": 2.0, "six": 6.0}
    numbers |= {"substeps": subject.substeps, "accurate": coarse}
    words: dict[str, object] = {
        "p": subject.prefix,
        "dynamics": kernel.call(subject.prefix, x="point", xd="rate"),
        **{name: real.literal(value) for name, value in numbers.items()},
        "left_range": subject.left_range("result"),
    }
    compiled = cache(partial(kernel.compiled, real))
    call = stepping(
        subject,
        "step",
        _STEP,
        longest,
        fill("step.c", words),
        partial(runge_kutta, evaluate=partial(kernel.evaluate, real)),
        None if subject.substeps < _MANY else lambda rows: runge_kutta(rows, compiled()),
    )
    constants = {
        "SUBSTEPS": str(subject.substeps),
        "LONGEST_STEP": real.literal(longest),
        "ACCURATE_STEP": real.literal(coarse),
    }
    return PackagePart("step", (kernel, *subject.kernels), (call,), constants)
