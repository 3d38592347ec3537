"""Compiled libraries, stored by the content that they were made of."""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import shutil
import stat
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_LOCK = "lock"


def cache_folder(kind: str = "compiled") -> Path:
    """Folder of compiled code or of another kind: in ``CONTINUUM_GRASP_CACHE``, else in the user's cache folder."""
    named = os.environ.get("CONTINUUM_GRASP_CACHE")
    if named:
        return Path(named) / kind
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "continuum_grasp" / kind


@dataclass(frozen=True)
class Cache:
    """Files of a kind that take long to make, stored by the content that they were made of.

    An entry is used only if it belongs to this user alone, its record names this very content, and the file's own hash
    is the recorded one, so that truncated, stale or foreign files are made again. Entries are written under a temporary
    name and then renamed, the record last; any number of processes may make the same one.
    """

    kind: str = "compiled"
    suffix: str = ".so"

    def entry(self, identity: str, build: Callable[[Path], Path], maker: str) -> Path:
        """Return the file of an identity; if it is missing, ``build`` writes it in an empty folder and returns its
        path.

        ``identity`` has everything that determines the file; ``maker`` is a note on its origin. OSError if no folder
        can be written or the disk is full.
        """
        folder = private_folder(self.kind)
        _remove_left_builds(folder)
        key, entry, record = _names(folder, identity, self.suffix)
        if _sound(entry, record, key):
            return entry
        with _build_folder(folder) as work:
            built, written = build(work), work / "record.json"
            written.write_text(json.dumps({"key": key, "sha256": _hash(built), "maker": maker}), encoding="utf-8")
            written.chmod(0o600)
            try:
                os.replace(built, entry)
                os.replace(written, record)
            except PermissionError:  # Windows replaces no library that a process has loaded
                if not _sound(entry, record, key):
                    raise
        return entry

    def known(self, identity: str) -> Path | None:
        """Return the file of an identity, which now counts as used; None if it does not exist."""
        folder = _lasting_folder(self.kind)
        key, entry, record = _names(folder or Path(), identity, self.suffix)
        if folder is None or not _sound(entry, record, key):
            return None
        with suppress(OSError):
            os.utime(entry)
        return entry

    def total(self, identity: str, more: float = 0.0) -> float:
        """Add to the number that is stored for an identity, which is zero at first and where no folder lasts.

        The last of several processes that add at the same moment counts alone.
        """
        folder = _lasting_folder(self.kind)
        if folder is None:
            return 0.0
        key, entry, _ = _names(folder, identity, self.suffix)
        total = more
        with suppress(OSError, ValueError):
            total += float(entry.read_text(encoding="ascii"))
        if more:
            with suppress(OSError):
                written = folder / f"{key}.{os.getpid()}"
                written.write_text(repr(total), encoding="ascii")
                os.replace(written, entry)
        return total

    @staticmethod
    @cache
    def hash_of_code(*packages: str) -> str:
        """Hash of the Python files of some packages of this one, for identities."""
        files = (file for name in packages for file in sorted((Path(__file__).parents[1] / name).rglob("*.py")))
        return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


def _names(folder: Path, identity: str, suffix: str) -> tuple[str, Path, Path]:
    """Key of an identity, and the files of its entry and of its record."""
    key = hashlib.sha256(identity.encode()).hexdigest()
    return key, folder / f"{key}{suffix}", folder / f"{key}.json"


@cache
def _remove_left_builds(folder: Path) -> None:
    """Remove, once in a process, the folders of builds that were killed."""
    for left in folder.glob("build-*"):
        with suppress(OSError):
            if _is_left(left):
                shutil.rmtree(left)


@contextmanager
def _build_folder(folder: Path) -> Iterator[Path]:
    """A folder for one build, with a locked file in it; the system unlocks that however the process ends."""
    with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as name:
        work = Path(name)
        with open(work / _LOCK, "wb") as file:
            if fcntl is not None:
                with suppress(OSError):  # file systems without locks
                    fcntl.flock(file, fcntl.LOCK_EX)
            yield work


def _is_left(build: Path) -> bool:
    """Whether no process works in a folder of a build any more."""
    # 2.0 * 3600.0: age of a finished build on systems without locks [s]; a compiler is stopped after half an hour
    if time.time() - build.lstat().st_mtime > (2.0 * 3600.0):
        return True
    if fcntl is None:
        return False
    with open(build / _LOCK, "rb") as file:  # a folder so young that it has none yet raises
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # raises while the process that builds there lives
    return True


def private_folder(kind: str = "compiled") -> Path:
    """Return the cache folder of a kind; a temporary one if no folder can be private to this user."""
    try:
        return _own_folder(kind)
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home folder
        return _temporary_folder(kind, str(error))


def _lasting_folder(kind: str) -> Path | None:
    """Return the cache folder of a kind; None if it cannot be private to this user."""
    with suppress(OSError, RuntimeError):
        return _own_folder(kind)
    return None


def _own_folder(kind: str) -> Path:
    folder = cache_folder(kind)
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    if not (_is_ours(folder) and os.access(folder, os.W_OK)):
        raise PermissionError(f"{folder} is open to others or cannot be written")
    return folder


@cache
def _temporary_folder(kind: str, why: str) -> Path:
    warnings.warn(f"the {kind} cache is stored for this process only: {why}", RuntimeWarning, stacklevel=2)
    folder = tempfile.mkdtemp(prefix="continuum_grasp-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _is_ours(path: Path) -> bool:
    """Whether a file or folder is no link, belongs to this user, and no other can read or write it."""
    state = path.lstat()
    mine = not hasattr(os, "getuid") or state.st_uid == os.getuid()
    return mine and not stat.S_ISLNK(state.st_mode) and (os.name == "nt" or not stat.S_IMODE(state.st_mode) & 0o077)


def _sound(library: Path, record: Path, key: str) -> bool:
    try:
        note = json.loads(record.read_text(encoding="utf-8"))
        ours = _is_ours(library) and _is_ours(record)
        return bool(ours and note["key"] == key and note["sha256"] == _hash(library))
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
