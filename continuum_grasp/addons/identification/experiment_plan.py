"""A plan of experiments: poses to measure, commands to log, and how well they show the unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.addons.identification.fit import estimate_texts, table_of
from continuum_grasp.addons.identification.scene import IdentifyScene
from continuum_grasp.addons.identification.segments import Segment
from continuum_grasp.base import Array
from continuum_grasp.results import Dimension, File, Picture, Result, Stored
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import Trajectory

POSES, SET = "poses.csv", "set"
"""Table of the poses to measure, and its column with the name of the set of each."""


@dataclass(frozen=True)
class ExperimentPlan(Result):
    """Poses and commands to measure next, and the standard deviations of the unknowns before and after.

    Attributes
    ----------
    names, units : tuple of str
        Names and units of the n unknowns.
    pose_headings, pose_rows : tuple of str, tuple of tuple of str
        Table of the poses, with empty cells for the measurements.
    segments : tuple of Segment
        Parts of the commands: name, what it shows, start and end [s].
    command_names : tuple of str
        Name and unit of each command.
    experiment_names : tuple of str
        Poses and segments.
    rehearsal : Trajectory or None
        The motion that the commands cause, at the known values.
    configuration : IdentifyScene or None
        Reads the table of poses, once it is filled in.
    scene : Scene
        With the commands in it, for `simulate`.
    status : {"designed", "not shown"}
        ``not shown``: no possible experiment shows one of the unknowns.
    warnings : tuple of str
        Unknowns that these experiments cannot show, and limits that the motion exceeds.
    statistics : mapping
    """

    kind: ClassVar[str] = "experiments"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("t", "(time,)", "s", "instants"),
        Stored("commands", "(time, command)", "", "commands of the drives"),
        Stored("values", "(unknown,)", "", "unknowns at which the deviations are predicted: as known, or the start"),
        Stored("before", "(unknown,)", "", "standard deviations that they have without these experiments"),
        Stored("deviations", "(unknown,)", "", "standard deviations that they will have"),
        Stored("shares", "(unknown, experiment)", "1", "share of each experiment in the information on an unknown"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("time", "instants", "t", "s"),
        Dimension("command", "commands of the drives", "command_names"),
        Dimension("unknown", "unknowns to estimate", "unknown_names"),
        Dimension("experiment", "poses, and segments of the commands", "experiment_names"),
    )
    texts: ClassVar[tuple[File, ...]] = (
        File(POSES, "continuum_grasp.addons.identification.experiment_plan:poses_text", needs="pose_rows"),
        File(
            "experiments.yaml",
            "continuum_grasp.addons.identification.experiment_plan:configuration_text",
            needs="pose_rows",
        ),
        File("excitation.csv", "continuum_grasp.addons.identification.experiment_plan:commands_text", needs="segments"),
        File("excitation.yaml", "continuum_grasp.addons.identification.experiment_plan:scene_text", needs="segments"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("excitation", "continuum_grasp.addons.identification.pictures:plot_excitation", needs="segments"),
    )

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    before: Array
    deviations: Array
    shares: Array
    experiment_names: tuple[str, ...]
    scene: Scene
    status: str
    warnings: tuple[str, ...]
    pose_headings: tuple[str, ...] = ()
    pose_rows: tuple[tuple[str, ...], ...] = ()
    configuration: IdentifyScene | None = None
    segments: tuple[Segment, ...] = ()
    t: Array = field(default_factory=lambda: np.zeros(0))
    commands: Array = field(default_factory=lambda: np.zeros((0, 0)))
    command_names: tuple[str, ...] = ()
    rehearsal: Trajectory | None = None
    statistics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def unknown_names(self) -> tuple[str, ...]:
        """Name and unit of each unknown."""
        return tuple(f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True))

    @property
    def shown_by(self) -> tuple[str, ...]:
        """Per unknown the experiment that shows most of it; none for what cannot be seen."""
        return tuple(self.experiment_names[int(np.argmax(row))] if np.any(row > 0.0) else "none" for row in self.shares)

    def pairs(self) -> dict[str, str]:
        """Unknowns with the deviations that they will have."""
        return estimate_texts(self, 4)

    def details(self) -> dict[str, Any]:
        """Unknowns, poses and segments as plain data."""
        known = {"name": self.names, "unit": self.units, "value": self.values, "before": self.before}
        return {
            "unknowns": table_of(**known, deviation=self.deviations, shown_by=self.shown_by),
            "poses": [dict(zip(self.pose_headings, row, strict=True)) for row in self.pose_rows],
            "segments": [segment._asdict() for segment in self.segments],
        }


def poses_text(plan: ExperimentPlan) -> str:
    """The poses as a table with empty cells for the measurements."""
    return plan.as_csv(plan.pose_headings, plan.pose_rows)


def configuration_text(plan: ExperimentPlan) -> str:
    """The configuration that reads what was measured, and the table of poses."""
    head = f"# Reads {POSES}, once its empty cells are filled in.\n"
    plain = {} if plan.configuration is None else plan.configuration.model_dump(mode="json", exclude_unset=True)
    return plan.as_yaml({"schema_version": 1, **plain}, head, exact=True)


def commands_text(plan: ExperimentPlan) -> str:
    """The commands as a table for the drives' controller, and for a log."""
    rows = [[f"{value:.9g}" for value in row] for row in np.column_stack([plan.t, plan.commands]).tolist()]
    return plan.as_csv(("t [s]", *plan.command_names), rows)


def scene_text(plan: ExperimentPlan) -> str:
    """The scene with the commands, which ``simulate`` reads."""
    lines = [f"# {segment.start:g} to {segment.end:g} s: {segment.name}, {segment.shows}" for segment in plan.segments]
    head = "".join(f"{line}\n" for line in lines)
    return plan.as_yaml(plan.scene.model_dump(mode="json", exclude_unset=True), head, exact=True)
