"""C of packages on this machine: files of a folder, and libraries by the flags with which every bit is the same."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Mapping
from pathlib import Path

from continuum_grasp.core.compiler import Compiler

FLAGS = {
    "strict": ["-std=c99", "-ffp-contract=off", "-fno-math-errno"],
    "gcc": ["-fexcess-precision=fast", "-fno-tree-vectorize"],
}
"""Flags with which results are the same to the last bit. Those of gcc: s390x would compute float in double, and 12.2
fuses multiplications with additions in vectors (x86 with FMA) in spite of -ffp-contract=off."""


def strict_flags(version: str) -> list[str]:
    """Strict flags of a compiler, by its version text."""
    return FLAGS["strict"] + ([] if "clang" in version.lower() else FLAGS["gcc"])


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write files into a temporary folder, by their paths in it."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def strict_library(compiler: Compiler, files: Mapping[str, str]) -> ctypes.CDLL:
    """Compile the C among files of a package, with the strict flags, and load it."""
    # Windows removes no library that is loaded.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as work:
        write_files(Path(work), files)
        flags = [*strict_flags(compiler.version), "-O1", "-shared", "-fPIC", "-w", "-Iinclude", "-Itests"]
        compiler.run([*flags, *(name for name in files if name.endswith(".c")), "-o", "host.so"], Path(work))
        return ctypes.CDLL(str(Path(work) / "host.so"))
