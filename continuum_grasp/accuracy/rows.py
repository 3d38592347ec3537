"""Tables of the report, for reading and for programs: what each choice costs and how wrong it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.accuracy.choice import ACCURACIES, Choice, assess, choices, open_families
from continuum_grasp.accuracy.motion import INSTANTS, Motion, Runs, evaluation_error, evaluation_ns, pace, rms
from continuum_grasp.accuracy.truth import Truth
from continuum_grasp.core import Core
from continuum_grasp.errors import ContinuumGraspError, NumericalError
from continuum_grasp.scene.families import PAPER_FAMILY
from continuum_grasp.scene.integrators import INTEGRATORS, SIMULATION_METHODS
from continuum_grasp.scene.simulate import Scene


@dataclass(frozen=True)
class Table:
    """Rows of figures under named columns.

    Attributes
    ----------
    title : str
    columns : tuple of str
    rows : tuple of tuple
        Texts and numbers; None and NaN where something does not apply.
    note : str
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    note: str = ""

    def column(self, name: str) -> list[Any]:
        """All entries under one name."""
        k = self.columns.index(name)
        return [row[k] for row in self.rows]

    def markdown(self) -> str:
        """The table as Markdown, numbers to the right."""
        texts = [[_text(value) for value in row] for row in self.rows]
        number = [all(not isinstance(row[k], str) for row in self.rows) for k in range(len(self.columns))]
        lines = [f"## {self.title}", "", _line(self.columns), _line(["---:" if right else "---" for right in number])]
        lines += [_line(row) for row in texts]
        return "\n".join([*lines, "", *([self.note, ""] if self.note else [])])

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; what is not finite is None."""
        rows = [[_plain(value) for value in row] for row in self.rows]
        return {"title": self.title, "columns": list(self.columns), "rows": rows, "note": self.note}


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _text(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:,.0f}" if 1000.0 <= abs(value) < 1e9 else f"{value:.3g}"
    return str(value)


COLUMNS = (
    "model",
    "elements",
    "unknowns",
    "instructions",
    "evaluation [ns]",
    "real-time factor",
    "tip / L",
    "shape / L",
    "frequency 1",
    "frequency 2",
    "motion / L",
)
_LONGEST = 10_000
"""Instructions of the forward dynamics up to which a model is compiled and timed; compiling larger ones would take
most of the report's time."""
_STEPS = tuple(
    (name, count)
    for name in SIMULATION_METHODS
    for count in ((1, 2, 4) if INTEGRATORS[name].stable is None else (1, 2, 4, 8))
)
"""Methods and steps between two instants."""
_FINEST = 64
"""Steps between two instants of the motion that others are compared with: eight times the most of `_STEPS`, which rk4
rewards with an error 4,096 times smaller."""
_EQUAL = 1e-4
"""Error of the time steps, per length, at which real-time factors are compared: below the error of most models."""

NOTES = {
    "choices": "Greatest errors over the static load cases, and of the natural frequencies about them; r.m.s. error of "
    f"the tip in motion; real-time factor with Runge-Kutta steps whose own error is {_EQUAL:g} of the length.",
    "integrators": "Greatest error of the tip by the steps alone; as called from Python.",
    "terms": "Greatest error of the accelerations by truncated terms and nodes, per their greatest entry, over "
    "states in the declared range.",
    "precision": "As in the table of terms, by rounding alone.",
}


def columns_of(title: str) -> tuple[str, ...]:
    if title == "integrators":
        return ("model", "method", "steps per s", "real-time factor", "error of steps / L")
    if title == "terms":
        return ("model", "accuracy", "instructions", "evaluation [ns]", "error of xd")
    if title == "precision":
        return ("model", "real", "evaluation [ns]", "error of xd")
    return COLUMNS


Job = Callable[[], "tuple[Any, ...] | None"]


class ReportRows:
    """Rows of the tables, one by one."""

    def __init__(self, scene: Scene, truth: Truth, reference: Motion | None) -> None:
        self.scene, self.truth, self.reference = scene, truth, reference
        self.families = open_families(scene)

    def jobs(self, counts: Sequence[int]) -> Iterator[tuple[str, Job]]:
        """Title of the table and what gives its next row."""
        for family in reversed(self.families):
            for choice in choices(self.scene, self.truth, family, None, counts=counts):
                yield "choices", lambda choice=choice: self._choice(choice)  # type: ignore[misc]
        for family in (PAPER_FAMILY, self.families[0]):
            two = [c for c in choices(self.scene, self.truth, family, None) if c.elements >= 2]
            if not two:
                continue
            for accuracy in ACCURACIES:
                yield "terms", lambda c=two[0], a=accuracy: self._terms(c, a)  # type: ignore[misc]
            for real in ("double", "float"):
                yield "precision", lambda c=two[0], r=real: self._precision(c, r)  # type: ignore[misc]
            if self.reference is not None:
                for method, substeps in _STEPS:
                    yield "integrators", lambda c=two[0], m=method, n=substeps: self._integrator(c, m, n)  # type: ignore[misc]

    def _choice(self, choice: Choice) -> tuple[Any, ...]:
        found, model = assess(choice, self.truth), choice.model
        scene = self.scene.model_copy(update={"fidelity": choice.fidelity})
        time, factor, motion = math.nan, math.nan, math.nan
        if found.instructions <= _LONGEST:
            time = evaluation_ns(model)
            if self.reference is not None:
                try:
                    run = pace(scene, model, _EQUAL)
                    factor, motion = run.real_time_factor, rms(run.tip - self.reference.tip) / model.finger.rod.length
                except ContinuumGraspError:  # no such start, or no motion that stays finite
                    motion = math.inf
        frequencies = found.frequencies if self.reference is not None else (math.nan, math.nan)
        name = choice.family + (", aligned" if choice.aligned else "")
        costs = (found.instructions, time, factor)
        return (name, len(model.lengths), model.n, *costs, found.tip, found.shape, *frequencies, motion)

    def _terms(self, choice: Choice, accuracy: float) -> tuple[Any, ...]:
        model, full = choice.with_accuracy(accuracy).model, choice.with_accuracy(1e-15).model
        name = f"{choice.elements} {choice.family}"
        error = evaluation_error(model.forward_dynamics, full)
        return (name, accuracy, int(model.forward_dynamics.n_instructions()), evaluation_ns(model), error)

    def _precision(self, choice: Choice, real: str) -> tuple[Any, ...] | None:
        core = Core(choice.model, precision="double")
        if not core.compiled:
            return None
        core = Core(choice.model, precision=real)
        error = evaluation_error(lambda *x: core.forward_dynamics(*x), choice.model)
        return (f"{choice.elements} {choice.family}", real, evaluation_ns(choice.model, precision=real), error)

    def _integrator(self, choice: Choice, method: str, substeps: int) -> tuple[Any, ...] | None:
        runs = Runs(self.scene.model_copy(update={"fidelity": choice.fidelity}), choice.model)
        finest, length = runs.tip(_FINEST), choice.model.finger.rod.length
        try:
            off = runs.tip(substeps, method) - finest
        except NumericalError:
            return (f"{choice.elements} {choice.family}", method, round(substeps / runs.step), math.nan, math.inf)
        factor = INSTANTS * runs.step / runs.seconds(substeps, method)
        error = float(np.linalg.norm(off, axis=1).max()) / length
        return (f"{choice.elements} {choice.family}", method, round(substeps / runs.step), factor, error)
