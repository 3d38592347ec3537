"""``continuum-grasp sweep``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from continuum_grasp.cli.options import option, out_option, verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import InputError

if TYPE_CHECKING:
    from continuum_grasp.sweeps import SweepTable

_OUT = out_option("Folder of the sweep (default: runs/sweep/NAME-OF-CONFIG); one that was stopped goes on.")
_PICTURES = typer.Option("--pictures/--no-pictures", help="Draw maps and Pareto pictures.")


@verb("config", "out", "changes", "pictures", "as_json", "quiet", "verbose", out=_OUT, pictures=_PICTURES)
def sweep(
    output: Output,
    workers: int | None = option("Processes on this machine (default: all cores).", metavar="N", min=1, max=4096),
    scheduler: str | None = option("Work on a Dask cluster (extra: cluster).", metavar="tcp://HOST:PORT"),
    keep: str = option("Of which runs to keep the files.", default="all", metavar="all|failed|none"),
    plot_only: bool = option("Compute nothing: draw what the table holds by now.", default=False),
) -> None:
    """Find the grasps of many scenes. Keys vary on a grid or at random; a sweep resumes after an interruption."""
    if keep not in ("all", "failed", "none"):
        raise InputError(f"expected all, failed or none, got {keep!r}", key="--keep")
    folder = output.folder
    output.check_folder(alone=False)  # a sweep locks its table, which may be drawn while it grows
    if plot_only:
        from continuum_grasp.results.record import begin_run
        from continuum_grasp.sweeps import sweep_table
        from continuum_grasp.sweeps.folder import PLAN
        from continuum_grasp.sweeps.plan import plan_of
        from continuum_grasp.sweeps.table import CSV

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
                progress=lambda now: report(now.done / max(now.total, 1), now.text),
                overrides=output.changes or [],
            )
    _report(table, output, drawn=output.pictures or plot_only)


def _report(table: SweepTable, output: Output, *, drawn: bool) -> None:
    """Draw a table where that is wanted, and print what it holds."""
    files: list[Path] = []
    if drawn:
        with output.drawing():
            files = output.drawn(table, table.folder)
    statistics = dict(table.statistics)
    output.warn(statistics.pop("notes", ()))
    if len(table) and not table.solved.any():
        output.warn([f"no scene has a grasp; the first row says: {table['message'][0]}"])
    output.pairs({**table.pairs(), **output.saved_in(files)})
    output.statistics(statistics)
    output.result(
        folder=table.folder,
        table=table.folder / "table.jsonl",
        files=files,
        scenes=table.total,
        rows=len(table),
        status=table.counts,
        failures=table.failures,
        statistics=statistics,
    )
