"""Parts of what is seen of a finger: ``shape``, ``velocities`` and ``contact``; pages take the same kernels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from continuum_grasp.core.calls import straight_function
from continuum_grasp.errors import InputError
from continuum_grasp.export.control.loop import identifiers, unit_of
from continuum_grasp.export.fields import Field, Struct
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Array, Call, Code, Part, Rows
from continuum_grasp.export.parts.model import DRAWN, drawing, range_warning, rate_fields, refusing
from continuum_grasp.export.subject import Subject
from continuum_grasp.model import System

Symbols = Mapping[str, ca.SX]

# Each kernel is of the state, input and parameters of a system, which are expressions of the symbols that are given.


def shape_kernel(system: System, at: Sequence[float], given: Symbols, x: ca.SX, u: ca.SX, p: ca.SX) -> Kernel:
    """Positions and angles of sections at places along the finger [m]."""
    r, angle = system.sections(at)(x, u, p)
    found = {"section_x": r[0, :].T, "section_y": r[1, :].T, "section_angle": angle}
    return _kernel("shape", given, found, "Positions and angles of sections.")


def velocity_kernel(system: System, at: Sequence[float], given: Symbols, x: ca.SX, u: ca.SX, p: ca.SX) -> Kernel:
    """Their velocities and turning rates."""
    v, spin = system.section_velocities(at)(x, u, p)
    found = {"section_vx": v[0, :].T, "section_vy": v[1, :].T, "section_spin": spin}
    return _kernel("velocities", given, found, "Velocities and turning rates of sections.")


def contact_kernel(system: System, given: Symbols, x: ca.SX, u: ca.SX, w: ca.SX, p: ca.SX) -> Kernel:
    """Gaps and forces of all contacts, as of ``System.touch``; vectors by their components."""
    found = by_component(dict(zip(system.touch.name_out(), system.touch(x, u, w, p), strict=True)))
    return _kernel("contact", given, found, "Gaps and forces of all contacts.")


def by_component(touch: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Outputs of ``System.touch``, those that are vectors by their components, in the order of ``TOUCH``."""
    found: dict[str, ca.SX] = {}
    for name, value in touch.items():
        found |= {f"{name}_x": value[0, :].T, f"{name}_y": value[1, :].T} if name in _VECTORS else {name: value}
    return found


_VECTORS = ("force", "point", "normal")
"""Outputs of ``System.touch`` that are world vectors (2, K)."""


def _kernel(name: str, given: Symbols, found: Symbols, text: str) -> Kernel:
    return Kernel(name, straight_function(name, dict(given), {n: ca.densify(v) for n, v in found.items()}), text)


def _filled(kernel: Kernel, prefix: str) -> str:
    """C that fills ``result`` with the outputs, one behind the other."""
    starts = np.cumsum([0, *kernel.outputs.values()])
    places = {name: f"result + {start}" for name, start in zip(kernel.outputs, starts, strict=False)}
    return f"  {kernel.call(prefix, **{name: name for name in kernel.inputs}, **places)}\n"


def shape(subject: Subject) -> Part:
    """Write many sections in one call, without derivatives."""
    fields = {"x": ("m", "base first, tip last"), "y": ("m", ""), "angle": ("rad", "its tangent is (-sin, cos) of it")}
    text = "Sections of the finger in the world, evenly spaced from base to tip."
    return _of_sections(subject, "shape", "sections", text, fields, shape_kernel(subject.system, *_finger(subject)))


def velocities(subject: Subject) -> Part:
    """Write their velocities."""
    fields = {"x": ("m/s", "base first, tip last"), "y": ("m/s", ""), "spin": ("rad/s", "rate of the angle")}
    text = "Velocities of the sections of a shape, in the world."
    return _of_sections(
        subject, "velocities", "section_velocities", text, fields, velocity_kernel(subject.system, *_finger(subject))
    )


def _finger(subject: Subject) -> tuple[list[float], dict[str, ca.SX], ca.SX, ca.SX, ca.SX]:
    """Where sections are, symbols of the finger, and what the system has of them: what it touches moves no section."""
    model, system = subject.model, subject.system
    given = {"x": ca.SX.sym("x", model.nx), "u": ca.SX.sym("u", model.nu), "p": ca.SX.sym("p", model.np)}
    x = ca.vertcat(given["x"], ca.SX.zeros(system.nx - model.nx))
    return subject.stations, given, x, given["u"], ca.vertcat(given["p"], ca.SX.zeros(system.np - model.np))


def _of_sections(
    subject: Subject, name: str, kind: str, text: str, fields: Mapping[str, tuple[str, str]], kernel: Kernel
) -> Part:
    count = (subject.sections,)
    struct = Struct(kind, text, tuple(Field(f, unit, said, shape=count) for f, (unit, said) in fields.items()))

    def value(rows: Rows) -> Array:
        return np.concatenate(list(kernel.evaluate(subject.real, **rows).values()), axis=1)

    call = Call(
        name,
        text + DRAWN,
        subject.acting(forces=False, drawn=True),
        Argument(struct.name, struct, "result"),
        _filled(kernel, subject.prefix) + range_warning(subject),
        drawing(subject, value),
        codes=(Code.WARN_LEFT_RANGE,),
    )
    constants = {"SECTIONS": f"{subject.sections} /* from base to tip, of a shape and of velocities */"}
    return Part(name, (kernel, *subject.kernels), (call,), constants)


