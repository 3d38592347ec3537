"""Fields of messages of ROS 2, as the library for bags decodes them, by paths such as ``position.x`` or ``data[0]``."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

from continuum_grasp.base import InputError

_ENTRY = r"\[[^\[\]]+\]"
PATH = re.compile(rf"[A-Za-z]\w*({_ENTRY})*(\.[A-Za-z]\w*({_ENTRY})*)*")
"""Path of a field: entries of lists by number from 0, or by name."""
_PART = re.compile(rf"{_ENTRY}|\w+")
_NAMES = ("name", "names", "joint_names", "interface_names")
"""Fields that name the entries of neighboring lists, as in sensor_msgs/JointState, control_msgs and trajectory_msgs."""
_IDENTITIES = ("child_frame_id", "name", "id", "marker_name", "rigid_body_name")
"""Fields that name the owner of each message in a list, as in tf2_msgs/TFMessage and motion capture."""


class EntryName(str):
    """Name of an entry of a list, in a path."""


Part = str | int | EntryName


def parts_of(path: str) -> tuple[Part, ...]:
    return tuple(_part(text) for text in _PART.findall(path))


def _part(text: str) -> Part:
    if not text.startswith("["):
        return text
    inside = text[1:-1].strip()
    return int(inside) if inside.isdecimal() else EntryName(inside)


def is_entry(part: Part) -> bool:
    return isinstance(part, (int, EntryName))


def joined(parts: Sequence[Part]) -> str:
    return "".join(f"[{part}]" if is_entry(part) else f".{part}" for part in parts).removeprefix(".")


def leaves(message: Any) -> Iterator[str]:
    """Fields of a message that are no messages themselves; lists by their first entry."""
    for name in type(message).__slots__:
        value = getattr(message, name)
        if isinstance(value, SimpleNamespace):
            yield from (f"{name}.{leaf}" for leaf in leaves(value))
        elif isinstance(value, (str, int, float)):
            yield name
        elif len(value) and isinstance(value[0], SimpleNamespace):
            yield from (f"{name}[0].{leaf}" for leaf in leaves(value[0]))
        else:
            yield f"{name}[0]"


def is_number(message: Any, path: str) -> bool:
    """Whether a path leads to a number without passing a list."""
    if "[" in path:
        return False
    for part in parts_of(path):
        message = getattr(message, str(part))
    return isinstance(message, (int, float))


class _Names(NamedTuple):
    """Source of the names of the entries of a list.

    ``field`` is a field of the message that is ``depth`` parts down the path; with the depth None, a field of each
    entry.
    """

    field: str
    depth: int | None


class FieldReader:
    """Read one field of the messages of a topic.

    If messages name the entries of their lists, each message is searched by name, because a driver may change the order
    or leave joints out. A number stands for the entry with that number in the first message.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        self._parts = parts
        self._sources: dict[int, _Names | None] | None = None
        self._keys: dict[int, Hashable] = {k: str(part) for k, part in enumerate(parts) if isinstance(part, EntryName)}

    def cell(self, message: Any) -> str:
        """Return text that reads back as the same number; empty if the message lacks the entry."""
        value = self.value(message)
        if isinstance(value, bool):
            return str(int(value))
        return "" if value is None else repr(value) if isinstance(value, float) else str(value).strip()

    def value(self, message: Any) -> Any:
        """Return the value of the field; None if the message lacks the entry."""
        if self._sources is None:
            self._sources = _sources(message, self._parts)
        if self._sources is None:
            return None
        passed = [message]
        for place, part in enumerate(self._parts):
            if not is_entry(part):
                message = getattr(message, str(part))
            else:
                number = self._number(place, message, passed, self._sources[place])
                if number is None or number >= len(message):
                    return None
                message = message[number]
            passed.append(message)
        return message

    def _number(self, place: int, entries: Any, passed: Sequence[Any], source: _Names | None) -> int | None:
        """Return the number of an entry in the list of a message."""
        part = self._parts[place]
        names = [] if source is None else _names(source, entries, passed)
        if not names or len(set(names)) < len(names):
            if isinstance(part, int):
                return part
            if len(entries):
                raise InputError(f"nothing names the entries of {joined(self._parts[:place])}: give a number")
            return None
        if len(entries) not in (0, len(names)):
            raise InputError(
                f"a message has {len(names)} names and {len(entries)} entries of {joined(self._parts[:place])}"
            )
        if isinstance(part, int) and place not in self._keys:
            if part >= len(names):
                return None
            self._keys[place] = names[part]
        key = self._keys[place]
        return names.index(key) if key in names else None


def _names(source: _Names, entries: Any, passed: Sequence[Any]) -> list[Hashable]:
    if source.depth is None:
        return [getattr(entry, source.field) for entry in entries]
    return list(getattr(passed[source.depth], source.field))


def _sources(message: Any, parts: Sequence[Part]) -> dict[int, _Names | None] | None:
    """Return the source of the names of each list on a path, by its place in the path; None if a list is empty.

    Names of a message belong to the innermost list below it without names: in a DynamicJointState, joints name the
    outer list and interfaces the inner one; in a JointTrajectory, joints name the positions of all points.
    """
    messages = dict[int, Any]()
    sources = dict[int, _Names | None]()
    for place, part in enumerate(parts):
        if not is_entry(part):
            messages[place] = message
            message = getattr(message, str(part))
        elif not len(message):
            return None
        else:
            message = message[0]
            sources[place] = None
            field = next((name for name in _IDENTITIES if isinstance(getattr(message, name, None), (str, int))), None)
            if field is not None:
                sources[place] = _Names(field, None)
    for depth in reversed(messages):
        field = next((name for name in _NAMES if _is_list_of_texts(getattr(messages[depth], name, None))), None)
        free = [place for place, source in sources.items() if place > depth and source is None]
        if field is not None and free and parts[depth] != field:
            sources[free[-1]] = _Names(field, depth)
    return sources


def _is_list_of_texts(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and all(isinstance(entry, str) for entry in value)
