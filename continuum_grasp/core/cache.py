"""Compiled libraries, kept by the content that they were made of."""

from __future__ import annotations

import hashlib
import json
import os
import stat
import tempfile
from pathlib import Path

from continuum_grasp.core.compiler import Compiler

__all__ = ["cache_folder", "library_for"]


def cache_folder() -> Path:
    """Folder of compiled code: ``CONTINUUM_GRASP_CACHE``, else ``continuum_grasp`` in the user's cache folder."""
    named = os.environ.get("CONTINUUM_GRASP_CACHE")
    if named:
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "continuum_grasp"


def library_for(source: str, compiler: Compiler) -> Path:
    """The shared library of a C source, compiled unless it is in the cache.

    An entry is used only if its record names this very content and the library's own hash is the recorded one, so that
    truncated, stale or foreign files are built again. Entries are written under a temporary name and then renamed, the
    record last; any number of processes may build the same one.

    Parameters
    ----------
    source : str
        C source.
    compiler : Compiler
        What to compile it with.

    Returns
    -------
    pathlib.Path
        The library.

    Raises
    ------
    CompileError
        If the compiler refuses the source.
    OSError
        If no cache folder can be written.
    """
    folder = _private_folder()
    key = hashlib.sha256(compiler.identity(source).encode()).hexdigest()
    library, record = folder / f"{key}.so", folder / f"{key}.json"
    if _sound(library, record, key):
        return library
    with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as work:
        code, built = Path(work) / "code.c", Path(work) / "code.so"
        code.write_text(source)
        compiler.build(code, built)
        built.chmod(0o700)
        note = {"key": key, "sha256": _hash(built), "compiler": compiler.version}
        kept = Path(work) / "record.json"
        kept.write_text(json.dumps(note))
        kept.chmod(0o600)
        os.replace(built, library)
        os.replace(kept, record)
    return library


def _private_folder() -> Path:
    """The cache folder, readable by its owner alone; a temporary one where that cannot be had."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        state = folder.stat()
        if hasattr(os, "getuid") and state.st_uid != os.getuid():
            raise PermissionError(f"{folder} belongs to another user")
        if stat.S_IMODE(state.st_mode) & 0o077:
            folder.chmod(0o700)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="continuum_grasp-"))


def _sound(library: Path, record: Path, key: str) -> bool:
    try:
        note = json.loads(record.read_text())
        return bool(note["key"] == key and note["sha256"] == _hash(library))
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