def contact(subject: Subject) -> Part:
    """Write gaps and forces of all contacts, and the motion of finger and object under them."""
    model, system = subject.model, subject.system
    if not system.touch_names:
        raise InputError("contact needs an object and its contact_law in the scene: leave the part out", key="what")
    states, forces = _object_fields(system, subject), _force_fields(system, model.nw)
    names = ", ".join(system.touch_names)
    taken = [
        Argument(
            "object", Struct("object", "What is touched: where it is, how it moves, how contacts slide.", states), "o"
        )
    ]
    if forces:
        text = "What else acts on the object, and where the table is."
        taken.append(Argument("object_forces", Struct("object_forces", text, forces), "v"))
    given = {"x": model.nx, "u": model.nu, "w": model.nw, "p": model.np, "o": len(states), "v": len(forces)}
    of = {name: ca.SX.sym(name, size) for name, size in given.items()}
    own = system.nx - model.nx
    x, w = ca.vertcat(of["x"], of["o"][:own]), ca.vertcat(of["w"], of["v"])
    p = ca.vertcat(of["p"], of["o"][own:])
    kernel = contact_kernel(system, of, x, of["u"], w, p)
    count = (len(system.touch_names),)
    struct = Struct(
        "contacts",
        f"Contacts with the object, in this order: {names}. Normals are the object's, outward; zero on a table.",
        tuple(Field(name, unit, text, shape=count) for name, unit, text in TOUCH),
    )
    calls = [
        Call(
            "touch",
            "Gaps, forces and places of all contacts, by the contact law of the scene with its friction.",
            (*subject.acting(forces="w" in kernel.inputs and bool(model.nw)), *taken),
            Argument("contacts", struct, "result"),
            _filled(kernel, subject.prefix),
            refusing(subject, kernel),
            subject.guard_source,
        )
    ]
    kernels = [kernel]
    if not model.sweeps:
        rates = (*rate_fields(subject.state.fields), *rate_fields(states[:own]))
        rate = ca.densify(system.forward_dynamics(x, of["u"], w, p))
        function = straight_function("touching_dynamics", of, {"xd": rate})
        kernels.append(
            Kernel("touching_dynamics", function, "Rate of change of finger and object; equation of motion.")
        )
        struct = Struct("touching_rate", "Rate of change of each entry of the state, then of the object.", rates)
        calls.append(
            Call(
                "touching_dynamics",
                "Rate of change of the state and of the object, which press on each other. It is stiff: implicit "
                "steps, or short ones.",
                (*subject.acting(), *taken),
                Argument("rate", struct, "result"),
                _filled(kernels[-1], subject.prefix),
                refusing(subject, kernels[-1]),
                subject.guard_source,
            )
        )
    constants = {"CONTACTS": f"{count[0]} /* {names} */"}
    return Part("contact", (*kernels, *subject.kernels), tuple(calls), constants)


TOUCH = (
    ("gap", "m", "below zero where surfaces are pressed"),
    ("normal_force", "N", ""),
    ("friction", "N", "on what touches the object, along the normal turned by +90 degrees"),
    ("lift", "N", "on the object, out of the plane"),
    ("force_x", "N", "on the object"),
    ("force_y", "N", "on the object"),
    ("point_x", "m", "where it acts"),
    ("point_y", "m", "where it acts"),
    ("normal_x", "1", ""),
    ("normal_y", "1", ""),
)
"""Fields of a contact: name, unit, what it is; those of ``contact_kernel`` in their order."""
_USUAL = {"rad": math.pi, "m/s": 0.1, "rad/s": 1.0, "1": 1.5, "N": 1.0, "N m": 0.01}
"""Sizes of usual values by unit."""
_HEIGHT = 1e-3
"""The same of heights over the table [m]."""


def _object_fields(system: System, subject: Subject) -> tuple[Field, ...]:
    """Entries of the state behind those of the finger, and the position of an object that does not move."""
    labels = [*system.x_names[subject.model.nx :], *system.p_names[subject.model.np :]]
    return _fields(labels, subject.model.finger.rod.length)


def _force_fields(system: System, first: int) -> tuple[Field, ...]:
    return _fields(system.w_names[first:], _HEIGHT)


def _fields(labels: Sequence[str], reach: float) -> tuple[Field, ...]:
    """Entries around usual sizes; lengths are usually up to ``reach`` [m]."""
    found = []
    for name, label in zip(identifiers(labels), labels, strict=True):
        unit = unit_of(label)
        usual = _HEIGHT if name == "object_z" else _USUAL.get(unit, reach)
        found.append(Field(name, unit, "").around(usual))
    return tuple(found)
