"""README of a package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from continuum_grasp.export.header import calls_of, codes_of_package, structs_of
from continuum_grasp.export.layer import kernels_of
from continuum_grasp.export.part import Part
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill

__all__ = ["readme"]


def readme(
    subject: Subject,
    parts: Sequence[Part],
    *,
    words: Mapping[str, str],
    errors: Mapping[str, float],
    vectors: Mapping[str, int],
    measured: Mapping[str, Any] | None,
    source: str,
    wasm: bool,
) -> str:
    """The text."""
    prefix, model = subject.prefix, subject.model
    calls = calls_of(parts)
    functions = _table(
        ("function", "gives", "relative error", "test cases"),
        [(f"`{prefix}_{c.name}`", c.text, f"{errors[c.name]:.0e}", str(vectors[c.name])) for c in calls],
    )
    structs = _table(
        ("struct", "field", "unit", "range"),
        [
            (f"`{prefix}_{s.name}`", f"`{f.name}{''.join(f'[{n}]' for n in f.shape)}`", f.unit, _range(f.low, f.high))
            for s in structs_of(subject, parts)
            for f in s.fields
        ],
    )
    operations = _table(
        ("kernel", "computes", "+ and -", "*", "/", "other"),
        [
            (k.name, k.text, str(o["+"] + o["-"]), str(o["*"]), str(o["/"]), _other(o))
            for k in kernels_of(parts)
            for o in [k.operations]
        ],
    )
    codes = _table(("code", "name", "meaning"), [(str(int(c)), c.name, c.text) for c in codes_of_package(parts)])
    more = {
        "source": source,
        "family": model.family,
        "elements": " + ".join(f"{h:g}" for h in model.lengths),
        "ranges": ", ".join(f"{r:.4g}" for r in model.ranges),
        "radius": f"{subject.radius:.4g}",
        "longest": f"{subject.longest_step:g}",
        "accurate": f"{subject.accurate_step:g}",
        "functions": functions,
        "structs": structs,
        "operations": operations,
        "codes": codes,
        "measured": _measured(measured),
        "error_note": _error_note(subject),
        "wasm": _WASM if wasm else "",
        "cases": str(sum(vectors.values())),
    }
    return fill("README.md", {**words, **more})


_WASM = """
WebAssembly, with clang and lld alone: `sh wasm/build.sh`, then `node wasm/test.mjs` runs the vectors and the wrapper.
"""


def _error_note(subject: Subject) -> str:
    if subject.real.name == "double":
        return (
            "They compute what the Python core computes, to the rounding of double precision (relative error 0 here)."
        )
    return (
        "The relative error is the greatest difference from double precision over rows that cover the ranges, per the "
        "greatest value of each output."
    )


def _measured(measured: Mapping[str, Any] | None) -> str:
    if measured is None:
        return (
            "Not measured for this package. `sh examples/baremetal/run.sh` prints the size of the code and, per "
            "function, the least and the most instructions over the test vectors and the bytes of stack; "
            "`continuum-grasp export-c --measure` puts them here."
        )
    rows = [
        (name, f"{v['least_instructions']}", f"{v['most_instructions']}", f"{v['stack_bytes']}")
        for name, v in measured["functions"].items()
    ]
    table = _table(("function", "least instructions", "most instructions", "stack [bytes]"), rows)
    sizes = _table(
        ("object", "code and constants [bytes]", "data", "bss"),
        [(name, str(v["text"]), str(v["data"]), str(v["bss"])) for name, v in measured["sizes"].items()],
    )
    where = f"On an emulated {measured['core']} ({measured['compiler']}; {measured['emulator']})"
    note = "Instructions are counted, not cycles: neither flash wait states nor caches are emulated."
    return f"{where}, {measured['failures']} vectors failed:\n\n{table}\n\n{sizes}\n\n{note}"


def _other(operations: Mapping[str, int]) -> str:
    rest = {name: count for name, count in sorted(operations.items()) if name not in "+-*/"}
    return ", ".join(f"{count} {name}" for name, count in rest.items()) or "none"


def _range(low: float, high: float) -> str:
    if low == float("-inf") and high == float("inf"):
        return "finite"
    return f"{low:.6g} to {high:.6g}" if high < float("inf") else f"{low:.6g} or more"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines)
