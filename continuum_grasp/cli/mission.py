"""``continuum-grasp mpc`` of a mission: once, or on many plants."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from continuum_grasp.cli.output import Output

if TYPE_CHECKING:
    from continuum_grasp.grasp.result import GraspResult
    from continuum_grasp.mission.outcomes import Outcome
    from continuum_grasp.mission.result import MissionRun
    from continuum_grasp.scene.mission import MissionScene

__all__ = ["carry_out", "try_out"]

DROPPED = 1
_SHOWN = 10
"""Failed plants that are listed."""


def carry_out(scene: MissionScene, folder: Path, animation: str | None, pictures: bool, output: Output) -> None:
    """Carry a mission out once: saves it, prints the verdict, draws it; exit status 1 if the object was dropped."""
    from continuum_grasp.mission.run import run_mission

    grasp = _grasp(scene, output)
    with output.computing("carrying it out", folder) as report:
        run = run_mission(scene, grasp=grasp, progress=report)
    files = output.save_motion(run, folder, pictures, animation)
    _tell(run, folder, files, output)
    if not run.verdict.held:
        raise typer.Exit(DROPPED)


def try_out(scene: MissionScene, folder: Path, jobs: int | None, pictures: bool, output: Output) -> None:
    """Carry a mission out on many plants: saves and prints how it went; exit status 1 if it failed on any."""
    from continuum_grasp.errors import Interrupted
    from continuum_grasp.mission.trials import run_trials

    grasp = _grasp(scene, output)
    stopped: Interrupted | None = None
    try:
        with output.busy(f"on {scene.trials.count} plants") as report:
            outcomes = run_trials(scene, grasp=grasp, jobs=jobs, progress=report)
    except Interrupted as error:
        if not error.result:
            raise
        outcomes, stopped = error.result, error
    _tell_outcomes(scene, outcomes, folder, pictures, output)
    if stopped is not None:
        raise stopped
    if not all(outcome.succeeded for outcome in outcomes):
        raise typer.Exit(DROPPED)


def _grasp(scene: MissionScene, output: Output) -> GraspResult:
    from continuum_grasp.grasp import optimize_grasp

    with output.busy("optimizing the grasp"):
        found = optimize_grasp(scene.grasp)
    if found.statistics["interrupted"]:
        raise KeyboardInterrupt("interrupted while the grasp was optimized")
    return found


def _tell(run: MissionRun, folder: Path, files: list[Path], output: Output) -> None:
    found = run.run.metrics()
    output.warn(run.warnings)
    output.pairs(run.verdict.pairs())
    output.say("")
    rows = run.rows()
    output.table(rows[0], rows[1:])
    output.say("")
    times = [row for row in found.rows() if row[0] == "time" or row[0] in run.run.phase_names]
    output.table(times[0], times[1:])
    output.say("")
    pairs = found.pairs()
    output.pairs({key: pairs[key] for key in ("late", "status", "health", "anomalies", "mismatch")})
    output.pairs({"saved in": folder, "pictures": ", ".join(file.name for file in files) or "none"})
    output.statistics(dict(run.run.statistics))
    output.result(
        status=run.run.ended,
        folder=str(folder),
        files=[str(file) for file in files],
        verdict={**asdict(run.verdict), "succeeded": run.verdict.succeeded},
        phases=[asdict(span) for span in run.spans],
        pulls={name: wrench.tolist() for name, wrench in run.pulls.items()},
        metrics=asdict(found),
        warnings=list(run.warnings),
        statistics=dict(run.run.statistics),
    )


def _tell_outcomes(scene: MissionScene, outcomes: list[Outcome], folder: Path, pictures: bool, output: Output) -> None:
    from continuum_grasp.mission.outcomes import save_trials, summarize

    found = summarize(outcomes)
    with output.saving(folder):
        files = [save_trials(outcomes, folder)]
    if pictures:
        from continuum_grasp.plotting.mission.timeline import plot_trials
        from continuum_grasp.results import save_picture

        with output.drawing(folder):
            files.append(save_picture(plot_trials(outcomes), folder / "trials.png"))
    output.pairs(found.pairs())
    for k in found.failed[:_SHOWN]:
        output.say(f"plant {k + 1}: {outcomes[k].text}")
    if len(found.failed) > _SHOWN:
        output.say(f"and {len(found.failed) - _SHOWN} more: see trials.csv")
    output.pairs({"saved in": folder, "files": ", ".join(file.name for file in files)})
    output.result(
        folder=str(folder),
        files=[str(file) for file in files],
        asked=scene.trials.count,
        summary=asdict(found),
        failed=[{"plant": k + 1, "text": outcomes[k].text} for k in found.failed],
    )
