"""The lists in docs/results.md, as the results declare them; ``python -m tests.results_page`` writes them there."""

from __future__ import annotations

from pathlib import Path

from continuum_grasp.addons.design import DesignResult
from continuum_grasp.addons.identification import Commissioning, Comparison, ExperimentPlan, Fit, Replay
from continuum_grasp.addons.mission import MissionRun, TrialsResult
from continuum_grasp.addons.planning import MotionPlan
from continuum_grasp.addons.sweeps import SweepTable
from continuum_grasp.closed_loop import ControlRun
from continuum_grasp.grasp import GraspResult, HandResult
from continuum_grasp.results import Dimension, Result, Stored
from continuum_grasp.simulation import AccuracyReport, Equilibrium, Modes, Trajectory

PAGE = Path(__file__).parents[1] / "docs" / "results.md"
BEGIN = "<!-- What follows is written by `python -m tests.results_page`. -->\n"
MADE_BY = {
    Trajectory: "`cg.simulate`, `continuum-grasp simulate`",
    Equilibrium: "`cg.equilibrium`",
    Modes: "`cg.modes`, `continuum-grasp modes`",
    GraspResult: "`cg.optimize_grasp`, `continuum-grasp grasp`",
    HandResult: "`cg.optimize_grasp` of a hand, `continuum-grasp grasp`",
    DesignResult: "`cg.optimize_design`, `continuum-grasp design`",
    MotionPlan: "`cg.plan`, `continuum-grasp plan`",
    ControlRun: "`cg.run_closed_loop`, `continuum-grasp mpc`",
    MissionRun: "`cg.run_mission`, `continuum-grasp mpc` of a mission",
    TrialsResult: "`cg.run_trials`, `continuum-grasp mpc --trials`",
    Comparison: "`cg.compare`, `continuum-grasp compare`",
    Replay: "`cg.replay`, `continuum-grasp replay`",
    Commissioning: "`cg.commission`, `continuum-grasp commission`",
    Fit: "`cg.identify`, `continuum-grasp identify`",
    ExperimentPlan: "`continuum_grasp.addons.identification.design_experiments`, `continuum-grasp identify --design`",
    AccuracyReport: "`cg.accuracy_report`, `continuum-grasp accuracy`",
    SweepTable: "`cg.sweep`, `cg.sweep_table`, `continuum-grasp sweep`",
}
"""Results by what makes them, in the order of the page."""


def lists() -> str:
    """Files, arrays and dimensions of all results."""
    return "\n".join(section(result, by) for result, by in MADE_BY.items())


def section(result: type[Result], by: str) -> str:
    """One result."""
    lines = [f"### {result.__name__}", "", f"Made by {by}; `kind` in `meta.json` is `{result.kind}`.", ""]
    pictures = [f"`{one.name}`" for one in result.pictures]
    if pictures:
        lines.append(f"- Pictures: {', '.join(pictures)}.")
    if result.on_request:
        lines.append(f"- Pictures that need options: {', '.join(f'`{one.name}`' for one in result.on_request)}.")
    files = [f"`{one.name}`" for one in (*result.texts, *result.pages)]
    if files:
        lines.append(f"- Texts: {', '.join(files)}.")
    if lines[-1]:
        lines.append("")
    if result.stored:
        lines += table(("array", "dimensions", "unit", "what it is"), [row(one) for one in result.stored])
        lines += table(("dimension", "labels", "what it is"), [labels(one) for one in result.dimensions])
    return "\n".join(lines)


def row(one: Stored) -> tuple[str, ...]:
    """An array."""
    unit = {"": "by label", "text": "text"}.get(one.unit, one.unit)
    return f"`{one.name}`", ", ".join(one.dimensions) or "one value", unit, one.meaning


def labels(one: Dimension) -> tuple[str, ...]:
    """A dimension."""
    if isinstance(one.labels, tuple):
        found = ", ".join(one.labels) or "none"
    elif isinstance(one.labels, int):
        found = f"counted from {one.labels}"
    else:
        found = f"`{one.labels}`" + (f" [{one.unit}]" if one.unit else "")
    return one.name, found, one.meaning


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """A table in Markdown, and an empty line."""
    return [f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows)] + [""]


if __name__ == "__main__":
    written = PAGE.read_text(encoding="utf-8").split(BEGIN)[0]
    PAGE.write_text(f"{written}{BEGIN}\n{lists()}", encoding="utf-8")
