"""C of packages on this machine: libraries by the flags with which every bit is the same, and WebAssembly by clang."""

from __future__ import annotations

import ctypes
import itertools
import os
import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

from continuum_grasp.base import InputError, SolverError
from continuum_grasp.core import Cache, Compiler
from continuum_grasp.export.fields import fill

FLAGS = {
    "strict": ["-std=c99", "-ffp-contract=off", "-fno-math-errno"],
    "gcc": ["-fexcess-precision=fast", "-fno-tree-vectorize"],
}
"""Flags with which results are the same to the last bit. Flags of gcc: s390x would compute float in double, and 12.2
fuses multiplications with additions in vectors (x86 with FMA) in spite of -ffp-contract=off."""


def strict_flags(version: str = "gcc") -> list[str]:
    """Strict flags of a compiler, by its version text."""
    return FLAGS["strict"] + ([] if "clang" in version.lower() else FLAGS["gcc"])


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write files into a temporary folder, by their paths in it."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def strict_library(files: Mapping[str, str]) -> ctypes.CDLL:
    """Compile the C among files of a package, with the strict flags, and load it; from the cache where it is there.

    The flags give the same bits at every level of optimization. InputError without a compiler.
    """
    compiler = Compiler.find()
    if compiler is None:
        raise InputError(f"memory and vectors of estimator and controller need a C compiler: {Compiler.why_none()}")
    flags = [*strict_flags(compiler.version), "-fPIC", "-w", "-Iinclude", "-Itests"]
    levels = {
        name: "-O1" if text.count("\n") <= _SHORT else "-O0" for name, text in files.items() if name.endswith(".c")
    }

    def build(work: Path) -> Path:
        write_files(work, files)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            commands = [[*flags, level, "-c", name, "-o", f"{name}.o"] for name, level in levels.items()]
            list(pool.map(lambda command: compiler.run(command, work), commands))
        compiler.run(["-shared", *(f"{name}.o" for name in levels), "-o", "host.so"], work)
        (work / "host.so").chmod(0o700)
        return work / "host.so"

    identity = compiler.identity("\0".join([*flags, *levels.values(), *itertools.chain(*sorted(files.items()))]))
    return ctypes.CDLL(str(Cache().entry(identity, build, compiler.version)))


_SHORT = 10_000
"""Lines of a source file up to which it is optimized: kernels of the mission of configs/mission/mug.yaml, 38,700 lines,
compile in 2 s of CPU in place of 12 s, and the rows of its vectors take 3 s longer (gcc 12.2, ``export_c``)."""


# Those of templates/wasm/build.sh, so that pages have the bits of packages.
_WASM = ("--target=wasm32", "-nostdlib", "-std=c99", "-O2", "-ffp-contract=off", "-fno-builtin", "-mbulk-memory")
_LINKED = ("-Wl,--no-entry", "-Wl,--strip-all")


class WebAssembly:
    """Modules of WebAssembly, and the programs that make them."""

    @staticmethod
    def check_tools(needed: str) -> None:
        """Refuse where a program is missing; ``needed`` says what they are for, with braces in their place."""
        check_tools(("clang", "wasm-ld"), needed, "clang lld")

    @staticmethod
    def module(files: Mapping[str, str], exports: Sequence[str]) -> bytes:
        """A module of C files and headers by their names, with functions that it exports; cached.

        Sources are compiled side by side, on all processors.
        """
        files = {**files, **{name: fill(f"wasm/{name}", {}) for name in ("string.h", "string.c")}}
        linked = [*_LINKED, *(f"-Wl,--export={name}" for name in exports)]
        version = f"{shutil.which('clang')} {version_of('clang')}"

        def build(work: Path) -> Path:
            write_files(work, files)
            sources = [name for name in files if name.endswith(".c")]
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                list(pool.map(lambda name: clang(work, "-I.", "-c", name, "-o", f"{name}.o"), sources))
            clang(work, *linked, *(f"{name}.o" for name in sources), "-o", "module.wasm")
            (work / "module.wasm").chmod(0o600)
            return work / "module.wasm"

        identity = "\0".join([version, *_WASM, *linked, *(part for item in sorted(files.items()) for part in item)])
        return Cache(suffix=".wasm").entry(identity, build, version).read_bytes()


def clang(folder: Path, *arguments: str) -> str:
    """Run clang for WebAssembly in a folder and return its output; SolverError if it fails."""
    done = Compiler.said_by(["clang", *_WASM, *arguments], folder)
    if done.returncode != 0:
        raise SolverError("clang could not make WebAssembly", status="failed", advice=done.stderr[-2000:])
    return done.stdout


def check_tools(names: Sequence[str], needed: str, packages: str) -> None:
    """Refuse where programs are missing; ``needed`` says what they are for, with braces in their place.

    ``packages`` of Debian have them.
    """
    missing = [name for name in names if shutil.which(name) is None]
    if missing:
        raise InputError(f"{needed.format(' and '.join(missing))}; on Debian and Ubuntu: sudo apt install {packages}")


@cache
def version_of(program: str) -> str:
    """First line of what a program says of its version, or its name."""
    done = Compiler.said_by([program, "--version"])
    return done.stdout.splitlines()[0] if done.stdout else program
