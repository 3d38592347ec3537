"""Changes to a configuration from outside its file: ``key.path=value``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from continuum_grasp.errors import InputError
from continuum_grasp.scene.document import Change, Document, KeyPath, Place, dotted
from continuum_grasp.scene.yaml_loader import parse_yaml

__all__ = ["Overrides", "apply_override", "path_of", "placed", "read_overrides"]

Overrides = Iterable[str] | Mapping[str, Any]
_PART = re.compile(r"([^.\[\]\s]+)|\[(\d+)\]")


def read_overrides(overrides: Overrides) -> list[Change]:
    """Read overrides, given as ``"key.path=value"`` texts or as a mapping from key path to value.

    Values in texts are read as YAML; entries of lists are ``masses[0]`` or ``masses.0``.

    Raises
    ------
    InputError
        Where a text is not of that form.
    """
    if isinstance(overrides, Mapping):
        named = ((_word(key), value) for key, value in overrides.items())
        return [(path_of(key, key), placed(value, Place(f"override {key}"))) for key, value in named]
    if isinstance(overrides, str) or not isinstance(overrides, Iterable):
        raise InputError(f"overrides: expected a list of key.path=value texts, or a mapping, got {overrides!r:.60}")
    return [_read(_word(text)) for text in overrides]


def _word(given: Any) -> str:
    if not isinstance(given, str):
        raise InputError(f"overrides: expected a text, got {given!r:.60}")
    return given


def _read(text: str) -> tuple[KeyPath, Document]:
    name = f"--set {text}"
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError("expected key.path=value", file=name)
    path = path_of(key.strip(), name)
    try:
        document = parse_yaml(value, name)
    except InputError as error:
        raise InputError(error.message, file=name, key=dotted(path)) from None
    return path, placed(document.value, Place(name))


def path_of(key: str, name: str) -> KeyPath:
    """The path that a text such as ``finger.masses[0].mass`` means; ``name`` says in errors where it stands.

    Raises
    ------
    InputError
        Where it is no such text.
    """
    parts: list[str | int] = []
    for word, index in _PART.findall(key):
        parts.append(int(index or word) if (index or word).isdecimal() else word)
    if not parts or dotted(tuple(parts)) != re.sub(r"\.(\d+)(?=\.|\[|$)", r"[\1]", key):
        raise InputError(f"expected a key path such as finger.masses[0].mass, got {key!r}", file=name)
    return tuple(parts)


def placed(value: Any, place: Place) -> Document:
    """A value as a document all of whose entries come from the same place."""
    document = Document(None, {(): place})
    if isinstance(value, Mapping):
        document.value = {}
        for key, child in value.items():
            document.put((key,), placed(child, place))
    elif isinstance(value, list | tuple):
        document.value = [None] * len(value)
        for k, child in enumerate(value):
            document.put((k,), placed(child, place))
    else:
        document.value = value
    return document


def apply_override(document: Document, path: KeyPath, new: Document) -> None:
    """Set one entry; mappings above it that are missing are made.

    Raises
    ------
    InputError
        Where the way leads through a number, or past the end of a list.
    """
    place = new.places[()]
    value = document.value
    for k, part in enumerate(path):
        here = path[:k]
        if isinstance(part, int):
            count = len(value) if isinstance(value, list) else 0
            if part >= count:
                what = f"has {count} entries" if isinstance(value, list) else "is not a list"
                raise place.error(f"no entry [{part}]: {dotted(here)} {what}", path)
        elif not isinstance(value, dict):
            raise place.error(f"{dotted(here) or 'the file'} has no keys", path)
        if k == len(path) - 1:
            break
        child = value.get(part) if isinstance(value, dict) else value[part]
        if child is None:
            child = {}
            document.put(path[: k + 1], Document(child, {(): place}))
        value = child
    document.put(path, new)
