"""Targets of a package, examples for bare metal and a GPU, and the page that says how to use it."""

from __future__ import annotations

import math
import re
import subprocess
import tempfile
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from continuum_grasp.base import InputError, SolverError
from continuum_grasp.core import precision_of, said_by
from continuum_grasp.export.accuracy import Report
from continuum_grasp.export.build import check_tools, version_of, write_files
from continuum_grasp.export.layer import Contents
from continuum_grasp.export.part import Call, Stateful
from continuum_grasp.export.parts.model import moment_note
from continuum_grasp.export.subject import Subject

TARGETS = {
    "host": ("double", "float"),
    "cortex-m4f": ("float",),
    "cortex-m7": ("double", "float"),
    "wasm": ("double", "float"),
}
"""Machines with the real types that their hardware computes in, the usual one first."""


def target_of(name: Any, real: Any) -> tuple[str, str]:
    """A target and the real type that is asked for, or its usual one."""
    if not isinstance(name, str) or name not in TARGETS:
        instead = "; a ROS 2 node calls the C of `host`, or cg.Controller" if str(name).startswith("ros") else ""
        raise InputError(f"expected one of {', '.join(TARGETS)}, got {name!r:.60}{instead}", key="target")
    if real is None:
        return name, TARGETS[name][0]
    if real in ("float", "double") and real not in TARGETS[name]:
        raise InputError(
            f"{name} computes {real} in software, 22 to 35 times slower: expected {TARGETS[name][0]}", key="real"
        )
    return name, precision_of(real)


def _core(target: str) -> str | None:
    """Argument of ``examples/baremetal/run.sh``; None where the target is no board."""
    return target if target.startswith("cortex") else None


TOOLS = ("arm-none-eabi-gcc", "qemu-system-arm")
"""Programs that measuring needs."""
_TIMEOUT = 600.0
"""After which an emulator is taken to hang [s]; it counts every instruction."""
_LINE = re.compile(r"^(\w+) (\d+) (\d+) (\d+) (\d+)$", re.MULTILINE)
_COUNTED = ("least_instructions", "mean_instructions", "most_instructions", "stack_bytes")
_SIZE = re.compile(r"^\s*(\d+)\s+(\d+)\s+(\d+)\s+\d+\s+\w+\s+(\w+)\.o$", re.MULTILINE)


def measured_core(target: str) -> str:
    """Core of a target's emulated board; InputError where there is none, or where its tools are missing."""
    core = _core(target)
    if core is None:
        raise InputError(f"{target} has no emulated board: take cortex-m4f or cortex-m7", key="target")
    check_tools(TOOLS, "measuring needs {}", "gcc-arm-none-eabi qemu-system-arm")
    return core


def measure(files: Mapping[str, str], target: str) -> dict[str, Any]:
    """Build a package for its board, run the vectors there, and read off what it says."""
    core = measured_core(target)
    with tempfile.TemporaryDirectory() as work:
        write_files(Path(work), files)
        line = ["sh", f"{work}/examples/baremetal/run.sh", core]
        try:
            done = said_by(line, seconds=_TIMEOUT)
        except subprocess.TimeoutExpired:
            what = (
                f"the package did not end on {core} within {_TIMEOUT:g} s, under an emulator that counts instructions"
            )
            raise SolverError(what, status="stopped", advice="measure the controller without its mission") from None
    said = done.stdout + done.stderr
    if done.returncode != 0:
        raise SolverError(f"the package failed on {core}", status="failed", advice=said[-2000:])
    failures = re.search(r"^(\d+) failures$", said, re.MULTILINE)
    return {
        "core": core,
        "compiler": version_of("arm-none-eabi-gcc"),
        "emulator": version_of("qemu-system-arm"),
        "failures": int(failures[1]) if failures else -1,
        "functions": {
            name: dict(zip(_COUNTED, map(int, counts), strict=True)) for name, *counts in _LINE.findall(said)
        },
        "sizes": {
            f"{name}.o": {"text": int(text), "data": int(data), "bss": int(bss)}
            for text, data, bss, name in _SIZE.findall(said)
        },
    }


_BARE_METAL = ("start.c", "board.h", "board.ld", "main.c", "run.sh")
_SHARE = 0.25
"""Share of the usual input that the example takes."""


def example_files(contents: Contents, target: str) -> dict[str, str]:
    """Examples by path; those that step in time, and those that control, only where the package does."""
    subject, names = contents.subject, {part.name for part in contents.parts}
    core = _core(target) or ("cortex-m4f" if subject.real.name == "float" else "cortex-m7")
    files = {name: contents.fill(name, core=core) for name in (f"examples/baremetal/{name}" for name in _BARE_METAL)}
    if "step" in names:
        words = _step_words(subject)
        files |= {name: contents.fill(name, **words) for name in ("examples/loop.c", "examples/cuda/batch.cu")}
    if "mpc" in names and subject.loop is not None:
        wanted = ", ".join(subject.real.literal(float(v)) for v in subject.loop.wanted)
        sources = {"examples/control_loop.c": "examples/control/loop.c"}
        sources |= {"examples/mission_loop.c": "examples/control/mission.c"} if "mission" in names else {}
        read_line = contents.fill("examples/control/read_line.c")
        files |= {path: contents.fill(name, wanted=wanted, read_line=read_line) for path, name in sources.items()}
    return files


def _step_words(subject: Subject) -> dict[str, object]:
    real = subject.real
    state, first = subject.state.fields, subject.input.fields[0]
    return {
        "start": [*map(real.literal, subject.start)] if subject.touching is not None else [],
        "h": real.literal(subject.accurate_step),
        "level": real.literal(_SHARE * first.scale),
        # 0.1: time within which the example's input sets in [s]
        "onset": "" if subject.model.structure.moment_is_constant else real.literal(0.1),
        "first_input": first.name,
        "first_state": state[0].name,
    }


def readme(contents: Contents, report: Report, *, source: str, wasm: bool) -> str:
    """Text of the README of a package."""
    subject, stateful = contents.subject, contents.stateful
    finger, names = subject.finger, {part.name for part in contents.parts}
    note = "" if finger is None else moment_note(subject)
    both: list[Call | Stateful] = [*contents.calls, *stateful]
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
        functions=[(f.name, f.text.removesuffix(note).rstrip(), report.cases[f.name]) for f in both],
        operations=[(k, o["+"] + o["-"], o["*"], o["/"], _other(o)) for k in contents.kernels for o in [k.operations]],
        measured=report.measured,
        counts=[(name, *v.values()) for name, v in measured["functions"].items()],
        sizes=[(name, *v.values()) for name, v in measured["sizes"].items()],
        bounds=bounds,
        differences=differences,
        unbounded=_unbounded(subject),
        **_usage(contents),
        stateful=_stateful(contents),
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
