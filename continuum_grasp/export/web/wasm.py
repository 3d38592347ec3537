"""C of a page as WebAssembly, by clang and its linker alone."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from continuum_grasp.core.cache import entry_for
from continuum_grasp.core.compiler import TIMEOUT, said_by, version_of
from continuum_grasp.errors import SolverError
from continuum_grasp.export.build import write_files
from continuum_grasp.export.fields import fill
from continuum_grasp.export.layer import Contents

# Those of templates/wasm/build.sh, so that pages have the bits of packages.
_FLAGS = ("--target=wasm32", "-nostdlib", "-std=c99", "-O2", "-ffp-contract=off", "-fno-builtin", "-mbulk-memory")
_LINKED = ("-Wl,--no-entry", "-Wl,--strip-all")
_INTEGER = re.compile(r"^\s*\.int32\s+(\d+)", re.MULTILINE)


def compiled(files: Mapping[str, str], exports: Sequence[str]) -> bytes:
    """A module of C files and headers by their names, with functions that it exports; from the cache where it is there.

    Sources are compiled side by side, on all processors.
    """
    files = {**files, **{name: fill(f"wasm/{name}", {}) for name in ("string.h", "string.c")}}
    linked = [*_FLAGS, *_LINKED, *(f"-Wl,--export={name}" for name in exports)]
    version = f"{shutil.which('clang')} {version_of('clang')}"

    def build(work: Path) -> Path:
        write_files(work, files)
        sources = [name for name in files if name.endswith(".c")]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(lambda name: _run(work, *_FLAGS, "-I.", "-c", name, "-o", f"{name}.o"), sources))
        _run(work, *linked, *(f"{name}.o" for name in sources), "-o", "module.wasm")
        (work / "module.wasm").chmod(0o600)
        return work / "module.wasm"

    identity = "\0".join([version, *linked, *(part for item in sorted(files.items()) for part in item)])
    return entry_for(identity, ".wasm", build, version).read_bytes()


def add_sizes(contents: Contents, files: Mapping[str, str]) -> tuple[int, int]:
    """Add the bytes of a package's memory to its words; ``files`` are its headers by their names.

    Returns the place of the plan within the controller, or within its mission, [bytes] and the number of its nodes.
    """
    prefix = contents.subject.prefix
    owned = [name for function in contents.stateful for name in function.types]
    sizes = ", ".join(f"sizeof({prefix}_{name})" for name in owned)
    with tempfile.TemporaryDirectory() as folder:
        owner, plan = ("mission", "controller.") if "mission" in owned else ("controller", "")
        plan, states = f"{plan}memory.state.plan.x", f"(({prefix}_controller *)0)->memory.state.plan.x"
        sizes += f", __builtin_offsetof({prefix}_{owner}, {plan}), sizeof {states} / sizeof {states}[0]"
        source = f'#include "{prefix}.h"\nconst unsigned int sizes[] = {{{sizes}}};\n'
        write_files(Path(folder), {**files, "sizes.c": source})
        assembly = _run(Path(folder), *_FLAGS, "-I.", "-S", "sizes.c", "-o", "-")
    numbers = _INTEGER.findall(assembly)
    contents.words.update((f"{name}_bytes", size) for name, size in zip(owned, numbers, strict=False))
    return int(numbers[-2]), int(numbers[-1])


def _run(folder: Path, *arguments: str) -> str:
    """Run clang in a folder and return its output; SolverError if it fails."""
    done = said_by(["clang", *arguments], folder, TIMEOUT)
    if done.returncode != 0:
        raise SolverError("clang could not make WebAssembly", status="failed", advice=done.stderr[-2000:])
    return done.stdout
