"""``continuum-grasp grasp``."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from continuum_grasp.cli.options import Config, Json, Out, Quiet, Set, Verbose
from continuum_grasp.cli.output import Output, run_folder

__all__ = ["grasp"]


def grasp(
    config: Config,
    out: Out = None,
    changes: Set = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", metavar="N", help="Seed of the random starts (default: as in the configuration)."),
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Find how a finger holds an object: verified, saved, drawn."""
    from continuum_grasp.cli.scenes import grasp_scene

    output = Output(as_json, quiet, verbose)
    seeding = [] if seed is None else [f"solver.random_seed={seed}"]
    scene = grasp_scene(config, [*(changes or ()), *seeding])
    folder = run_folder(out, config)

    from continuum_grasp.grasp import optimize_grasp

    with output.busy("searching"):
        result = optimize_grasp(scene)
    result.save(folder)
    picture = folder / "grasp.png"
    result.plot(picture)

    statistics: dict[str, Any] = dict(result.statistics)
    output.warn(result.warnings)
    output.say(result.table())
    output.statistics(statistics)
    output.say(f"saved in {folder}, drawn in {picture}")
    output.result(
        status=result.status,
        folder=str(folder),
        files=[str(picture)],
        table=result.table(),
        warnings=list(result.warnings),
        statistics=statistics,
    )
