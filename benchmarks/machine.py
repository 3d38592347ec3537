"""What a benchmark ran on."""

from __future__ import annotations

import contextlib
import os
import platform
import subprocess
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from continuum_grasp.core.compiler import find_compiler

CFLAGS = ("-O3", "-march=native", "-fPIC")
PACKAGES = ("casadi", "numpy", "continuum-grasp")


def describe() -> dict[str, Any]:
    """Processor, cores, governor, load before the run, versions, compiler and its flags."""
    return {
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "governor": _read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor") or "not readable",
        "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
        "compiler": _compiler_version(),
        "flags": " ".join(CFLAGS),
    }


def compiler() -> str:
    """The C compiler that the package itself would use."""
    found = find_compiler()
    if found is None:
        raise RuntimeError("no C compiler found: the benchmarks need CC, cc, gcc or clang")
    return found.command[0]


@contextlib.contextmanager
def one_core() -> Iterator[int | None]:
    """Keep this thread, and threads and processes started from it, on one core, where the system allows it.

    Yields
    ------
    int or None
        The core.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return
    before = os.sched_getaffinity(0)
    core = max(before)
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, before)


def _cpu_model() -> str:
    for line in _read("/proc/cpuinfo").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _compiler_version() -> str:
    try:
        said = subprocess.run([compiler(), "--version"], capture_output=True, text=True, check=True).stdout
    except (RuntimeError, OSError, subprocess.CalledProcessError) as error:
        return f"none ({error})"
    return said.splitlines()[0]
