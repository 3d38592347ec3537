"""What a package is made for."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from continuum_grasp.errors import InputError, SolverError

__all__ = ["TOOLS", "Target", "measure", "target_of"]


@dataclass(frozen=True)
class Target:
    """A machine, with the real types that its hardware computes in."""

    name: str
    reals: tuple[str, ...]
    """The usual one first."""
    core: str | None = None
    """Argument of ``examples/baremetal/run.sh``."""

    def real(self, given: Any) -> str:
        """The type that is asked for, or the usual one.

        Raises
        ------
        InputError
            If the hardware does not compute in it.
        """
        if given is None:
            return self.reals[0]
        if given in ("float", "double") and given not in self.reals:
            raise InputError(
                f"{self.name} computes {given} in software, 22 to 35 times slower: expected {self.reals[0]}",
                key="real",
            )
        return str(given)


TARGETS = {
    target.name: target
    for target in (
        Target("host", ("double", "float")),
        Target("cortex-m4f", ("float",), "cortex-m4f"),
        Target("cortex-m7", ("double", "float"), "cortex-m7"),
        Target("wasm", ("double", "float")),
    )
}


def target_of(name: Any) -> Target:
    """The target of a name.

    Raises
    ------
    InputError
        If there is none.
    """
    if not isinstance(name, str) or name not in TARGETS:
        raise InputError(f"expected one of {', '.join(TARGETS)}, got {name!r:.60}", key="target")
    return TARGETS[name]


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
