"""One file of a bag of ROS 2, in MCAP or SQLite."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from importlib import import_module
from typing import Any

from continuum_grasp.base import InputError
from continuum_grasp.scene.bag_sqlite import MAGIC as SQLITE
from continuum_grasp.scene.bag_sqlite import SqliteReader
from continuum_grasp.scene.bag_topics import NANOSECONDS, ros_module

MAGIC = b"\x89MCAP0\r\n"
"""First bytes of every MCAP file."""


class BagFile:
    """Open MCAP or SQLite file."""

    def __init__(self, file: str) -> None:
        self.file = file
        self._mcap = ros_module("mcap.reader", file)
        self.decoders = ros_module("mcap_ros2.decoder", file).DecoderFactory()
        with open(file, "rb") as stream:
            begin = stream.read(len(SQLITE))
        if not begin.startswith((MAGIC, SQLITE)):
            message = "is no MCAP or SQLite file; expected a bag that ROS 2 recorded as mcap or sqlite3"
            raise InputError(message, file=file)
        self._in_sqlite = begin == SQLITE

    def channels(self) -> dict[str, tuple[Any, Any]]:
        """Channel and schema of each topic, from the index of the file or, without an index, from the messages."""
        summary = self.read(lambda reader: reader.get_summary())
        if summary is not None and (summary.channels or self._in_sqlite):
            schemas = summary.schemas
            return {each.topic: (each, schemas.get(each.schema_id)) for each in summary.channels.values()}
        found: dict[str, tuple[Any, Any]] = self.read(
            lambda reader: {
                channel.topic: (channel, schema) for schema, channel, _ in reader.iter_messages(log_time_order=False)
            }
        )
        return found

    def read(self, work: Callable[[Any], Any]) -> Any:
        """Yield items that are read from the file; `InputError` if the file is cut off or damaged."""
        try:
            if self._in_sqlite:
                return work(SqliteReader(self.file, self.decoders))
            with open(self.file, "rb") as stream:
                return work(self._mcap.make_reader(stream, validate_crcs=True, decoder_factories=[self.decoders]))
        except InputError:
            raise
        except NotImplementedError as error:
            raise self._error(f"the library for bags cannot decode a message: {error}") from None
        except Exception as error:  # the library passes on the errors of its parts
            raise self._error(f"the file is cut off or damaged ({why(error)}); {self._readable()}") from None

    def _readable(self) -> str:
        """Summarize the messages before the fault."""
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

    def _error(self, message: str) -> InputError:
        return InputError(message, file=self.file)


def why(error: Exception) -> str:
    """Return kind and text of an error on one line: libraries quote definitions of a hundred lines."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text:.160}" if text else type(error).__name__
