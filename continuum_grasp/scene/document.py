"""Plain data that remembers where each part of it was written; what can be read as a file."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from continuum_grasp.base import InputError
from continuum_grasp.scene.doubts import warn_of_doubt

KeyPath = tuple[str | int, ...]


@dataclass(frozen=True)
class Place:
    """Positions of a value and of its key in a file; lines and columns count from 1, None outside a file.

    Paths are relative to ``folder``. If it is None, they are relative to the folder of the file; without a file, to
    that of the main file.
    """

    file: str
    line: int | None = None
    column: int | None = None
    key_line: int | None = None
    key_column: int | None = None
    folder: Path | None = None

    def error(self, message: str, path: KeyPath = ()) -> InputError:
        """An error that says it is about what stands here."""
        key = dotted(path) or None
        return InputError(message, file=self.file, line=self.line, column=self.column, key=key)

    def named_file(self, target: str, main: Path, what: str, path: KeyPath) -> Path:
        """The file that is named here, which must exist; ``main`` is the main file."""
        file = (self.folder or (main if self.line is None else Path(self.file)).parent) / target
        if not file.is_file():
            raise self.error(f"no such {what}: {os.path.normpath(file)}", path)
        return file


@dataclass
class Document:
    """Plain data and the place of each entry.

    ``value`` holds dict, list, str, int, float, bool and None; ``places`` maps paths of entries, such as ``("finger",
    "masses", 0, "at")``, to their places in files. Files whose keys are ``varied`` are not inserted; ``notes`` describe
    the contents of files by key.
    """

    value: Any
    places: dict[KeyPath, Place] = field(default_factory=dict)
    varied: tuple[KeyPath, ...] = ()
    notes: list[str] = field(default_factory=list)

    @classmethod
    def at(cls, place: Place, value: Any) -> Document:
        """A value as a document all of whose entries come from the same place."""
        return Document(plain(value), {(): place})

    @staticmethod
    def path_of(key: str, name: str) -> KeyPath:
        """Parse a path such as ``finger.masses[0].mass``; errors use ``name`` for the place of the text."""
        path = tuple(int(part) if str(part).isdecimal() else part for part in undotted(key))
        # A skipped character, such as an open bracket, is missing when the path is written again.
        if not path or re.search(r"\s", key) or dotted(path) != re.sub(r"\.(\d+)(?=\.|\[|$)", r"[\1]", key):
            raise InputError(f"expected a key path such as finger.masses[0].mass, got {key!r}", file=name)
        return path

    def get(self, path: KeyPath) -> Any:
        """The value at a path that exists."""
        value = self.value
        for part in path:
            value = value[part]
        return value

    def place(self, path: KeyPath) -> Place:
        """Position of ``path``, or of the nearest path above it: values that were set from outside share one
        position.
        """
        while path and path not in self.places:
            path = path[:-1]
        return self.places[path]

    def nearest(self, path: KeyPath, *, at_key: bool = False) -> Place:
        """Position of ``path``, or of the key that it would stand in."""
        place = self.place(path)
        if (at_key or path not in self.places) and place.key_line is not None:
            return Place(place.file, place.key_line, place.key_column)
        return Place(place.file, place.line, place.column)

    def placed_error(self, error: InputError) -> InputError:
        path = undotted(error.key or "")
        return self.nearest(path).error(error.message, path)

    def doubt(self, key: str, text: str) -> None:
        """Warn of an implausible value at a key, with its place."""
        warn_of_doubt(str(self.nearest(undotted(key)).error(f"{key} {text}")))

    def part(self, path: KeyPath) -> Document:
        """The part of the document below ``path``, as a document of its own."""
        count = len(path)
        places = {p[count:]: place for p, place in self.places.items() if p[:count] == path}
        return Document(self.get(path), {(): self.place(path), **places})

    def put(self, path: KeyPath, new: Document) -> None:
        """Set the entry at ``path``, whose parent exists."""
        self.forget(path)
        self.places.update({path + p: place for p, place in new.places.items()})
        if path:
            self.get(path[:-1])[path[-1]] = new.value
        else:
            self.value = new.value

    def override(self, path: KeyPath, new: Document) -> None:
        """Set one entry from outside; mappings above it that are missing are made."""
        place = new.places[()]
        value = self.value
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
            inner = value.get(part) if isinstance(value, dict) else value[part]
            if inner is None:
                inner = {}
                self.put(path[: k + 1], Document(inner, {(): place}))
            value = inner
        self.put(path, new)

    def write_out(self, path: KeyPath, value: Any) -> None:
        """Write the defaults above ``path`` of the scene value whose data this is: a change there leaves their rest."""
        for k, part in enumerate(path[:-1]):
            value = child(value, part)
            if value is None:
                return
            here = self.get(path[:k])
            if isinstance(here, dict) and part not in here:
                here[part] = plain(value)

    def forget(self, path: KeyPath) -> None:
        """Drop the places at and below ``path``."""
        for p in [p for p in self.places if p[: len(path)] == path]:
            del self.places[p]

    def merged(self, other: Document) -> Document:
        """A copy with the keys of the other laid over its own; mappings merge, all else is replaced."""
        if not (isinstance(self.value, dict) and isinstance(other.value, dict)):
            return other
        result = Document(dict(self.value), {**self.places, (): other.places[()]})
        for key in other.value:
            new = other.part((key,))
            result.put((key,), self.part((key,)).merged(new) if key in self.value else new)
        return result


def dotted(path: KeyPath) -> str:
    """A path as users write it: ``finger.masses[0].at``."""
    words = (f"[{part}]" if isinstance(part, int) else f".{_printable(part)}" for part in path)
    return "".join(words).removeprefix(".")


def undotted(text: str) -> KeyPath:
    """The path that `dotted` writes so."""
    parts = re.findall(r"([^.\[\]]+)|\[(\d+)\]", text)
    return tuple(int(index) if index else name for name, index in parts)


def _printable(key: str) -> str:
    return key if key and key.isprintable() and len(key) <= 60 else repr(key[:60])


def plain(value: Any) -> Any:
    """Scene values, mappings and sequences as the dict and list that a file would have, without unset defaults.

    A default that is the only choice stays: where several classes may stand, it says which one this is.
    """
    if hasattr(value, "model_fields_set"):
        fields = type(value).model_fields.items()
        stated = (name for name, field in fields if name in value.model_fields_set or _is_tag(field.annotation))
        return {name: plain(getattr(value, name)) for name in stated}
    if isinstance(value, Mapping):
        return {key: plain(child) for key, child in value.items()}
    return [plain(child) for child in value] if isinstance(value, list | tuple) else value


def _is_tag(kind: Any) -> bool:
    return get_origin(kind) is Literal and len(get_args(kind)) == 1


def child(value: Any, part: str | int) -> Any:
    """Return the entry of a scene value, mapping or sequence; None if it does not exist."""
    if hasattr(value, "model_fields_set"):
        return getattr(value, part, None) if isinstance(part, str) and part in type(value).model_fields else None
    try:
        return value[part]
    except (KeyError, IndexError, TypeError):
        return None


Change = tuple[KeyPath, Document]
"""A path, and the document that is put there."""


def refuse_what_is_no_file(path: str | os.PathLike[str], name: str | None = None) -> None:
    """Refuse folders, pipes and devices, which have no end or wait for a writer; a missing file passes.

    Errors call the file ``name`` instead of its path.
    """
    file = Path(path)
    try:
        if file.is_file() or not file.exists():
            return
    except (OSError, ValueError):  # opening it says why
        return
    what = "a folder" if file.is_dir() else "a pipe" if file.is_fifo() else "a device or socket"
    raise InputError(f"expected a file, got {what}", file=name or os.fspath(path))


def text_of(path: str | os.PathLike[str], most: int, name: str | None = None) -> str:
    """Return the text of a file in UTF-8 with a limited number of bytes, without the byte order mark of Windows
    editors.

    InputError if the file cannot be read, is longer, or is not UTF-8. Errors call it ``name`` instead of its path.
    """
    name = name or os.fspath(path)
    refuse_what_is_no_file(path, name)
    try:
        with open(path, "rb") as stream:
            data = stream.read(most + 1)  # its size is not asked first: it may grow meanwhile
    except FileNotFoundError:
        raise InputError("no such file", file=name) from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {getattr(error, 'strerror', None) or error}", file=name) from None
    if len(data) > most:
        raise InputError(f"the file is too large; expected at most {most} bytes", file=name)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError("the file is not UTF-8 text", file=name, line=line) from None
