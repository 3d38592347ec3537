"""Bags of ROS 2, in MCAP or SQLite files: fields of messages as columns of a table."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from continuum_grasp.base import InputError, nearest
from continuum_grasp.scene.bag_fields import PATH, Part, is_entry, is_number, joined, leaves, parts_of
from continuum_grasp.scene.bag_file import MAGIC, BagFile, why
from continuum_grasp.scene.bag_rows import BagCells, FieldColumn, header_of, led, together
from continuum_grasp.scene.bag_sqlite import MAGIC as SQLITE
from continuum_grasp.scene.bag_topics import field_name

_UNIT = re.compile(r"(.*?)\s+\[([^\[\]]+)\]")
"""Column with its unit: a blank tells the unit from the number of an entry, as in position[0]."""
_SUFFIXES = (".mcap", ".db3")
_LISTED = 12
"""Topics and fields that an error lists [1]: more do not fit on a screen."""


def bag_files(path: str | Path) -> list[Path]:
    """Return the files of a bag: all files of a folder from ``ros2 bag record``, in order; any other path unchanged."""
    folder = Path(path)
    if not is_bag_folder(folder):
        return [folder]
    files = [each for each in folder.iterdir() if each.suffix.lower() in _SUFFIXES]
    if not files:
        others = ", ".join(sorted(each.name for each in folder.iterdir())[:_LISTED])
        message = f"expected a bag with files {' or '.join(_SUFFIXES)}, got a folder with {others}"
        raise InputError(f"{message}: decompress the bag first, or name a file", file=str(path))
    return sorted(files, key=_number_of)


def is_bag_folder(path: Path) -> bool:
    """Whether a path is a folder from ``ros2 bag record``."""
    return (path / "metadata.yaml").is_file()


def _number_of(file: Path) -> tuple[int, str]:
    """Return the number at the end of a file name of a bag, such as 10 for recorded_10.mcap."""
    number = re.search(r"(\d+)$", file.stem)
    return (int(number[1]) if number else -1), file.name


def is_bag(path: str | Path) -> bool:
    """Whether a path is a bag: its folder, or a file that is MCAP or SQLite by its first bytes or its name.

    False for a file that cannot be read: its reader reports that.
    """
    try:
        if Path(path).is_dir():
            return is_bag_folder(Path(path))
        with open(path, "rb") as stream:
            return stream.read(len(SQLITE)).startswith((MAGIC, SQLITE)) or Path(path).suffix.lower() in _SUFFIXES
    except (OSError, ValueError):
        return False


def bag_cells(
    path: str | Path,
    columns: Sequence[str],
    leader: str | None = None,
    stamps: str | None = None,
    max_age: float | None = None,
) -> BagCells:
    """Read columns of a bag: ``/topic.field``, ``/topic`` for its stamps, or the name of a field of one topic alone.

    With a ``leader``, one of the columns, rows are the messages of its topic, and columns of other topics have the last
    value that is no older than ``max_age`` [s], without one the value of the same stamp. Else a row has the messages of
    one stamp, whatever their topic, and a column ``t`` counts from the first stamp on [s]; columns that no topic has
    are left out unless they name one. Without ``columns``, all fields that are numbers.
    """
    bag = _Bag(str(path), [BagFile(str(file)) for file in bag_files(path)], stamps or "header")
    return bag.table(columns, leader, max_age)


class _Bag:
    """Open bag: one file, or the files of a split recording."""

    def __init__(self, path: str, files: Sequence[BagFile], stamps: str) -> None:
        self.file = path
        self.by_header = stamps == "header"
        self._files = files
        self.topics: dict[str, tuple[Any, Any]] = {}
        for file in files:
            self.topics = file.channels() | self.topics
        self._first = dict[str, Any]()

    def error(self, message: str, key: str | None = None) -> InputError:
        """An error about the file; ``key`` is the column, or the argument, that is at fault."""
        return InputError(message, file=self.file, key=key)

    def table(self, columns: Sequence[str], leader: str | None, max_age: float | None) -> BagCells:
        texts = dict.fromkeys(columns if leader is None else (leader, *columns))
        found = [self._column(text, needed=leader is not None or text.startswith("/")) for text in texts]
        known = [*{column.heading: column for column in found if column is not None}.values()]
        if leader is None:
            return together(self, known if columns else self._all())
        return led(self, known, max_age)

    # -- topics and fields --------------------------------------------------------------------------------------------

    def read(self, work: Callable[[Any], Any]) -> list[Any]:
        """Yield items that are read from each file; `InputError` if a file is cut off or damaged."""
        return [file.read(work) for file in self._files]

    def first(self, topic: str) -> Any:
        """First message of a topic."""
        if topic not in self._first:
            channel, schema = self.topics[topic]
            if self._decoded(channel, schema) is None:
                encoding = f"{channel.message_encoding}, {schema.encoding if schema else 'no schema'}"
                raise self.error(
                    f"topic {topic} has no messages of ROS 2 with their definition (cdr, ros2msg), but {encoding}"
                )
            decoded = (
                file.read(lambda reader: [*islice(reader.iter_decoded_messages(topics=[topic]), 1)])
                for file in self._files
            )
            found = next(filter(None, decoded), None)
            if found is None:
                raise self.error(f"topic {topic} has no messages")
            self._first[topic] = found[0].decoded_message
        return self._first[topic]

    def _first_messages(self) -> dict[str, Any]:
        """Yield the first message of each readable topic; bags also have topics that no configuration names."""
        for topic in self.topics:
            with suppress(InputError):
                self.first(topic)
        return self._first

    def _decoded(self, channel: Any, schema: Any) -> Any:
        try:
            return self._files[0].decoders.decoder_for(channel.message_encoding, schema)
        except Exception as error:  # of a definition that its parser does not take
            raise self.error(f"topic {channel.topic}: its message definition cannot be read ({why(error)})") from None

    def _column(self, text: str, *, needed: bool) -> FieldColumn | None:
        """The column that a text names; None where no topic has it, and it is not needed."""
        try:
            return self._named_column(text, needed)
        except InputError as error:
            raise error.at(text) from None

    def _named_column(self, text: str, needed: bool) -> FieldColumn | None:
        united = _UNIT.fullmatch(text.strip())
        name, unit = (united[1], united[2]) if united else (text.strip(), None)
        if not name.startswith("/"):
            return self._by_field(name, unit, needed)
        topic, _, path = name.partition(".")
        if topic not in self.topics:
            listed = ", ".join(sorted(self.topics)[:_LISTED]) or "none"
            raise self.error(f"no topic {topic!r}{nearest(topic, self.topics, say_all=False)} (the bag has {listed})")
        message = self.first(topic)
        if not path:
            return FieldColumn(name, "s", topic, ())
        if not PATH.fullmatch(path):
            raise self.error(f"expected /topic.field or /topic.field[0].field, got {name!r:.60}")
        parts = parts_of(path)
        self._check_field(topic, path, parts, message)
        return FieldColumn(name, unit, topic, parts)

    def _by_field(self, name: str, unit: str | None, needed: bool) -> FieldColumn | None:
        """Column by the name of a field alone, which one topic has."""
        field = field_name(name)
        having = [
            topic
            for topic, message in self._first_messages().items()
            if isinstance(getattr(message, field, None), (int, float))
        ]
        if len(having) > 1:
            named = " or ".join(f"{topic}.{field}" for topic in having[:_LISTED])
            raise self.error(f"{len(having)} topics have a field {name}: write {named}")
        if having:
            return FieldColumn(name, unit, having[0], (field,))
        if needed:
            listed = ", ".join(sorted(self.topics)[:_LISTED]) or "none"
            raise self.error(
                f"no topic has a field {name!r}: write /topic.field, and /topic for its stamps (the bag has {listed})"
            )
        return None

    def _check_field(self, topic: str, path: str, parts: tuple[Part, ...], message: Any) -> None:
        """Refuse a field that a message does not have, or that is no single value."""
        value = message
        for k, part in enumerate(parts):
            if is_entry(part):
                if isinstance(value, (SimpleNamespace, str, int, float)) or value is None:
                    raise self.error(f"{topic}.{joined(parts[:k])} is no list: it has no entry [{part}]")
                if not len(value):  # of one message; others may have some
                    return
                value = value[0]
            elif not isinstance(value, SimpleNamespace) or not hasattr(value, str(part)):
                fields = [*leaves(message)]
                hint = nearest(path, fields, say_all=False)
                shown = ", ".join(fields[:_LISTED]) + (", ..." if len(fields) > _LISTED else "")
                raise self.error(f"topic {topic} has no field {path!r}{hint} (it has {shown})")
            else:
                value = getattr(value, str(part))
        if isinstance(value, SimpleNamespace):
            fields = [f"{path}.{leaf}" for leaf in leaves(value)]
            raise self.error(f"{topic}.{path} is no number: name one of {', '.join(fields[:_LISTED])}")
        if not isinstance(value, (str, int, float)):
            raise self.error(f"{topic}.{path} is a list: name an entry of it, such as {path}[0]")

    def _all(self) -> list[FieldColumn]:
        """Columns of all fields that are numbers, of topics whose stamps are known."""
        columns = list[FieldColumn]()
        for topic, message in self._first_messages().items():
            if not (self.by_header and header_of(message) is None):
                fields = [(leaf, parts_of(leaf)) for leaf in leaves(message) if not leaf.startswith("header.")]
                columns += [FieldColumn(leaf, None, topic, parts) for leaf, parts in fields if is_number(message, leaf)]
        counts = Counter(column.heading.lower() for column in columns) + Counter(("t",))
        return [
            column
            if counts[column.heading.lower()] == 1
            else column._replace(heading=f"{column.topic}.{column.heading}")
            for column in columns
        ]
