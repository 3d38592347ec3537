"""Closed loops as bags of ROS 2: topics of measurements, estimate, commands, setpoints and health."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.control import Command, Controller, ControlLog
from continuum_grasp.results import replacing
from continuum_grasp.scene import DataTable

Topics = dict[str, tuple[Array, Mapping[str, Sequence[Any] | Array]]]
"""Instants (K,) [s] of each topic, and columns of K values by name and unit."""


def topics_of_hardware(log: ControlLog, controller: Controller, commands: Mapping[int, Command]) -> Topics:
    """Topics of a loop on hardware: its log, and its commands by the rows of the log."""
    at = log.t[[*commands]] if commands else np.zeros(0)
    given = [*commands.values()]
    states = np.array([command.estimate.x for command in given]).reshape(len(given), -1)
    health: dict[str, Sequence[Any] | Array] = {
        "status": [command.status.name.lower() for command in given],
        "health": [command.health.name.lower() for command in given],
        "text": [command.health_text for command in given],
        "mismatch [1]": np.array([command.mismatch for command in given]),
        "violation [1]": np.array([command.violation for command in given]),
        "iterations [1]": np.array([command.iterations for command in given]),
    }
    reference = controller.nominal_setpoints
    return named_topics(
        "",
        {
            "measured": (log.t, columns_of_rows("", log.y_names, log.y)),
            "estimate": (at, columns_of_rows("estimated_", controller.estimated_names[: states.shape[1]], states)),
            "commands": (log.t, columns_of_rows(ControlLog.COMMANDED, log.u_names, log.u)),
            "reference": (log.t, columns_of_rows("reference_", reference.names, reference.rows(log.t))),
            "health": (at, health),
        },
    )


def write_topics(topics: Topics, file: str | os.PathLike[str], start: int = 0) -> Path:
    """Write topics as a bag, whole or not at all; ``start`` is the stamp of time zero [ns]."""
    content = DataTable.bag(topics, start)
    with replacing(file) as temporary:
        temporary.write_bytes(content)
    return Path(file)


def columns_of_rows(prefix: str, labels: Sequence[str], rows: Array) -> dict[str, Array]:
    return {prefix + label: column for label, column in zip(labels, rows.T, strict=True)}


def named_topics(prefix: str, topics: Topics) -> Topics:
    """Topics with their names below a prefix; none without columns."""
    return {f"{prefix}/{name}": (t, columns) for name, (t, columns) in topics.items() if columns}
