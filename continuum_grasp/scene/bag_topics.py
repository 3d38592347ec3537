"""Tables as topics of a bag of ROS 2 in an MCAP file."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from continuum_grasp.base import Array, InputError, install_line, split_unit

_PACKAGE = "continuum_grasp_msgs"
"""ROS 2 package of each message, by name."""
NANOSECONDS = 1_000_000_000
"""Nanoseconds, the unit of stamps, per second."""
_HEADER_PARTS = f"""{"=" * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
"""Definitions that a message with a header carries, as bags embed them."""


def ros_module(module: str, file: str) -> Any:
    """Import a module of the libraries for bags; if they are missing, an `InputError` tells how to install them."""
    try:
        return import_module(module)
    except ImportError:
        raise InputError(f"bags of ROS 2 need the extra 'ros': {install_line('ros')}", file=file or None) from None


def field_name(label: str) -> str:
    """Name of a field for a label ``"name [unit]"``, as ROS 2 takes it: small letters, digits, single underscores."""
    name = re.sub(r"[^a-z0-9]+", "_", split_unit(label).name.lower()).strip("_")
    return name if name[:1].isalpha() else f"f_{name}"


def bag_bytes(topics: Mapping[str, tuple[Array, Mapping[str, Sequence[Any] | Array]]], start: int = 0) -> bytes:
    """A bag with messages of each topic at instants (K,) [s] after ``start`` [ns]: K values by label each.

    Messages have a header, and a field per label: numbers as float64, texts as strings; the definition of each topic's
    message, with the units, is in the file. Numbers that are missing are NaN.
    """
    writer_class = ros_module("mcap_ros2.writer", "").Writer
    stream = io.BytesIO()
    writer = writer_class(stream)
    messages = list[tuple[int, int, str, Any, dict[str, Any]]]()
    for topic, (t, columns) in topics.items():
        schema, fields, values = _defined(writer, topic, columns)
        for k, (instant, row) in enumerate(zip(t.tolist(), zip(*values, strict=True), strict=True)):
            stamp = start + round(instant * NANOSECONDS)
            header = {"stamp": {"sec": stamp // NANOSECONDS, "nanosec": stamp % NANOSECONDS}, "frame_id": "world"}
            messages.append((stamp, k, topic, schema, {"header": header, **dict(zip(fields, row, strict=True))}))
    for stamp, k, topic, schema, message in sorted(messages, key=lambda each: each[0]):
        writer.write_message(topic, schema, message, log_time=stamp, publish_time=stamp, sequence=k)
    writer.finish()
    return stream.getvalue()


def is_own_bag(file: str | Path) -> bool:
    """Whether `bag_bytes` wrote a file: its summary has their message definitions, uncompressed."""
    return f"{_PACKAGE}/msg/".encode() in Path(file).read_bytes()


def _defined(writer: Any, topic: str, columns: Mapping[str, Any]) -> tuple[Any, list[str], list[list[Any]]]:
    """Schema of a topic, its fields, and their values by column."""
    values = [[value if isinstance(value, str) else float(value) for value in column] for column in columns.values()]
    fields = _field_names([*columns])
    lines = ["std_msgs/Header header"]
    for label, field, column in zip(columns, fields, values, strict=True):
        unit = split_unit(label).unit
        kind = "string" if any(isinstance(value, str) for value in column) else "float64"
        lines.append(f"{kind} {field}" + (f"  # {unit}" if unit else ""))
    kind = "".join(word.capitalize() for word in re.split(r"[^a-zA-Z0-9]+", topic))
    definition = "\n".join([*lines, _HEADER_PARTS])
    return writer.register_msgdef(f"{_PACKAGE}/msg/{kind}", definition), fields, values


def _field_names(labels: Sequence[str]) -> list[str]:
    """Return a unique name per label."""
    names = list[str]()
    for label in labels:
        name = field_name(label)
        k = 2
        while name in names:
            name, k = f"{field_name(label)}_{k}", k + 1
        names.append(name)
    return names
