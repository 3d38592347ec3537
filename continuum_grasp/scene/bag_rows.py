"""Messages of a bag as rows of a table, in the order of their stamps."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from continuum_grasp.base import InputError
from continuum_grasp.scene.bag_fields import EntryName, FieldReader, Part, joined
from continuum_grasp.scene.bag_topics import NANOSECONDS
from continuum_grasp.scene.instants import in_order


class BagCells(NamedTuple):
    """Cells of a table from a bag: headings without units, units, rows, number and topic of the message of each row."""

    headings: tuple[str, ...]
    units: tuple[str | None, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: tuple[int, ...]
    topics: tuple[str, ...]  # of the columns, empty for the column of time
    notes: tuple[str, ...]  # notes on topics whose messages are not in the order of their stamps


class FieldColumn(NamedTuple):
    """Column of a table: heading, unit, topic, and the parts of its field (none: the stamps)."""

    heading: str
    unit: str | None
    topic: str
    parts: tuple[Part, ...]


class OpenBag(Protocol):
    """Open bag."""

    topics: dict[str, Any]
    by_header: bool

    def error(self, message: str, key: str | None = None) -> InputError: ...

    def read(self, work: Callable[[Any], Any]) -> Any: ...

    def first(self, topic: str) -> Any: ...


class _Samples(NamedTuple):
    """Messages of a topic: stamps [ns], numbers in the log, and cells of columns by heading."""

    stamps: list[int]
    numbers: list[int]
    cells: dict[str, list[str]]


def header_of(message: Any) -> Any:
    """Return the stamp in the header of a message; None without one."""
    return getattr(getattr(message, "header", None), "stamp", None)


def together(bag: OpenBag, columns: Sequence[FieldColumn]) -> BagCells:
    """Return a row for each stamp, from the messages with that stamp."""
    for column in columns:
        if not column.parts:
            raise bag.error("expected a field of the topic: the column t has its stamps", column.heading)
    samples, notes = _samples(bag, columns)
    rows = dict[tuple[int, int], dict[str, str]]()
    for found in samples.values():
        repeated = Counter[int]()
        for k, stamp in enumerate(found.stamps):
            row = rows.setdefault((stamp, repeated[stamp]), {})
            repeated[stamp] += 1
            row.update({heading: cells[k] for heading, cells in found.cells.items()})
    keys = sorted(rows)
    if not keys:
        listed = ", ".join(sorted(bag.topics)[:12]) or "none"
        raise bag.error(f"no topic has a number at a requested stamp (the bag has {listed})")
    begin = keys[0][0]
    headings = [column.heading for column in columns]
    cells = [
        (repr((key[0] - begin) / NANOSECONDS), *(rows[key].get(heading, "") for heading in headings)) for key in keys
    ]
    units = ("s", *(column.unit for column in columns))
    topics = ("", *(column.topic for column in columns))
    return BagCells(("t", *headings), units, tuple(cells), tuple(range(1, len(cells) + 1)), topics, notes)


def led(bag: OpenBag, columns: Sequence[FieldColumn], max_age: float | None) -> BagCells:
    """Return a row for each message of the first column's topic, with the last value of other topics within
    ``max_age``.
    """
    samples, notes = _samples(bag, columns)
    lead = columns[0].topic
    stamps = samples[lead].stamps
    age = None if max_age is None else round(max_age * NANOSECONDS)
    taken = {topic: _latest(found.stamps, stamps, age) for topic, found in samples.items() if topic != lead}
    for topic, rows in taken.items():
        if all(row is None for row in rows):
            hint = "state max_age, the greatest age of a value" if max_age is None else "is max_age too small?"
            raise bag.error(f"no message of {topic} goes with one of {lead}, whose stamps lead: {hint}", "max_age")
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
    headings, units = (tuple(each) for each in zip(*((c.heading, c.unit) for c in columns), strict=True))
    return BagCells(headings, units, tuple(zip(*cells, strict=True)), tuple(samples[lead].numbers), topics, notes)


def _samples(bag: OpenBag, columns: Sequence[FieldColumn]) -> tuple[dict[str, _Samples], tuple[str, ...]]:
    """Read the messages of the columns' topics in the order of their stamps, with notes on topics logged out of order.

    A topic whose stamps start again has two runs: an `InputError`.
    """
    of_topic = dict[str, list[FieldColumn]]()
    for column in columns:
        of_topic.setdefault(column.topic, []).append(column)
    logged = _logged(bag, of_topic)
    samples = dict[str, _Samples]()
    notes = list[str]()
    for topic, found in logged.items():

        def refused(message: str, _: int, topic: str = topic) -> InputError:
            return bag.error(f"topic {topic}: {message}")

        order, note = in_order(found.stamps, "messages", refused)
        notes += [f"{topic}: {note}"] if note else []
        cells = {heading: [values[k] for k in order] for heading, values in found.cells.items()}
        samples[topic] = _Samples([found.stamps[k] for k in order], [found.numbers[k] for k in order], cells)
    return samples, tuple(notes)


def _logged(bag: OpenBag, of_topic: Mapping[str, Sequence[FieldColumn]]) -> dict[str, _Samples]:
    """Read the messages of topics in the order of the log."""
    for topic in of_topic if bag.by_header else ():
        if header_of(bag.first(topic)) is None:
            raise bag.error(
                f"topic {topic} has no header with a stamp: set stamps: log, the times of recording", "stamps"
            )
    readers = {
        topic: {column.heading: FieldReader(column.parts) for column in own if column.parts}
        for topic, own in of_topic.items()
    }
    samples = {topic: _Samples([], [], {heading: [] for heading in of}) for topic, of in readers.items()}

    def work(reader: Any) -> None:
        for decoded in reader.iter_decoded_messages(topics=[*of_topic]):
            topic = decoded.channel.topic
            message = decoded.decoded_message
            stamp = header_of(message) if bag.by_header else None
            found = samples[topic]
            found.numbers.append(len(found.stamps) + 1)
            found.stamps.append(decoded.message.log_time if stamp is None else stamp.sec * NANOSECONDS + stamp.nanosec)
            for heading, field in readers[topic].items():
                try:
                    found.cells[heading].append(field.cell(message))
                except InputError as error:
                    raise bag.error(f"topic {topic}: {error.message}", heading) from None

    bag.read(work)
    for topic, own in of_topic.items():
        for column in own:
            if _in_list(column.parts) and not any(samples[topic].cells[column.heading]):
                named = any(isinstance(part, EntryName) for part in column.parts)
                why = "no entry has that name" if named else "its lists are shorter"
                raise bag.error(f"no message has {topic}.{joined(column.parts)}: {why}", column.heading)
    return samples


def _in_list(parts: Sequence[Part]) -> bool:
    return any(isinstance(part, (int, EntryName)) for part in parts)


def _latest(stamps: list[int], wanted: list[int], age: int | None) -> list[int | None]:
    """Return the last message within an age before each wanted stamp; age None: with exactly that stamp."""
    rows = [bisect_right(stamps, stamp) - 1 for stamp in wanted]
    return [
        row if row >= 0 and stamp - stamps[row] <= (age or 0) else None for row, stamp in zip(rows, wanted, strict=True)
    ]
