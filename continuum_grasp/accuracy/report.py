"""Speed against error of every choice that a user has, in one scene."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

from continuum_grasp import interrupt
from continuum_grasp.accuracy.motion import Motion, reference_motion
from continuum_grasp.accuracy.rows import NOTES, ReportRows, Table, columns_of
from continuum_grasp.accuracy.truth import Truth, find_truth
from continuum_grasp.errors import InputError
from continuum_grasp.results.record import begin_run
from continuum_grasp.results.result import File, Result
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.simulate import Fidelity, Scene

FRONTS = (
    ("evaluation [ns]", "tip / L"),
    ("evaluation [ns]", "frequency 1"),
    ("real-time factor", "motion / L"),
)
"""Costs and errors that are set against each other."""
COUNTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
"""Numbers of elements: each about 4/3 or 3/2 of the one before, which is even on the logarithmic axis of cost."""


@dataclass(frozen=True)
class AccuracyReport(Result):
    """What every choice of a scene costs, and how wrong it is.

    Attributes
    ----------
    scene : Scene
    truth : Truth
    reference : Motion or None
        The motion that others are compared with; None where the scene has no time.
    tables : tuple of Table
        ``choices`` first.
    """

    kind: ClassVar[str] = "accuracy"
    texts: ClassVar[tuple[File, ...]] = (
        File("accuracy.md", "accuracy.report:AccuracyReport.markdown"),
        File("accuracy.json", "accuracy.report:AccuracyReport.tables_json"),
    )
    pictures: ClassVar[tuple[File, ...]] = (File("accuracy.png", "plotting.accuracy:plot_accuracy"),)

    scene: Scene
    truth: Truth
    reference: Motion | None
    tables: tuple[Table, ...]

    @property
    def choices(self) -> Table:
        """Families and numbers of elements."""
        return self.tables[0]

    def front(self, cost: str = "evaluation [ns]", error: str = "tip / L") -> list[tuple[Any, ...]]:
        """Rows of ``choices`` that no other dominates in both cost and error (the Pareto front), cheapest first."""
        i, j = self.choices.columns.index(cost), self.choices.columns.index(error)
        sign = -1.0 if cost == "real-time factor" else 1.0
        known = [row for row in self.choices.rows if math.isfinite(_number(row[i])) and math.isfinite(_number(row[j]))]
        front: list[tuple[Any, ...]] = []
        for row in sorted(known, key=lambda row: (sign * row[i], row[j])):
            if not front or row[j] < front[-1][j]:
                front.append(row)
        return front

    def _fronts(self) -> list[str]:
        """Choices on each Pareto front, and those on none."""
        lines, seen = [], set()
        for cost, error in FRONTS:
            front = self.front(cost, error)
            if len(front) > 1:
                names = [f"{row[1]} {row[0]}" for row in front]
                seen.update(names)
                lines.append(f"- {error} against {cost}: {', '.join(names)}")
        rest = [name for row in self.choices.rows if (name := f"{row[1]} {row[0]}") not in seen]
        if not lines:
            return []
        return ["Not dominated in cost and error:", "", *lines, f"- on none: {', '.join(rest) or 'none'}", ""]

    def markdown(self) -> str:
        """All tables as Markdown."""
        name = self.scene.name or "scene"
        head = [f"# Speed against error: {name}", ""]
        if self.reference is not None:
            head += [
                f"Motions are compared with 12 free clothoids, good to {self.reference.error:.2g} of the length.",
                "",
            ]
        if self.truth.omitted:
            head += ["Load cases omitted: " + "; ".join(self.truth.omitted) + ".", ""]
        return "\n".join([*head, *self._fronts(), *(table.markdown() for table in self.tables)])

    def tables_json(self) -> str:
        """All tables as JSON."""
        return json.dumps([table.as_dict() for table in self.tables], indent=1, allow_nan=False)

    def save(self, folder: str | PathLike[str]) -> Path:
        """Write ``accuracy.md`` and ``accuracy.json`` into a run folder, each whole or not at all.

        Returns
        -------
        pathlib.Path
            The folder.

        Raises
        ------
        OSError
            The files cannot be written.
        """
        target = begin_run(folder, self.kind)
        self._write(self.texts, target)
        return target


@interrupt.listening()
def accuracy_report(
    scene: Scene | str | PathLike[str],
    *,
    counts: Sequence[int] = COUNTS,
    progress: Callable[[float], None] | None = None,
) -> AccuracyReport:
    """Measure the choices of a scene: their cost, and their error against the exact rod.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file; of its ``fidelity``, only ``bending_range`` matters.
    counts : sequence of int
        Numbers of elements.
    progress : callable, optional
        Called with the share that is done, 0 to 1.

    Returns
    -------
    AccuracyReport

    Raises
    ------
    InputError
        If the scene gives its initial state in coordinates of one model.
    SolverError
        If the exact rod is not found.
    NumericalError
        If the reference motion stops.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> scene = cg.Scene(
    ...     schema_version=1,
    ...     finger={
    ...         "rod": {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.006},
    ...         "base": {"angle": -1.5708},  # along +x
    ...     },
    ...     gravity=(0.0, -9.81),
    ... )
    >>> report = cg.accuracy_report(scene, counts=(1, 2))
    >>> sorted({row[0] for row in report.choices.rows})
    ['arc', 'clothoid', 'matched_clothoid']
    """
    given = scene_of(scene)
    if given.initial.q is not None:
        raise InputError("initial.q is in coordinates of one model: give a pose", key="initial.q")
    given = given.model_copy(update={"fidelity": Fidelity(bending_range=given.fidelity.bending_range)})
    truth = find_truth(given)
    measuring = ReportRows(given, truth, reference_motion(given, truth) if given.time is not None else None)
    jobs = list(measuring.jobs(counts))
    found: dict[str, list[tuple[Any, ...]]] = {}
    for k, (title, job) in enumerate(jobs):
        row = job()
        if row is not None:
            found.setdefault(title, []).append(row)
        if progress is not None:
            progress((k + 1) / len(jobs))
    tables = [
        Table(title, columns_of(title), tuple(found.get(title, ())), NOTES[title])
        for title in NOTES
        if found.get(title)
    ]
    return AccuracyReport(given, truth, measuring.reference, tuple(tables))


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)
