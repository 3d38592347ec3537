"""Bags of ROS 2, in MCAP or SQLite files: fields of messages as columns of a table."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from continuum_grasp.base import InputError, nearest
from continuum_grasp.scene.bag_fields import cell_of, is_number, joined, leaves, parts_of
from continuum_grasp.scene.bag_sqlite import MAGIC as SQLITE
from continuum_grasp.scene.bag_sqlite import SqliteReader
from continuum_grasp.scene.bag_topics import NANOSECONDS, field_name, ros_module

MAGIC = b"\x89MCAP0\r\n"
"""First bytes of every MCAP file."""
_PATH = re.compile(r"[A-Za-z]\w*(\[\d+\])*(\.[A-Za-z]\w*(\[\d+\])*)*")
_UNIT = re.compile(r"(.*?)\s+\[([^\[\]]+)\]")
"""Column with its unit: a blank tells the unit from the number of an entry, as in position[0]."""
_SUFFIXES = (".mcap", ".db3")
_LISTED = 12
"""Topics and fields that an error lists [1]: more do not fit on a screen."""


class BagCells(NamedTuple):
    """Cells of a table from a bag: headings without units, units, rows, number and topic of the message of each row."""

    headings: tuple[str, ...]
    units: tuple[str | None, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: tuple[int, ...]
    topics: tuple[str, ...]  # of the columns, empty for the column of time


class _FieldColumn(NamedTuple):
    """Column of a table: its heading, unit and topic, and the parts of its field; none: the stamps."""

    heading: str
    unit: str | None
    topic: str
    parts: tuple[str | int, ...]


class _Samples(NamedTuple):
    """Messages of a topic: stamps [ns], and the cells of its columns by heading."""

    stamps: list[int]
    cells: dict[str, list[str]]


def bag_file(path: str | Path) -> str | Path:
    """The one file of a bag that is a folder, as ``ros2 bag record`` makes it; any other path as it is."""
    folder = Path(path)
    if not (folder / "metadata.yaml").is_file():
        return path
    files = sorted(each for each in folder.iterdir() if each.suffix.lower() in _SUFFIXES)
    if len(files) != 1:
        listed = ", ".join(each.name for each in files[:_LISTED]) or "none"
        raise InputError(
            f"expected a bag of one file, got a folder with {len(files)} ({listed}): name one", file=str(path)
        )
    return files[0]


def is_bag(path: str | Path) -> bool:
    """Whether a file is MCAP or SQLite by its first bytes or its name; not if it cannot be read: others report that."""
    try:
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
    return _Bag(str(path), stamps or "header").table(columns, leader, max_age)


class _Bag:
    """An MCAP or SQLite file that is open for reading."""

    def __init__(self, file: str, stamps: str) -> None:
        self.file = file
        self.by_header = stamps == "header"
        self._mcap = ros_module("mcap.reader", file)
        self._decoders = ros_module("mcap_ros2.decoder", file).DecoderFactory()
        with open(file, "rb") as stream:
            begin = stream.read(len(SQLITE))
        if not begin.startswith((MAGIC, SQLITE)):
            raise self.error("is no MCAP or SQLite file; expected a bag that ROS 2 recorded as mcap or sqlite3")
        self._in_sqlite = begin == SQLITE
        self.topics = self._channels()
        self._first = dict[str, Any]()

    def error(self, message: str, key: str | None = None) -> InputError:
        """An error about the file; ``key`` is the column, or the argument, that is at fault."""
        return InputError(message, file=self.file, key=key)

    def table(self, columns: Sequence[str], leader: str | None, max_age: float | None) -> BagCells:
        texts = dict.fromkeys(columns if leader is None else (leader, *columns))
        found = [self._column(text, needed=leader is not None or text.startswith("/")) for text in texts]
        known = [*{column.heading: column for column in found if column is not None}.values()]
        if leader is None:
            return self._together(known if columns else self._all())
        return self._led(known, max_age)

    # -- topics and fields --------------------------------------------------------------------------------------------

    def _channels(self) -> dict[str, tuple[Any, Any]]:
        """Channel and schema of each topic, from the index of the file or, where it has none, from its messages."""
        summary = self._read(lambda reader: reader.get_summary())
        if summary is not None and (summary.channels or self._in_sqlite):
            schemas = summary.schemas
            return {each.topic: (each, schemas.get(each.schema_id)) for each in summary.channels.values()}
        found: dict[str, tuple[Any, Any]] = self._read(
            lambda reader: {
                channel.topic: (channel, schema) for schema, channel, _ in reader.iter_messages(log_time_order=False)
            }
        )
        return found

    def _read(self, work: Any) -> Any:
        """Something that is read from the file; an `InputError` where the file is cut off or damaged."""
        try:
            if self._in_sqlite:
                return work(SqliteReader(self.file, self._decoders))
            with open(self.file, "rb") as stream:
                return work(self._mcap.make_reader(stream, validate_crcs=True, decoder_factories=[self._decoders]))
        except InputError:
            raise
        except NotImplementedError as error:
            raise self.error(f"the library for bags cannot decode a message: {error}") from None
        except Exception as error:  # the library raises whatever its parts do
            raise self.error(f"the file is cut off or damaged ({_why(error)}); {self._readable()}") from None

    def _readable(self) -> str:
        """Summary of the messages before the fault."""
        if self._in_sqlite:
            return "recover it by `sqlite3 FILE .recover`"
        records = import_module("mcap.records")
        counts = Counter[int]()
        topics = dict[int, str]()
        first = math.inf
        last = -math.inf
        try:
            with open(self.file, "rb") as stream:
                for record in import_module("mcap.stream_reader").StreamReader(stream).records:
                    if isinstance(record, records.Channel):
                        topics[record.id] = record.topic
                    elif isinstance(record, records.Message):
                        counts[record.channel_id] += 1
                        first = min(first, record.log_time)
                        last = max(last, record.log_time)
        except Exception:  # the fault itself
            pass
        if not counts:
            return "no message can be read"
        listed = ", ".join(f"{count} of {topics[channel]}" for channel, count in counts.items() if channel in topics)
        return f"before the fault are {listed}, in {(last - first) / NANOSECONDS:.3g} s: recover them by `mcap recover`"

    def first(self, topic: str) -> Any:
        """First message of a topic."""
        if topic not in self._first:
            channel, schema = self.topics[topic]
            if self._decoded(channel, schema) is None:
                encoding = f"{channel.message_encoding}, {schema.encoding if schema else 'no schema'}"
                raise self.error(
                    f"topic {topic} has no messages of ROS 2 with their definition (cdr, ros2msg), but {encoding}"
                )
            decoded = self._read(lambda reader: [*islice(reader.iter_decoded_messages(topics=[topic]), 1)])
            if not decoded:
                raise self.error(f"topic {topic} has no messages")
            self._first[topic] = decoded[0].decoded_message
        return self._first[topic]

    def _first_messages(self) -> dict[str, Any]:
        """First message of each topic that can be read: bags have others beside those that are asked for."""
        for topic in self.topics:
            with suppress(InputError):
                self.first(topic)
        return self._first

    def _decoded(self, channel: Any, schema: Any) -> Any:
        try:
            return self._decoders.decoder_for(channel.message_encoding, schema)
        except Exception as error:  # of a definition that its parser does not take
            raise self.error(f"topic {channel.topic}: its message definition cannot be read ({_why(error)})") from None

    def _column(self, text: str, *, needed: bool) -> _FieldColumn | None:
        """The column that a text names; None where no topic has it, and it is not needed."""
        try:
            return self._named_column(text, needed)
        except InputError as error:
            raise error.at(text) from None

    def _named_column(self, text: str, needed: bool) -> _FieldColumn | None:
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
            return _FieldColumn(name, "s", topic, ())
        if not _PATH.fullmatch(path):
            raise self.error(f"expected /topic.field or /topic.field[0].field, got {name!r:.60}")
        parts = parts_of(path)
        self._check_field(topic, path, parts, message)
        return _FieldColumn(name, unit, topic, parts)

    def _by_field(self, name: str, unit: str | None, needed: bool) -> _FieldColumn | None:
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
            return _FieldColumn(name, unit, having[0], (field,))
        if needed:
            listed = ", ".join(sorted(self.topics)[:_LISTED]) or "none"
            raise self.error(
                f"no topic has a field {name!r}: write /topic.field, and /topic for its stamps (the bag has {listed})"
            )
        return None

    def _check_field(self, topic: str, path: str, parts: tuple[str | int, ...], message: Any) -> None:
        """Refuse a field that a message does not have, or that is no single value."""
        value = message
        for k, part in enumerate(parts):
            if isinstance(part, int):
                if isinstance(value, (SimpleNamespace, str, int, float)) or value is None:
                    raise self.error(f"{topic}.{joined(parts[:k])} is no list: it has no entry [{part}]")
                if part >= len(value):  # of one message; others may have more
                    return
                value = value[part]
            elif not isinstance(value, SimpleNamespace) or not hasattr(value, part):
                fields = [*leaves(message)]
                hint = nearest(path, fields, say_all=False)
                shown = ", ".join(fields[:_LISTED]) + (", ..." if len(fields) > _LISTED else "")
                raise self.error(f"topic {topic} has no field {path!r}{hint} (it has {shown})")
            else:
                value = getattr(value, part)
        if isinstance(value, SimpleNamespace):
            fields = [f"{path}.{leaf}" for leaf in leaves(value)]
            raise self.error(f"{topic}.{path} is no number: name one of {', '.join(fields[:_LISTED])}")
        if not isinstance(value, (str, int, float)):
            raise self.error(f"{topic}.{path} is a list: name an entry of it, such as {path}[0]")

    def _all(self) -> list[_FieldColumn]:
        """Columns of all fields that are numbers, of topics whose stamps are known."""
        columns = list[_FieldColumn]()
        for topic, message in self._first_messages().items():
            if not (self.by_header and self._header(message) is None):
                fields = [(leaf, parts_of(leaf)) for leaf in leaves(message) if not leaf.startswith("header.")]
                columns += [
                    _FieldColumn(leaf, None, topic, parts) for leaf, parts in fields if is_number(message, parts)
                ]
        counts = Counter(column.heading.lower() for column in columns) + Counter(("t",))
        return [
            column
            if counts[column.heading.lower()] == 1
            else column._replace(heading=f"{column.topic}.{column.heading}")
            for column in columns
        ]

    # -- rows ---------------------------------------------------------------------------------------------------------

    @staticmethod
    def _header(message: Any) -> Any:
        return getattr(getattr(message, "header", None), "stamp", None)

    def _samples(self, columns: Sequence[_FieldColumn]) -> dict[str, _Samples]:
        """Messages of all topics of some columns, in the order in which they were logged."""
        of_topic = dict[str, list[_FieldColumn]]()
        for column in columns:
            of_topic.setdefault(column.topic, []).append(column)
        for topic in of_topic if self.by_header else ():
            if self._header(self.first(topic)) is None:
                raise self.error(
                    f"topic {topic} has no header with a stamp: set stamps: log, the times of recording", "stamps"
                )
        samples = {
            topic: _Samples([], {column.heading: [] for column in own if column.parts})
            for topic, own in of_topic.items()
        }

        def work(reader: Any) -> None:
            for decoded in reader.iter_decoded_messages(topics=[*of_topic]):
                topic = decoded.channel.topic
                message = decoded.decoded_message
                stamp = self._header(message) if self.by_header else None
                found = samples[topic]
                found.stamps.append(
                    decoded.message.log_time if stamp is None else stamp.sec * NANOSECONDS + stamp.nanosec
                )
                for column in of_topic[topic]:
                    if column.parts:
                        found.cells[column.heading].append(cell_of(message, column.parts))

        self._read(work)
        for topic, own in of_topic.items():
            for column in own:
                in_list = any(isinstance(part, int) for part in column.parts)
                if in_list and not any(samples[topic].cells[column.heading]):
                    raise self.error(f"no message has {topic}.{joined(column.parts)}: its lists are shorter")
        return samples

    def _check_order(self, topic: str, stamps: Sequence[int]) -> None:
        for k in range(1, len(stamps)):
            if stamps[k] < stamps[k - 1]:
                back = (stamps[k - 1] - stamps[k]) / NANOSECONDS
                raise self.error(
                    f"topic {topic}: message {k + 1} has a stamp {back:g} s before message {k}; expected "
                    "instants of one run, in their order"
                )

    def _together(self, columns: Sequence[_FieldColumn]) -> BagCells:
        """Rows of one stamp each, with the messages that have it."""
        for column in columns:
            if not column.parts:
                raise self.error("expected a field of the topic: the column t has its stamps", column.heading)
        samples = self._samples(columns)
        rows = dict[tuple[int, int], dict[str, str]]()
        for topic, found in samples.items():
            self._check_order(topic, found.stamps)
            repeated = Counter[int]()
            for k, stamp in enumerate(found.stamps):
                row = rows.setdefault((stamp, repeated[stamp]), {})
                repeated[stamp] += 1
                row.update({heading: cells[k] for heading, cells in found.cells.items()})
        keys = sorted(rows)
        if not keys:
            listed = ", ".join(sorted(self.topics)[:_LISTED]) or "none"
            raise self.error(f"no topic has a number at a requested stamp (the bag has {listed})")
        begin = keys[0][0]
        headings = [column.heading for column in columns]
        cells = [
            (repr((key[0] - begin) / NANOSECONDS), *(rows[key].get(heading, "") for heading in headings))
            for key in keys
        ]
        units = ("s", *(column.unit for column in columns))
        topics = ("", *(column.topic for column in columns))
        return BagCells(("t", *headings), units, tuple(cells), tuple(range(1, len(cells) + 1)), topics)

    def _led(self, columns: Sequence[_FieldColumn], max_age: float | None) -> BagCells:
        """Rows of the messages of the first column's topic, with the last value of the others that is not too old."""
        samples = self._samples(columns)
        lead = columns[0].topic
        stamps = samples[lead].stamps
        age = None if max_age is None else round(max_age * NANOSECONDS)
        taken = {
            topic: self._latest(topic, found.stamps, stamps, age) for topic, found in samples.items() if topic != lead
        }
        for topic, rows in taken.items():
            if all(row is None for row in rows):
                hint = (
                    "state max_age, up to which the last value counts" if max_age is None else "is max_age too small?"
                )
                raise self.error(f"no message of {topic} goes with one of {lead}, whose stamps lead: {hint}", "max_age")
        cells = list[list[str]]()
        for column in columns:
            own = samples[column.topic]
            if not column.parts:
                values = [repr((stamp - stamps[0]) / NANOSECONDS) for stamp in own.stamps]
            else:
                values = own.cells[column.heading]
            if column.topic != lead:
                values = ["" if row is None else values[row] for row in taken[column.topic]]
            cells.append(values)
        topics = tuple(column.topic if column.parts else "" for column in columns)
        numbers = tuple(range(1, len(stamps) + 1))
        headings, units = (tuple(each) for each in zip(*((c.heading, c.unit) for c in columns), strict=True))
        return BagCells(headings, units, tuple(zip(*cells, strict=True)), numbers, topics)

    def _latest(self, topic: str, stamps: list[int], wanted: list[int], age: int | None) -> list[int | None]:
        """Last message at or before each wanted stamp that is no older than an age; None: that has the stamp itself."""
        self._check_order(topic, stamps)
        rows = [bisect_right(stamps, stamp) - 1 for stamp in wanted]
        return [
            row if row >= 0 and stamp - stamps[row] <= (age or 0) else None
            for row, stamp in zip(rows, wanted, strict=True)
        ]


def _why(error: Exception) -> str:
    """Kind and text of an error on one line: texts of libraries quote definitions of a hundred lines."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text:.160}" if text else type(error).__name__
