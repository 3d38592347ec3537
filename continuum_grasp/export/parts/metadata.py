"""Part ``metadata``: names, units and ranges of the fields of all structs, readable at run time."""

from __future__ import annotations

from collections.abc import Sequence

from continuum_grasp import __version__
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.part import Part
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill


def metadata(subject: Subject) -> Part:
    """Write functions that describe the structs of the other parts."""
    prefix, real = subject.prefix, subject.real

    def table(structs: Sequence[Struct]) -> str:
        # Texts of one width and no pointers: tables of those are no constants in shared libraries.
        entries = [(struct.name, field.name, field) for struct in structs for field in struct.fields]
        rows = [
            f'  {{"{of}", "{name}", "{f.unit}", {f.size}, {real.finite_literal(f.low)}, {real.finite_literal(f.high)}}}'
            for of, name, f in entries
        ]
        words = {
            "of": max(len(of) for of, _, _ in entries) + 1,
            "name": max(len(name) for _, name, _ in entries) + 1,
            "unit": max(len(f.unit) for _, _, f in entries) + 1,
            "rows": ",\n".join(rows),
            "count": f"{len(entries)}u",
            "version": __version__,
        }
        return fill("metadata.c", {"p": prefix, "P": prefix.upper(), **words})

    declared = fill("metadata.h", {"p": prefix, "P": prefix.upper()})
    return Part("metadata", (), (), declarations=declared, describes=(f"src/{prefix}_metadata.c", table))
