"""Speed against error of every choice that a user has, in one scene."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from continuum_grasp import interrupt
from continuum_grasp.accuracy.motion import Motion, reference_motion
from continuum_grasp.accuracy.rows import NOTES, Measuring, columns_of
from continuum_grasp.accuracy.tables import Table
from continuum_grasp.accuracy.truth import Truth, find_truth
from continuum_grasp.errors import InputError
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.simulate import Fidelity, Scene

__all__ = ["COUNTS", "AccuracyReport", "accuracy_report"]

FRONTS = (
    ("evaluation [ns]", "tip / L"),
    ("evaluation [ns]", "frequency 1"),
    ("real-time factor", "motion / L"),
)
"""Costs and errors that are set against each other."""
COUNTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)


@dataclass(frozen=True)
class AccuracyReport:
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

    scene: Scene
    truth: Truth
    reference: Motion | None
    tables: tuple[Table, ...]

    @property
    def choices(self) -> Table:
        """Families and numbers of elements."""
        return self.tables[0]

    def front(self, cost: str = "evaluation [ns]", error: str = "tip / L") -> list[tuple[Any, ...]]:
        """Rows of ``choices`` that no other beats in both cost and error, cheapest first."""
        i, j = self.choices.columns.index(cost), self.choices.columns.index(error)
        sign = -1.0 if cost == "real-time factor" else 1.0
        known = [row for row in self.choices.rows if math.isfinite(_number(row[i])) and math.isfinite(_number(row[j]))]
        kept: list[tuple[Any, ...]] = []
        for row in sorted(known, key=lambda row: (sign * row[i], row[j])):
            if not kept or row[j] < kept[-1][j]:
                kept.append(row)
        return kept

    def _fronts(self) -> list[str]:
        """Who is on which front, and who is on none."""
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
        return ["Beaten by no other in cost and error:", "", *lines, f"- on none: {', '.join(rest) or 'no one'}", ""]

    def markdown(self) -> str:
        """All tables as Markdown."""
        name = self.scene.name or "scene"
        head = [f"# Speed against error: {name}", ""]
        if self.reference is not None:
            head += [
                f"Motions are compared with 12 free clothoids, good to {self.reference.error:.2g} of the length.",
                "",
            ]
        if self.truth.left_out:
            head += ["Poses left out: " + "; ".join(self.truth.left_out) + ".", ""]
        return "\n".join([*head, *self._fronts(), *(table.markdown() for table in self.tables)])

    def save(self, folder: str | PathLike[str]) -> list[Path]:
        """Write ``accuracy.md``, ``accuracy.json`` and ``accuracy.png`` into a folder."""
        from continuum_grasp.plotting import plot_accuracy, save_picture
        from continuum_grasp.results import begin_run, replacing

        target = begin_run(folder, "accuracy")
        texts = {
            "accuracy.md": self.markdown(),
            "accuracy.json": json.dumps([table.as_dict() for table in self.tables], indent=1, allow_nan=False),
        }
        files = []
        for name, text in texts.items():
            with replacing(target / name) as temporary:
                temporary.write_text(text)
            files.append(target / name)
        return [*files, save_picture(plot_accuracy(self), target / "accuracy.png")]


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
        The scene, or its YAML file; what its ``fidelity`` says does not matter, but for ``bending_range``.
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
        If the scene says its initial state in coordinates of one model.
    SolverError
        If the exact rod is not found.
    NumericalError
        If the reference motion stops.
    """
    given = scene_of(scene)
    if given.initial.q is not None:
        raise InputError("initial.q says bends of one model: give a pose", key="initial.q")
    given = given.model_copy(update={"fidelity": Fidelity(bending_range=given.fidelity.bending_range)})
    truth = find_truth(given)
    measuring = Measuring(given, truth, reference_motion(given, truth) if given.time is not None else None)
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
