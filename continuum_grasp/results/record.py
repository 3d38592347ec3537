"""Record of the versions that made a run and of the files in its folder, which alone the next run there removes."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import platform
import re
import secrets
from collections.abc import Collection, Iterator
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from continuum_grasp.base import InputError

_PACKAGES = {"continuum_grasp": "continuum-grasp", "casadi": "casadi", "numpy": "numpy"}


@functools.cache
def _versions() -> dict[str, str]:
    """Versions of Python, the package, CasADi and numpy, ``"not installed"`` in a plain checkout; not to be changed."""
    installed = {"python": platform.python_version()}
    for name, distribution in _PACKAGES.items():
        try:
            installed[name] = metadata.version(distribution)
        except metadata.PackageNotFoundError:
            installed[name] = "not installed"
    return installed


def _machine() -> dict[str, str]:
    """Operating system, its release, processor architecture and Python implementation; no host or user name."""
    return {
        "system": platform.system(),
        "release": platform.release(),
        "architecture": platform.machine(),
        "implementation": platform.python_implementation(),
    }


def provenance() -> dict[str, Any]:
    """Time of now, ``created`` in UTC as ISO 8601 to the second, ``versions`` of the software, and ``platform``."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {"created": now, "versions": _versions(), "platform": _machine()}


RECORD = ".run.json"
_TEMPORARY = re.compile(r"\.tmp-(\d+)-[0-9a-f]{12}-.")


def begin_run(folder: str | os.PathLike[str], kind: str | None = None, *, retained: Collection[str] = ()) -> Path:
    """Make a folder the folder of a new run: files that an earlier run wrote and that have not changed since are
    removed.

    A file is recorded with its content's SHA-256 before it gets its name, so a process killed at any instant leaves
    no file of its own unrecorded. Files that no run wrote, and files changed since, stay; so do the ``retained`` files,
    which the caller replaces next, or which belong to this run already: the record takes them over. ``kind`` is the
    command of the run.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    old = _read(target)
    _remove(target, old, retained)
    for path in target.glob(".tmp-*"):
        match = _TEMPORARY.match(path.name)
        if match and not _alive(int(match[1])):  # of a process that was killed
            path.unlink(missing_ok=True)
    # Recorded before the caller replaces them, so that a kill in between leaves them known.
    files = {
        name: sorted({*old["files"].get(name, ()), _digest(target / name)})
        for name in retained
        if (target / name).is_file()
    }
    _write(target, {"kind": kind, "files": files, "parts": []})
    return target


def kind_of_run(folder: str | os.PathLike[str]) -> str | None:
    """The command whose run or C package is in a folder; None where there is none, or it does not say."""
    kind = _read(Path(folder))["kind"]
    if isinstance(kind, str):
        return kind
    manifest = Path(folder) / "MANIFEST.json"
    try:
        return "export" if manifest.is_file() and "configuration_hash" in json.loads(manifest.read_bytes()) else None
    except (OSError, ValueError, TypeError):
        return None


def is_run_folder(folder: Path) -> bool:
    """Whether a folder has a record of the files that a run wrote."""
    return bool(_read(folder)["known"])


def check_own(target: Path) -> None:
    """Refuse to replace a file that no run wrote into its folder, or that has changed since."""
    if not target.exists() and not target.is_symlink():
        return
    is_file = target.is_file() and not target.is_symlink()
    if not is_file or _digest(target) not in _read(target.parent)["files"].get(target.name, ()):
        message = "no run wrote this file, or it has changed since: move it away, or choose another folder"
        raise InputError(message, file=str(target))


def note_file(target: Path, content: Path) -> None:
    """Record a file that is about to get its name, if its folder belongs to a run."""
    record = _read(target.parent)
    if record["known"]:
        known = record["files"].get(target.name, [])  # also of the file it replaces, should that never happen
        digests = sorted({*known, _digest(content)})
        _write(target.parent, {**record, "files": {**record["files"], target.name: digests}})


def note_part(folder: Path, name: str) -> None:
    """Record that the run in a folder below, of this name, belongs to this one: the next run here removes it too."""
    record = _read(folder)
    if record["known"]:
        _write(folder, {**record, "parts": sorted({*record["parts"], name})})


def _remove(folder: Path, record: dict[str, Any], but: Collection[str] = ()) -> None:
    for name, digests in record["files"].items():
        path = folder / name
        if name not in but and _is_plain(name) and not path.is_symlink() and _digest(path) in digests:
            path.unlink()
    for name in record["parts"]:
        part = folder / name
        if _is_plain(name) and part.is_dir() and not part.is_symlink():
            _remove(part, _read(part))
            (part / RECORD).unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # something else is in it
                part.rmdir()


def _read(folder: Path) -> dict[str, Any]:
    """The record of a folder, empty where there is none or it is damaged."""
    path = folder / RECORD
    try:
        record = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        files = {str(name): [str(digest) for digest in digests] for name, digests in record["files"].items()}
        return {"known": True, "kind": record["kind"], "files": files, "parts": [str(name) for name in record["parts"]]}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {"known": False, "kind": None, "files": {}, "parts": []}


def _write(folder: Path, record: dict[str, Any]) -> None:
    text = json.dumps({key: record[key] for key in ("kind", "files", "parts")}, indent=1) + "\n"
    with swapped(folder / RECORD) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextlib.contextmanager
def swapped(target: Path, mark: str | None = None) -> Iterator[Path]:
    """A temporary name in the folder of a file, which gets the file's name where nothing is raised, and else goes.

    ``mark`` is a part of that name, by which others know whose it is; by default its own, by this process.
    """
    own = f"{os.getpid()}-{secrets.token_hex(6)}-" if mark is None else mark
    # In the same folder, since a rename is atomic within one file system only.
    temporary = target.with_name(f".tmp-{own}{target.name}")
    try:
        with naming(target, temporary):
            yield temporary
            os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def naming(path: Path, temporary: Path | None = None) -> Iterator[None]:
    """Have errors of the system name this file where they name none, as on a full disk, or a temporary one."""
    try:
        yield
    except OSError as error:
        if error.filename is None or (temporary is not None and error.filename in (temporary, str(temporary))):
            error.filename = str(path)
            error.filename2 = None
        raise


def _is_plain(name: str) -> bool:
    return bool(name) and name not in (".", "..") and not set(name) & set("/\\:\0")


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "none"


def _alive(process: int) -> bool:
    """Whether a process of that number runs on this machine, or may."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)  # signal 0 only asks
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
