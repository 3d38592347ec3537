"""``continuum-grasp mpc``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from continuum_grasp.cli.options import Animate, Config, Json, Out, Quiet, Set, Verbose
from continuum_grasp.cli.output import Output, run_folder

if TYPE_CHECKING:
    from collections.abc import Iterable

    from continuum_grasp.closed_loop.result import ControlRun
    from continuum_grasp.grasp.result import GraspResult
    from continuum_grasp.mission.result import MissionRun
    from continuum_grasp.mission.trials import Outcome
    from continuum_grasp.scene.control import ControlScene
    from continuum_grasp.scene.mission import MissionScene

TRIPPED = 1
"""Exit status of a closed loop that ended in the safe state."""


def mpc(
    config: Config,
    out: Out = None,
    changes: Set = None,
    animation: Animate = None,
    compare: Annotated[
        bool,
        typer.Option("--compare", help="Run the same with the paper's two arcs, and with NMPC solved to convergence."),
    ] = False,
    seed: Annotated[
        int | None, typer.Option("--seed", metavar="N", help="Seed of the noise (default: as in the configuration).")
    ] = None,
    trials: Annotated[
        str | None,
        typer.Option(
            "--trials",
            metavar="N|all",
            help="Carry a mission out on N plants that differ at random (all: as many as it says).",
        ),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", metavar="N", min=1, help="Processes for --trials (default: all cores).")
    ] = None,
    pictures: Annotated[bool, typer.Option("--pictures/--no-pictures", help="Draw pictures.")] = True,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Control a finger in closed loop with a finer model of it: saves the run, prints how well it went, draws it.

    Exit status 1 if the supervisor tripped. A mission (its configuration has a grasp) takes an object from approach to
    release; exit status 1 if it is dropped.
    """
    from continuum_grasp.errors import InputError
    from continuum_grasp.scene.mission import MissionScene

    output = Output(as_json, quiet, verbose)
    scene = _scene(config, [*(changes or ()), *_settings(seed, trials)])
    folder = run_folder(out, config, "mpc")
    if isinstance(scene, MissionScene):
        if compare:
            raise InputError("is not for missions", key="--compare")
        if trials is None:
            _carry_out(scene, folder, animation, pictures, output)
        elif animation:
            raise InputError("is for one mission, not for --trials", key="--animate")
        else:
            _try_out(scene, folder, jobs, pictures, output)
        return
    if trials is not None:
        raise InputError("is for missions", key="--trials")

    from continuum_grasp.closed_loop.run import run_closed_loop

    with output.computing("controlling", folder) as report:
        run = run_closed_loop(scene, progress=report)
    files = output.save_motion(run, folder, pictures, animation)
    others = _others(scene, output) if compare else {}
    _report(run, others, folder, files, output)
    if run.tripped:
        raise typer.Exit(TRIPPED)


def _settings(seed: int | None, trials: str | None) -> list[str]:
    """Entries of the configuration that have options of their own."""
    from continuum_grasp.errors import InputError

    found = [] if seed is None else [f"plant.seed={seed}"]
    if trials is not None and seed is not None:
        found.append(f"trials.seed={seed}")
    if trials not in (None, "all"):
        if not trials.isdecimal():
            raise InputError(f"expected a number or all, got {trials!r}", key="--trials")
        found.append(f"trials.count={trials}")
    return found


def _scene(config: Path, changes: Iterable[str]) -> ControlScene | MissionScene:
    from continuum_grasp.errors import InputError
    from continuum_grasp.scene.control import ControlScene
    from continuum_grasp.scene.load import load, other_kind
    from continuum_grasp.scene.mission import MissionScene

    scene = load(config, changes)
    if not isinstance(scene, (ControlScene, MissionScene)):
        raise other_kind(config, ControlScene, scene)
    if isinstance(scene, ControlScene) and scene.duration is None:
        raise InputError("a closed loop needs a duration [s]", file=str(config), key="duration")
    return scene


def _others(scene: ControlScene, output: Output) -> dict[str, ControlRun]:
    from continuum_grasp.closed_loop.converged import compared

    with output.busy("comparing") as report:
        return compared(scene, progress=report)


def _report(run: ControlRun, others: dict[str, ControlRun], folder: Path, files: list[Path], output: Output) -> None:
    found = run.metrics()
    output.warn(run.warnings)
    output.pairs({"status": run.ended, "time": f"{run.t[-1]:g} s in {len(run.u)} periods of {1e3 * run.period:g} ms"})
    output.say("")
    rows = found.rows()
    output.table(rows[0], rows[1:])
    output.say("")
    output.pairs(found.pairs())
    if others:
        output.say("")
        output.table(*_comparison({"this controller": run, **others}))
    output.pairs({"saved in": folder, "pictures": ", ".join(file.name for file in files) or "none"})
    statistics: dict[str, Any] = dict(run.statistics)
    output.statistics(statistics)
    output.result(
        status=run.ended,
        folder=str(folder),
        files=[str(file) for file in files],
        duration=float(run.t[-1]),
        metrics=asdict(found),
        compared={name: asdict(other.metrics()) for name, other in others.items()},
        warnings=list(run.warnings),
        statistics=statistics,
    )


def _comparison(runs: dict[str, ControlRun]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """One line per controller."""
    rows: list[tuple[str, ...]] = []
    for name, run in runs.items():
        found = run.metrics()
        first = found.tracking[0]
        total = 1e6 * float(run.phase_times.sum(axis=1).mean()) if run.phase_times.size else 0.0
        values = (f"{found.cost:.5g}", f"{1e3 * first.rms:.3g}", f"{1e3 * first.final:.3g}", f"{total:.4g}")
        rows.append((name, *values))
    unit = next(iter(runs.values())).metrics().tracking[0].unit
    return ("controller", "cost", f"r.m.s. [1e-3 {unit}]", f"final [1e-3 {unit}]", "mean time [us]"), rows


DROPPED = 1
"""Exit status, as of a solver that failed: there is no mission to use."""
_SHOWN = 10
"""Failed plants that are listed."""


def _carry_out(scene: MissionScene, folder: Path, animation: str | None, pictures: bool, output: Output) -> None:
    """Carry a mission out once: saves it, prints the verdict, draws it; exit status 1 if the object was dropped."""
    from continuum_grasp.mission.run import run_mission

    grasp = _grasp(scene, output)
    with output.computing("carrying it out", folder) as report:
        run = run_mission(scene, grasp=grasp, progress=report)
    files = output.save_motion(run, folder, pictures, animation)
    _tell(run, folder, files, output)
    if not run.verdict.held:
        raise typer.Exit(DROPPED)


def _try_out(scene: MissionScene, folder: Path, jobs: int | None, pictures: bool, output: Output) -> None:
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
    from continuum_grasp.mission.trials import save_trials, summarize

    found = summarize(outcomes)
    with output.saving(folder):
        files = [save_trials(outcomes, folder)]
    if pictures:
        from continuum_grasp.plotting.mission import plot_trials
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
