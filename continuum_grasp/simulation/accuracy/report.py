"""Speed against error of every choice that a user has, in one scene."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.base import (
    CheckedArgument,
    ContinuumGraspError,
    InputError,
    check_arguments,
    interruptible,
    split_unit,
)
from continuum_grasp.results import File, Picture, Result, Stored, begin_run, pareto
from continuum_grasp.scene import Fidelity, Scene, scene_of
from continuum_grasp.simulation.accuracy.choice import Choice, assess, choices, open_families
from continuum_grasp.simulation.accuracy.motion import TipMotion, evaluation_ns, pace, reference_motion, rms
from continuum_grasp.simulation.accuracy.truth import Truth, find_truth

FRONTS = (
    ("evaluation [ns]", "tip / L"),
    ("evaluation [ns]", "frequency 1"),
    ("real-time factor", "motion / L"),
)
"""Costs and errors that are set against each other."""
COUNTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
"""Numbers of elements: each about 4/3 or 3/2 of the one before, which is even on the logarithmic axis of cost."""


COLUMNS = (
    *("model", "elements", "unknowns", "instructions", "evaluation [ns]", "real-time factor"),
    *("tip / L", "shape / L", "frequency 1", "frequency 2", "motion / L"),
)
_EQUAL = 1e-4
"""Error of the time steps in the comparison of real-time factors, per length: below the error of most models."""
NOTE = (
    "Greatest errors over the static load cases, and of the natural frequencies about them; r.m.s. error of "
    f"the tip in motion; real-time factor with Runge-Kutta steps whose own error is {_EQUAL:g} of the length."
)


@dataclass(frozen=True)
class ChoiceFigures:
    """A row of figures for each choice."""

    rows: tuple[tuple[Any, ...], ...]  # texts and numbers; NaN where something does not apply
    columns: ClassVar[tuple[str, ...]] = COLUMNS

    def column(self, name: str) -> list[Any]:
        """All entries under one name."""
        k = self.columns.index(name)
        return [row[k] for row in self.rows]

    def markdown(self) -> str:
        """The table as Markdown, numbers to the right."""
        texts = [[_text(value) for value in row] for row in self.rows]
        number = [all(not isinstance(row[k], str) for row in self.rows) for k in range(len(self.columns))]
        lines = ["## choices", "", _line(self.columns), _line(["---:" if right else "---" for right in number])]
        lines += [_line(row) for row in texts]
        return "\n".join([*lines, "", NOTE, ""])

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; a value that is not finite is None."""
        rows = [[None if isinstance(v, float) and not math.isfinite(v) else v for v in row] for row in self.rows]
        return {"title": "choices", "columns": list(self.columns), "rows": rows, "note": NOTE}


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _text(value: Any) -> str:
    if isinstance(value, float):
        written = f"{value:,.0f}" if 1000.0 <= abs(value) < 1e9 else f"{value:.3g}"
        return "-" if math.isnan(value) else written
    return f"{value:,}" if isinstance(value, int) else str(value)


