"""``continuum-grasp sweep``."""

from __future__ import annotations

from dataclasses import replace

from continuum_grasp.cli import Output, option, run_verb

_FOLDER = "Folder of the sweep (default: runs/sweep/NAME-OF-CONFIG); a stopped sweep resumes."


@run_verb(out=_FOLDER, pictures="Draw maps and Pareto pictures.")
def sweep(
    output: Output,
    workers: int | None = option("Processes on this machine (default: all cores).", metavar="N", min=1, max=4096),
    scheduler: str | None = option("Work on a Dask cluster (extra: cluster).", metavar="tcp://HOST:PORT"),
    keep: str = option("Runs whose files to keep.", default="all", words=("all", "failed", "none")),
    plot_only: bool = option("Compute nothing: draw the rows of the table so far.", default=False),
) -> None:
    """Find the grasps of many scenes. Keys vary on a grid or at random; a sweep resumes after an interruption."""
    from continuum_grasp.addons.sweeps.table import CSV, sweep_table

    folder = output.folder
    output.check_folder(alone=False)  # a sweep locks its table, which may be drawn while it grows
    if plot_only:
        from continuum_grasp.addons.sweeps.folder import PLAN
        from continuum_grasp.addons.sweeps.plan import SweepPlan
        from continuum_grasp.results import begin_run

        # The pictures are those that the configuration asks for now; those of before go.
        table = replace(sweep_table(folder), requested=SweepPlan.of(output.config, output.changes or []).pictures)
        begin_run(folder, "sweep", retained=(PLAN, CSV))
    else:
        from continuum_grasp.addons.sweeps.run import sweep as run

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
        output.warn([f"no scene has a grasp; first row: {table['message'][0]}"])
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
