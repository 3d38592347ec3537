"""``continuum-grasp sweep``."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from continuum_grasp.cli.options import Config, Json, Quiet, Set, Verbose, out_option
from continuum_grasp.cli.output import Output, run_folder, saved_in
from continuum_grasp.errors import InputError

if TYPE_CHECKING:
    from continuum_grasp.sweeps import Progress

_LINE_SECONDS = 10.0
"""Between two lines of progress where there is no terminal [s]: a day of work is 8,640 lines of a log."""


def sweep(
    config: Config,
    out: Annotated[
        Path | None,
        out_option("Folder of the sweep (default: runs/sweep/NAME-OF-CONFIG); one that was stopped goes on."),
    ] = None,
    changes: Set = None,
    workers: Annotated[
        int | None,
        typer.Option("--workers", metavar="N", min=1, max=4096, help="Processes on this machine (default: all cores)."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="tcp://HOST:PORT", help="Work on a Dask cluster (extra: cluster)."),
    ] = None,
    keep: Annotated[
        str, typer.Option("--keep", metavar="all|failed|none", help="Of which runs to keep the files.")
    ] = "all",
    plot_only: Annotated[
        bool, typer.Option("--plot-only", help="Compute nothing: draw what the table holds by now.")
    ] = False,
    pictures: Annotated[bool, typer.Option("--pictures/--no-pictures", help="Draw maps and Pareto pictures.")] = True,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Find the grasps of many scenes: a grid or random draws of any keys; resumes after an interruption."""
    output = Output(as_json, quiet, verbose)
    if keep not in ("all", "failed", "none"):
        raise InputError(f"expected all, failed or none, got {keep!r}", key="--keep")
    folder = run_folder(out, config, "sweep")
    if plot_only:
        from continuum_grasp.results import begin_run
        from continuum_grasp.sweeps import sweep_table
        from continuum_grasp.sweeps.folder import PLAN
        from continuum_grasp.sweeps.plan import plan_of
        from continuum_grasp.sweeps.table import CSV

        # The pictures are those that the configuration asks for now; those of before go.
        table = replace(sweep_table(folder), requested=plan_of(config, changes or []).pictures)
        begin_run(folder, "sweep", retained=(PLAN, CSV))
    else:
        from continuum_grasp.sweeps import sweep as run

        with _shown(output) as report:
            table = run(
                config,
                folder=folder,
                workers=workers,
                scheduler=scheduler,
                keep=keep,  # type: ignore[arg-type]
                progress=report,
                overrides=changes or [],
            )
    files: list[Path] = []
    if pictures or plot_only:
        with output.drawing(folder):
            files = table.save_pictures(folder)
    statistics = dict(table.statistics)
    output.warn(statistics.pop("notes", ()))
    if len(table) and not table.solved.any():
        output.warn([f"no scene has a grasp; the first row says: {table['message'][0]}"])
    output.pairs({**table.pairs(), **saved_in(table.folder, files)})
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


@contextmanager
def _shown(output: Output) -> Iterator[Callable[[Progress], None] | None]:
    """Progress on the error stream: a bar on a terminal, otherwise a line now and then."""
    if output.quiet:
        yield None
    elif sys.stderr.isatty():
        with _bar() as report:
            yield report
    else:
        reported = [time.monotonic()]

        def line(progress: Progress) -> None:
            if time.monotonic() - reported[0] > _LINE_SECONDS:
                reported[0] = time.monotonic()
                typer.echo(progress.text, err=True)

        yield line


@contextmanager
def _bar() -> Iterator[Callable[[Progress], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bars

    columns: tuple[Any, ...] = (BarColumn(), TextColumn("{task.description}"))
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("starting workers", total=None)

        def report(progress: Progress) -> None:
            bars.update(task, total=progress.total, completed=progress.done, description=progress.text)

        yield report
