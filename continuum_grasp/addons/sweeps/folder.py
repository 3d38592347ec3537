"""The folder of a sweep: its plan, its table as it grows, and the runs; one process works in it at a time.

A row of the table is a line of JSON that states whether it is whole, so that a killed process spoils none.
"""

from __future__ import annotations

import json
import mmap
import os
import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

from continuum_grasp.addons.sweeps.plan import SweepPlan, differences
from continuum_grasp.base import InputError
from continuum_grasp.results import (
    Run,
    begin_run,
    check_folder,
    locked,
    naming,
    provenance,
    write_text,
)
from continuum_grasp.scene import refuse_what_is_no_file

PLAN = "sweep.json"
TABLE = "table.jsonl"
_LOCK = ".lock"
_TAIL = len(b',"check":"00000000"}\n')
SOLVED = ("optimal", "feasible")
"""Statuses that mean a verified grasp."""
_ABOUT = ("name", "created", "versions", "columns", "units", "pictures")
"""Entries of the stored plan that do not decide the computation."""


def store_plan(folder: Path, plan: SweepPlan) -> list[str]:
    """Write the plan into a new folder, or compare it with the one that is there: what to know before work goes on.

    Another plan in it, or a table without one, raises an InputError.
    """
    new = plan.as_json()
    pictures = plan.pictures
    now = provenance()
    if not (folder / PLAN).exists():
        if (folder / TABLE).exists():
            raise InputError(f"the folder has {TABLE} but no {PLAN}; choose another folder", file=str(folder))
        check_folder(folder, "sweep")
        begin_run(folder, "sweep")
        about = {"name": plan.sweep.name, "created": now["created"], "versions": now["versions"]}
        _write(folder, {**about, "columns": list(plan.columns), "units": plan.units, "pictures": pictures, **new})
        return []
    old = read_plan(folder)
    changed = differences({key: value for key, value in old.items() if key not in _ABOUT}, new)
    if changed:
        raise InputError(
            "the folder holds a sweep with another plan: "
            + "; ".join(changed)
            + ". Choose another folder, or remove this one to start over",
            file=str(folder),
        )
    if old.get("pictures") != pictures:  # which decide nothing that is computed
        begin_run(folder, "sweep", retained=(PLAN,))
        _write(folder, {**old, "pictures": pictures})
    was = old.get("versions", {})
    other = [f"{name} {was.get(name)}, now {here}" for name, here in now["versions"].items() if was.get(name) != here]
    return [f"the rows so far were computed with other versions: {', '.join(other)}"] if other else []


def _write(folder: Path, plan: Mapping[str, Any]) -> None:
    write_text(json.dumps(plan, indent=1, ensure_ascii=False) + "\n", folder / PLAN)


def read_plan(folder: Path) -> dict[str, Any]:
    """The plan that a folder holds. Raises an InputError where there is none, or it cannot be read."""
    path = folder / PLAN
    refuse_what_is_no_file(path)
    try:
        plan = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"no sweep in this folder: there is no {PLAN}", file=str(folder)) from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", file=str(path)) from None
    if not isinstance(plan, dict) or not {"scenes", "vary", "sample", "follow", "record"} <= plan.keys():
        raise InputError("not the plan of a sweep", file=str(path))
    return plan


def encode(row: Mapping[str, Any]) -> bytes:
    """A row as a line of JSON that ends with the CRC-32 of what stands before it."""
    text = json.dumps(row, separators=(",", ":"), ensure_ascii=True, allow_nan=False).encode("ascii")
    return b'%s,"check":"%08x"}\n' % (text[:-1], zlib.crc32(text))


def decode(line: bytes) -> dict[str, Any] | None:
    """The row of a line; None where the line is torn or damaged."""
    body = line[:-_TAIL] + b"}"
    tail = line[-_TAIL:]
    if tail != b',"check":"%08x"}\n' % zlib.crc32(body):
        return None
    try:
        row = json.loads(body)
    except ValueError:
        return None
    return row if isinstance(row, dict) else None


def rows_of(folder: Path, count: int) -> Iterator[dict[str, Any]]:
    """Row of each of ``count`` scenes that has one; damaged lines are left out."""
    path = folder / TABLE
    seen = bytearray(count)
    refuse_what_is_no_file(path)
    with suppress(FileNotFoundError), open(path, "rb") as file:
        for line in file:
            row = decode(line)
            index = None if row is None else row.get("index")
            # The first row counts: where the file system has no locks, two processes may have worked on a scene.
            if row is not None and isinstance(index, int) and 0 <= index < count and not seen[index]:
                seen[index] = 1
                yield row


class TableFile:
    """The growing table: whole lines are appended, each in one write, and nothing in it is ever changed.

    Every line is handed to the system at once, so that a killed process loses none; the disk is asked to keep them
    every two seconds, so that a power cut costs no more than that. A torn line at its end, of a process that was
    killed, is cut off.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        refuse_what_is_no_file(path)
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o644)
        if os.fstat(self._handle).st_size:
            with mmap.mmap(self._handle, 0, access=mmap.ACCESS_READ) as content:
                whole = content.rfind(b"\n") + 1
            os.ftruncate(self._handle, whole)
        self._flushed = time.monotonic()

    def append(self, lines: bytes) -> None:
        """Add whole lines."""
        view = memoryview(lines)
        with naming(self._path):
            while view:  # the system may take a part of it
                view = view[os.write(self._handle, view) :]
            # 2.0: time between two writes to the disk [s]: what a loss of power can cost
            if time.monotonic() - self._flushed > 2.0:
                os.fsync(self._handle)
                self._flushed = time.monotonic()

    def close(self) -> None:
        """Have everything on the disk."""
        try:
            with naming(self._path):
                os.fsync(self._handle)
        finally:
            os.close(self._handle)


def run_path(folder: Path, index: int) -> Path:
    """The folder of one run; a thousand of them to a folder."""
    return folder / "runs" / f"{index // 1000:04d}" / f"{index:07d}"


def write_run_file(folder: Path, index: int, content: bytes) -> None:
    Run.write_packed(run_path(folder, index), content)


def held_folder(folder: Path) -> AbstractContextManager[None]:
    """Make the folder, and keep other processes from it."""
    folder.mkdir(parents=True, exist_ok=True)
    refuse_what_is_no_file(folder / _LOCK)
    return locked(folder / _LOCK, folder, "sweep")
