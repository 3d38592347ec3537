"""Writing the files of a package into its folder, in which there may be an earlier one."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from continuum_grasp.errors import InputError

__all__ = ["MANIFEST", "write_package"]

MANIFEST = "MANIFEST.json"


def write_package(folder: Path, files: Mapping[str, str]) -> None:
    """Every file whole, the manifest last; files of an earlier package that are of no more use are removed.

    Raises
    ------
    InputError
        If a file of that name is there that no export wrote, or that was changed since; nothing is written then.
    """
    from continuum_grasp.results import kind_of_run, write_text

    kind = kind_of_run(folder)
    if kind not in (None, "export-c"):
        raise InputError(f"{folder} holds a run of {kind}: take another folder", key="folder")
    earlier = _earlier(folder)
    for name, text in files.items():
        path = folder / name
        if path.exists() and _digest(path) not in (hashlib.sha256(text.encode()).hexdigest(), earlier.get(name)):
            raise InputError(f"{path} is not as an export left it: move it away, or take another folder", key="folder")
    for name in earlier.keys() - files.keys():
        path = folder / name
        if path.resolve().is_relative_to(folder.resolve()) and path.is_file() and _digest(path) == earlier[name]:
            path.unlink()
    for name, text in files.items():
        write_text(text, folder / name)


def _earlier(folder: Path) -> dict[str, str]:
    """SHA-256 of the files of the package that is there, its manifest included; empty where there is none."""
    path = folder / MANIFEST
    try:
        listed = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        digests = {str(name): str(digest) for name, digest in listed["sha256"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
    return digests | {MANIFEST: _digest(path)} if "configuration_hash" in listed else {}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
