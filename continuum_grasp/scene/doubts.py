"""Doubts about implausible values, which are more likely slips than intended: warnings, or errors with ``--strict``."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple, TypeAlias

from pydantic import BaseModel

from continuum_grasp.base import InputError

_Path: TypeAlias = tuple[str | int, ...]


class Doubt(UserWarning):
    """An implausible value, more likely a slip, such as another unit, than intended."""


class CollectedDoubt(NamedTuple):
    """Doubt during the check of a document: key below a value, and the words after the key."""

    key: str
    text: str
    owner: BaseModel | None


_COLLECTED: ContextVar[list[CollectedDoubt] | None] = ContextVar("collected", default=None)


@contextmanager
def collected_doubts() -> Iterator[list[CollectedDoubt]]:
    """Collect doubts, to report them with their places in a file."""
    doubts: list[CollectedDoubt] = []
    token = _COLLECTED.set(doubts)
    try:
        yield doubts
    finally:
        _COLLECTED.reset(token)


def doubt(key: str, text: str, owner: BaseModel | None = None) -> None:
    """Warn of an implausible value at a key below ``owner``.

    During the check of a document the warning names file and line; otherwise it names the line of the user's code.
    """
    collected = _COLLECTED.get()
    if collected is not None:
        collected.append(CollectedDoubt(key, text, owner))
    else:
        warn_of_doubt(f"{type(owner).__name__}.{key} {text}" if owner is not None else f"{key} {text}")


def warn_of_doubt(text: str) -> None:
    """Warn, naming the line of the user's code."""
    # The number of pydantic's frames between this line and the user's line varies.
    frame, level = inspect.currentframe(), 1
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in (
        "continuum_grasp",
        "contextlib",
        "pydantic",
    ):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, Doubt, stacklevel=level)


@contextmanager
def doubts_refused() -> Iterator[None]:
    """Raise InputError with all doubts of the context, instead of warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    doubts = [str(each.message) for each in caught if issubclass(each.category, Doubt)]
    for each in caught:
        if not issubclass(each.category, Doubt):
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
    if doubts:
        raise InputError("\n".join(dict.fromkeys(doubts)))


def children(value: BaseModel, path: _Path = ()) -> Iterator[tuple[_Path, BaseModel]]:
    """Yield a value and all values inside it, each with its path."""
    yield path, value
    for name, entry in value:
        yield from _below(entry, (*path, name))


def _below(entry: Any, path: _Path) -> Iterator[tuple[_Path, BaseModel]]:
    if isinstance(entry, BaseModel):
        yield from children(entry, path)
    elif isinstance(entry, dict):
        for key, each in entry.items():
            yield from _below(each, (*path, key))
    elif isinstance(entry, tuple):
        for k, each in enumerate(entry):
            yield from _below(each, (*path, k))
