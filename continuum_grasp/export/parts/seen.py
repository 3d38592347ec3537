"""Parts to look at the finger: ``shape``, ``velocities`` and ``contact``, whose kernels pages take too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import casadi as ca

from continuum_grasp.export.fields import Field, Struct, identifiers
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, PackagePart
from continuum_grasp.export.parts.model import DRAWN, evaluating
from continuum_grasp.export.subject import Subject
from continuum_grasp.model import System

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
"""By part: struct, which is a function of ``System`` too, its text, the kernel's text, and fields."""


@dataclass(frozen=True)
class SeenKernels:
    """Kernels to look at a system, whose state, input, forces and parameters are expressions of symbols."""

    system: System
    symbols: Mapping[str, ca.SX]
    """Arguments of the kernels by their names."""
    x: ca.SX
    u: ca.SX
    w: ca.SX
    p: ca.SX

    def sections(self, name: str, at: Sequence[float]) -> Kernel:
        """Positions and angles (``shape``) of sections at places along the finger [m], or their ``velocities``."""
        kind, _, text, fields = _SECTIONS[name]
        across, turn = getattr(self.system, kind)(at)(self.x, self.u, self.p)
        axes = "v" * (name == "velocities")
        outputs = {f"section_{axes}x": across[0, :].T, f"section_{axes}y": across[1, :].T}
        outputs[f"section_{fields[2][0]}"] = turn
        return Kernel.of(name, self.symbols, outputs, text)

    def contacts(self, *, slip: bool = False) -> Kernel:
        """Gaps and forces of all contacts, see `ContactFields`, with their slip speeds where ``slip`` is set."""
        acting = self.x, self.u, self.w, self.p
        touch = self.system.touch
        outputs = ContactFields.components(dict(zip(touch.name_out(), touch(*acting), strict=True)))
        if slip:
            outputs["slip"] = self.system.slip(*acting)
        return Kernel.of("contact", self.symbols, outputs, "Gaps and forces of all contacts.")


@dataclass(frozen=True)
class ContactFields:
    """Numbers of contacts, which have names like ``disc.tip``."""

    names: Sequence[str]

    def by_name(self) -> list[Field]:
        """Entries of each number of each contact."""
        return [Field(f"{at}.{name}", unit, text) for name, unit, text in _TOUCH for at in identifiers(self.names)]

    def arrays(self) -> tuple[Field, ...]:
        """Entries of each number of all contacts."""
        return tuple(Field(name, unit, text, shape=(len(self.names),)) for name, unit, text in _TOUCH)

    @staticmethod
    def components(touch: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        """Outputs of ``System.touch`` in the order of these entries: those that are vectors by their components."""
        components: dict[str, ca.SX] = {}
        for name, value in touch.items():
            if name in _VECTORS:
                components |= {f"{name}_x": value[0, :].T, f"{name}_y": value[1, :].T}
            else:
                components[name] = value
        return components


_VECTORS = ("force", "point", "normal")
"""Outputs of ``System.touch`` that are world vectors (2, K)."""
_TOUCH = (
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
"""Fields of a contact: name, unit, what it is; in the order of ``SeenKernels.contacts``."""


def _seen(system: System) -> SeenKernels:
    """Kernels of the state, input, forces and parameters themselves."""
    symbols = {letter: ca.SX.sym(letter, getattr(system, f"n{letter}")) for letter in "xuwp"}
    return SeenKernels(system, symbols, **symbols)


def sections(name: str, subject: Subject) -> PackagePart:
    """Write many sections in one call, without derivatives, or their velocities."""
    kind, text, _, entries = _SECTIONS[name]
    kernel = _seen(subject.system).sections(name, subject.stations)
    struct = Struct(kind, text, tuple(Field(f, unit, said, shape=(subject.sections,)) for f, unit, said in entries))
    inputs = subject.acting(forces=False, drawn=True)
    output = Argument(struct.name, struct, "result")
    call = evaluating(subject, kernel, name, text + DRAWN, inputs, output, warns=True)
    constants = {"SECTIONS": f"{subject.sections} /* from base to tip, of a shape and of velocities */"}
    return PackagePart(name, (kernel, *subject.kernels), (call,), constants)


def contact(subject: Subject) -> PackagePart:
    """Write gaps and forces of all contacts."""
    system = cast(System, subject.touching)  # without it packages do not have this part
    names = ", ".join(system.touch_names)
    kernel = _seen(system).contacts()
    struct = Struct(
        "contacts",
        f"Contacts with the object, in this order: {names}. Normals are the object's, outward; zero on a table.",
        ContactFields(system.touch_names).arrays(),
    )
    text = (
        "Gaps, forces and places of all contacts, by the contact law of the scene with its friction. It warns where "
        "the state is beyond what a step takes."
    )
    inputs = subject.acting(forces="w" in kernel.inputs)
    output = Argument("contacts", struct, "result")
    call = evaluating(subject, kernel, "touch", text, inputs, output, warns=True)
    constants = {"CONTACTS": f"{len(system.touch_names)} /* {names} */"}
    return PackagePart("contact", (kernel, *subject.kernels), (call,), constants)
