"""Bags of ROS 2 in SQLite files (``.db3``), read as the library for MCAP reads its files."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from continuum_grasp.base import InputError

MAGIC = b"SQLite format 3\0"
"""First bytes of every SQLite file."""
_COLUMNS = {
    "topics": ("id", "name", "type", "serialization_format"),
    "messages": ("id", "topic_id", "timestamp", "data"),
    "message_definitions": ("id", "topic_type", "encoding", "encoded_message_definition"),
}
"""Columns that are read of each table."""
_DEFINED = "SELECT topic_type, encoding, CAST(encoded_message_definition AS BLOB) FROM message_definitions ORDER BY id"
_TOPICS = "SELECT id, CAST(name AS TEXT), type, serialization_format FROM topics WHERE name IS NOT NULL ORDER BY id"
_MESSAGES = "SELECT topic_id, timestamp, CAST(data AS BLOB) FROM messages ORDER BY timestamp, id"


class SqliteReader:
    """Topics, definitions and messages of a file, under the names of the reader of the ``mcap`` library.

    Only bags that carry the definitions of their messages can be read: ROS 2 writes them since the release Iron.
    """

    def __init__(self, file: str, decoders: Any) -> None:
        self._file, self._decoders = file, decoders
        tables = {name for (name,) in self._rows("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise InputError("is no bag of ROS 2: it has no tables topics and messages", file=file)
        for table in tables & {*_COLUMNS}:
            found = {name for (name,) in self._rows(f"SELECT name FROM pragma_table_info('{table}')")}
            if missing := [name for name in _COLUMNS[table] if name not in found]:
                raise InputError(f"is no bag of ROS 2: its table {table} has no {', '.join(missing)}", file=file)
        definitions = [*self._rows(_DEFINED)] if "message_definitions" in tables else []
        topics = [*self._rows(_TOPICS)]
        if topics and not definitions:
            raise InputError(
                "the bag has no definitions of its messages, as ROS 2 wrote before the release Iron: convert it, by "
                f"`ros2 bag convert -i {Path(file).parent} -o convert.yaml` with convert.yaml: "
                "`output_bags: [{uri: converted, storage_id: mcap, all: true}]`",
                file=file,
            )
        numbers = {kind: k for k, (kind, _, _) in enumerate(definitions, 1)}
        schemas = {
            k: SimpleNamespace(id=k, name=kind, encoding=encoding, data=text)
            for k, (kind, encoding, text) in enumerate(definitions, 1)
            if text is not None
        }
        channels = {
            number: SimpleNamespace(topic=topic, message_encoding=encoding, schema_id=numbers.get(kind, 0))
            for number, topic, kind, encoding in topics
        }
        self._summary = SimpleNamespace(channels=channels, schemas=schemas)

    def get_summary(self) -> Any:
        """Channels and schemas by their numbers."""
        return self._summary

    def iter_decoded_messages(self, topics: Iterable[str]) -> Iterator[Any]:
        """Yield channel, message and decoded message of some topics, in the order of the log."""
        wanted = {*topics}
        decoders = dict[int, Any]()
        for number, stamp, data in self._rows(_MESSAGES):
            channel = self._summary.channels.get(number)
            if channel is None or channel.topic not in wanted:
                continue
            if not isinstance(stamp, int):
                raise InputError(
                    f"a message of {channel.topic} has no time of recording, but {stamp!r:.40}", file=self._file
                )
            if number not in decoders:
                schema = self._summary.schemas.get(channel.schema_id)
                decoders[number] = self._decoders.decoder_for(channel.message_encoding, schema)
            message = SimpleNamespace(log_time=stamp)
            yield SimpleNamespace(channel=channel, message=message, decoded_message=decoders[number](data))

    def _rows(self, query: str) -> Iterator[tuple[Any, ...]]:
        # Read-only, and as if nothing could change: a bag on a stick that cannot be written. Not where a recording that
        # was broken off left its last messages in a file beside it.
        path = Path(self._file).absolute()
        beside = (path.with_name(path.name + end) for end in ("-wal", "-journal"))
        left = any(each.is_file() and each.stat().st_size for each in beside)
        with closing(
            sqlite3.connect(path.as_uri() + ("?mode=ro" if left else "?mode=ro&immutable=1"), uri=True)
        ) as data:
            yield from data.execute(query)
