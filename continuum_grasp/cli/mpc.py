"""``continuum-grasp mpc``."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from continuum_grasp.base import InputError, Interrupted
from continuum_grasp.cli.options import option, run_verb
from continuum_grasp.cli.output import Output

if TYPE_CHECKING:
    from continuum_grasp.addons.mission import MissionScene
    from continuum_grasp.grasp import GraspResult
    from continuum_grasp.scene import ControlScene

_SHOWN = 10
"""Failed plants that are listed."""


@run_verb("animation")
def mpc(
    output: Output,
    seed: int | None = option("Seed of the noise (default: from the configuration).", metavar="N"),
    trials: str | None = option("Run the mission on N random plants (all: trials.count of them).", metavar="N|all"),
    times: bool = option("Measure the controller's times, with optimized code.", default=False),
    jobs: int | None = option("Processes for --trials (default: all cores).", metavar="N", min=1),
    mcap: Path | None = option("Write a bag of ROS 2 too, for Foxglove and replay (extra ros).", metavar="FILE"),
) -> None:
    """Control a finger in closed loop with a finer model of it.

    Exit status 1 if the supervisor tripped, or a setpoint that stood was missed. A mission (its configuration has a
    grasp) takes an object from approach to release; exit status 1 if it is dropped, or not let go in the end.
    """
    from continuum_grasp.addons.mission import MissionScene
    from continuum_grasp.scene import ControlScene

    seeding = [] if seed is None else [f"plant.seed={seed}"]
    output = replace(output, changes=[*(output.changes or ()), *seeding])
    scene = output.scene(ControlScene, MissionScene)
    if isinstance(scene, ControlScene) and scene.duration is None:
        raise InputError("a closed loop needs a duration [s]", file=str(output.config), key="duration")
    if isinstance(scene, ControlScene) and trials is not None:
        raise InputError("works only for missions", key="--trials")
    if trials is not None and output.animation is not None:
        raise InputError("works for one mission only, not with --trials", key="--animate")
    if mcap is not None:
        _check_bag(mcap, trials)
    if isinstance(scene, ControlScene):
        _control(scene, output, times, mcap)
    elif trials is None:
        _carry_out(scene, output, times, mcap)
    else:
        _try_out(_with_trials(trials, seed, output), jobs, output)


def _check_bag(file: Path, trials: str | None) -> None:
    """Refuse, before any work, a bag that cannot be written."""
    from continuum_grasp.scene import DataTable

    if trials is not None:
        raise InputError("works for one mission only, not with --trials", key="--mcap")
    if file.is_dir():
        raise InputError("expected a file, got a folder", file=str(file), key="--mcap")
    if file.exists() and not DataTable.is_own_bag(file):
        raise InputError("no run wrote this bag: move it away, or name another file", file=str(file), key="--mcap")
    DataTable.bag({})  # its libraries may be missing


def _control(scene: ControlScene, output: Output, times: bool, mcap: Path | None) -> None:
    """Run a closed loop: saves it, prints how well it went, draws it; exit status 1 if it ended badly."""
    from continuum_grasp.closed_loop import run_closed_loop

    run, files = output.run("controlling", lambda report: run_closed_loop(scene, progress=report, times=times))
    if mcap is not None:
        files.append(run.write_mcap(mcap))
    output.warn(run.warnings)
    output.say(run.report())
    output.conclude(run, files, status=run.outcome, duration=run.t[-1], metrics=asdict(run.metrics()))
    if run.outcome != "finished":
        output.fail()


def _with_trials(trials: str, seed: int | None, output: Output) -> Any:
    """The mission with as many trials as asked, and their seed."""
    from continuum_grasp.addons.mission import MissionScene

    if trials != "all" and not trials.isdecimal():
        raise InputError(f"expected a number or all, got {trials!r}", key="--trials")
    count = [] if trials == "all" else [f"trials.count={trials}"]
    seeding = [] if seed is None else [f"trials.seed={seed}"]
    return replace(output, changes=[*(output.changes or ()), *count, *seeding]).scene(MissionScene)


def _carry_out(scene: MissionScene, output: Output, times: bool, mcap: Path | None) -> None:
    """Carry a mission out once: saves it, prints the verdict, draws it; exit status 1 if it failed."""
    from continuum_grasp.addons.mission import run_mission

    output.check_folder()  # by the files of its results
    grasp = _grasp(scene, output)
    run, files = output.run(
        "carrying it out", lambda report: run_mission(scene, grasp=grasp, progress=report, times=times)
    )
    if mcap is not None:
        first, *others = run.fingers.values()
        files.append(first.write_mcap(mcap, run.fingers if others else None))
    said = {limit.text for limit in run.exceeded}  # before the run
    output.warn(text for text in run.warnings if text not in said)
    output.pairs(run.verdict.pairs())
    output.say("")
    output.table(*run.rows())
    metrics = {name: finger.metrics() for name, finger in run.fingers.items()}
    for name, finger_metrics in metrics.items():
        output.say("" if run.run is not None else f"\nfinger {name}")
        if finger_metrics.times:
            output.table(*finger_metrics.time_rows())
            output.say("")
        pairs = finger_metrics.pairs()
        output.pairs(
            {key: pairs[key] for key in ("late", "status", "health", "anomalies", "mismatch")}
            | {"code": run.fingers[name].code}
        )
    counted = {name: asdict(finger_metrics) for name, finger_metrics in metrics.items()}
    of_run = counted if run.run is None else next(iter(counted.values()))
    output.conclude(run, files, **run.findings(), pulls=run.pulls, metrics=of_run)
    if not run.verdict.succeeded:
        output.fail()


def _try_out(scene: MissionScene, jobs: int | None, output: Output) -> None:
    """Carry a mission out on many plants: saves and prints how it went; exit status 1 if it failed on any."""
    from continuum_grasp.addons.mission import run_trials

    output.check_folder()  # by the files of its results
    grasp = _grasp(scene, output)
    stopped: Interrupted | None = None
    try:
        with output.busy(f"on {scene.trials.count} plants") as report:
            outcomes = run_trials(scene, grasp=grasp, jobs=jobs, progress=report)
    except Interrupted as error:
        if not error.result:
            raise
        outcomes = error.result
        stopped = error
    summary = outcomes.summary
    files = output.save(outcomes)
    output.pairs(summary.pairs())
    for k in summary.failed[:_SHOWN]:
        output.say(f"plant {k + 1}: {outcomes[k].text}")
    if len(summary.failed) > _SHOWN:
        output.say(f"and {len(summary.failed) - _SHOWN} more: see trials.csv")
    failed = [{"plant": k + 1, "text": outcomes[k].text} for k in summary.failed]
    output.conclude(outcomes, files, asked=scene.trials.count, summary=asdict(summary), failed=failed)
    if stopped is not None:
        raise stopped
    if not all(outcome.succeeded for outcome in outcomes):
        output.fail()


def _grasp(scene: MissionScene, output: Output) -> GraspResult:
    from continuum_grasp.grasp import optimize_grasp

    with output.busy("optimizing the grasp"):
        grasp = optimize_grasp(scene.grasp)
    # A search that was stopped has a grasp, but not the one that a mission should be judged by.
    if grasp.statistics["interrupted"]:
        raise KeyboardInterrupt("interrupted while the grasp was optimized")
    return grasp
