"""Verbs of grasps: ``grasp``, ``design``, ``sweep``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import typer

from continuum_grasp.base import SolverError
from continuum_grasp.cli.options import OF_RUNS, option, verb
from continuum_grasp.cli.output import Output, one_of, out_option

if TYPE_CHECKING:
    from continuum_grasp.grasp import Reason

_PICTURES = typer.Option("--pictures/--no-pictures", help="Draw a picture and write the HTML report.")


@verb(*OF_RUNS, pictures=_PICTURES)
def grasp(
    output: Output,
    seed: int | None = option("Seed of robust grasps' draws (default: as in the configuration).", metavar="N"),
    fine: bool = option(
        "Solve once more with a fine model and report what that changes.", "--fine/--no-fine", default=True
    ),
) -> None:
    """Find how fingers hold an object, or why they cannot."""
    from continuum_grasp.scene import GraspScene

    seeding = [] if seed is None else [f"solver.random_seed={seed}"]
    output = replace(output, changes=[*(output.changes or ()), *seeding])
    scene = output.scene(GraspScene)
    output.check_folder()

    from continuum_grasp.grasp import optimize_grasp

    with output.busy("searching") as report:
        result = optimize_grasp(
            scene, raise_on_failure=False, fine=fine, progress=lambda text: report(None, f"searching, {text}")
        )
    with output.saving():  # the grasp is safe before what can be computed again
        result.save(output.folder, quality=False)
    with output.drawing():
        result.save(output.folder)
        files = output.drawn(result) if output.pictures else []

    output.say(result.table())  # its first line is the verdict
    output.warn(result.warnings)
    output.conclude(result, files, table=result.table(), reasons=[_numbers(reason) for reason in result.reasons])
    if not result.solved:
        raise SolverError(result.message, status=result.status.value, result=result)


def _numbers(reason: Reason) -> dict[str, Any]:
    """The numbers of a reason, and of those that go with it."""
    numbers = {"name": reason.name, "key": reason.key, "limit": reason.limit, "needed": reason.needed}
    return numbers | ({"also": [_numbers(other) for other in reason.also]} if reason.also else {})


@verb(*OF_RUNS)
def design(output: Output) -> None:
    """Choose numbers of a finger or scene by gradient. The grasps of one or many objects become best."""
    from continuum_grasp.design import optimize_design

    optimum, files = output.run(
        "designing",
        lambda report: optimize_design(
            output.config, progress=report, raise_on_failure=False, overrides=output.changes or ()
        ),
    )
    output.report(optimum, files, set=optimum.values, **optimum.details())
    if not optimum.solved:
        raise SolverError(optimum.message, status=optimum.status.value, result=optimum)


_OUT = out_option("Folder of the sweep (default: runs/sweep/NAME-OF-CONFIG); one that was stopped goes on.")
_MAPS = typer.Option("--pictures/--no-pictures", help="Draw maps and Pareto pictures.")


@verb(*OF_RUNS, out=_OUT, pictures=_MAPS)
def sweep(
    output: Output,
    workers: int | None = option("Processes on this machine (default: all cores).", metavar="N", min=1, max=4096),
    scheduler: str | None = option("Work on a Dask cluster (extra: cluster).", metavar="tcp://HOST:PORT"),
    keep: str = option(
        "Of which runs to keep the files.",
        default="all",
        metavar="all|failed|none",
        parser=one_of("all", "failed", "none"),
    ),
    plot_only: bool = option("Compute nothing: draw what the table holds by now.", default=False),
) -> None:
    """Find the grasps of many scenes. Keys vary on a grid or at random; a sweep resumes after an interruption."""
    folder = output.folder
    output.check_folder(alone=False)  # a sweep locks its table, which may be drawn while it grows
    if plot_only:
        from continuum_grasp.results import begin_run
        from continuum_grasp.sweeps import CSV, PLAN, plan_of, sweep_table

        # The pictures are those that the configuration asks for now; those of before go.
        table = replace(sweep_table(folder), requested=plan_of(output.config, output.changes or []).pictures)
        begin_run(folder, "sweep", retained=(PLAN, CSV))
    else:
        from continuum_grasp.sweeps import sweep as run

        with output.busy("starting workers") as report:
            table = run(
                output.config,
                folder=folder,
                workers=workers,
                scheduler=scheduler,
                keep=keep,  # type: ignore[arg-type]
                progress=report,
                overrides=output.changes or [],
            )
    files = []
    if output.pictures or plot_only:
        with output.drawing():
            files = output.drawn(table)
    statistics = dict(table.statistics)
    output.warn(statistics.pop("notes", ()))
    if len(table) and not table.solved.any():
        output.warn([f"no scene has a grasp; the first row says: {table['message'][0]}"])
    output.conclude(
        replace(table, statistics=statistics),
        files,
        table.pairs(),
        table=table.folder / "table.jsonl",
        scenes=table.total,
        rows=len(table),
        status=table.counts,
        failures=table.failures,
    )
