"""Sizes, stack and instruction counts of a package on the emulated board."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.export.targets import Target

__all__ = ["TOOLS", "measure"]

TOOLS = ("arm-none-eabi-gcc", "qemu-system-arm")
"""Programs that measuring needs."""
_TIMEOUT = 600.0
"""After which an emulator is taken to hang [s]; it counts every instruction."""
_LINE = re.compile(r"^(\w+) (\d+) (\d+) (\d+) (\d+)$", re.MULTILINE)
_COUNTED = ("least_instructions", "mean_instructions", "most_instructions", "stack_bytes")
_SIZE = re.compile(r"^\s*(\d+)\s+(\d+)\s+(\d+)\s+\d+\s+\w+\s+(\w+)\.o$", re.MULTILINE)


def measure(files: Mapping[str, str], prefix: str, target: Target) -> dict[str, Any]:
    """Build a package for its board, run the vectors there, and read off what it says.

    Raises
    ------
    InputError
        If the target has no emulated board, or a tool is missing.
    SolverError
        If the package does not build or a vector fails.
    """
    if target.core is None:
        raise InputError(f"{target.name} has no emulated board: take cortex-m4f or cortex-m7", key="target")
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        raise InputError(f"measuring needs {', '.join(missing)} (Debian: gcc-arm-none-eabi, qemu-system-arm)")
    with tempfile.TemporaryDirectory() as work:
        for name, text in files.items():
            path = Path(work) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        line = ["sh", f"{work}/examples/baremetal/run.sh", target.core]
        done = subprocess.run(line, capture_output=True, text=True, timeout=_TIMEOUT, check=False)
    said = done.stdout + done.stderr
    if done.returncode != 0:
        raise SolverError(f"the package failed on {target.core}", status="failed", advice=said[-2000:])
    failures = re.search(r"^(\d+) failures$", said, re.MULTILINE)
    return {
        "core": target.core,
        "compiler": _version("arm-none-eabi-gcc"),
        "emulator": _version("qemu-system-arm"),
        "failures": int(failures[1]) if failures else -1,
        "functions": {
            name: dict(zip(_COUNTED, map(int, counts), strict=True)) for name, *counts in _LINE.findall(said)
        },
        "sizes": {
            f"{name}.o": {"text": int(text), "data": int(data), "bss": int(bss)}
            for text, data, bss, name in _SIZE.findall(said)
        },
    }


def _version(tool: str) -> str:
    done = subprocess.run([tool, "--version"], capture_output=True, text=True, timeout=60, check=False)
    return done.stdout.splitlines()[0] if done.stdout else tool
