"""Targets of a package, and examples for bare metal and a GPU."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from continuum_grasp.base import InputError, SolverError
from continuum_grasp.core import Compiler, CReal
from continuum_grasp.export.build import check_tools, version_of, write_files
from continuum_grasp.export.layer import Contents
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
    return name, CReal.named(real).name


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
    """Return the core of a target's emulated board; InputError if the target has none."""
    core = _core(target)
    if core is None:
        raise InputError(f"{target} has no emulated board: use cortex-m4f or cortex-m7", key="target")
    return core


def check_measuring_tools() -> None:
    """Raise InputError if a program for measurements is missing."""
    check_tools(TOOLS, "measuring needs {}", "gcc-arm-none-eabi qemu-system-arm")


def measure(files: Mapping[str, str], target: str) -> dict[str, Any]:
    """Build a package for its board, run the vectors there, and read off what it says."""
    core = measured_core(target)
    with tempfile.TemporaryDirectory() as work:
        write_files(Path(work), files)
        line = ["sh", f"{work}/examples/baremetal/run.sh", core]
        try:
            done = Compiler.said_by(line, seconds=_TIMEOUT)
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
    subject = contents.subject
    names = {part.name for part in contents.parts}
    core = _core(target) or ("cortex-m4f" if subject.real.name == "float" else "cortex-m7")
    templates = [f"examples/baremetal/{name}" for name in _BARE_METAL]
    files = {template: contents.fill(template, core=core) for template in templates}
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
    state = subject.state.fields
    first = subject.input.fields[0]
    return {
        "start": [*map(real.literal, subject.start)] if subject.touching is not None else [],
        "h": real.literal(subject.accurate_step),
        "level": real.literal(_SHARE * first.scale),
        # 0.1: time within which the example's input sets in [s]
        "onset": "" if subject.model.structure.moment_is_constant else real.literal(0.1),
        "first_input": first.name,
        "first_state": state[0].name,
    }
