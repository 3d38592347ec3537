"""Files of exports by the mark at their begin: others are not written over."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from continuum_grasp.base import InputError
from continuum_grasp.results import check_folder

_HEAD = 4096
"""Bytes at the begin of a file within which an export names its maker [1]."""


def is_marked(file: Path, mark: bytes = b"continuum_grasp") -> bool:
    """Whether a file begins like one of an export, or has no content."""
    with open(file, "rb") as stream:
        head = stream.read(_HEAD)
    return not head or mark in head


def check_file(file: Path, is_own: Callable[[Path], bool] = is_marked) -> None:
    """Refuse a file that cannot be written, or that is there and of no export."""
    check_folder(file.absolute().parent)
    if file.is_dir():
        raise InputError("expected the name of a file, got a folder", file=str(file))
    if file.exists() and not is_own(file):
        raise InputError("no export wrote this file: move it away, or choose another name", file=str(file))
