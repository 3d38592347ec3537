"""README of a package."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from typing import Any

from continuum_grasp.export.accuracy import OutputError
from continuum_grasp.export.layer import Contents
from continuum_grasp.export.part import Call, Stateful
from continuum_grasp.export.parts.model import moment_note
from continuum_grasp.export.subject import Subject


def readme(
    contents: Contents,
    *,
    errors: Mapping[str, tuple[OutputError, ...]],
    vectors: Mapping[str, int],
    measured: Mapping[str, Any] | None,
    source: str,
    wasm: bool,
) -> str:
    """Text of the README of a package."""
    subject, stateful = contents.subject, contents.stateful
    finger, names = subject.finger, {part.name for part in contents.parts}
    note = "" if finger is None else moment_note(subject)
    both: list[Call | Stateful] = [*contents.calls, *stateful]
    error_rows = [
        [(f.name, error) for f in functions for error in errors.get(f.name, ())]
        for functions in (contents.calls, stateful)
    ]
    return contents.fill(
        "README.md",
        source=source,
        finger=finger,
        elements=" + ".join(f"{h:g}" for h in finger.lengths) if finger else "",
        ranges=", ".join(f"{r:.4g}" for r in finger.ranges) if finger else "",
        functions=[(f.name, f.text.removesuffix(note).rstrip(), vectors[f.name]) for f in both],
        operations=[(k, o["+"] + o["-"], o["*"], o["/"], _other(o)) for k in contents.kernels for o in [k.operations]],
        measured=measured,
        counts=[(name, *v.values()) for name, v in measured["functions"].items()] if measured else (),
        sizes=[(name, *v.values()) for name, v in measured["sizes"].items()] if measured else (),
        bounds=error_rows[0],
        differences=error_rows[1],
        unbounded=_unbounded(subject),
        **_usage(contents),
        stateful=_stateful(contents),
        step="step" in names,
        mpc="mpc" in names,
        note=f"\n\n{textwrap.fill(note, 118)}" if note else "",
        wasm=wasm,
        cases=sum(vectors.values()),
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


def _stateful(contents: Contents) -> str:
    """Text on needs and work of estimator and controller."""
    loop, words = contents.subject.loop, contents.words
    if loop is None or not contents.stateful:
        return ""
    usual, first = _times(loop.calls.sqp_iterations), _times(loop.calls.start_iterations)
    return contents.fill(
        "control/README.md",
        memory=[(name, words[f"{name}_bytes"]) for function in contents.stateful for name in function.types],
        iterations=f"{usual} at the last plan, or {first} where there is none: at first, and after blindness",
        mpc="mpc" in loop.parts,
        owner="controller" if "mpc" in loop.parts else contents.stateful[-1].types[0],
        places=", ".join(f"{at:g} m" for at in loop.contact.finger.places) if loop.contact is not None else "",
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
