"""Parts of what is seen: ``shape``, ``velocities`` and ``contact``, whose kernels pages take too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

import casadi as ca

from continuum_grasp.export.fields import Field, Struct
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, PackagePart
from continuum_grasp.export.parts.model import DRAWN, evaluating
from continuum_grasp.export.subject import Subject
from continuum_grasp.model import System

Symbols = Mapping[str, ca.SX]

# Each kernel is of the state, input and parameters of a system, which are expressions of the symbols that are given.


_SECTIONS = {
    "shape": (
        "sections",
        "Sections of the finger in the world, evenly spaced from base to tip.",
        "Positions and angles of sections.",
        (("x", "m", "base first, tip last"), ("y", "m", ""), ("angle", "rad", "its tangent is (-sin, cos) of it")),
    ),
    "velocities": (
        "section_velocities",
        "Velocities of the sections of a shape, in the world.",
        "Velocities and turning rates of sections.",
        (("x", "m/s", "base first, tip last"), ("y", "m/s", ""), ("spin", "rad/s", "rate of the angle")),
    ),
}
"""By part: struct, which is a function of ``System`` too, its text, that of the kernel, and fields."""


def sections_kernel(
    name: str, system: System, at: Sequence[float], given: Symbols, x: ca.SX, u: ca.SX, p: ca.SX
) -> Kernel:
    """Positions and angles of sections at places along the finger [m], or their velocities and turning rates."""
    kind, _, text, fields = _SECTIONS[name]
    across, turn = getattr(system, kind)(at)(x, u, p)
    axes = "v" * (name == "velocities")
    outputs = {f"section_{axes}x": across[0, :].T, f"section_{axes}y": across[1, :].T, f"section_{fields[2][0]}": turn}
    return Kernel.of(name, given, outputs, text)


def contact_kernel(
    system: System, given: Symbols, x: ca.SX, u: ca.SX, w: ca.SX, p: ca.SX, slip: bool = False
) -> Kernel:
    """Gaps and forces of all contacts, as of ``System.touch``, vectors by their components; on demand slip speeds."""
    outputs = by_component(dict(zip(system.touch.name_out(), system.touch(x, u, w, p), strict=True)))
    outputs |= {"slip": system.slip(x, u, w, p)} if slip else {}
    return Kernel.of("contact", given, outputs, "Gaps and forces of all contacts.")


def by_component(touch: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Outputs of ``System.touch``, those that are vectors by their components, in the order of ``TOUCH``."""
    components: dict[str, ca.SX] = {}
    for name, value in touch.items():
        components |= {f"{name}_x": value[0, :].T, f"{name}_y": value[1, :].T} if name in _VECTORS else {name: value}
    return components


_VECTORS = ("force", "point", "normal")
"""Outputs of ``System.touch`` that are world vectors (2, K)."""


def sections(name: str, subject: Subject) -> PackagePart:
    """Write many sections in one call, without derivatives, or their velocities."""
    kind, text, _, entries = _SECTIONS[name]
    symbols = {letter: ca.SX.sym(letter, getattr(subject.system, f"n{letter}")) for letter in "xup"}
    kernel = sections_kernel(name, subject.system, subject.stations, symbols, *symbols.values())
    struct = Struct(kind, text, tuple(Field(f, unit, said, shape=(subject.sections,)) for f, unit, said in entries))
    inputs, output = subject.acting(forces=False, drawn=True), Argument(struct.name, struct, "result")
    call = evaluating(subject, kernel, name, text + DRAWN, inputs, output, warns=True)
    constants = {"SECTIONS": f"{subject.sections} /* from base to tip, of a shape and of velocities */"}
    return PackagePart(name, (kernel, *subject.kernels), (call,), constants)


def contact(subject: Subject) -> PackagePart:
    """Write gaps and forces of all contacts."""
    system = cast(System, subject.touching)  # without it packages do not have this part
    names = ", ".join(system.touch_names)
    of = {name: ca.SX.sym(name, getattr(system, f"n{name}")) for name in "xuwp"}
    kernel = contact_kernel(system, of, of["x"], of["u"], of["w"], of["p"])
    count = (len(system.touch_names),)
    struct = Struct(
        "contacts",
        f"Contacts with the object, in this order: {names}. Normals are the object's, outward; zero on a table.",
        tuple(Field(name, unit, text, shape=count) for name, unit, text in TOUCH),
    )
    text = (
        "Gaps, forces and places of all contacts, by the contact law of the scene with its friction. It warns where "
        "the state is beyond what a step takes."
    )
    inputs, output = subject.acting(forces="w" in kernel.inputs), Argument("contacts", struct, "result")
    call = evaluating(subject, kernel, "touch", text, inputs, output, warns=True)
    return PackagePart("contact", (kernel, *subject.kernels), (call,), {"CONTACTS": f"{count[0]} /* {names} */"})


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
