"""The page of a package that says how to use it."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping

import numpy as np

from continuum_grasp.export.accuracy import Report
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.layer import Contents
from continuum_grasp.export.part import Call, Stateful
from continuum_grasp.export.parts.model import moment_note
from continuum_grasp.export.subject import Subject

_COMMENT_OR_FUNCTION = r"^/\* (?P<comment>.*?) ?\*/|^(?:#define |(?:\w+_API )?(?:const )?\w+ \*?)(?P<name>{p}_\w+)\("
"""Pattern of comments, of functions, and of the macros by which these are called, at the begin of a header's line."""


def functions_of(header: str, prefix: str) -> dict[str, str]:
    """Functions that a header declares, with the comment above each; those behind a macro by the macro's name."""
    functions = dict[str, str]()
    comment = ""
    for match in re.finditer(_COMMENT_OR_FUNCTION.format(p=prefix), header, re.MULTILINE | re.DOTALL):
        if match["name"] is None:
            comment = " ".join(match["comment"].split())
        elif not match["name"].endswith(("_init_abi", "_check_built")):
            functions.setdefault(match["name"], comment)
    return functions


def readme(contents: Contents, report: Report, *, header: str, source: str, wasm: bool) -> str:
    """Text of the README of a package with a header."""
    subject, stateful = contents.subject, contents.stateful
    finger = subject.finger
    names = {part.name for part in contents.parts}
    note = "" if finger is None else moment_note(subject)
    both = list[Call | Stateful]([*contents.calls, *stateful])
    prefix = subject.prefix
    tested = {f"{prefix}_{f.name}": (f.text.removesuffix(note).rstrip(), report.cases[f.name]) for f in both}
    bounds, differences = (
        [(f.name, error) for f in functions for error in report.errors.get(f.name, ())]
        for functions in (contents.calls, stateful)
    )
    measured = report.measured or {"functions": {}, "sizes": {}}
    return contents.fill(
        "README.md",
        source=source,
        finger=finger,
        elements=" + ".join(f"{h:g}" for h in finger.lengths) if finger else "",
        ranges=", ".join(f"{r:.4g}" for r in finger.ranges) if finger else "",
        functions=[(name, *tested.get(name, (text, ""))) for name, text in functions_of(header, prefix).items()],
        owned=bool(stateful),
        phases=bool(subject.loop and subject.loop.phases and "mission" in names),
        operations=[(k, o["+"] + o["-"], o["*"], o["/"], _other(o)) for k in contents.kernels for o in [k.operations]],
        measured=report.measured,
        counts=[(name, *v.values()) for name, v in measured["functions"].items()],
        sizes=[(name, *v.values()) for name, v in measured["sizes"].items()],
        bounds=bounds,
        differences=differences,
        unbounded=_unbounded(subject),
        **_usage(contents),
        stateful=_stateful(contents, max((v["stack_bytes"] for v in measured["functions"].values()), default=0)),
        step="step" in names,
        mpc="mpc" in names,
        springs=finger is not None and finger.structure.has_law("damping"),
        note=f"\n\n{textwrap.fill(note, 118)}" if note else "",
        wasm=wasm,
        cases=sum(report.cases.values()),
    )


_BEGIN_NOTES = {
    "measurement": "nothing measured: NaN",
    "reference": "the setpoints of the scene, at all nodes",
    "command": "what was applied before",
}


def _usage(contents: Contents) -> dict[str, object]:
    """Words of a first call: of the step, else of any function of the model, else of the last one with memory."""
    if not contents.calls:
        function = contents.stateful[-1]
        names = (*function.types, *function.inputs, function.output)
        begun = [(name, _BEGIN_NOTES[name]) for name in function.inputs]
        return {"used": function, "owner": function.types[0], "declared": names, "begun": begun, "passed": names}
    call = next((c for c in contents.calls if c.name == "step"), contents.calls[0])
    structs = {a.name: a.kind.name for a in call.inputs if a.is_struct}
    # A state is stepped in place; numbers are steps and positions, of which an accurate step will do.
    output = "state" if call.output.kind.name == "state" else call.output.name
    passed = [f"&{a.name}" if a.name in structs else f"{contents.subject.accurate_step:g}" for a in call.inputs]
    return {
        "used": call,
        "declared": [(kind, f"{name} = {{0}}") for name, kind in structs.items()]
        + ([(call.output.kind.name, output)] if output != "state" else []),
        "passed": [*passed, f"&{output}"],
        "touched": "state" in structs and contents.subject.touching is not None,
    }