@dataclass(frozen=True)
class AccuracyReport(Result):
    """Cost and error of every choice of a scene."""

    kind: ClassVar[str] = "accuracy"
    texts: ClassVar[tuple[File, ...]] = (
        File("accuracy.md", "continuum_grasp.simulation.accuracy.report:AccuracyReport.markdown"),
        File("accuracy.json", "continuum_grasp.simulation.accuracy.report:AccuracyReport.table_json"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("accuracy", "continuum_grasp.simulation.accuracy.pictures:plot_accuracy", panels=True),
    )

    scene: Scene
    truth: Truth
    reference: TipMotion | None  # the motion that others are compared with; None where the scene has no time
    choices: ChoiceFigures  # families and numbers of elements
    status: str = "finished"
    warnings: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)

    def pairs(self) -> dict[str, str]:
        """Number of measured choices, and the cheapest and the most exact of the choices that no other one
        dominates.
        """
        front = self.front()
        time = COLUMNS.index("evaluation [ns]")
        error = COLUMNS.index("tip / L")
        rows = {"choices": f"{len(self.choices.rows)} families and numbers of elements"}
        for what, row in zip(("cheapest", "most exact"), (*front[:1], *front[-1:]), strict=False):
            rows[what] = f"{row[1]} {row[0]}: {row[time]:.3g} ns, static tip error {row[error]:.2g} of the length"
        return rows

    def declared(self) -> list[Stored]:
        """The columns of the table of the choices."""
        units = {name: split_unit(name).unit or "1" for name in COLUMNS} | {"model": "text"}
        return [Stored(name, "(choices,)", unit, NOTE) for name, unit in units.items()]

    def stored_arrays(self) -> dict[str, Any]:
        """The columns by name."""
        return {name: np.array(self.choices.column(name)) for name in COLUMNS}

    def front(self, cost: str = "evaluation [ns]", error: str = "tip / L") -> list[tuple[Any, ...]]:
        """Rows of ``choices`` that no other dominates in both cost and error (the Pareto front), cheapest first."""
        i, j = COLUMNS.index(cost), COLUMNS.index(error)
        known = [row for row in self.choices.rows if math.isfinite(row[i]) and math.isfinite(row[j])]
        x, y = (np.array([row[k] for row in known], dtype=float) for k in (i, j))
        fast = cost == "real-time factor"
        best = pareto(x, y, x_greatest=fast)
        return [known[k] for k in (best[::-1] if fast else best)]

    @property
    def fronts(self) -> dict[tuple[str, str], list[tuple[Any, ...]]]:
        """Rows on each Pareto front of more than one, by cost and error."""
        fronts = {(cost, error): self.front(cost, error) for cost, error in FRONTS}
        return {pair: rows for pair, rows in fronts.items() if len(rows) > 1}

    def _fronts(self) -> list[str]:
        """Choices on each Pareto front, and those on none."""
        if not self.fronts:
            return []
        named = {pair: [f"{row[1]} {row[0]}" for row in rows] for pair, rows in self.fronts.items()}
        lines = [f"- {error} against {cost}: {', '.join(names)}" for (cost, error), names in named.items()]
        seen = {name for names in named.values() for name in names}
        rest = [name for row in self.choices.rows if (name := f"{row[1]} {row[0]}") not in seen]
        lines += [f"- dominated in each: {', '.join(rest)}"] if rest else []
        return ["Not dominated in cost and error:", "", *lines, ""]

    def markdown(self) -> str:
        """The table as Markdown, and the choices on its fronts."""
        name = self.scene.name or "scene"
        head = [f"# Speed against error: {name}", ""]
        if self.reference is not None:
            good_to = f"{self.reference.error:.2g} of the length"
            head += [f"Motions are compared with 12 free clothoids, good to {good_to}.", ""]
        if self.truth.omitted:
            head += ["Load cases omitted: " + "; ".join(self.truth.omitted) + ".", ""]
        return "\n".join([*head, *self._fronts(), self.choices.markdown()])

    def table_json(self) -> str:
        """The table as JSON."""
        return json.dumps(self.choices.as_dict(), indent=1, allow_nan=False)

    @check_arguments
    def save(self, folder: str | PathLike[str]) -> Path:
        """Write the texts into a run folder, each whole or not at all, and return the folder."""
        target = begin_run(folder, self.kind)
        self._write(self.texts, target)
        return target


def row_of(choice: Choice, truth: Truth, reference: TipMotion | None) -> tuple[Any, ...] | None:
    """Measure a choice and return its row of the table; None if it cannot have enough nodes for its accuracy."""
    if not choice.open:
        return None
    assessment = assess(choice, truth)
    model = choice.model
    scene = choice.scene.model_copy(update={"fidelity": choice.fidelity})
    time, factor, motion = math.nan, math.nan, math.nan
    # 10_000: instructions of the forward dynamics up to which a model is compiled and timed; compiling larger ones
    # would take most of the report's time
    if assessment.instructions <= 10_000:
        time = evaluation_ns(model)
        if reference is not None:
            try:
                run = pace(scene, model, _EQUAL)
                factor = run.real_time_factor
                motion = rms(run.tip - reference.tip) / model.finger.rod.length
            except ContinuumGraspError:  # no such start, or no motion that stays finite
                motion = math.inf
    frequencies = assessment.frequencies if reference is not None else (math.nan, math.nan)
    name = choice.family + (", aligned" if choice.aligned else "")
    costs = (assessment.instructions, time, factor)
    return (name, len(model.lengths), model.n, *costs, assessment.tip, assessment.shape, *frequencies, motion)


@interruptible()
@check_arguments
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
        The scene, or its YAML file; only ``bending_range`` of its ``fidelity`` matters.
    counts : sequence of int
        Numbers of elements.
    progress : callable, optional
        Called with the share done so far, 0 to 1.

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
    if not [CheckedArgument("counts", count).whole() for count in counts]:
        raise InputError("expected numbers of elements, got none", key="counts")
    bare_scene = scene_of(scene)
    bare_scene.check_for_exact_rod()
    bare_scene = bare_scene.model_copy(update={"fidelity": Fidelity(bending_range=bare_scene.fidelity.bending_range)})
    truth = find_truth(bare_scene)
    reference = reference_motion(bare_scene, truth) if bare_scene.time is not None else None
    listed = [
        c
        for family in reversed(open_families(bare_scene))
        for c in choices(bare_scene, truth, family, None, counts=counts)
    ]
    rows = []
    for k, choice in enumerate(listed, 1):
        rows.append(row_of(choice, truth, reference))
        if progress is not None:
            progress(k / len(listed))
    return AccuracyReport(bare_scene, truth, reference, ChoiceFigures(tuple(row for row in rows if row is not None)))
