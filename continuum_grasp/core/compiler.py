"""The C compiler of this machine."""

from __future__ import annotations

import errno
import os
import platform
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from continuum_grasp.errors import ContinuumGraspError

__all__ = ["CompileError", "Compiler", "find_compiler", "why_no_compiler"]

_COMMON = ("-std=gnu11", "-march=native", "-fPIC", "-shared", "-w")
_USUAL = ("cc", "gcc", "clang")
_LEVELS = ((20_000, "-O3"), (60_000, "-O1"))
"""Optimisation by the lines of the longest function: compilers need minutes for long straight-line code."""
_GCC = ("-fschedule-insns", "-fsched-pressure", "-flive-range-shrinkage")
"""Scheduling under register pressure: straight-line code gains about 7 %, compiling takes twice as long."""
_SHORT = 15_000
"""Lines of a source up to which that is worth it."""


class CompileError(ContinuumGraspError, RuntimeError):
    """The compiler refused the source."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler with the flags for this machine."""

    command: tuple[str, ...]
    version: str
    machine: str

    def flags(self, source: str) -> tuple[str, ...]:
        """Compiler flags for a source."""
        longest = max(function.count("\n") for function in source.split("\n}\n"))
        level = next((flag for limit, flag in _LEVELS if longest <= limit), "-O0")
        is_gcc = "clang" not in self.version.lower()
        return (*_COMMON, level, *(_GCC if is_gcc and source.count("\n") <= _SHORT else ()))

    def identity(self, source: str) -> str:
        """Everything that a compiled source depends on."""
        return "\0".join((*self.command, self.version, self.machine, *self.flags(source), source))

    def build(self, source: Path, library: Path) -> None:
        """Compile a source file to a shared library.

        Raises
        ------
        CompileError
            With the first lines that the compiler said.
        """
        flags = self.flags(source.read_text())
        line = [*self.command, *flags, str(source), "-o", str(library), "-lm"]
        try:
            done = subprocess.run(line, capture_output=True, text=True, timeout=1800, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise CompileError(f"{shlex.join(self.command)}: {error}") from error
        if done.returncode != 0 or not library.exists():
            if os.strerror(errno.ENOSPC) in done.stderr:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(library.parent))
            said = " | ".join(done.stderr.strip().splitlines()[:3]) or f"exit status {done.returncode}"
            raise CompileError(f"{shlex.join(self.command)}: {said}")


def find_compiler() -> Compiler | None:
    """The compiler named by ``CC``, else the first of cc, gcc and clang; None if there is none."""
    return next((found for _, found in _tried() if isinstance(found, Compiler)), None)


def why_no_compiler() -> str:
    """What was tried, and why none of it is a C compiler."""
    named = os.environ.get("CC")
    if named is None:
        return "no C compiler found (" + "; ".join(f"{command}: {why}" for command, why in _tried()) + ")"
    if not named.strip():
        return "no C compiler: CC is set and empty (unset it to have cc, gcc and clang tried)"
    why = "; ".join(str(why) for _, why in _tried())
    return f"no C compiler: CC={named}: {why} (nothing else is tried while CC is set)"


def _tried() -> Iterator[tuple[str, Compiler | str]]:
    """Each command that may be a compiler, with the compiler or why it is none."""
    named = os.environ.get("CC")
    for line in _USUAL if named is None else (named,):
        try:
            command = tuple(shlex.split(line))
        except ValueError as error:
            yield line, f"cannot be read as a command ({error})"
            continue
        if command:
            path = shutil.which(command[0])
            yield line, _describe(command, path) if path else "no such program"


@cache
def _describe(command: tuple[str, ...], path: str) -> Compiler | str:
    asked = f"{shlex.join(command)} --version"
    try:
        done = subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=30, check=False)
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        return " ".join(f"{asked}: {error}".split())
    if done.returncode != 0 or not done.stdout:
        said = " ".join(done.stderr.split())[:200]
        return f"{asked} exits with {done.returncode}" + (f", says {said!r}" if said else " and says nothing")
    return Compiler((path, *command[1:]), done.stdout.splitlines()[0], _machine())


@cache
def _machine() -> str:
    """Processor and system; code for one machine must not be run on another that shares the cache."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    wanted = ("model name", "flags", "Features", "CPU part")
    seen = sorted({line for line in lines if line.split(":")[0].strip() in wanted})
    return "\n".join([platform.system(), platform.machine(), platform.processor(), *seen])
