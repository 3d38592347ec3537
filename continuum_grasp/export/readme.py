"""README of a package."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from continuum_grasp.export.accuracy import OutputError
from continuum_grasp.export.layer import Contents
from continuum_grasp.export.part import Call, Stateful
from continuum_grasp.export.parts.model import moment_note


def readme(
    contents: Contents,
    *,
    errors: Mapping[str, tuple[OutputError, ...]],
    vectors: Mapping[str, int],
    measured: Mapping[str, Any] | None,
    source: str,
    wasm: bool,
) -> str:
    """The text."""
    subject, calls, stateful = contents.subject, contents.calls, contents.stateful
    prefix, finger = subject.prefix, subject.finger
    note = "" if finger is None else moment_note(subject)
    both: list[Call | Stateful] = [*calls, *stateful]
    functions = _table(
        ("function", "gives", "test cases"),
        [(f"`{prefix}_{f.name}`", f.text.removesuffix(note).rstrip(), str(vectors[f.name])) for f in both],
    )
    structs = _table(
        ("struct", "field", "unit", "range"),
        [
            (f"`{prefix}_{s.name}`", f"`{f.name}{''.join(f'[{n}]' for n in f.shape)}`", f.unit, f.limits or "finite")
            for s in contents.structs
            for f in s.fields
        ],
    )
    operations = _table(
        ("kernel", "computes", "+ and -", "*", "/", "other"),
        [
            (k.name, k.text, str(o["+"] + o["-"]), str(o["*"]), str(o["/"]), _other(o))
            for k in contents.kernels
            for o in [k.operations]
        ],
    )
    names = {part.name for part in contents.parts}
    return contents.fill(
        "README.md",
        source=source,
        finger=finger,
        subject=subject,
        elements=" + ".join(f"{h:g}" for h in finger.lengths) if finger else "",
        ranges=", ".join(f"{r:.4g}" for r in finger.ranges) if finger else "",
        functions=functions,
        structs=structs,
        operations=operations,
        codes=_table(("code", "name", "meaning"), [(str(int(c)), c.name, c.text) for c in contents.codes]),
        measured=measured is not None,
        **(_measured(measured) if measured is not None else {}),
        **_rounding(contents, errors),
        **_usage(contents),
        loops="Loops have bounded counts." if stateful else "Loops have fixed counts.",
        calls=calls,
        mixed=calls and stateful,
        stateful=_stateful(contents),
        step="step" in names,
        mpc="mpc" in names,
        skeletons={"step", "mpc"} & names,
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
    prefix = contents.subject.prefix
    if contents.calls:
        call = next((c for c in contents.calls if c.name == "step"), contents.calls[0])
        inputs = [a for a in call.inputs if a.is_struct]
        # A state is stepped in place; numbers are steps and positions, of which an accurate step will do.
        output = "state" if call.output.kind.name == "state" else call.output.name
        declared = [f"{prefix}_{a.kind.name} {a.name} = {{0}};" for a in inputs]
        declared += [f"{prefix}_{call.output.kind.name} {output};"] if output != "state" else []
        passed = [f"&{a.name}" if a.is_struct else f"{contents.subject.accurate_step:g}" for a in call.inputs]
        start = ""
        if "state" in [a.name for a in inputs] and contents.subject.touching is not None:
            start = f"\ncode = {prefix}_state_init(&state); /* the object where the scene has it */"
        words = {"start": start, "name": call.name, "passed": ", ".join([*passed, f"&{output}"])}
    else:
        function = contents.stateful[-1]
        names = (*function.types, *function.inputs, function.output)
        declared = [f"static {prefix}_{name} {name};" for name in names]
        begun = [
            f"if (code >= 0) code = {prefix}_{name}_init(&{name}); /* {_BEGIN_NOTES[name]} */"
            for name in function.inputs
        ]
        words = {"name": function.name, "passed": ", ".join(f"&{name}" for name in names)}
        words |= {"owner": function.types[0], "begun": "\n".join(begun)}
    return {"use_declared": "\n".join(declared), **{f"use_{key}": value for key, value in words.items()}}


def _stateful(contents: Contents) -> str:
    """What estimator and controller need, and what they do."""
    loop, words = contents.subject.loop, contents.words
    if loop is None or not contents.stateful:
        return ""
    owners = [name for function in contents.stateful for name in function.types]
    rows = [(f"`{contents.subject.prefix}_{name}`", words[f"{name}_bytes"]) for name in owners]
    usual, first = _times(loop.calls.sqp_iterations), _times(loop.calls.start_iterations)
    return contents.fill(
        "control/README.md",
        loop=loop,
        memory=_table(("memory", "bytes"), rows),
        iterations=f"{usual} at the last plan, or {first} where there is none: at first, and after blindness",
        mpc="mpc" in loop.parts,
        owner=contents.stateful[-1].types[0],
        places=", ".join(f"{at:g} m" for at in loop.contact.finger.places) if loop.contact is not None else "",
    )


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _rounding(contents: Contents, errors: Mapping[str, tuple[OutputError, ...]]) -> dict[str, object]:
    """Words of what is known of rounding: bounds of functions of the model, differences seen of those with memory."""
    subject = contents.subject
    single = subject.real.name == "float"

    def table(functions: Sequence[Call | Stateful], what: str) -> str:
        rows = [
            (f"`{subject.prefix}_{f.name}`", f"`{one.name}`", one.unit, f"{one.bound:.2g}", f"{one.greatest:.2g}")
            for f in functions
            for one in errors[f.name]
        ]
        return _table(("function", "output", "unit", what, "greatest value"), rows)

    usual = ", ".join(
        f"{field.name} {field.scale:.2g} {field.unit}"
        for struct in (subject.state, subject.input, *([subject.forces] if subject.forces else []))
        for field in struct.fields
        if not (math.isfinite(field.low) and math.isfinite(field.high))
    )
    return {
        "exact": not single,
        "bounds": table(contents.calls, "error at most") if single and contents.calls else "",
        "differences": table(contents.stateful, "difference") if single and contents.stateful else "",
        "both_errors": single and contents.calls and contents.stateful,
        "unbounded": f" and, where there is no range, up to these sizes: {usual}" if usual else "",
    }


def _measured(measured: Mapping[str, Any]) -> dict[str, object]:
    """Words of what an emulated board counted."""
    rows = [
        (name, *(str(v[f"{which}_instructions"]) for which in ("least", "mean", "most")), str(v["stack_bytes"]))
        for name, v in measured["functions"].items()
    ]
    sizes = [(name, str(v["text"]), str(v["data"]), str(v["bss"])) for name, v in measured["sizes"].items()]
    return {
        **{name: measured[name] for name in ("core", "compiler", "emulator", "failures")},
        "instructions": _table(("function", "least instructions", "mean", "most", "stack [bytes]"), rows),
        "sizes": _table(("object", "code and constants [bytes]", "data", "bss"), sizes),
    }


def _other(operations: Mapping[str, int]) -> str:
    rest = {name: count for name, count in sorted(operations.items()) if name not in "+-*/"}
    return ", ".join(f"{count} {name}" for name, count in rest.items()) or "none"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines)