_OF_PHASES = {
    "touch": ("goes to the object for a stroke", "nothing"),
    "turn": ("turns the object on its table", "nothing"),
    "leave": ("leaves the object", "nothing"),
    "approach": ("bends to just before the touch", "keep arm and object where the scene has them"),
    "squeeze": ("goes to angles and tensions of the grasp", "keep arm and object still"),
    "settle": ("follows the force of the grasp while the object still stands", "keep arm and object still"),
    "confirm": ("squeezes on until its contacts bear enough to lift", "keep the arm still; watch the decision"),
    "lift": ("holds by the force of the grasp", "lift the object, in the time of the phase"),
    "hold": ("holds by the force of the grasp", "carry the object"),
    "pull": ("holds by the force of the grasp", "carry the object: loads as in the certificate may act"),
    "rest": ("holds by the force of the grasp", "carry the object"),
    "lower": ("holds by the force of the grasp", "put the object down, in the time of the phase"),
    "release": ("opens", "keep the arm still until it has"),
    "end": ("stays open", "the arm may leave; a next mission begins with `_start` or `_init`"),
}
"""Texts on what a finger does in a phase, and on what its host does, by the first word of the phase's name."""


def _phase_rows(loop: Loop) -> list[tuple[str, str, str, str, str]]:
    """Rows of the table of phases; neighbors that do the same by turns are one row."""
    if loop.phases is None:
        return []
    lengths = np.asarray(loop.phases.members["length"], dtype=float).tolist()
    rows: dict[str, list[int]] = {}
    for k, name in enumerate(loop.phases.names):
        rows.setdefault(name.split(" ")[0], []).append(k)
    table = []
    for word, numbers in rows.items():
        name = word if len(numbers) == 1 else f"{word}, {len(numbers)} times"
        lasts = " or ".join(dict.fromkeys(f"{lengths[k]:.3g}" for k in numbers))
        lasts = {"confirm": f"{lasts} at most", "end": "until it begins anew"}.get(word, lasts)
        table.append((", ".join(map(str, numbers)), name, lasts, *_OF_PHASES[word]))
    return table


def _stateful(contents: Contents, stack: int) -> str:
    """Text on needs and work of estimator, controller and mission; ``stack`` is what was measured [bytes], or 0."""
    loop = contents.subject.loop
    words = contents.words
    if loop is None or not contents.stateful:
        return ""
    usual = _times(loop.calls.sqp_iterations)
    first = _times(loop.calls.start_iterations)
    return contents.fill(
        "control/README.md",
        memory=[
            (name, words[f"{name}_bytes"], "scratch of a call" if name.endswith("_work") else "lasts from call to call")
            for function in contents.stateful
            for name in function.types
        ],
        double=contents.subject.real.name == "double",
        stack=stack,
        horizon=loop.stages.stages * loop.stages.stage,
        phases=_phase_rows(loop),
        waits=loop.phases is not None and bool(np.asarray(loop.phases.members["holds_on"])),
        confirm=0.0 if loop.phases is None else float(np.asarray(loop.phases.members["patience"])),
        several=loop.phases is not None and bool(loop.phases.reported),
        iterations=f"{usual} at the last plan, or {first} where there is none: at first, and after blindness",
        mpc="mpc" in loop.parts,
    )


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _unbounded(subject: Subject) -> str:
    """Sizes of usual values of what has no range."""
    return ", ".join(
        f"{field.name} {field.scale:.2g} {field.unit}"
        for struct in (subject.state, subject.input, *([subject.forces] if subject.forces else []))
        for field in struct.fields
        if not (math.isfinite(field.low) and math.isfinite(field.high))
    )


def _other(operations: Mapping[str, int]) -> str:
    rest = {name: count for name, count in sorted(operations.items()) if name not in "+-*/"}
    return ", ".join(f"{count} {name}" for name, count in rest.items()) or "none"
